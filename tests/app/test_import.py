"""Old tables become runs: whatever spreadsheet wrote them, in their units, said to be imported, and refused in sentences."""

import csv
import hashlib
import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from app.export import export
from app.identifying import identify
from app.main import main
from app.observing import observations
from app.sheet import split_head
from drivers.sensor import LaserSensor
from model.amplifier import AmplifierMap
from model.identification.observations import FrequencyResponse, MassResonance, StaticLoading, VoltageSteps
from model.parameters import Tactor
from model.response import amplifier_response
from model.statics import load_compliance, voltage_gain
from protocols.events import Status
from protocols.fresh_run import Header
from protocols.layout import columns
from protocols.protocol import Protocol
from protocols.quality import Quality
from protocols.registry import PROTOCOLS
from protocols.runfile import RunFile
from protocols.runreader import Run
from tests.runs import finished_run

FULL = ["--set", "peak_to_peak_v=5 V"]


def brought(path: Path, *arguments: str) -> Path:
    """The run file of an import."""
    out = path.parent / "runs"
    before = set(out.glob("*.h5"))
    assert main(["import", str(path), "--out", str(out), *arguments]) == 0
    (made,) = set(out.glob("*.h5")) - before
    return made


def points(path: Path) -> dict[str, np.ndarray]:
    with Run(path) as run:
        return run.points()


def refused(path: Path, capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["import", str(path), "--out", str(path.parent / "runs"), *arguments]) == 2
    told = capsys.readouterr()
    assert "Traceback" not in told.err
    assert not list((path.parent / "runs").glob("*.h5"))
    return told.err


# -- what spreadsheets write ------------------------------------------------------------------------------------------

TABLES = {
    "plain": "frequency [Hz],peak_to_peak_um\n100,760.1\n150,1154.2\n",
    "a byte-order mark, remarks, ; and decimal commas": "\ufeff# by hand\r\nf / Hz;Peak to peak (mm)\r\n100;0,7601\r\n\r\n150;1,1542\r\n",
    "tabs, units in a line of their own": "frequency\tp2p\nHz\tum\n100\t760.1\n150\t1154.2\n",
    "an old Macintosh": "frequency [Hz];p2p [um]\r100;760,1\r150;1154,2\r",
    "blanks": "% old\nfrequency_Hz  pk-pk_um\n100   760.1\n150  1154.2\n",
    "Excel's own line, quoted": 'sep=;\n"frequency [Hz]";"max - min [µm]";""\n"100";"760,1";""\n"150";"1154,2";""\n',
}


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "utf-16"])
def test_every_country_s_table_is_read(name: str, encoding: str, tmp_path: Path) -> None:
    text = TABLES[name] if encoding == "utf-8" else TABLES[name].removeprefix("\ufeff")
    (tmp_path / "t.csv").write_bytes(text.encode(encoding))
    got = points(brought(tmp_path / "t.csv", *FULL))
    np.testing.assert_allclose(got["frequency"], [100, 150])
    np.testing.assert_allclose(got["peak_to_peak"], [760.1e-6, 1154.2e-6], rtol=1e-12)
    assert np.isnan(got["phase"]).all()
    np.testing.assert_array_equal(got["drive_amplitude"], 2.5)


@pytest.mark.parametrize(
    ("head", "name", "unit"),
    [
        ("frequency [Hz]", "frequency", "Hz"),
        ("amplitude_um", "amplitude", "um"),
        ("Load (g)", "Load", "g"),
        ("f/Hz", "f", "Hz"),
        ("drive in V", "drive", "V"),
        ("max - min", "max - min", None),
        ("peak_to_peak", "peak_to_peak", None),
    ],
)
def test_a_head_tells_name_and_unit(head: str, name: str, unit: str | None) -> None:
    assert split_head(head) == (name, unit)


def test_a_load_in_grams_is_a_mass_and_its_side_may_be_a_word(tmp_path: Path) -> None:
    (tmp_path / "l.csv").write_text(
        "Load (g),Displacement (um),u_Displacement (um),side\n20,27,1,MFC\n500,677,2,aluminium\n"
    )
    path = brought(tmp_path / "l.csv", "--specimen", "T1")
    got = points(path)
    np.testing.assert_allclose(got["load"], [0.02 * 9.80665, 0.5 * 9.80665])
    np.testing.assert_array_equal(got["side"], [1, -1])
    np.testing.assert_allclose(got["deflection_errors"], [1e-6, 2e-6])
    with Run(path) as run:
        sides = [o.side for o in observations(run) if isinstance(o, StaticLoading)]
    assert sides == ["mfc", "aluminium"]


def test_volts_on_the_specimen_are_turned_back_to_the_input(tmp_path: Path) -> None:
    (tmp_path / "v.csv").write_text("high voltage [kV],deflection [um]\n-0.5,-119\n1.5,357\n")
    path = brought(tmp_path / "v.csv", "--uncertainty", "deflection=1 %")
    np.testing.assert_allclose(points(path)["level"], [0.0, 5.0])
    with Run(path) as run:
        (steps,) = observations(run)
    assert isinstance(steps, VoltageSteps)
    np.testing.assert_allclose(steps.input_v, [0.0, 5.0])
    np.testing.assert_allclose(steps.errors_m, [1.19e-6, 3.57e-6])


def test_a_resonance_says_whether_it_is_a_peak_or_the_natural_frequency(tmp_path: Path) -> None:
    for head, meaning in (("resonance frequency [Hz]", "peak"), ("natural frequency [Hz]", "undamped")):
        (tmp_path / "m.csv").write_text(f"added mass [g];{head};sigma [Hz]\n1,75;300,9;0,3\n9,75;141,8;0,3\n")
        with Run(brought(tmp_path / "m.csv")) as run:
            (found,) = observations(run)
        assert isinstance(found, MassResonance)
        assert found.meaning == meaning
        np.testing.assert_allclose(found.frequency_hz, [300.9, 141.8])
        np.testing.assert_allclose(found.mass_kg, [1.75e-3, 9.75e-3])


def test_an_elongation_makes_it_a_membrane_series(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(
        "frequency [Hz],pp [um],elongation [mm]\n100,760,\n150,1154,\n100,437,1.27\n150,357,1.27\n"
    )
    path = brought(tmp_path / "m.csv", *FULL, "--uncertainty", "peak_to_peak=1 %")
    with Run(path) as run:
        assert run.protocol == "membrane-series"
        found = [o.elongation_m for o in observations(run) if isinstance(o, FrequencyResponse)]
    assert found == [None, pytest.approx(1.27e-3)]
    (tmp_path / "one.csv").write_text("frequency [Hz],pp [um]\n100,437\n")
    assert points(brought(tmp_path / "one.csv", *FULL, "--membrane-elongation", "1.27 mm"))["elongation"] == [
        pytest.approx(1.27e-3)
    ]


# -- what the file says of itself -------------------------------------------------------------------------------------


def test_the_file_says_where_it_comes_from_and_pretends_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "fig4.csv"
    table.write_text("f [Hz],A [um],humidity [%]\n100,760.1,40\n150,1154.2,41\n")
    path = brought(table, *FULL, "--column", "peak_to_peak=A", "--specimen", "T1", "--measured", "2019-05-04")
    with h5py.File(path) as file:
        told = json.loads(file["entry/imported"][()])
        assert file.attrs["format_version"] == 2
        assert file["entry/simulated"][()] == False  # noqa: E712 - numpy's own
        assert file["entry/trace/displacement"].shape == (0,)
        assert file["entry/events"].shape == file["entry/recordings"].shape == (0,)
        assert np.isnan(file["entry/instrument/displacement_sensor/gain"][()])
        assert file["entry/start_time"][()].startswith(b"2019-05-0")
    assert told["files"] == [{"name": "fig4.csv", "sha256": hashlib.sha256(table.read_bytes()).hexdigest()}]
    assert told["columns"]["peak_to_peak"] == {"column": "A [um]", "unit": "um"}
    assert told["left_out"] == ["humidity [%]"]
    flags = [Quality(int(q)) for q in points(path)["quality"]]
    assert all(flag == Quality.IMPORTED and flag.usable for flag in flags)
    capsys.readouterr()
    assert main(["show", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "imported: from fig4.csv (SHA-256" in shown
    assert "peak_to_peak = 'A [um]'" in shown
    assert main(["resume", str(path)]) == 2
    assert "was imported, not measured" in capsys.readouterr().err


def test_imported_runs_are_listed_drawn_exported_and_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path / "cache")
    (tmp_path / "t.csv").write_text(TABLES["plain"])
    path = brought(tmp_path / "t.csv", *FULL, "--specimen", "T7", "--uncertainty", "peak_to_peak=2 um")
    capsys.readouterr()
    assert main(["runs", str(path.parent), "--status", "imported", "--json"]) == 0
    assert [run["state"] for run in json.loads(capsys.readouterr().out)] == ["imported"]
    assert main(["show", str(path), "--picture", str(tmp_path / "p.png")]) == 0
    assert main(["export", str(path), "--format", "json", "--out", str(tmp_path)]) == 0
    assert json.loads((tmp_path / f"{path.stem}.json").read_text("utf-8"))["imported"]["files"][0]["name"] == "t.csv"
    assert main(["report", "T7", "--folder", str(path.parent), "--out", str(tmp_path)]) == 0
    assert "imported" in next(tmp_path.glob("*T7*.html")).read_text("utf-8")


# -- the truth comes back ---------------------------------------------------------------------------------------------


def test_a_specimen_is_identified_from_old_tables_alone(tmp_path: Path) -> None:
    """Tables computed from a known tactor; only max - min, as the paper has it, no phase."""
    truth, map_ = Tactor(k2=8.0e-3, mu=-1.2e-5, c0=150.0), AmplifierMap()
    f = np.array([25.0, 60, 100, 130, 150, 160, 175, 200, 250])
    moved = amplifier_response(truth, f, 2.5, 2.5, map_, n=30).peak_to_peak  # thirty shapes: the beam itself to 3e-5
    loads, levels = 9.80665 * np.array([0.02, 0.05, 0.1, 0.2, 0.5]), np.arange(0.5, 5.01, 0.5)
    tables = {
        "dwell": ("frequency [Hz];max-min [um]", f, 1e6 * moved),
        "load": ("force [mN];deflection [um]", 1e3 * loads, 1e6 * load_compliance(truth) * loads),
        "steps": ("input [V];deflection [um]", levels, 1e6 * voltage_gain(truth) * map_.specimen_v(levels)),
    }
    made = []
    for name, (head, x, y) in tables.items():
        rows = "\n".join(f"{a:.6f};{b:.4f}".replace(".", ",") for a, b in zip(x, y, strict=True))
        (tmp_path / f"{name}.csv").write_text(f"{head}\n{rows}\n")
        what = "peak_to_peak" if name == "dwell" else "deflection"
        more = FULL if name == "dwell" else []
        made.append(brought(tmp_path / f"{name}.csv", *more, "--uncertainty", f"{what}=0.5 %", "--specimen", "T1"))
    found = {e.name: e for e in identify(made).estimates}
    for name in ("k2", "mu", "c0", "m_add"):
        assert found[name].value == pytest.approx(getattr(truth, name), rel=1e-3), name
        assert abs(found[name].value - getattr(truth, name)) < found[name].standard_error


def test_a_time_series_gives_amplitude_and_phase(tmp_path: Path) -> None:
    t = np.arange(5000) / 10_000
    drive, moved = 2.5 + 2.0 * np.sin(2 * np.pi * 160 * t), 3e-4 * np.sin(2 * np.pi * 160 * t - 0.7) + 1e-3
    for name, rows in (("a.csv", slice(0, None)), ("b.csv", slice(100, None))):
        with (tmp_path / name).open("w", newline="") as file:
            sheet = csv.writer(file)
            sheet.writerow(["time [ms]", "drive [V]", "displacement [um]"])
            sheet.writerows(zip(1e3 * t[rows], drive[rows], 1e6 * moved[rows], strict=True))
    out = tmp_path / "runs"
    files = [str(tmp_path / "a.csv"), str(tmp_path / "b.csv")]
    assert main(["import", *files, "--as", "raw", "--out", str(out), "--sensor-delay", "100 us"]) == 0
    (path,) = out.glob("*.h5")
    got = points(path)
    np.testing.assert_allclose(got["frequency"], 160, rtol=1e-6)
    np.testing.assert_allclose(got["fundamental"], 3e-4, rtol=1e-6)
    np.testing.assert_allclose(got["phase"], -0.7 + 2 * np.pi * 160 * 1e-4, atol=1e-5)
    np.testing.assert_allclose(got["drive_amplitude"], 2.0, rtol=1e-6)
    with Run(path) as run:
        assert run.protocol == "sine-dwell"
        assert run.trace.samples == 0
        assert len(run.curves()[0].columns["displacement"].values) == 5000


# -- there and back ---------------------------------------------------------------------------------------------------


def written(folder: Path, protocol: type[Protocol]) -> Path:
    """A run of any protocol with a number of its own in every cell, some of them none."""
    random = np.random.default_rng(7)
    header = Header(
        protocol.name, protocol.title, {}, protocol.point_type, protocol.axes, LaserSensor("l", 1e-4), {}, False, "T9"
    )
    file = RunFile.new(folder, header)
    widths = {name: width for name, (_, _, width) in columns(protocol.point_type).items()}
    for row in range(3):
        values: dict[str, Any] = {f.name: float(random.uniform(1.0, 2.0)) for f in fields(protocol.point_type)}
        values |= {name: (*tuple(random.uniform(1, 2, 8).tolist()[:-1]), np.nan) for name, w in widths.items() if w}
        values |= {name: 1.0 for name in ("side", "direction") if name in values}
        values["quality"] = int((Quality.GOOD, Quality.UNSETTLED, Quality.GOOD)[row])
        file.point(protocol.point_type(**values), row)
    file.finish(Status.COMPLETED, "all points measured")
    return file.path


@pytest.mark.parametrize("kind", ["csv", "mat"])
@pytest.mark.parametrize("name", PROTOCOLS)
def test_what_is_exported_and_imported_again_is_the_same(name: str, kind: Any, tmp_path: Path) -> None:
    original = written(tmp_path / "old", PROTOCOLS[name])
    with Run(original) as run:
        (file,) = export(run, tmp_path, kind, ("about", "points") if kind == "mat" else ("points",))
    got, wanted = points(brought(file)), points(original)
    with Run(next((tmp_path / "runs").glob("*.h5"))) as run:
        assert run.protocol == name
        assert run.specimen == ("T9" if kind == "mat" else "unnamed")
    assert got.keys() == wanted.keys()
    for column, values in wanted.items():
        if column == "quality":
            np.testing.assert_array_equal(got[column], values + int(Quality.IMPORTED))
        else:
            np.testing.assert_array_equal(got[column], values, err_msg=column)


def test_a_side_that_nobody_told_comes_back_untold(tmp_path: Path) -> None:
    (tmp_path / "l.csv").write_text("load [N],deflection [um]\n1,137\n2,275\n")
    with Run(brought(tmp_path / "l.csv")) as run:
        for kind in ("csv", "mat"):
            (file,) = export(run, tmp_path / kind, kind, ("points",))  # type: ignore[arg-type]
            assert np.isnan(points(brought(file))["side"]).all()


def test_what_was_simulated_stays_simulated(tmp_path: Path) -> None:
    with Run(finished_run(tmp_path / "old")) as run:
        files = [*export(run, tmp_path, "csv", ("points",)), *export(run, tmp_path, "mat", ("about", "points"))]
    renamed = files[0].rename(tmp_path / "harmless.csv")
    cut = tmp_path / "columns_of_a_SIMULATED_run.csv"  # without its flags, the name still tells
    cut.write_text("frequency [Hz],pp [um],drive pp [V]\n100,760,5\n")
    assert points(brought(cut))["quality"] == [int(Quality.SIMULATED | Quality.IMPORTED)]
    for file in (renamed, files[1]):
        with Run(brought(file)) as run:
            assert run.simulated
            assert Quality(int(run.points()["quality"][0])) == Quality.SIMULATED | Quality.IMPORTED


# -- sentences --------------------------------------------------------------------------------------------------------

GOOD = "frequency [Hz],pp [um]\n100,760\n150,1154\n"
BAD: dict[str, tuple[str, list[str], str]] = {
    "empty": ("", FULL, "is empty; give a table"),
    "header only": ("frequency [Hz],pp [um]\n", FULL, "no values below it"),
    "remarks only": ("# nothing\n", FULL, "remarks only"),
    "no header": ("100,760\n150,1154\n", FULL, "line 1: '100,760' are numbers where the names"),
    "a title without #": ("Measured by K.\nfrequency [Hz];pp [um]\n1;2\n", FULL, "begin remarks with #"),
    "unknown unit": ("frequency [Hz],pp [furlongs per]\n100,760\n", FULL, "'furlongs per' is no unit of peak to peak; m or a multiple"),
    "wrong unit": ("frequency [Hz],pp [kg]\n100,760\n", FULL, "'kg' is no unit of peak to peak"),
    "no unit": ("frequency,pp [um]\n100,760\n", FULL, "column 'frequency': no unit; write it in the header, 'frequency [Hz]', or say it: --unit"),
    "missing column": ("frequency [Hz],colour [um]\n100,760\n", ["--as", "sine-dwell", *FULL], "no column peak_to_peak or fundamental"),
    "unknown table": ("a [Hz],colour [um]\n100,760\n", FULL, "of no measurement known here; say what they are: --as"),
    "unclear amplitude": ("frequency [Hz],amplitude_um\n100,760\n", FULL, '--column "peak_to_peak=amplitude_um"'),
    "twice": ("frequency [Hz],f [Hz],pp [um]\n100,100,760\n", FULL, "may both be the frequency; say which"),
    "no drive": (GOOD, [], 'nothing tells how large the drive was; say it, max - min at the amplifier\'s input: --set "peak_to_peak_v=5 V"'),
    "drive too large": ("frequency [Hz],pp [um],drive pp [V]\n100,760,2000\n", [], "line 2: a drive of 2000 V, max - min, leaves the amplifier's range"),
    "not a number": ("frequency [Hz],pp [um]\n100,760\n150,about 9\n", FULL, "line 3, column 'pp [um]': 'about 9' is no number"),
    "thousands": ("frequency [Hz];pp [um]\n100;1.154,2\n", FULL, "'1.154,2' is no number; write it without thousands separators"),
    "nan": ("frequency [Hz],pp [um]\n100,NaN\n", FULL, "line 2, column 'pp [um]': 'NaN' is no measured value"),
    "no value": ("frequency [Hz],pp [um]\n100,\n", FULL, "line 2, column 'pp [um]': '' is no measured value"),
    "infinite": ("frequency [Hz],pp [um]\n100,inf\n", FULL, "'inf' is no measured value"),
    "negative frequency": ("frequency [Hz],pp [um]\n-100,3\n", FULL, "-100 is no frequency; it must be positive"),
    "the same line": ("frequency [Hz],pp [um]\n100,3\n150,4\n100,3\n", FULL, "line 4 is the same as line 2"),
    "uneven": ("frequency [Hz],pp [um]\n100,3,9\n", FULL, "line 2: 3 cells where the header (line 1) names 2 columns"),
    "commas between commas": ("frequency [Hz],pp [um]\n100,0,760,1\n", FULL, "save it with ; between the cells"),
    "comma and point": ("frequency [Hz];pp [um]\n100,5;3\n150.5;4\n", FULL, "decimal comma in line 2 ('100,5') and a decimal point in line 3"),
    "negative error": ("frequency [Hz],pp [um],pp error [um]\n100,3,-1\n", FULL, "-1 is no uncertainty"),
    "volts": ("level [V],deflection [um]\n1500,350\n", [], '--column "specimen_voltage=level [V]"'),
    "side": ("load [N],deflection [um],side\n1,137,left\n", [], "line 2, column 'side': 'left' is no side"),
    "no such column": (GOOD, [*FULL, "--column", "phase=phi"], "has no such column; it has: 'frequency [Hz]', 'pp [um]'"),
    "no such quantity": (GOOD, [*FULL, "--column", "colour=pp"], "sine-dwell has no 'colour'"),
    "no such kind": (GOOD, ["--as", "dance"], "there is no such measurement; there are: raw,"),
    "no such setting": (GOOD, ["--set", "volume=11"], "has no parameter 'volume'"),
    "no such uncertainty": (GOOD, [*FULL, "--uncertainty", "phase=1 %"], "there is no phase among the values"),
    "uncertainty of what": (GOOD, [*FULL, "--uncertainty", "peak_to_peak=1 kg"], "no quantity in m"),
    "day to come": (GOOD, [*FULL, "--measured", "2999-01-01"], "still to come"),
    "no day": (GOOD, [*FULL, "--measured", "once"], "write a day, 2019-05-04"),
    "series backwards": ("time [s],drive [V],displacement [um]\n0,2.5,0\n0.2,3,1\n0.1,3,1\n", ["--as", "raw"], "line 4, column 'time [s]': 0.1 does not come after 0.2"),
    "series with a gap": ("time [s],drive [V],displacement [um]\n0,2.5,0\n0.1,3,1\n0.2,3,1\n0.5,3,1\n0.6,3,1\n", ["--as", "raw"], "cut it at its gaps"),
    "series without a drive": ("time [s],displacement [um]\n0,2.5\n0.1,3\n0.2,3\n", ["--as", "raw"], "has no column of the drive"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_bad_table_is_a_sentence(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text, arguments, words = BAD[name]
    (tmp_path / "t.csv").write_text(text)
    assert words in refused(tmp_path / "t.csv", capsys, *arguments)


def test_a_bad_file_is_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, data, words in (
        ("new.mat", b"MATLAB 7.3 MAT-file, Platform" + bytes(600), "save it anew: save('file.mat', '-v7')"),
        ("broken.mat", b"MATLAB 5.0 MAT-file" + bytes(200), "no MAT file that can be read"),
        ("book.xlsx", b"PK\x03\x04" + bytes(50), "save its sheet as CSV"),
        ("picture.csv", bytes(range(256)), "is no text and no MAT file"),
    ):
        (tmp_path / name).write_bytes(data)
        assert words in refused(tmp_path / name, capsys, *FULL)
    assert "there is no file" in refused(tmp_path / "gone.csv", capsys)
    assert "cannot be read" in refused(tmp_path, capsys)
    assert "an HDF5 file" in refused(finished_run(tmp_path / "old"), capsys)


def test_mat_vectors_of_different_length_are_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    savemat(tmp_path / "t.mat", {"frequency_Hz": np.arange(1.0, 4), "pp_um": np.arange(1.0, 6)})
    assert "the columns differ in length: 'frequency_Hz' 3, 'pp_um' 5" in refused(tmp_path / "t.mat", capsys, *FULL)
    savemat(tmp_path / "e.mat", {"words": "none"})
    assert "holds no vectors of numbers (it has: words)" in refused(tmp_path / "e.mat", capsys, *FULL)


def test_a_mat_file_that_is_damaged_is_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    savemat(tmp_path / "t.mat", {"frequency_Hz": np.arange(1.0, 400), "pp_um": np.arange(1.0, 400)})
    whole = (tmp_path / "t.mat").read_bytes()
    (tmp_path / "t.mat").write_bytes(whole[:-100])
    assert "is cut off or damaged, 100 bytes are missing" in refused(tmp_path / "t.mat", capsys, *FULL)
    (tmp_path / "t.mat").write_bytes(whole[:132] + b"\xff\xff\xff\x7f" + whole[136:])  # two gigabytes, it says
    assert "is cut off or damaged" in refused(tmp_path / "t.mat", capsys, *FULL)
    (tmp_path / "t.mat").write_bytes(whole)
    monkeypatch.setattr("app.sheet_mat.READER", "import os; os.abort()")  # as scipy's does of some damaged bytes
    assert "no MAT file that can be read (its reader died of it)" in refused(tmp_path / "t.mat", capsys, *FULL)


def test_mat_vectors_and_a_matrix_are_columns(tmp_path: Path) -> None:
    savemat(
        tmp_path / "t.mat", {"frequency_Hz": np.array([[100.0, 150]]), "pp_um": np.array([760.0, 1154]), "room": 23.0}
    )
    np.testing.assert_allclose(points(brought(tmp_path / "t.mat", *FULL))["peak_to_peak"], [760e-6, 1154e-6])
    savemat(tmp_path / "m.mat", {"data": np.array([[100.0, 760], [150, 1154]])})
    said = [
        "--column",
        "frequency=data_1",
        "--column",
        "peak_to_peak=data_2",
        "--unit",
        "data_1=Hz",
        "--unit",
        "data_2=um",
    ]
    np.testing.assert_allclose(points(brought(tmp_path / "m.mat", *FULL, *said))["frequency"], [100, 150])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "frequency [Hz],pp [m]\n100,760.1\n150,1154\n",
            "line 2, column 'pp [m]': 760.1 is 760.1 m, and peak to peak is usually",
        ),
        ("frequency [kHz],pp [um]\n100,760.1\n150,1154\n", "is 1e+05 Hz, and frequency is usually"),
        ("frequency [Hz],pp [um]\n150,1154\n100,760.1\n", "frequency does not rise (line 3)"),
        ("frequency [Hz],pp [um]\n100,760\n100,761\n", "frequency 100 stands 2 times (line 2, line 3)"),
        ("frequency [Hz],pp [um]\n100,760.1\n", "nothing tells how certain the values are"),
    ],
)
def test_what_looks_odd_is_told_and_kept(
    text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "t.csv").write_text(text)
    path = brought(tmp_path / "t.csv", *FULL)
    assert words in capsys.readouterr().out
    with Run(path) as run:
        assert any(words in caution for caution in run.imported["cautions"])


def test_a_dry_run_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "t.csv").write_text(GOOD)
    assert main(["import", str(tmp_path / "t.csv"), *FULL, "--dry-run", "--out", str(tmp_path / "runs")]) == 0
    assert "nothing was written" in capsys.readouterr().out
    assert not (tmp_path / "runs").exists()


def test_a_measured_run_is_not_imported(tmp_path: Path) -> None:
    with Run(finished_run(tmp_path)) as run:
        assert run.imported == {}
        assert run.state == "completed"
