"""Resumed runs: one run in the file, points measured again, drift in between detected."""

import math
import threading
from pathlib import Path
from types import SimpleNamespace

import h5py
import pytest

from protocols import registry
from protocols.base import EntryStarted, LogMessage, PointMeasured, Quality, RunStatus
from protocols.resume import ResumableRun, load_resumable
from protocols.runfile.reader import Run, RunReadError
from protocols.runfile.record import RunRecord
from tests.helpers.level_protocol import LEVELS, Handy, Levels, resumed
from tests.helpers.simulated_bench import Trigger, laboratory, run, simulated


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(registry.PROTOCOLS, "levels", Levels)


def test_what_was_stopped_goes_on_as_one_run(known: None, tmp_path: Path) -> None:
    cancel = threading.Event()
    with laboratory() as lab:
        second = Trigger(lambda e: isinstance(e, PointMeasured) and e.index == 1, cancel.set)
        first = run(LEVELS, tmp_path, lab, second, cancel=cancel)
        assert first.status == RunStatus.STOPPED
        ran = resumed(first.path, tmp_path, lab)
    assert ran.status == RunStatus.COMPLETED
    assert any("Drift check at 2.2 V" in e.text for e in ran.events if isinstance(e, LogMessage))
    with Run(ran.path) as file:
        columns = file.points()
        good = [Quality(int(q)).usable for q in columns["quality"]]
        assert columns["level"][good].tolist() == [2.0, 2.2, 2.8, 3.0]
        assert file.resumed_from == first.path
        assert [r.entry for r in file.recordings()] == [0, 1, 1, 2, 3]
        again = {
            r.entry: LEVELS.point((LEVELS.levels_v[r.entry],), [r], file.record.simulated) for r in file.recordings()
        }
        for level, moved, entry, usable in zip(
            columns["level"], columns["displacement"], columns["entry"], good, strict=True
        ):
            if usable:
                assert (again[entry].level, again[entry].displacement) == (level, moved)
    with h5py.File(ran.path) as plain:  # as any HDF5 reader does
        assert plain["entry/earlier/trace/drive"].shape[0] > 0


@pytest.mark.deep
def test_points_can_be_measured_again_into_a_continuation(known: None, tmp_path: Path) -> None:
    with laboratory() as lab:
        first = run(LEVELS, tmp_path, lab)
        ran = resumed(first.path, tmp_path, lab, again=(2,))
    assert [e.index for e in ran.events if isinstance(e, EntryStarted)] == [2]
    with Run(ran.path) as file:
        flags = [Quality(int(q)) for q in file.points()["quality"]]
        assert [Quality.SUPERSEDED in flag for flag in flags] == [False, False, True, False, False]
        assert file.earlier_runs() == [first.path]
        assert list(file.entries()) == [0, 1, 2, 3]


@pytest.mark.deep
def test_a_moved_sensor_is_noticed_before_a_run_goes_on(known: None, tmp_path: Path) -> None:
    cancel = threading.Event()
    with laboratory() as lab:
        second = Trigger(lambda e: isinstance(e, PointMeasured) and e.index == 1, cancel.set)
        first = run(LEVELS, tmp_path, lab, second, cancel=cancel)
    with laboratory(simulated(sensor={"zero_v": 0.5})) as lab:
        operator = Handy(lab.operator)
        ran = resumed(first.path, tmp_path, lab, operator=operator)
    question = operator.asked[-1]
    assert question.action == "drifted"
    assert question.choices == ("go on", "stop")
    assert ran.status == RunStatus.COMPLETED


def test_what_cannot_be_gone_on_with_is_a_sentence(known: None, tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(Levels(levels_v=(2.0,)), tmp_path, lab)
    with pytest.raises(RunReadError, match="is complete: there is nothing to resume"):
        load_resumable(ran.path)
    with pytest.raises(RunReadError, match=rf"{ran.path.name}.*\b7\b"):
        load_resumable(ran.path, repeat_entries=(7,))


@pytest.mark.one_in(1)
@pytest.mark.parametrize(("sigmas", "asks"), [(3.9, False), (4.5, True), (30.0, True)])
def test_a_change_of_more_than_four_standard_errors_is_asked_about(sigmas: float, asks: bool) -> None:
    error = 0.1 / sigmas / math.sqrt(2)
    first, second = (SimpleNamespace(displacement=value, displacement_errors=error) for value in (1.0, 1.1))
    message, question = ResumableRun(Path(), LEVELS, RunRecord(specimen="T1")).assess_drift("2.2 V", first, second)
    assert "+10.00 %" in message
    assert (question is not None) is asks
