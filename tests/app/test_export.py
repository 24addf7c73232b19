"""Exported files, read back with third-party programs."""

import csv
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from app.archive import ExportError, export_run, raw_left_out
from app.cli.main import main
from app.common.progress import Progress
from protocols.runfile.reader import Run
from tests.helpers.messages import assert_names
from tests.helpers.run_files import crashed_run, finished_run


class Cancelled(Progress):
    """Progress of an operation that is cancelled from its beginning."""

    cancelled = True


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_run(tmp_path_factory.mktemp("original"), "T7")


@pytest.fixture
def path(original: Path, tmp_path: Path) -> Path:
    (tmp_path / "runs").mkdir()
    return Path(shutil.copy(original, tmp_path / "runs"))


def sheet(file: Path) -> list[list[str]]:
    with file.open(newline="", encoding="utf-8") as text:
        return list(csv.reader(text))


def test_csv_has_units_in_every_header_and_simulated_in_every_name(path: Path, tmp_path: Path) -> None:
    with Run(path) as run:
        files = {f.stem.rpartition("_")[2]: f for f in export_run(run, tmp_path / "out", "csv")}
    assert files.keys() == {"about", "points", "estimates", "events", "raw"}
    assert all("SIMULATED" in f.name for f in files.values())
    columns = ["frequency [Hz]", "peak_to_peak [m]"]
    points = sheet(files["points"])
    assert points[0][:2] == columns
    assert all("[" in head for head in points[0][:-1])
    assert [float(row[0]) for row in points[1:]] == [100.0, 160.0]
    assert points[1][-1] == "simulated"
    assert sheet(files["estimates"])[1] == ["natural_frequency", "158.35", "0.01", "Hz", "fit"]
    assert [row[2] for row in sheet(files["events"])[1:]] == ["Armed", "Noted"]
    assert json.loads(sheet(files["events"])[2][3])["text"] == "ß: a long remark " * 100


def test_raw_samples_keep_their_time_over_a_gap(path: Path, tmp_path: Path) -> None:
    with Run(path) as run:
        (file,) = export_run(run, tmp_path / "out", "csv", ("raw",))
    head, *rows = sheet(file)
    assert head == ["time [s]", "drive [V]", "displacement [m]"]
    t, drive, moved = np.array(rows, float).T
    assert len(t) == 2000
    np.testing.assert_allclose(t[[0, 999, 1000, 1999]], [0, 0.1998, 0.4, 0.5998])
    assert (drive.min(), drive.max()) == pytest.approx((0.0, 5.0), abs=6e-3)
    assert (moved.min(), moved.max()) == pytest.approx((-5e-4, 5e-4), abs=1e-6)


@pytest.mark.parametrize("arrow", [True, False])
def test_raw_samples_in_csv_lose_no_digit(
    arrow: bool, path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not arrow:
        monkeypatch.setattr("app.archive.exporting.table_files.find_spec", lambda _: None)
    with Run(path) as run:
        (file,) = export_run(run, tmp_path, "csv", ("raw",))
        values = np.loadtxt(file, delimiter=",", skiprows=1)
        np.testing.assert_array_equal(values[:, 0], run.trace.time_s())
        np.testing.assert_array_equal(values[:, 1], run.trace.drive_v())
        np.testing.assert_array_equal(values[:, 2], run.trace.displacement_m())


def test_json_holds_the_same(path: Path, tmp_path: Path) -> None:
    with Run(path) as run:
        (file,) = export_run(run, tmp_path / "out", "json")
        drive = run.trace.drive_v()
    got = json.loads(file.read_text("utf-8"))
    assert got["points"]["frequency"] == [100.0, 160.0]
    assert got["raw"]["units"] == {"time": "s", "drive": "V", "displacement": "m"}
    np.testing.assert_allclose(got["raw"]["drive"], drive, rtol=1e-8)
    assert got["simulated"] is True


@pytest.mark.parametrize("compressed", [True, False])
def test_mat_opens_with_structures_and_units(
    compressed: bool, path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from scipy.io import loadmat

    if not compressed:
        monkeypatch.setattr("app.archive.exporting.matlab.MAX_COMPRESSED_SCANS", 10)
    with Run(path) as run:
        (file,) = export_run(run, tmp_path / "out", "mat")
        moved = run.trace.displacement_m()
    got = loadmat(file, simplify_cells=True)
    np.testing.assert_allclose(got["points"]["frequency"], [100.0, 160.0])
    assert got["points"]["units"]["peak_to_peak"] == "m"
    np.testing.assert_array_equal(got["raw"]["displacement"], moved)
    assert got["about"]["specimen"] == "T7"
    assert got["estimates"]["natural_frequency"]["standard_error"] == 0.01


@pytest.mark.parametrize("kind", ["csv", "json", "mat"])
def test_a_stopped_export_leaves_nothing_half(kind: str, path: Path, tmp_path: Path) -> None:
    with Run(path) as run:
        assert export_run(run, tmp_path / "out", kind, ("raw",), Cancelled()) == []  # type: ignore[arg-type]
    assert list((tmp_path / "out").iterdir()) == []


def test_raw_data_that_a_format_cannot_hold_are_left_out_or_refused(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("app.archive.exporting.export.MAX_SCANS", {"mat": 100})
    with Run(path) as run, pytest.raises(ExportError, match="take csv or parquet, or leave the raw data out"):
        export_run(run, tmp_path, "mat", ("points", "raw"))
    from scipy.io import loadmat

    with Run(path) as run:
        assert raw_left_out(run, "csv") == ""
        assert re.search(r"2000 scans.*\b100\b", raw_left_out(run, "mat"))
        (file,) = export_run(run, tmp_path, "mat")
    assert {"points", "raw"} & loadmat(file, simplify_cells=True).keys() == {"points"}
    assert main(["export", str(path), "--format", "mat", "--out", str(tmp_path)]) == 0
    assert "2000 scans" in capsys.readouterr().err


def test_a_run_whose_name_is_not_text_is_to_be_renamed(path: Path, tmp_path: Path) -> None:
    try:
        named = path.rename(path.with_name("T\udce4.h5"))
    except OSError:
        pytest.skip("this file system has no such names")
    with Run(named) as run, pytest.raises(ExportError, match="UTF-8"):
        export_run(run, tmp_path, "csv")


def test_a_folder_that_cannot_be_written_is_a_sentence(path: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with Run(path) as run, pytest.raises(ExportError, match=re.escape(str(tmp_path / "file"))):
        export_run(run, tmp_path / "file")


def test_a_crashed_run_is_exported_up_to_its_end(tmp_path: Path) -> None:
    with Run(crashed_run(tmp_path / "runs")) as run:
        files = export_run(run, tmp_path / "out", "csv", ("points", "raw"))
    assert len(sheet(files[0])) == 2
    assert len(sheet(files[1])) == 2001


def test_the_commands(path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], cache: None) -> None:
    half = path.with_name("20260101T000000Z_half_sine-dwell.h5")
    half.write_bytes(path.read_bytes()[:9000])
    assert main(["runs", str(path.parent), "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert [(run["specimen"], run["state"]) for run in listed] == [("T7", "completed"), ("half", "damaged")]
    assert main(["runs", str(path.parent), "--status", "damaged"]) == 0
    out = capsys.readouterr().out
    (damaged,) = (run["reason"] for run in listed if run["state"] == "damaged")
    assert_names(damaged, half.name, 9000, path.stat().st_size)
    assert " ".join(damaged.split()) in " ".join(out.split())
    assert "1 of 2 runs" in out
    assert main(["export", str(half), str(path), "--out", str(tmp_path / "out"), "--part", "points"]) == 1
    captured = capsys.readouterr()
    assert_names(captured.err, half.name, 9000, path.stat().st_size)
    assert captured.out.strip().endswith("_SIMULATED_points.csv")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["runs", "no-such-folder"], "name the folder of your runs"),
        (["runs", ".", "--since", "soon"], "write a day"),
        (["runs", ".", "--status", "done"], "there are: completed"),
        (["export", "x.h5", "--part", "all"], "its parts are: about"),
    ],
)
def test_what_is_asked_wrongly_gets_a_sentence(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str], cache: None
) -> None:
    assert main(arguments) == 2
    assert message in capsys.readouterr().err


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path / "cache")
