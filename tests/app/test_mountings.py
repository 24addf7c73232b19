"""Mountings: kept by the simulated specimen from session to session, stored in the run, and told apart by the fit."""

import json
from contextlib import nullcontext
from pathlib import Path

import h5py
import numpy as np
import pytest

from app.archive.notes import mount_part
from app.cli.main import main
from app.common import ExitCode
from app.config.bench_file import BenchConfig
from app.identification.specimen_identification import identify
from app.session.session import Session
from protocols.base import MOUNTED, Prompt, SpecimenMounted
from protocols.measurements.sine_dwell import SineDwell
from protocols.paper_campaign import FIX_PAPER_MASS
from protocols.runfile.errors import NotesError
from protocols.runfile.mountings import mountings_text, read_mountings
from protocols.runfile.reader import Run
from protocols.runner.request import RunRequest
from sim_hardware.plant.parameters import MountingScatter, SimulationParameters
from sim_hardware.plant.setup_state import apply_action, initial_state
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import laboratory, simulated

SHORT = SineDwell(frequencies_hz=(100, 160), record_s=0.1, min_cycles=10)
DWELL = SineDwell(frequencies_hz=(100, 140, 150, 160, 170, 220), record_s=0.2)
SCATTER = {"mass_kg": 1e-4, "plate_share": 0.01, "laser_share": 2e-3}


def bench() -> BenchConfig:
    return simulated(mounting=SCATTER, fresh_noise=False, seed=3, tactor={"m_add": 7.85e-3})


def measure(folder: Path, *prepare: Prompt, protocol: SineDwell = SHORT) -> tuple[Path, float]:
    """Measure a dwell in a session of its own; return the file and the mass that moved with the centre."""
    with laboratory(bench()) as lab:
        session = Session(lambda: nullcontext(lab), [], lab.operator)
        session.start()
        session.run(RunRequest(protocol, folder, "T1", prepare=prepare))
        assert session.finished.wait(60)
        moved_kg = lab.control.plant.setup_state.fixed_kg
        assert session.close(60)
    return session.path, moved_kg


def test_a_glued_mass_stays_from_session_to_session_and_differs_from_the_next_one(tmp_path: Path) -> None:
    found, first_kg = measure(tmp_path)
    glued, glued_kg = measure(tmp_path, FIX_PAPER_MASS)
    later, later_kg = measure(tmp_path)
    again, again_kg = measure(tmp_path, FIX_PAPER_MASS)
    scatter = MountingScatter(**SCATTER)
    assert first_kg == 7.85e-3
    assert glued_kg == later_kg == pytest.approx(7.73e-3 + scatter.difference("mass", 1, 3))
    assert again_kg == pytest.approx(7.73e-3 + scatter.difference("mass", 2, 3))
    times = []
    for path in (found, glued, later, again):
        with Run(path) as run:
            times.append([each.time for each in run.mountings if each.part == "mass"])
    assert times[0] == []
    assert times[1] == times[2]
    assert times[3] > times[1]
    assert [each.time for each in read_mountings(tmp_path, "T1")] == [*times[1], *times[3]]


@pytest.mark.deep
def test_the_fit_finds_the_difference_between_mountings_that_the_plant_had(tmp_path: Path) -> None:
    runs = [measure(tmp_path, *prepare, protocol=DWELL) for prepare in ((), (FIX_PAPER_MASS,), (), (FIX_PAPER_MASS,))]
    paths, (first_kg, glued_kg, _, again_kg) = (tuple(each) for each in zip(*runs, strict=True))
    fitted = identify(paths)
    assert fitted.adequacy is not None
    assert fitted.adequacy.adequate, fitted.verdict
    fit = fitted.joint_fit
    assert fit is not None
    sizes = dict(zip(fit.names, fit.theta, strict=True))
    for number, moved_kg in ((1, first_kg), (2, glued_kg)):
        name = f"mounting {number} of the mass"
        error = fit.enlarged_covariance[fit.names.index(name), fit.names.index(name)] ** 0.5
        assert sizes[name] == pytest.approx(moved_kg - again_kg, abs=4 * error)
        assert error < 4e-5
    plain = identify(paths, plain=True)
    assert plain.adequacy is not None
    assert plain.adequacy.adequate is False


def test_an_answer_that_nothing_changed_is_no_mounting() -> None:
    assert SpecimenMounted.by_prompt(FIX_PAPER_MASS, "unchanged", "Anna") is None
    mounted = SpecimenMounted.by_prompt(FIX_PAPER_MASS, "done", "Anna")
    assert mounted is not None
    assert (mounted.part, mounted.who, mounted.values["mass_kg"]) == ("mass", "Anna", 7.73e-3)
    added = Prompt("fix-mass", "Fix an added mass of 2 g in the cylinder.", {"mass_kg": 2e-3}, hands_on=True)
    assert SpecimenMounted.by_prompt(added, "done", "Anna") is None
    assert SpecimenMounted.by_prompt(Prompt("turn-side", "Turn it."), "done", "Anna") is None


def test_the_command_records_and_lists_mountings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["mounting", "T1", "plate", "--by", "Anna", "--folder", str(tmp_path)]) == ExitCode.DONE
    capsys.readouterr()
    assert main(["mounting", "T1", "--folder", str(tmp_path), "--json"]) == ExitCode.DONE
    listed = json.loads(capsys.readouterr().out)["mountings"]
    assert (listed["part"], listed["who"]) == (["plate"], ["Anna"])
    assert main(["mounting", "T1", "clamp", "--folder", str(tmp_path)]) == ExitCode.USAGE
    assert_names(capsys.readouterr().err, "clamp", "plate")


def test_a_plate_that_was_clamped_again_bends_otherwise_in_the_next_session(tmp_path: Path) -> None:
    before, _ = measure(tmp_path)
    mount_part(tmp_path, "T1", "plate", "Anna")
    mount_part(tmp_path, "T1", "laser", "Anna")
    after, _ = measure(tmp_path)
    responses = []
    for path in (before, after):
        with Run(path) as run:
            responses.append(run.points()["fundamental"])
    scatter = MountingScatter(**SCATTER)
    low = responses[1][0] / responses[0][0] - 1  # below resonance the response grows with the length, about cubed
    longer = scatter.difference("plate", 1, 3)
    assert abs(low - scatter.difference("laser", 1, 3)) > 0.2 * abs(longer)
    assert np.abs(responses[1] / responses[0] - 1).max() < 0.2


def test_a_damaged_file_of_mountings_refuses_the_run_and_is_named(tmp_path: Path) -> None:
    file = tmp_path / "T1.mountings.json"
    file.write_text('{"specimen": "T1", "mountings": [{"part": "roof", "time": "2026-01-01"}]}')
    with pytest.raises(NotesError) as caught:
        read_mountings(tmp_path, "T1")
    assert_names(str(caught.value), str(file), "roof")
    path, _ = measure(tmp_path)
    assert path is None
    assert list(tmp_path.glob("*.h5")) == []


def test_the_state_in_the_run_file_is_that_of_its_points_even_with_long_names(tmp_path: Path) -> None:
    mountings = [SpecimenMounted.now(part, "Ü" * 900) for part in ("mass", "plate", "laser", "membrane")]
    assert len(mountings_text(mountings).encode()) < 4000
    path, _ = measure(tmp_path, FIX_PAPER_MASS)
    with h5py.File(path) as file:
        (stored,) = json.loads(file["entry/mountings"][()])["mountings"]
        kinds = [row["kind"].decode() for row in file["entry/events"]]
    assert stored["values"] == {"mass_kg": 7.73e-3, "moving": 1.0, MOUNTED: 1.0}
    assert kinds.index("Mounted") < kinds.index("EntryBegan")


@pytest.mark.deep
def test_files_of_earlier_versions_tell_a_mounting_by_the_answered_prompt(tmp_path: Path) -> None:
    first, _ = measure(tmp_path)
    glued, _ = measure(tmp_path, FIX_PAPER_MASS)
    for path in (first, glued):
        with h5py.File(path, "r+") as file:
            del file["entry/mountings"]
    with Run(first) as run:
        assert run.mountings == ()
    with Run(glued) as run:
        assert [(each.part, each.time) for each in run.mountings] == [("mass", run.record.start_time)]


@pytest.mark.parametrize("part", ["mass", "plate", "laser"])
def test_differences_between_mountings_have_the_stated_size_and_do_not_repeat(part: str) -> None:
    scatter = MountingScatter(2.0, 2.0, 2.0)
    drawn = np.array([scatter.difference(part, number, seed) for seed in range(20) for number in range(1, 21)])
    assert np.std(drawn) == pytest.approx(2.0, rel=0.1)
    assert len(set(drawn)) == drawn.size
    assert scatter.difference(part, 0, 1) == 0.0


def test_the_initial_mass_glued_by_command_differs_as_well() -> None:
    parameters = SimulationParameters(mounting=MountingScatter(1e-4), seed=3)
    state = apply_action(initial_state(parameters), "tidy-up", {"mass_mountings": 1.0}, parameters)
    expected = parameters.tactor.m_add + parameters.mounting.difference("mass", 1, 3)
    assert state.fixed_kg == pytest.approx(expected)


@pytest.mark.deep
def test_show_names_the_mountings_of_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, _ = measure(tmp_path, FIX_PAPER_MASS)
    assert main(["show", str(path), "--json"]) == ExitCode.DONE
    (mounting,) = json.loads(capsys.readouterr().out)["mountings"]
    assert (mounting["part"], mounting["values"]["mass_kg"]) == ("mass", 7.73e-3)
    assert main(["show", str(path)]) == ExitCode.DONE
    assert_names(capsys.readouterr().out, mounting["time"][11:16])
    sheet = tmp_path / "T1.specimen.toml"
    sheet.write_text('specimen = "T1"\n[mounting]\nplate = "0.5 %"\n')
    assert main(["specimen", "show", "T1", "--folder", str(tmp_path), "--json"]) == ExitCode.DONE
    assert json.loads(capsys.readouterr().out)["mountings"] == {"plate": pytest.approx(5e-3)}
