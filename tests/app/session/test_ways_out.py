"""Every state of session and window has a way out: Stop ends a run, Connect connects, Close closes; explored exhaustively."""

import threading
import time
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from app.gui.status.session_controller import SessionController
from app.live.session_link import SessionAdapter
from app.session.reducer import observe, reduce
from app.session.session import (
    BenchFailed,
    BlockMonitored,
    MonitorFailed,
    MonitorStarted,
    Observation,
    RunRejected,
    SessionEvent,
    SessionState,
)
from app.session.session import Session as RealSession
from app.session.simulation import SimulationSettings
from app.session.state import (
    BenchState,
    CommissioningEnded,
    OperatorAction,
    RunRequested,
    TimedEvent,
    WindowEvent,
    WindowState,
    initial_window_state,
)
from drivers.bench.card_reading import CardReading
from drivers.deadlines import Deadline
from model.amplifier_map import AmplifierMap
from protocols.base import (
    DISABLE_HIGH_VOLTAGE,
    ENABLE_HIGH_VOLTAGE,
    BenchArmed,
    DriveReadbackChanged,
    DriveStarted,
    PromptAnswered,
    PromptShown,
    RestMeasured,
    RunEnded,
    RunPaused,
    RunResumed,
    RunStatus,
    ShutdownStarted,
    SpecimenMayBeLive,
)
from protocols.measurements.sine_dwell import SineDwell
from protocols.runner.request import RunRequest
from tests.app.test_session import SHORT, connect, simulated
from tests.app.test_view import AT_REST, FAILED, NOT_AT_REST, OPENED, ROLES, SINE, STARTED, STOPPED, UNSAFE, WHEN
from tests.helpers.messages import assert_names
from tests.helpers.waiting import wait_until

GONE = BenchFailed("no bench")
ENOUGH = 40
"""Events that lead to every state there is."""
HUNG = RunEnded(RunStatus.UNSAFE, "UNSAFE: a driver hangs", "run.h5")

# -- the reducer: every event in every state -------------------------------------------------------------------------------

SEEN = {
    "rest": CardReading((2.5, 2.5), (2.5, 2.5), 10.0, (2.5, 2.5)),
    "0 V": CardReading((0.0, 0.0), (0.0, 0.0), 10.0, (0.0, 0.0)),
    "old": CardReading((0.0, 0.0), (0.0, 0.0), 1.0, (0.0, 0.0)),
}
EVENTS: dict[str, WindowEvent] = {
    "opened": OPENED,
    "gone": GONE,
    "requested": RunRequested("x"),
    "rejected": RunRejected("no"),
    "started": STARTED,
    "asked off": PromptShown(1, DISABLE_HIGH_VOLTAGE),
    "asked on": PromptShown(1, ENABLE_HIGH_VOLTAGE),
    "answered": PromptAnswered(1, "done"),
    "armed": BenchArmed(),
    "armed off": BenchArmed(False),
    "drive": DriveStarted(SINE),
    "lost": DriveReadbackChanged(True, 0.0, 0.0),
    "found": DriveReadbackChanged(False, 0.0, 5.0),
    "paused": RunPaused("rest"),
    "resumed": RunResumed(),
    "warned": SpecimenMayBeLive(0.0, 5.0, "no answer"),
    "shutdown": ShutdownStarted(),
    "at rest": AT_REST,
    "not at rest": NOT_AT_REST,
    "stopped": STOPPED,
    "failed": FAILED,
    "unsafe": UNSAFE,
    "watched": MonitorStarted(1e4, ()),
    "not watched": MonitorFailed("no"),
    "commissioned": CommissioningEnded("done", passed=True),
    **{str(action): action for action in OperatorAction},
}


def key_of(view: WindowState) -> Hashable:
    """What decides how a state goes on; texts, points and times do not."""
    flags = (
        view.phase, view.off_aim, view.unread, view.warned, view.watched, view.connected, view.busy, view.pause_requested,
        view.paused, view.rest_lost, view.high_voltage, bool(view.queued), bool(view.unsafe),
    )  # fmt: skip
    return flags, view.drive is None, view.rest is None, view.prompt is None, view.fitted[0].lamp


def step(view: WindowState, name: str) -> WindowState:
    """Apply an event, or a look at what the card measures."""
    if name in SEEN:
        return observe(view, Observation(SEEN[name]), 10.0, WHEN)
    return reduce(view, TimedEvent(EVENTS[name], WHEN, at_s=1.0))


def after(view: WindowState, *names: str) -> WindowState:
    for name in names:
        view = step(view, name)
    return view


def shown_of(view: WindowState) -> Hashable:
    """What a person can see of a state, and what keys do in it."""
    return (
        view.phase, view.danger, view.off_aim, view.connected, view.busy, view.paused, view.pause_requested, view.rest_lost,
        bool(view.queued), bool(view.unsafe), view.prompt is None, view.fitted[0].lamp,
    )  # fmt: skip


def reachable(key: Callable[[WindowState], Hashable], depth: int) -> list[WindowState]:
    """Return every state that any `depth` events and readings lead to, also in an order that no bench makes."""
    first = initial_window_state(AmplifierMap(), "bench", True, ROLES)
    found, ahead = {key(first): first}, [first]
    for _ in range(depth):
        later = {key(new): new for view in ahead for name in (*EVENTS, *SEEN) if (new := step(view, name))}
        ahead = [replace(new, messages=(), points=()) for which, new in later.items() if which not in found]
        found |= {key(new): new for new in ahead}
    assert not ahead or depth < ENOUGH, "there is no end to the states"
    return list(found.values())


@pytest.mark.parametrize(
    ("key", "depth", "least"),
    [
        (key_of, 2, 150),
        pytest.param(key_of, 5, 10_000, marks=pytest.mark.deep),
        pytest.param(shown_of, ENOUGH, 3_000, marks=pytest.mark.deep),
    ],
)
def test_every_event_in_every_state_of_the_window(
    key: Callable[[WindowState], Hashable], depth: int, least: int
) -> None:
    states = reachable(key, depth)
    assert len(states) > least
    for view in states:
        assert view.danger or view.bench_state not in (BenchState.DRIVE_LOST, BenchState.UNSAFE)
        assert view.blocked_reason or view.can_run
        assert not (view.can_run and view.can_queue)
        assert not (view.connected and view.can_queue)
        # Stop, and what a session reports then, ends every run; at rest, or unsafe.
        ended = after(view, OperatorAction.STOP, "shutdown", "at rest", "stopped")
        assert not ended.busy
        assert ended.bench_state is BenchState.AT_REST
        lost = after(view, OperatorAction.STOP, "shutdown", "not at rest", "unsafe", "gone")
        assert (lost.busy, lost.bench_state, lost.exit_code) == (False, BenchState.UNSAFE, 3)
        # Connect works in every state without a run, whatever was before.
        again = after(ended, OperatorAction.RECONNECT)
        assert not again.can_run
        assert after(again, "opened", OperatorAction.ACKNOWLEDGE).can_run
        assert not after(again, "gone").busy
        # A rest that was lost stays unsafe until rest is measured.
        assert not view.rest_lost or after(view, OperatorAction.ACKNOWLEDGE, "gone", "opened").exit_code == 3


# -- session and controller: every interleaving ---------------------------------------------------------------------------

RUN: tuple[SessionEvent, ...] = (
    STARTED,
    PromptShown(1, DISABLE_HIGH_VOLTAGE),
    PromptAnswered(1, "done"),
    PromptShown(2, ENABLE_HIGH_VOLTAGE),
    PromptAnswered(2, "done"),
    BenchArmed(),
    DriveStarted(SINE),
)


class Session:
    """A session whose thread takes a step when the test says so, and may hang; requests are queued as by the real one."""

    def __init__(self, observe: Callable[[SessionEvent], None]) -> None:
        self.observe = observe
        self.state, self.at = "new", 0
        self.requests: list[str] = []
        self.stopping = self.closing = self.hangs = self.abandoned = False
        self.patience_over = False
        self.bench, self.observation = None, Observation()

    def start(self) -> None:
        assert self.state == "new", "a thread is started once"
        self.state = "connecting"

    def run(self, _request: object) -> None:
        assert self.state != "ended", "nobody takes a run from a session that has ended"
        self.stopping = False
        self.requests.append("run")

    def stop(self) -> None:
        self.stopping = True

    def close(self, _timeout_s: float | None = None) -> bool:
        if not self.closing:
            self.requests.append("close")
        self.closing = self.stopping = True
        return self.state in ("new", "ended")

    def pause(self) -> None: ...

    def resume(self) -> None: ...

    def monitor(self, active: bool) -> None: ...

    def inject_event(self, event: object) -> None: ...

    def supervise(self) -> None:
        """Give up a thread that hangs, as the supervisor of a session does after its deadlines."""
        if self.hangs and self.patience_over and self.stopping and not self.abandoned:
            self.abandoned = True
            if self.state == "running":
                self.observe(RestMeasured(False, float("nan"), "a driver hangs"))
                self.observe(HUNG)
            self.observe(GONE)

    # -- what the thread does

    def steps(self) -> tuple[str, ...]:
        """Names of the steps that the thread can take."""
        if self.hangs:
            return () if self.patience_over else ("patience",)
        match self.state:
            case "connecting":
                return "open", "fail", "hang"
            case "running":
                return (*(("go on",) if not self.stopping and self.at < len(RUN) else ("rest", "no rest")), "hang")
            case "idle" if self.requests:
                return (*(("begin", "refuse") if self.requests[0] == "run" else ("end",)), "hang")
        return ()

    def take(self, step: str) -> None:
        match step:
            case "open":
                self.state = "idle"
                self.observe(OPENED)
            case "fail":
                self.state = "ended"
                self.observe(GONE)
            case "begin":
                self.requests.pop(0)
                self.state, self.at = "running", 0
            case "refuse":
                self.requests.pop(0)
                self.observe(RunRejected("the folder is read-only"))
            case "go on":
                self.observe(RUN[self.at])
                self.at += 1
            case "rest" | "no rest":
                self.state = "idle"
                measured = (AT_REST, STOPPED) if step == "rest" else (NOT_AT_REST, UNSAFE)
                for event in (ShutdownStarted(), *measured):
                    self.observe(event)
            case "end":
                self.state = "ended"
                for request in self.requests[1:]:
                    if request == "run":
                        self.observe(RunRejected("the bench was closed"))
            case "hang":
                self.hangs = True
            case "patience":
                self.patience_over = True


class Job:
    """A commissioning that ends when the test says so."""

    error, result = "stopped", None

    def __init__(self) -> None:
        self.started = self.ended = False

    def start(self) -> None:
        self.started = True

    def stop(self) -> None: ...


OPERATOR = ("run", "stop", "connect", "speed", "acknowledge", "commission", "close")


class World:
    """Controller and session after a sequence of steps of operator, bench thread and window."""

    def __init__(self, *path: str) -> None:
        self.sessions: list[Session] = []
        self.adapter = SessionAdapter(lambda: pytest.fail("nothing connects"), self._make, SimulationSettings(1.0))
        view = initial_window_state(AmplifierMap(), "bench", True, ROLES)
        self.controller = SessionController(self.adapter, view)
        self.adapter.session.start()
        self.speed = 1.0
        for each in path:
            self.take(each)

    def _make(self, _connect: object, observers: list[Any], _operator: object) -> Any:
        self.sessions.append(Session(observers[0]))
        return self.sessions[-1]

    @property
    def session(self) -> Session:
        return self.sessions[-1]

    def steps(self) -> Iterator[str]:
        """Yield what can happen next."""
        yield from self.session.steps()
        yield "tick"
        if self.controller.closing:
            return
        yield from OPERATOR
        if self.controller.commissioning is not None and self.controller.commissioning.started:
            yield "commissioned"

    def take(self, step: str) -> None:
        controller = self.controller
        match step:
            case "tick":
                for session in self.sessions:
                    session.supervise()
                controller.process_events()
            case "run":
                controller.start_run(SineDwell(), Path(), "T1")
            case "stop":
                controller.stop()
            case "connect":
                controller.reconnect()
            case "speed":
                self.speed = 3.0 - self.speed
                controller.change_speed(self.speed)
            case "acknowledge":
                controller.acknowledge()
            case "commission":
                controller.commission(Job())  # type: ignore[arg-type]
            case "commissioned":
                controller.commissioning.ended = True  # type: ignore[union-attr, misc]
            case "close":
                controller.close()
            case _:
                self.session.take(step)

    def key(self) -> Hashable:
        session, controller, job = self.session, self.controller, self.controller.commissioning
        waiting = self.adapter._events.qsize()
        return (
            key_of(controller.state), waiting, controller.closing, controller._reconnecting, controller._queued is None,
            job is not None and (job.started, job.ended), session.state, session.at, tuple(session.requests),
            session.stopping, session.closing, session.hangs, session.abandoned, session.patience_over,
        )  # fmt: skip

    def settle(self, choose: str = "") -> None:
        """Let bench and window go on until nothing happens any more; a `choose`n step is taken where it can be."""
        for _ in range(60):
            before = self.key()
            self.take("tick")
            job = self.controller.commissioning
            steps = [each for each in self.session.steps() if each not in ("hang", "fail", "refuse", "no rest")]
            if choose in self.session.steps():
                steps = [choose]
            if steps:
                self.take(steps[0])
            elif job is not None and job.started:
                self.take("commissioned")
            elif self.key() == before:
                return
        raise AssertionError("it never settles")


def assert_way_out(path: tuple[str, ...], result: str) -> None:
    """Stop, connect, run and close after a path; the bench comes to rest, or does not."""
    world = World(*path, "tick")
    if not world.controller.closing:
        world.take("stop")
        world.settle(result)
        view = world.controller.state
        assert not view.busy, "Stop ends the run"
        assert not view.queued or not view.connected
        world.take("acknowledge")
        world.take("connect")
        world.settle()
        view = world.controller.state
        assert view.connected or view.problem, "Connect connects, or says why not"
        world.take("acknowledge")
        if view.connected:
            world.take("run")
            world.take("tick")
            assert "run" in world.session.requests, "a run begins"
        world.take("close")
    world.settle(result)
    assert world.controller.released, "Close closes"


def explore(depth: int) -> Iterator[tuple[str, ...]]:
    """Yield the shortest path to every state that at most `depth` steps lead to; all there are where that is no limit."""
    found, ahead = {World().key()}, [()]
    for _ in range(depth):
        yield from ahead
        steps = [(*path, each) for path in ahead for each in World(*path).steps()]
        later = {World(*path).key(): path for path in steps}
        ahead = [path for key, path in later.items() if key not in found]
        found |= set(later)
    assert not ahead or depth < ENOUGH, "there is no end to the states"


@pytest.mark.parametrize(("depth", "least"), [(6, 100), pytest.param(ENOUGH, 2000, marks=pytest.mark.deep)])
def test_every_state_of_session_and_window_has_a_way_out(depth: int, least: int) -> None:
    paths = list(explore(depth))
    assert len(paths) > least
    for path in paths:
        for result in ("rest", "no rest", "hang"):
            try:
                assert_way_out(path, result)
            except AssertionError as error:
                raise AssertionError(f"after {', '.join(path)}; then {result}: {error}") from error


@pytest.mark.one_in(1)
@pytest.mark.parametrize("press", ["run", "stop", "connect"])
def test_a_run_during_a_reconnect_waits_and_begins_when_the_bench_is_connected(press: str) -> None:
    world = World("open", "tick", "speed", "tick", "run", "tick", *(() if press == "run" else (press,)))
    world.settle("none")
    assert len(world.sessions) == 2
    assert world.sessions[0].at == 0, "the session that is closed gets no run"
    assert (world.sessions[1].at > 0) is (press != "stop")


# -- the real session -------------------------------------------------------------------------------------------------------


def test_a_slow_close_and_a_run_meanwhile_hang_nothing(tmp_path: Path) -> None:
    """Another speed and Run within half a second: the old session, which is still closing, must not get the run."""
    may_close = threading.Event()

    @contextmanager
    def slowly() -> Iterator[Any]:
        with connect(simulated(), None) as lab:
            yield lab
            may_close.wait(60)

    adapter = SessionAdapter(slowly, simulation=SimulationSettings(1.0))
    controller = SessionController(adapter, initial_window_state(AmplifierMap(), "bench", True, ROLES))

    def until(condition: Callable[[], object]) -> None:
        assert wait_until(lambda: controller.process_events() or condition())

    adapter.session.start()
    until(lambda: controller.can_start)
    controller.change_speed(2.0)
    controller.start_run(SHORT, tmp_path, "T1")
    assert controller.state.queued == SHORT.title
    controller.process_events()
    assert not controller.state.busy
    may_close.set()
    until(lambda: controller.state.outcome is not None)
    assert controller.state.outcome is not None
    assert controller.state.outcome.status is RunStatus.COMPLETED
    controller.close()
    until(lambda: controller.released)


def test_a_run_that_is_requested_of_a_bench_that_is_being_closed_is_rejected_in_words(tmp_path: Path) -> None:
    events: list[SessionEvent] = []
    held = threading.Event()

    @contextmanager
    def opened() -> Iterator[Any]:
        with connect(simulated(), None) as lab:
            yield lab
            held.wait(60)

    session = RealSession(opened, [events.append], operator=None)  # type: ignore[arg-type]
    session.start()
    assert not session.close(0.0)
    session.run(RunRequest(SHORT, tmp_path, "T1"))
    held.set()
    assert session.finished.wait(60)
    assert session.close(60)
    rejected = [event.words for event in events if isinstance(event, RunRejected)]
    assert len(rejected) == 1
    assert_names(rejected[0], "bench", "closed")
    session.run(RunRequest(SHORT, tmp_path, "T1"))
    assert len([event for event in events if isinstance(event, RunRejected)]) == 2
    assert session.finished.is_set()


def test_what_the_old_session_still_says_is_not_taken_for_the_new_one() -> None:
    world = World("open", "connect", "tick")
    assert not world.controller.state.connected, "it was the session that is being closed which opened its bench"
    world.take("run")
    assert world.controller.state.queued
    world.settle("none")
    assert (world.sessions[0].at, world.sessions[1].at > 0) == (0, True)


def test_a_driver_that_hangs_while_the_bench_is_released_does_not_keep_the_window(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Deadline.BENCH_CLOSING, "seconds", 0.0)
    released, events = threading.Event(), []

    @contextmanager
    def opened() -> Iterator[Any]:
        with connect(simulated(), None) as lab:
            yield lab
            released.wait(60)

    session = RealSession(opened, [events.append], operator=None)  # type: ignore[arg-type]
    session.start()
    assert wait_until(lambda: session.state is SessionState.IDLE)
    assert not session.abandoned
    assert not session.close(0.0)
    assert wait_until(lambda: session.abandoned and bool(events))
    assert wait_until(lambda: isinstance(events[-1], BenchFailed))
    released.set()
    session._thread.join(60)


def test_scans_lost_between_runs_end_nothing() -> None:
    events: list[SessionEvent] = []
    labs: list[Any] = []

    @contextmanager
    def opened() -> Iterator[Any]:
        with connect(simulated(), None) as lab:
            labs.append(lab)
            yield lab

    session = RealSession(opened, [events.append], operator=None)  # type: ignore[arg-type]
    session.monitor(active=True)
    session.start()

    def blocks() -> int:
        return sum(isinstance(event, BlockMonitored) for event in events)

    assert wait_until(blocks)
    labs[0].control.inject("card-overrun")
    assert wait_until(lambda: labs[0].bench.reading.age_s(time.monotonic()) > 0.2)
    labs[0].control.clear()
    before = blocks()
    assert wait_until(lambda: blocks() > before)
    assert not any(isinstance(event, MonitorFailed) for event in events)
    assert session.close(60)


def test_what_the_card_measured_last_outlives_its_session() -> None:
    world = World("open")
    world.session.observation = seen = Observation(SEEN["0 V"])
    assert world.adapter.observation is seen
    world.session.observation = Observation()
    assert world.adapter.observation is seen
