"""Imported runs: source stated; listed, identified, exported and imported again."""

import hashlib
import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from app.archive.exporting.export import export_run
from app.cli.main import main
from app.identification.specimen_identification import identify
from drivers.sensors.laser_sensor import LaserSensor
from model.amplifier_map import AmplifierMap
from model.parameters import Tactor
from model.response.harmonic_response import amplifier_response
from model.response.statics import load_compliance, voltage_gain
from protocols.base import Protocol, Quality, RunStatus
from protocols.registry import PROTOCOLS
from protocols.runfile.reader import Run
from protocols.runfile.record import RunRecord
from protocols.runfile.schema import point_columns
from protocols.runfile.writer import RunFileWriter
from tests.helpers.importing import FULL, GOOD, brought, points
from tests.helpers.run_files import finished_run


def test_the_file_says_where_it_comes_from_and_pretends_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "fig4.csv"
    table.write_text("f [Hz],A [um],humidity [%]\n100,760.1,40\n150,1154.2,41\n")
    path = brought(table, *FULL, "--column", "peak_to_peak=A", "--specimen", "T1", "--measured", "2019-05-04")
    with h5py.File(path) as file:
        result = json.loads(file["entry/imported"][()])
        assert file.attrs["format_version"] == 3
        assert file["entry/simulated"][()] == False  # noqa: E712 - numpy's own
        assert file["entry/trace/displacement"].shape == (0,)
        assert file["entry/events"].shape == file["entry/recordings"].shape == (0,)
        assert np.isnan(file["entry/instrument/displacement_sensor/gain"][()])
        assert file["entry/start_time"][()].startswith(b"2019-05-0")
    assert result["files"] == [{"name": "fig4.csv", "sha256": hashlib.sha256(table.read_bytes()).hexdigest()}]
    assert result["columns"]["peak_to_peak"] == {"column": "A [um]", "unit": "um"}
    assert result["left_out"] == ["humidity [%]"]
    flags = [Quality(int(q)) for q in points(path)["quality"]]
    assert all(flag == Quality.IMPORTED and flag.usable for flag in flags)
    capsys.readouterr()
    assert main(["show", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "imported: from fig4.csv (SHA-256" in shown
    assert "peak_to_peak = 'A [um]'" in shown
    assert main(["resume", str(path)]) == 2
    assert "was imported, not measured" in capsys.readouterr().err


@pytest.mark.deep
def test_imported_runs_are_listed_drawn_exported_and_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path / "cache")
    (tmp_path / "t.csv").write_text(GOOD)
    path = brought(tmp_path / "t.csv", *FULL, "--specimen", "T7", "--uncertainty", "peak_to_peak=2 um")
    capsys.readouterr()
    assert main(["runs", str(path.parent), "--status", "imported", "--json"]) == 0
    assert [run["state"] for run in json.loads(capsys.readouterr().out)] == ["imported"]
    assert main(["show", str(path), "--picture", str(tmp_path / "p.png")]) == 0
    assert main(["export", str(path), "--format", "json", "--out", str(tmp_path)]) == 0
    assert json.loads((tmp_path / f"{path.stem}.json").read_text("utf-8"))["imported"]["files"][0]["name"] == "t.csv"
    assert main(["report", "T7", "--full", "--folder", str(path.parent), "--out", str(tmp_path)]) == 0
    assert "imported" in next(tmp_path.glob("*T7*.html")).read_text("utf-8")


@pytest.mark.deep
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
    found = {e.name: e for e in identify(made, plain=True).estimates}  # the tables have no effect beyond the beam model
    for name in ("k2", "mu", "c0", "m_add"):
        assert found[name].value == pytest.approx(getattr(truth, name), rel=1e-3), name
        assert abs(found[name].value - getattr(truth, name)) < found[name].standard_error


def written(folder: Path, protocol: type[Protocol]) -> Path:
    """A run of any protocol with a number of its own in every cell, some of them none."""
    random = np.random.default_rng(7)
    record = RunRecord(
        protocol=protocol.name,
        title=f"{protocol.title} of T9",
        specimen="T9",
        axes=protocol.axes,
        sensor=LaserSensor("l", 1e-4),
    )
    file = RunFileWriter.new(folder, record, protocol.point_type)
    widths = {name: width for name, (_, _, width) in point_columns(protocol.point_type).items()}
    for row in range(3):
        values: dict[str, Any] = {f.name: float(random.uniform(1.0, 2.0)) for f in fields(protocol.point_type)}
        values |= {name: (*tuple(random.uniform(1, 2, 8).tolist()[:-1]), np.nan) for name, w in widths.items() if w}
        values |= {name: 1.0 for name in ("side", "direction") if name in values}
        values["quality"] = int((Quality.GOOD, Quality.UNSETTLED, Quality.GOOD)[row])
        file.append_point(protocol.point_type(**values), row)
    file.finish(RunStatus.COMPLETED, "all points measured")
    return file.path


@pytest.mark.one_in(5)
@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *((name, "csv") for name in PROTOCOLS),
        *(pytest.param(name, "mat", marks=() if name == "sine-dwell" else pytest.mark.deep) for name in PROTOCOLS),
    ],
)
def test_what_is_exported_and_imported_again_is_the_same(name: str, kind: Any, tmp_path: Path) -> None:
    original = written(tmp_path / "old", PROTOCOLS[name])
    with Run(original) as run:
        (file,) = export_run(run, tmp_path, kind, ("about", "points") if kind == "mat" else ("points",))
    got, wanted = points(brought(file)), points(original)
    with Run(next((tmp_path / "runs").glob("*.h5"))) as run:
        assert run.record.protocol == name
        assert run.record.specimen == ("T9" if kind == "mat" else "unnamed")
    assert got.keys() == wanted.keys()
    for column, values in wanted.items():
        if column == "quality":
            np.testing.assert_array_equal(got[column], values + int(Quality.IMPORTED))
        else:
            np.testing.assert_array_equal(got[column], values, err_msg=column)


def test_an_export_of_an_earlier_version_gives_parameters_by_their_former_names(tmp_path: Path) -> None:
    with Run(written(tmp_path / "old", PROTOCOLS["sine-dwell"])) as run:
        about, table = export_run(run, tmp_path, "csv", ("about", "points"))
    with about.open("a", encoding="utf-8") as file:
        file.write("parameter_wanted,0.02\n")
    with Run(brought(table)) as run:
        assert run.record.parameters["target_relative_uncertainty"] == 0.02


@pytest.mark.deep
def test_a_side_that_nobody_told_comes_back_untold(tmp_path: Path) -> None:
    (tmp_path / "l.csv").write_text("load [N],deflection [um]\n1,137\n2,275\n")
    with Run(brought(tmp_path / "l.csv")) as run:
        for kind in ("csv", "mat"):
            (file,) = export_run(run, tmp_path / kind, kind, ("points",))  # type: ignore[arg-type]
            assert np.isnan(points(brought(file))["side"]).all()


@pytest.mark.deep
def test_what_was_simulated_stays_simulated(tmp_path: Path) -> None:
    with Run(finished_run(tmp_path / "old")) as run:
        files = [*export_run(run, tmp_path, "csv", ("points",)), *export_run(run, tmp_path, "mat", ("about", "points"))]
    renamed = files[0].rename(tmp_path / "harmless.csv")
    cut = tmp_path / "columns_of_a_SIMULATED_run.csv"  # without its flags, the name still says so
    cut.write_text("frequency [Hz],pp [um],drive pp [V]\n100,760,5\n")
    assert points(brought(cut))["quality"] == [int(Quality.SIMULATED | Quality.IMPORTED)]
    for file in (renamed, files[1]):
        with Run(brought(file)) as run:
            assert run.record.simulated
            assert Quality(int(run.points()["quality"][0])) == Quality.SIMULATED | Quality.IMPORTED


def test_a_measured_run_is_not_imported(tmp_path: Path) -> None:
    with Run(finished_run(tmp_path)) as run:
        assert run.record.imported == {}
        assert run.record.state == "completed"
