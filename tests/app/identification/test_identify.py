"""Identification from run files: true parameters of the simulated tactor, valid standard errors, calibration."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import h5py
import pytest

from app.cli.main import main
from app.identification import calibrations
from app.identification.calibrations import CalibrationError
from app.identification.observations import ObservationError, read_observations
from app.identification.specimen_identification import identify
from model.identification.observations import FrequencyResponseObservation
from model.parameters import Tactor
from protocols.base import Quality
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.voltage_steps import VoltageSteps
from tests.helpers.messages import assert_names
from tests.helpers.run_files import finished_run
from tests.helpers.simulated_bench import laboratory, run, simulated

TRUTH = Tactor(mu=-1.5e-5, c0=180.0)
DWELL = SineDwell(frequencies_hz=(50, 100, 130, 145, 160, 175, 200, 250), record_s=0.1)
STEPS = VoltageSteps(levels_v=(0.0, 1.0, 4.0, 5.0), repeats=2, rest_s=0.3, read_s=0.3, hold_s=0.5)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A dwell, a second one, and voltage steps of a tactor that is not the table's."""
    folder = tmp_path_factory.mktemp("runs")
    with laboratory(simulated(tactor={"mu": TRUTH.mu, "c0": TRUTH.c0}, seed=5)) as lab:
        lab.bench.block_s = 0.2  # fewer writes to the file
        dwells = [run(DWELL, folder, lab).path for _ in range(2)]
        return [*dwells, run(STEPS, folder, lab).path]


@pytest.mark.parametrize("method", ["joint", "chain"])
def test_the_truth_of_the_plant_comes_back_within_its_errors(runs: list[Path], method: str) -> None:
    found = identify([runs[0], runs[2]], method)  # type: ignore[arg-type]
    estimates = {e.name: e for e in found.estimates if e.name not in found.priors}
    assert set(estimates) == {"mu", "m_add", "c0"}
    allowance = 1e-4 if method == "joint" else 5e-3  # the chain's parabola through the peak has an error of its own
    for name, one in estimates.items():
        truth = getattr(TRUTH, name)
        assert abs(one.value - truth) < 4 * one.standard_error + allowance * abs(truth), name
    assert found.observations.simulated
    assert found.tactor.mu == estimates["mu"].value
    if method == "joint":
        assert "the errors explain the misfit" in found.verdict


def test_a_shared_gain_error_of_the_sensor_is_in_the_error_of_the_coupling(runs: list[Path]) -> None:
    """0.2 % of the sensor's gain cannot be averaged away by more points."""
    one = {e.name: e for e in identify([runs[0]], sheet="none").estimates}["mu"]
    all_ = {e.name: e for e in identify(runs, sheet="none").estimates}["mu"]
    assert one.standard_error / abs(one.value) == pytest.approx(2e-3, rel=0.2)
    assert all_.standard_error == pytest.approx(one.standard_error, rel=0.2)


def test_identical_samples_of_two_runs_are_counted_once(runs: list[Path], tmp_path: Path) -> None:
    """Two points of a copy have the same samples, but other values, as of another version of the program."""
    copy = Path(shutil.copy(runs[0], tmp_path / "again.h5"))
    with h5py.File(copy, "r+") as file:
        file["entry/points/fundamental"][:2] *= 1.01
        file["entry/points/fundamental"][2:] *= 1.01
        drive = file["entry/trace/drive"]
        rows = file["entry/recordings"]["start_row"]
        drive[int(rows[2]) :] = drive[int(rows[2]) :] + 1  # all recordings but the first two differ
    _, campaign, notes = read_observations([runs[0], copy])
    assert [r.usable.sum() for r in campaign.runs] == [8, 6]
    assert notes == [f"again.h5 holds the same data as {runs[0].name} at 2 of 8 points: they are counted once"]


def test_points_that_a_continuation_measured_again_are_left_out(runs: list[Path], tmp_path: Path) -> None:
    first = Path(shutil.copy(runs[0], tmp_path))
    later = Path(shutil.copy(runs[1], tmp_path))
    with h5py.File(first) as before, h5py.File(later, "r+") as file:
        points, earlier = file["entry/points"], before["entry/points"]
        for name in points:
            points[name][2] = earlier[name][2]  # carried over
        points["quality"][2] = int(Quality.SUPERSEDED)
        del file["entry/continues"]
        file["entry/continues"] = first.name
    for order in ([first, later], [later, first]):
        _, campaign, notes = read_observations(order)
        usable = {run.label: run.usable.tolist() for run in campaign.runs}
        assert usable[first.stem] == usable[later.stem] == [True, True, False, *[True] * 5]
        assert_names(next(note for note in notes if note.startswith(first.name)), later.name, 8)
        assert all(note.count(later.name) == 1 for note in notes)


def test_flagged_points_are_left_out(runs: list[Path], tmp_path: Path) -> None:
    copy = Path(shutil.copy(runs[0], tmp_path / "flagged.h5"))
    with h5py.File(copy, "r+") as file:
        file["entry/points/quality"][2] = int(Quality.CLIPPED)
        file["entry/points/fundamental"][2] *= 3
    _, campaign, _ = read_observations([copy])
    (response,) = campaign.of_type(FrequencyResponseObservation)
    assert response.usable.tolist() == [True, True, False, *[True] * 5]
    found = identify([copy, runs[0]])
    mu = {e.name: e for e in found.estimates}["mu"]
    assert abs(mu.value - TRUTH.mu) < 4 * mu.standard_error
    assert any(note.startswith(runs[0].name) and copy.name in note for note in found.notes)


def test_what_cannot_be_identified_together_is_a_sentence(runs: list[Path], tmp_path: Path) -> None:
    other = finished_run(tmp_path, "T1", (100.0, 160.0))
    shutil.copy(other, tmp_path / "copy.h5")
    with h5py.File(tmp_path / "copy.h5", "r+") as file:
        del file["entry/specimen"]
        file["entry/specimen"] = "T2"
    with pytest.raises(ObservationError, match="these runs are of several specimens, 'T1'"):
        read_observations([other, tmp_path / "copy.h5"])
    with pytest.raises(ObservationError, match=r"gone\.h5"):
        read_observations([tmp_path / "gone.h5"])


@pytest.mark.deep
def test_the_command_accepts_shows_and_tells_apart(
    runs: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    here = [shutil.copy(path, tmp_path) for path in runs]
    assert main(["identify", *here[::2], "--accept", "--by", "K. Tanaka", "--note", "first", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["simulated"] is True
    assert set(result["parameters"]["name"]) == {"mu", "m_add", "c0", "k2"}
    assert main(["calibration", "accept", *here]) == 0
    capsys.readouterr()
    assert main(["calibration", "show", "T1", "--folder", str(tmp_path), "--version", "1"]) == 0
    shown = capsys.readouterr().out
    assert "version 1 (version 2 is active), SIMULATED" in shown
    assert "K. Tanaka" in shown
    assert re.search(r"versions: 1 \(\d{4}-\d\d-\d\d, K. Tanaka\); 2 \(\d{4}-\d\d-\d\d, active\)", shown)
    assert main(["calibration", "diff", "T1", "1", "2", "--folder", str(tmp_path)]) == 0
    assert "in standard errors" in capsys.readouterr().out
    assert main(["calibration", "use", "T1", "1", "--folder", str(tmp_path)]) == 0
    assert calibrations.read_calibrations(tmp_path, "T1").active == 1
    assert calibrations.read_calibrations(tmp_path, "T1").get().tactor().c0 == pytest.approx(180.0, rel=0.1)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["calibration", "show", "T9"], "specimen T9 in runs: there is no calibration; versions: none"),
        (["identify", "nowhere.h5"], "there is no file nowhere.h5"),
        (["identify", "RUN", "--fix", "k2"], "write NAME=VALUE"),
        (["identify", "RUN", "--fix", "weight=3"], "weight"),
        (["identify", "RUN", "--free", "colour"], "colour"),
        (["identify", "RUN", "--method", "chain", "--robust"], "for the joint fit"),
        (["compare", "RUN", "nowhere.h5"], "there is no file nowhere.h5"),
    ],
)
def test_what_is_asked_wrongly_is_a_sentence(
    runs: list[Path], arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(runs[0]) if word == "RUN" else word for word in arguments]) == 2
    assert says in capsys.readouterr().err


def test_two_runs_of_one_specimen_agree(runs: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", str(runs[0]), str(runs[1]), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    errors = result["points"]["standard errors"]
    assert len(errors) == 8
    assert max(abs(e) for e in errors) < 4
    assert main(["compare", str(runs[0]), str(runs[2])]) == 2
    assert_names(capsys.readouterr().err, runs[0].name, "sine-dwell", runs[2].name, "voltage-steps")


@pytest.mark.deep
def test_points_are_compared_at_the_same_setting_not_at_the_same_place(tmp_path: Path, capsys: Any) -> None:
    """Two dwells at other frequencies, and a table without errors and with a smaller drive."""
    few, more = (finished_run(tmp_path / n, "T1", f) for n, f in (("a", (160.0, 250.0)), ("b", (100.0, 160.0, 250.0))))
    assert main(["compare", str(few), str(more), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["points"]["frequency"] == [160.0, 250.0]
    assert result["points"]["difference"] == [0.0, 0.0]
    (tmp_path / "t.csv").write_text("frequency [Hz],pp [um]\n160,900\n")
    assert main(["import", str(tmp_path / "t.csv"), "--set", "peak_to_peak_v=4", "--out", str(tmp_path / "c")]) == 0
    (table,) = (tmp_path / "c").glob("*.h5")
    capsys.readouterr()
    assert main(["compare", str(more), str(table)]) == 0
    result = capsys.readouterr().out
    assert "1 points in common, of 3 and 1 usable ones" in result
    assert "the drives differ: 5 V in" in result
    assert "never" not in result
    lone = finished_run(tmp_path / "d", "T1", (55.0,))
    assert main(["compare", str(lone), str(more)]) == 2
    assert "no usable point at the same frequency" in capsys.readouterr().err


def test_a_damaged_calibration_file_is_named(tmp_path: Path) -> None:
    path = calibrations.calibrations_path(tmp_path, "T1")
    path.write_text('{"format": "tactor-bench-calibrations", "versions": 3}')
    with pytest.raises(CalibrationError, match=re.escape(str(path))):
        calibrations.read_calibrations(tmp_path, "T1")
