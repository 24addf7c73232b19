"""Session: one bench, consecutive runs, every end reported, no thread left behind."""

import threading
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

from app.session.bench_connection import connect
from app.session.session import (
    BenchFailed,
    BenchOpened,
    BlockMonitored,
    InstrumentAwaited,
    RunRejected,
    Session,
    SessionState,
)
from app.session.supervisor import Signs
from drivers.errors import BenchError, InstrumentError, UnsafeError
from protocols.base import PointMeasured, Prompt, PromptAnswered, PromptShown, Record, RunEnded, RunPaused, RunStatus
from protocols.measurements.membrane_sag import MembraneSag
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.static_loading import StaticLoading
from protocols.resume import ResumableRun
from protocols.runfile import RunFileWriter, StorageError, read_mountings
from protocols.runfile.record import RunRecord
from protocols.runner.request import RunRequest
from sim_hardware.plant.setup_state import initial_state
from tests.helpers.scripted_protocol import Scripted
from tests.helpers.simulated_bench import Trigger, assert_safe_voltage, run, simulated

SHORT = SineDwell(frequencies_hz=(100, 160), record_s=0.1, min_cycles=10)


class Nobody:
    def show(self, ask_id: int, prompt: object) -> None:
        raise AssertionError("the simulated operator answers")

    def answer(self, ask_id: int) -> str | None:
        return None


def session(events: list, *observers: Callable) -> tuple[Session, list]:
    laboratories: list = []

    @contextmanager
    def opened():
        with connect(simulated(), None) as lab:
            laboratories.append(lab)
            yield lab

    return Session(opened, [events.append, *observers], Nobody()), laboratories


@pytest.mark.deep
def test_two_runs_on_one_bench_then_closed(tmp_path: Path) -> None:
    events: list = []
    one, laboratories = session(events)
    one.start()
    for _ in range(2):
        one.run(RunRequest(SHORT, tmp_path, "T1"))
        assert one.finished.wait(60)
        assert (one.outcome.status, one.outcome.reason) == (RunStatus.COMPLETED, "all points measured")
        assert one.state is SessionState.IDLE
    assert one.close(60)
    assert one.state is SessionState.CLOSED
    opened = next(i for i, event in enumerate(events) if isinstance(event, BenchOpened))
    assert "generator" in {event.role for event in events[:opened] if isinstance(event, InstrumentAwaited)}
    assert len([e for e in events if isinstance(e, RunEnded)]) == 2
    assert len(list(tmp_path.glob("*.h5"))) == 2
    assert_safe_voltage(laboratories[0].control.report())


@pytest.mark.parametrize("is_glibc", [True, False])
def test_memory_that_a_run_has_freed_is_returned_where_the_library_can(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_glibc: bool
) -> None:
    trimmed: list[int] = []
    library = SimpleNamespace(malloc_trim=trimmed.append) if is_glibc else SimpleNamespace()
    monkeypatch.setattr("app.session.session.ctypes", SimpleNamespace(CDLL=lambda _: library))
    one, _ = session([])
    one.start()
    for _ in range(2):
        one.run(RunRequest(SHORT, tmp_path, "T1"))
        assert one.finished.wait(60)
        assert one.outcome is not None
        assert one.outcome.status is RunStatus.COMPLETED
    assert one.close(60)
    assert len(trimmed) == 2 * is_glibc


def test_a_pause_and_a_stop_between_two_runs_do_not_reach_the_next_one(tmp_path: Path) -> None:
    events: list = []
    one, _ = session(events)
    one.start()
    one.pause()
    one.stop()
    one.run(RunRequest(SineDwell(frequencies_hz=(150,), record_s=0.05), tmp_path, "T1"))
    ended = one.finished.wait(60)
    assert one.close(60)
    assert ended
    assert one.outcome is not None
    assert one.outcome.status == RunStatus.COMPLETED
    assert not any(isinstance(e, RunPaused) for e in events)


@pytest.mark.deep
def test_what_a_stopped_run_left_on_the_specimen_is_off_before_the_next_one(tmp_path: Path) -> None:
    left: list = []

    def stop() -> None:
        left.append(laboratories[0].control.plant.setup_state)
        one.stop()

    events: list = []
    one, laboratories = session(events)
    weighs = Trigger(lambda e: isinstance(e, PromptAnswered) and e.words == "seen by the laser", stop)
    one = Session(one._connect, [events.append, weighs], Nobody())
    one.start()
    one.run(RunRequest(StaticLoading(), tmp_path, "T1"))
    assert one.finished.wait(60)
    assert one.outcome is not None
    assert one.outcome.status == RunStatus.STOPPED
    assert left[0].weights_kg
    one.run(RunRequest(SHORT, tmp_path, "T1"))
    assert one.finished.wait(60)
    assert laboratories[0].control.plant.setup_state == initial_state(laboratories[0].control.parameters)
    found = [e.point.fundamental for e in events if isinstance(e, PointMeasured)]
    with connect(simulated(), None) as lab:
        alone = [point.fundamental for point in run(SHORT, tmp_path / "alone", lab).points]
    assert found == pytest.approx(alone, rel=1e-3), "as if nothing had been before"
    assert one.close(60)


def test_closing_mid_run_goes_to_rest_first(tmp_path: Path) -> None:
    events: list = []
    one, laboratories = session(events)
    measured = threading.Event()
    hit = Trigger(lambda e: isinstance(e, PointMeasured), measured.set)
    one = Session(one._connect, [events.append, hit], Nobody())
    one.start()
    one.run(RunRequest(SineDwell(), tmp_path, "T1"))
    assert measured.wait(60)
    assert one.close(60)
    assert one.outcome is not None
    assert one.outcome.status == RunStatus.STOPPED
    assert_safe_voltage(laboratories[0].control.report())


@pytest.mark.parametrize("error", [InstrumentError, UnsafeError])
def test_a_bench_that_is_not_there_is_told_and_a_run_on_it_ends(error: type[BenchError], tmp_path: Path) -> None:
    @contextmanager
    def absent():
        raise error("the generator is not there; switch it on")
        yield

    events: list = []
    one = Session(absent, [events.append], Nobody())
    one.start()
    one.run(RunRequest(SHORT, tmp_path, "T1"))
    assert one.finished.wait(60)
    assert one.outcome is None
    assert one.state is SessionState.NO_BENCH
    assert one.unsafe is (error is UnsafeError), "of an earlier program"
    assert events == [BenchFailed("the generator is not there; switch it on")]
    assert one.close(60)
    one.run(RunRequest(SHORT, tmp_path, "T1"))
    assert one.finished.is_set()


@pytest.mark.deep
def test_a_run_that_cannot_be_gone_on_with_is_refused_and_keeps_the_bench(tmp_path: Path) -> None:
    events: list = []
    one, _ = session(events)
    one.start()
    one.run(RunRequest(SHORT, tmp_path, "T1"))
    assert one.finished.wait(60)
    assert one.path is not None
    before = one.path.read_bytes()
    at = before.index(b"peak_to_peak_v")
    (tmp_path / "damaged.h5").write_bytes(before[:at] + b"\xff" * 64 + before[at + 64 :])
    for path, entries, says in (
        (tmp_path / "gone.h5", (0,), "there is no file"),
        (one.path, (7,), "no point of entry 7"),
        (tmp_path / "damaged.h5", (0,), "damaged inside"),
    ):
        one.repeat_entries(path, entries, tmp_path)
        assert one.finished.wait(60)
        assert isinstance(events[-1], RunRejected)
        assert says in events[-1].words
        assert one.state is SessionState.IDLE
    one.repeat_entries(one.path, (0,), tmp_path)
    assert one.finished.wait(60)
    assert one.outcome is not None
    assert one.outcome.status == RunStatus.COMPLETED
    assert one.close(60)


def test_stop_while_the_earlier_run_is_read_begins_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    events: list = []
    one, _ = session(events)
    monkeypatch.setattr(
        "protocols.resume.load_resumable",
        lambda *_: one.stop() or ResumableRun(tmp_path, SHORT, RunRecord(specimen="T1")),
    )
    one.start()
    one.repeat_entries(tmp_path / "run.h5", (0,), tmp_path)
    assert one.finished.wait(60)
    (rejected,) = [
        event for event in events if isinstance(event, RunRejected)
    ]  # where the stop took long, its remark follows
    assert "nothing was measured" in rejected.words
    assert list(tmp_path.iterdir()) == []
    assert one.close(60)


def test_a_folder_nobody_can_write_refuses_the_run_and_keeps_the_bench(tmp_path: Path) -> None:
    events: list = []
    one, _ = session(events)
    one.start()
    one.run(RunRequest(SHORT, Path("/proc/nowhere"), "T1"))
    assert one.finished.wait(60)
    assert isinstance(events[-1], RunRejected)
    assert one.outcome is not None
    assert "/proc/nowhere" in one.outcome.reason
    one.run(RunRequest(SHORT, tmp_path, "T1"))
    assert one.finished.wait(60)
    assert one.outcome.status == RunStatus.COMPLETED
    assert one.close(60)


class Leaving(Scripted):
    """Leaves something under the sensor that the next run of another protocol must take away."""

    @property
    def restore(self) -> Prompt:
        return Prompt("restore", "Put it back.")


def test_what_a_run_left_is_asked_for_once(tmp_path: Path) -> None:
    events: list = []
    one, _ = session(events)
    one.start()
    asked = []
    for protocol in (Leaving(script=(Record(0.05),)), *[Scripted(script=(Record(0.05),))] * 2):
        one.run(RunRequest(protocol, tmp_path, "T1"))
        assert one.finished.wait(60)
        asked.append(sum(isinstance(e, PromptShown) and e.prompt.action == "restore" for e in events))
        events.clear()
    assert one.close(60)
    assert asked == [0, 1, 0]


def test_what_a_run_left_is_asked_for_by_the_next_one_that_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise StorageError("full")

    events: list = []
    one, _ = session(events)
    one.start()
    asked = []
    for protocol, is_refused in ((Leaving(script=(Record(0.05),)), False), (SHORT, True), (SHORT, False)):
        with monkeypatch.context() as patch:
            if is_refused:
                patch.setattr(RunFileWriter, "new", full)
            one.run(RunRequest(protocol, tmp_path, "T1"))
            assert one.finished.wait(60)
        assert any(isinstance(e, RunRejected) for e in events) is is_refused
        asked.append(sum(isinstance(e, PromptShown) and e.prompt.action == "restore" for e in events))
        events.clear()
    assert one.close(60)
    assert asked == [0, 0, 1]


def test_what_the_newest_run_of_a_folder_left_is_asked_for_by_the_first_run_of_another_program(tmp_path: Path) -> None:
    """Else the tactor is measured through the membrane, by a sensor that is out of its range there."""
    sag = MembraneSag(repeats=1, settle_s=0.25, record_s=0.5)
    asked = []
    for protocols in ((sag,), (SHORT, SHORT)):
        events: list = []
        one, _ = session(events)
        one.start()
        for protocol in protocols:
            one.run(RunRequest(protocol, tmp_path, "T1"))
            assert one.finished.wait(60)
            asked.append(sum(isinstance(e, PromptShown) and e.prompt == sag.restore for e in events))
            events.clear()
        assert one.close(60)
    assert asked == [0, 1, 0]
    assert [each.part for each in read_mountings(tmp_path, "T1")] == ["laser"]


def test_signs_of_life_are_of_the_present_phase_and_the_last_readings_are_kept(tmp_path: Path) -> None:
    signs: dict[str, Signs] = {}
    watched = threading.Event()

    def look(event: object) -> None:
        signs[type(event).__name__] = one.signs()
        if isinstance(event, BlockMonitored):
            watched.set()

    one, _ = session([], look)
    one.start()
    one.monitor(True)
    assert watched.wait(60)
    one.monitor(False)
    one.run(RunRequest(SHORT, tmp_path, "T1"))
    assert one.finished.wait(60)
    assert one.close(60)
    phases = {
        "BenchOpened": (False, False, False, False),
        "BlockMonitored": (False, True, False, False),
        "DriveStarted": (True, False, True, False),
        "RunEnded": (False, False, False, True),
    }
    seen = {name: signs[name] for name in phases}
    assert {
        name: (each.running, each.watching_card, each.may_be_live, each.at_end) for name, each in seen.items()
    } == phases
    assert not any(each.told_unsafe or each.connecting for each in seen.values())
    assert one.bench is None
    assert one.observation.card is not None


@pytest.mark.parametrize("is_stopped", [True, False])
@pytest.mark.parametrize("concludes", [True, False])
def test_a_run_that_is_given_up_ends_as_requested_and_is_told_once(is_stopped: bool, concludes: bool) -> None:
    events: list = []
    one, _ = session(events)

    def end_run(runner: object, bench: object, status: RunStatus, hangs: str) -> RunEnded:
        ended = RunEnded(status, hangs, "")
        if concludes:
            one._events.publish(ended)
        return ended

    one.state, one.bench = (
        SessionState.RUNNING,
        SimpleNamespace(reading=None, answered_s={}, amplifier=SimpleNamespace(commanded=None)),
    )
    one.runner, one._rescue = SimpleNamespace(path=Path("run.h5")), SimpleNamespace(end_run=end_run)
    if is_stopped:
        one.stop()
    one.give_up("hangs")
    (ended,) = [e for e in events if isinstance(e, RunEnded)]
    assert ended.status == (RunStatus.STOPPED if is_stopped else RunStatus.FAILED)
    assert one.abandoned
    assert one.finished.is_set()
    assert one.state is SessionState.NO_BENCH
    assert isinstance(events[-1], BenchFailed)


@pytest.mark.deep
def test_after_a_sag_the_next_run_asks_to_put_the_tactor_back(tmp_path: Path) -> None:
    events: list = []
    one, laboratories = session(events)
    one.start()
    asked = []
    for protocol in (MembraneSag(repeats=1, settle_s=0.5), MembraneSag(repeats=1, settle_s=0.5), SHORT, SHORT):
        one.run(RunRequest(protocol, tmp_path, "T1"))
        assert one.finished.wait(60)
        assert one.outcome.verdict.outcome.has_result
        asked.append(sum("put the tactor back" in e.prompt.text for e in events if isinstance(e, PromptShown)))
        events.clear()
    assert asked == [0, 0, 1, 0]
    assert one.close(60)
    assert_safe_voltage(laboratories[0].control.report())
