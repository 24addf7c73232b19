"""Exported files of exchange formats, read by libraries that did not write them or by the format's own columns."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from app.archive.exporting.export import ExportError, export_run
from app.archive.importing.importer import read_table
from app.cli.main import main
from protocols.base import RunStatus, Series, SeriesAxis, TableImportError
from protocols.measurements.sweep import Sweep
from protocols.runfile.reader import Run
from tests.helpers.importing import brought, points, refused
from tests.helpers.run_files import begun_run, finished_run
from tests.helpers.simulated_bench import laboratory, run, simulated

FREQUENCIES = (100.0, 155.123, 160.0)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_run(tmp_path_factory.mktemp("original"), "T7", FREQUENCIES)


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with a response of 101 lines 0.3 Hz apart, that of one oscillator."""
    file = begun_run(tmp_path_factory.mktemp("sweep"), "T7 = Müller's", (100.0,), 5000.0)
    f = 25.0 + 0.3 * np.arange(101)
    h = 1e-4 / (1 - (f / 40) ** 2 + 0.1j * f / 40)
    axes = {"x_axis": SeriesAxis("frequency", "Hz"), "y_axis": SeriesAxis("response", "m/V")}
    series = Series(f, h, np.full(101, 3e-9), coherence=np.full(101, 0.99), **axes, name="frequency response")
    file.finish(RunStatus.COMPLETED, "", series=(series,))
    return file.path


def data_sets(file: Path) -> list[list[str]]:
    """Lines of each data set between its two delimiters, by the rules of the format and without a library."""
    sets: list[list[str]] = []
    inside = False
    for line in file.read_text("ascii").split("\n"):
        if line == "    -1":
            inside = not inside
            if inside:
                sets.append([])
        elif inside:
            sets[-1].append(line)
    assert not inside
    return sets


def test_a_universal_file_has_the_columns_of_data_set_58(sweep: Path, tmp_path: Path) -> None:
    """Columns as in SDRC's description: 2(I5,I10),2(1X,10A1,I10,I4); 3I10,3E13.5; I10,3I5,2(1X,20A1)."""
    with Run(sweep) as run:
        (file,) = export_run(run, tmp_path, "uff")
    header, units, response, errors, coherence = data_sets(file)
    assert [int(s[0][:6]) for s in (header, units, response, errors, coherence)] == [151, 164, 58, 58, 58]
    assert "SIMULATED" in header[2]
    assert int(units[1][:10]) == 1
    assert float(units[2][:25].replace("D", "E")) == 1
    assert all(len(line) == 80 for line in response[1:6])
    record_6, record_7, *axes = response[6:12]
    assert [int(s[6][:5]) for s in (response, errors, coherence)] == [4, 0, 6]
    assert (record_6[31:41].strip(), int(record_6[41:51]), int(record_6[51:55])) == ("CENTRE", 1, 3)
    assert [int(record_7[i : i + 10]) for i in (0, 10, 20)] == [6, 101, 1]
    assert [float(record_7[i : i + 13]) for i in (30, 43)] == [25.0, 0.3]
    assert [int(axis[:10]) for axis in axes] == [18, 8, 1, 0]
    assert [axis[47:67].strip() for axis in axes[:3]] == ["Hz", "m", "V"]
    numbers = np.array([float(line[i : i + 20]) for line in response[12:] for i in range(0, len(line), 20)])
    f = 25.0 + 0.3 * np.arange(101)
    np.testing.assert_allclose(
        numbers[::2] + 1j * numbers[1::2], 1e-4 / (1 - (f / 40) ** 2 + 0.1j * f / 40), rtol=1e-10
    )


@pytest.mark.deep
def test_the_drive_of_a_sweep_survives_a_universal_file(tmp_path: Path) -> None:
    with laboratory(simulated()) as lab:
        sent = run(Sweep(), tmp_path, lab).path
    assert main(["export", str(sent), "--format", "uff", "--out", str(tmp_path)]) == 0
    (exported,) = tmp_path.glob("*.uff")
    assert main(["import", str(exported), "--specimen", "T2", "--out", str(tmp_path / "back")]) == 0
    (back,) = (tmp_path / "back").glob("*.h5")
    with Run(sent) as before, Run(back) as after:
        drive_v = before.points()["drive_amplitude"][0]
        assert after.points()["drive_amplitude"] == pytest.approx(drive_v, rel=1e-5)
        assert after.points()["frequency"].size > 100


def test_a_dwell_goes_out_and_comes_back_in(path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(path), "--format", "uff", "--out", str(tmp_path)]) == 0
    file = capsys.readouterr().out.strip()
    assert main(["import", file, "--out", str(tmp_path / "runs")]) == 0
    (imported,) = (tmp_path / "runs").glob("*_T7_sine-dwell.h5")
    with Run(path) as run, Run(imported) as again:
        assert again.record.simulated
        for name in ("fundamental", "fundamental_errors", "phase", "drive_amplitude"):
            np.testing.assert_allclose(again.points()[name], run.points()[name], rtol=1e-6, err_msg=name)
        np.testing.assert_allclose(again.points()["frequency"], FREQUENCIES, rtol=1e-5)  # E13.5


@pytest.mark.parametrize(("quantity", "times"), [(8, 0), (11, 1), (12, 2)])
def test_a_response_of_velocity_or_acceleration_becomes_displacement(quantity: int, times: int, tmp_path: Path) -> None:
    import pyuff

    f = np.array([50.0, 120.0, 300.0])
    written = {
        "type": 58, "func_type": 4, "rsp_node": 1, "rsp_dir": 3, "ref_node": 1, "ref_dir": 3, "x": f, "binary": 0,
        "data": (2j * np.pi * f) ** times * 1e-4, "ordinate_spec_data_type": quantity,
        "orddenom_spec_data_type": 1, "orddenom_axis_units_lab": "V",
    }  # fmt: skip
    file = tmp_path / "foreign.unv"
    pyuff.UFF(str(file)).write_sets([written], "overwrite")
    table = read_table(file)
    columns = {c.name: np.array(c.cells) for c in table.columns}
    np.testing.assert_allclose(columns["receptance"], 1e-4)
    np.testing.assert_allclose(columns["phase"], 0, atol=1e-9)
    written["orddenom_axis_units_lab"] = "N"
    pyuff.UFF(str(file)).write_sets([written], "overwrite")
    with pytest.raises(TableImportError, match="per volt at the amplifier's input is needed"):
        read_table(file)


def test_a_damaged_universal_file_is_a_sentence(path: Path, tmp_path: Path) -> None:
    with Run(path) as run:
        (file,) = export_run(run, tmp_path, "uff")
    lines = file.read_text().splitlines(keepends=True)
    for cut in (4, 17, 25, len(lines) - 12):
        file.write_text("".join(lines[:cut]))
        with pytest.raises(TableImportError, match=r"Universal File|frequency response"):
            read_table(file)


def test_a_run_without_a_response_is_refused(tmp_path: Path) -> None:
    with (
        Run(finished_run(tmp_path / "r", "T7", (100.0,))) as run,
        pytest.raises(ExportError, match=rf"{run.path.name}.*csv"),
    ):
        export_run(run, tmp_path, "uff")
    assert not list(tmp_path.glob("*.uff"))


def test_a_workbook_opens_with_units_and_no_formulas(path: Path, tmp_path: Path) -> None:
    from openpyxl import load_workbook

    columns = ["frequency [Hz]", "peak_to_peak [m]"]
    with Run(path) as run:
        (file,) = export_run(run, tmp_path, "xlsx")
        moved = run.trace.displacement_m()
    book = load_workbook(file)
    assert book.sheetnames == ["about", "points", "estimates", "events", "raw"]
    assert [book["points"].cell(1, i).value for i in (1, 2)] == columns
    assert [row[0].value for row in book["points"].iter_rows(min_row=2)] == list(FREQUENCIES)
    np.testing.assert_allclose([row[2] for row in book["raw"].iter_rows(min_row=2, values_only=True)], moved)
    assert not any(cell.data_type == "f" for sheet in book for row in sheet.iter_rows() for cell in row)


def test_parquet_has_units_in_its_schema(path: Path, tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    with Run(path) as run:
        files = {f.stem.rpartition("_")[2]: f for f in export_run(run, tmp_path, "parquet")}
        drive = run.trace.drive_v()
    points = pq.read_table(files["points"])
    assert points.schema.field("frequency").metadata == {b"unit": b"Hz"}
    assert points["frequency"].to_pylist() == list(FREQUENCIES)
    assert points.schema.metadata[b"simulated"] == b"true"
    np.testing.assert_array_equal(pq.read_table(files["raw"])["drive"], drive)


@pytest.mark.deep
def test_matlab_7_3_opens_with_plain_hdf5_and_comes_back_in(path: Path, tmp_path: Path) -> None:
    with Run(path) as run:
        (file,) = export_run(run, tmp_path, "mat73", ("about", "points"))
    assert file.read_bytes()[:19] == b"MATLAB 7.3 MAT-file"
    with h5py.File(file) as plain:
        assert plain["points"].attrs["MATLAB_class"] == b"struct"
        assert plain["points/frequency"].attrs["MATLAB_class"] == b"double"
        assert plain["points/frequency"].shape == (1, 3)  # MATLAB's order: a column of three
        text = plain["about/specimen"]
        assert text.attrs["MATLAB_class"] == b"char"
        assert text.shape == (2, 1)  # a row of two characters
    with Run(path) as run:
        (whole,) = export_run(run, tmp_path / "whole", "mat73")
        drive = run.trace.drive_v()
    with h5py.File(whole) as plain:
        np.testing.assert_array_equal(plain["raw/drive"][0], drive)
    table = read_table(file)
    assert table.metadata["specimen"] == "T7"
    (frequency,) = [c for c in table.columns if c.name == "frequency"]
    assert (frequency.unit, list(frequency.cells)) == ("Hz", list(FREQUENCIES))


def test_a_matlab_file_with_a_link_to_another_file_is_refused(path: Path, tmp_path: Path) -> None:
    with Run(path) as run:
        (file,) = export_run(run, tmp_path, "mat73", ("points",))
    with h5py.File(file, "r+") as plain:
        plain["secret"] = h5py.ExternalLink("/etc/passwd", "/")
    with pytest.raises(TableImportError, match="link"):
        read_table(file)


def test_a_tdms_waveform_is_read_with_its_times_and_units(tmp_path: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    moved = 1e-3 * np.sin(2 * np.pi * 100 * np.arange(500) / 5000)
    waveform = {"wf_increment": 2e-4, "wf_samples": 500}
    file = tmp_path / "logger.tdms"
    with TdmsWriter(str(file)) as writer:
        writer.write_segment(
            [
                ChannelObject("bench", "displacement", 1e3 * moved, {**waveform, "unit_string": "mm"}),
                ChannelObject("bench", "drive", 2.5 + 2.5 * moved / 1e-3, {**waveform, "unit_string": "V"}),
            ]
        )
    table = read_table(file)
    assert [(c.name, c.unit) for c in table.columns] == [("time", "s"), ("displacement", "mm"), ("drive", "V")]
    np.testing.assert_allclose(table.columns[0].cells, 2e-4 * np.arange(500))
    file.write_bytes(file.read_bytes()[:60])
    with pytest.raises(TableImportError, match=rf"{file.name}\b.*\bcut\b"):
        read_table(file)


def test_the_two_matlab_formats_do_not_replace_each_other(path: Path, tmp_path: Path) -> None:
    with Run(path) as run:
        (old,), (new,) = (export_run(run, tmp_path, kind, ("points",)) for kind in ("mat", "mat73"))
    assert (old.read_bytes()[:19], new.read_bytes()[:19]) == (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")
    assert new.name == f"{old.stem}_v73.mat"


def test_exported_series_come_back_with_their_own_columns(
    sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Run(sweep) as run:
        files = export_run(run, tmp_path, "csv", ("points", "series"))
        (response,) = run.series()
    (table,) = [file for file in files if "_series-" in file.name]
    stem = table.name.partition("_series-")[0]
    assert f"import {stem}_points.csv; or name the measurement" in refused(table, capsys)
    imported = points(brought(table, "--as", "sine-dwell", "--set", "peak_to_peak_v=5 V"))
    np.testing.assert_allclose(imported["fundamental"], 2.5 * np.abs(response.y))
    np.testing.assert_allclose(imported["fundamental_errors"], 7.5e-9)
    np.testing.assert_allclose(imported["phase"], np.angle(response.y))


def test_a_missing_library_is_named(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with Run(path) as run, pytest.raises(ExportError, match=r"pyarrow.*pip install 'tactor-bench\[formats\]'"):
        export_run(run, tmp_path, "parquet")
