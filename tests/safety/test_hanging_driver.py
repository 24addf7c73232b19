"""A driver that hangs: the watchdog brings the source to rest, and Ctrl-C ends the program all the same."""

import signal
import threading
import time
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from app.common.exit_codes import ExitCode
from app.session.bench_connection import connect
from app.session.session import BenchFailed, Session, SessionState
from app.session.supervisor import Rescue, Signs, Supervisor
from drivers.bench.watchdog_interface import NoWatchdog
from drivers.deadlines import Deadline, in_progress
from drivers.errors import MANUAL_SHUTDOWN_INSTRUCTIONS
from drivers.interfaces import Block
from protocols.base import LogMessage, RunEnded, RunStatus
from protocols.measurements.sine_dwell import SineDwell
from protocols.runner.request import RunRequest
from tests.helpers.messages import assert_names
from tests.helpers.program import program, safe
from tests.helpers.simulated_bench import assert_safe_voltage, laboratory, simulated

HANGS = """
import sys, threading
from drivers.bench.armed_bench import ArmedBench
from drivers.generators.keysight import Keysight33500

test_source = ArmedBench.test_source

def {method}(*_):
    threading.Event().wait()

def tested(*arguments):
    test_source(*arguments)
    Keysight33500.{method} = {method}

ArmedBench.test_source = tested
sys.argv[1:] = ["--bench", "bench.toml", "--out", ".", "run", "sine-dwell", "--set", "frequencies_hz=100"]
sys.argv += ["--without-commissioning", "simulated bench on its wires"]
from app.cli.main import entry
entry()
"""


@pytest.mark.deep
@pytest.mark.parametrize("method", ["start_drive", "stop"])
def test_ctrl_c_ends_a_program_whose_driver_hangs_after_the_watchdog_brought_the_source_to_rest(
    method: str, tmp_path: Path
) -> None:
    with program(tmp_path, script=HANGS.format(method=method)) as (run, _):
        run.arm()
        run.wait_for("high voltage is on")
        time.sleep(3.0)
        begin_s = time.monotonic()
        run.process.send_signal(signal.SIGINT)
        assert run.end() == ExitCode.UNSAFE, run.text
        took_s = time.monotonic() - begin_s
        assert_names(run.text, "driver", "hangs")
        assert MANUAL_SHUTDOWN_INSTRUCTIONS in run.text
        assert took_s < 40.0
        deadline = time.monotonic() + 20.0
        while not run.bench.report().ends_at_rest and time.monotonic() < deadline:
            time.sleep(0.1)
        safe(run.bench)


def test_a_driver_that_hangs_while_the_bench_connects_does_not_keep_the_program(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Deadline.STOP_ANSWER, "seconds", 0.05)
    over = threading.Event()

    @contextmanager
    def connect():
        over.wait()
        yield

    events: list[object] = []
    session = Session(connect, [events.append], None, ends_at_stop=True)  # type: ignore[arg-type]
    session.start()
    assert not session.finished.wait(0.3), "it was not to stop yet"
    session.stop()
    assert session.finished.wait(30.0)
    assert session.state is SessionState.NO_BENCH
    assert not session.close()
    assert type(events[-1]) is BenchFailed
    over.set()
    session._thread.join()


def test_a_bench_that_never_opens_is_given_up_without_a_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Deadline.BENCH_OPENING, "seconds", 0.05)
    over = threading.Event()

    @contextmanager
    def connect():
        over.wait()
        yield

    events: list[object] = []
    session = Session(connect, [events.append], None)  # type: ignore[arg-type]
    session.start()
    assert session.finished.wait(30.0)
    assert session.abandoned
    assert isinstance(events[-1], BenchFailed)
    assert_names(events[-1].words, "driven")
    over.set()
    session._thread.join()


class _HangingStream:
    """A card's stream that never returns a block."""

    rate_hz, scales = 1e4, ()

    def __init__(self, over: threading.Event, begun: threading.Event) -> None:
        self._over, self._begun = over, begun

    def __enter__(self) -> "_HangingStream":
        return self

    def __exit__(self, *_: object) -> None: ...

    def read(self) -> Block:
        with in_progress(Deadline.CARD_DRIVER):
            self._begun.set()
            self._over.wait()
        return Block(0, np.zeros((2, 1), np.int16))


@pytest.mark.parametrize("stopped", [True, False])
def test_a_card_that_hangs_between_runs_does_not_keep_the_program(
    stopped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    over, begun = threading.Event(), threading.Event()
    events: list[object] = []
    with connect(simulated(), None) as connection:
        monkeypatch.setattr(type(connection.bench), "open_stream", lambda *_: _HangingStream(over, begun))
        session = Session(lambda: nullcontext(connection), [events.append], None)  # type: ignore[arg-type]
        session.start()
        session.monitor(active=True)
        assert begun.wait(30.0)
        monkeypatch.setattr(Deadline.EARLY_STOP if stopped else Deadline.CARD_DRIVER, "seconds", 0.05)
        if stopped:
            session.stop()
        assert session.finished.wait(30.0)
        assert session.abandoned
        assert session.state is SessionState.NO_BENCH
        assert isinstance(events[-1], BenchFailed)
        over.set()
        session.close()
        session._thread.join()


@pytest.mark.parametrize("stopped", [False, True])
@pytest.mark.parametrize("method", ["is_at_rest", "initialize_at_rest", "start_drive"])
def test_a_generators_driver_that_hangs_before_high_voltage_ends_the_run_in_a_sentence_with_cause_and_remedy(
    method: str, stopped: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    over, begun = threading.Event(), threading.Event()

    def hangs(*_: object) -> None:
        begun.set()
        over.wait()
        raise SystemExit

    events: list[object] = []
    with connect(simulated(), None) as connection:
        monkeypatch.setattr(connection.bench.amplifier._source, method, hangs)
        session = Session(lambda: nullcontext(connection), [events.append], None)  # type: ignore[arg-type]
        try:
            session.start()
            session.run(RunRequest(SineDwell(), tmp_path, "T1"))
            assert begun.wait(30.0)
            monkeypatch.setattr(Deadline.EARLY_STOP if stopped else Deadline.SOURCE_SETUP, "seconds", 0.05)
            if stopped:
                session.stop()
            assert session.finished.wait(30.0)
        finally:
            over.set()
            session.close()
            session._thread.join()
        assert not connection.control.report().live_s
    assert session.outcome is not None
    assert session.outcome.status is (RunStatus.STOPPED if stopped else RunStatus.FAILED)
    assert isinstance(events[-1], BenchFailed)
    for words in (session.outcome.reason, events[-1].words):
        assert_names(words, "generator", "driver", "voltage", "switch", "cable")


@pytest.mark.one_in(1)  # both sides of each deadline
@pytest.mark.parametrize(
    ("signs", "given_up"),
    [
        (Signs(running=True, may_be_live=True, silent_s=14.9), False),
        (Signs(running=True, may_be_live=True, silent_s=15.1), True),
        (Signs(running=True, may_be_live=False, silent_s=15.1), False),
        (Signs(running=False, may_be_live=True, silent_s=15.1), False),  # of the run before
        (Signs(call_overdue_s=-0.1), False),
        (Signs(call_overdue_s=0.1), True),
        (Signs(connecting=True, quiet_s=119.0), False),
        (Signs(connecting=True, quiet_s=121.0), True),
        (Signs(running=True, quiet_s=1e4), False),  # a long analysis
        (Signs(connecting=True, quiet_s=2.0, stopped_s=1.4), False),
        (Signs(connecting=True, quiet_s=2.0, stopped_s=1.6), True),
        (Signs(connecting=True, quiet_s=1.4, stopped_s=2.0), False),
        (Signs(running=True, quiet_s=2.0, stopped_s=2.0), True),  # not armed yet
        (Signs(running=True, at_end=True, quiet_s=59.0, stopped_s=70.0), False),
        (Signs(running=True, at_end=True, quiet_s=61.0, stopped_s=61.0), True),
        (Signs(running=True, may_be_live=True, quiet_s=59.0, stopped_s=59.0), False),
        (Signs(running=True, may_be_live=True, quiet_s=61.0, stopped_s=61.0), True),
        (Signs(watching_card=True, quiet_s=1.6, stopped_s=1.6), True),
        (Signs(quiet_s=1e4, stopped_s=1e4), False),  # idle
        (Signs(closing_s=1e4, quiet_s=14.9), False),  # it still reports
        (Signs(closing_s=14.9, quiet_s=1e4), False),
        (Signs(closing_s=15.1, quiet_s=15.1), True),
        (Signs(told_unsafe=True, quiet_s=14.9), False),
        (Signs(told_unsafe=True, quiet_s=15.1), True),
    ],
)
def test_a_session_is_given_up_beyond_its_deadlines_alone(signs: Signs, given_up: bool) -> None:
    assert bool(signs.hang(Deadline.STOP_ANSWER)) is given_up


def test_the_signs_of_a_session_count_from_the_first_stop_and_from_its_own_last_event(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    now_s = 100.0
    clock = SimpleNamespace(monotonic=lambda: now_s, sleep=time.sleep)
    monkeypatch.setattr("app.session.session.time", clock)
    session = Session(nullcontext, [], None)  # type: ignore[arg-type]
    session.stop()
    now_s = 103.0
    session.stop()
    session.say(LogMessage("the stop waits"))  # of the supervisor
    assert (session.signs().stopped_s, session.signs().quiet_s) == (3.0, 3.0)
    session._events.publish(LogMessage("a sign of life"))
    assert session.signs().quiet_s == 0.0
    session.run(RunRequest(SineDwell(), tmp_path, "T1"))
    assert session.signs().stopped_s < 0, "a stop before the request is not of this run"

    session.close(0.0)
    now_s = 105.0
    session.close(0.0)
    assert session.signs().closing_s < 0, "while it connects"
    session.state = SessionState.IDLE
    assert session.signs().closing_s == 2.0

    session.outcome = RunEnded(RunStatus.UNSAFE, "the card sees 3 V", "")
    assert session.signs().told_unsafe
    session.finished.set()
    assert not session.signs().told_unsafe

    for watchdog, acts in ((NoWatchdog(), False), (NoWatchdog("the bench file disables it"), True)):
        session.bench = SimpleNamespace(watchdog=watchdog)  # type: ignore[assignment]
        assert session.signs().watchdog_acts is acts


class Asked(NoWatchdog):
    """A watchdog that brings the source to rest, or cannot, and keeps what it is asked and told."""

    def __init__(self, obeys: bool) -> None:
        super().__init__()
        self._obeys, self.heard = obeys, list[str]()

    def request_rest(self, reason: str, /) -> str:
        self.heard.append(reason)
        self.brought_to_rest = self._obeys
        return "the source rests" if self._obeys else "no answer"

    def log(self, message: str) -> None:
        self.heard.append(message)


def test_a_watchdog_that_has_taken_the_source_over_is_not_asked_again() -> None:
    with laboratory() as lab:
        lab.bench.watchdog = watchdog = Asked(True)
        watchdog.takeover_outcome, watchdog.brought_to_rest = "it rests after 0.31 s", True
        runner = SimpleNamespace(
            may_be_live=True, give_up=lambda status, reason: RunEnded(status, reason, "run.h5"), path=Path("run.h5")
        )
        rescue = Rescue()
        rescue.end_run(runner, lab.bench, RunStatus.FAILED, "The disk hangs")  # type: ignore[arg-type]
        rescue.close()
    (logged,) = watchdog.heard
    assert "0.31 s" in logged


@pytest.mark.one_in(1)
@pytest.mark.parametrize(("live", "obeys"), [(True, True), (True, False), (False, False)])
def test_the_rescue_of_a_run_that_hangs_asks_the_watchdog_first_and_commands_the_source_if_that_cannot(
    live: bool, obeys: bool
) -> None:
    ends: list[RunEnded] = []
    watchdog, rescue = Asked(obeys), Rescue()

    def give_up(status: RunStatus, reason: str) -> RunEnded:
        ends.append(RunEnded(status, reason, "run.h5"))
        return ends[-1]

    with laboratory() as lab:
        lab.bench.amplifier.initialize_at_rest()
        lab.control.enable_hv()
        lab.bench.amplifier._source.ramp_to(3.0, 0.3)
        scpi = lab.bench.amplifier._source._scpi  # type: ignore[attr-defined]
        opened, reopen = list[str](), scpi.link.reopen
        scpi.link.reopen = lambda: (
            opened.append("anew"),
            reopen(),
        )  # the thread that hangs may hold the old connection
        lab.bench.watchdog = watchdog
        runner = SimpleNamespace(may_be_live=live, give_up=give_up, path=Path("run.h5"))
        ended = rescue.end_run(runner, lab.bench, RunStatus.STOPPED, "The disk hangs")  # type: ignore[arg-type]
        rescue.close()
        assert ends == [ended]
        is_commanded = lab.control.report().ends_at_rest
        lab.bench.amplifier.force_rest()
        assert_safe_voltage(lab.control.report())
    assert bool(opened) == (live and not obeys)
    assert is_commanded == (live and not obeys), "two must not command the source in turn"
    assert ended.status is (RunStatus.UNSAFE if live else RunStatus.STOPPED)
    assert "The disk hangs" in ended.reason
    if live:
        assert MANUAL_SHUTDOWN_INSTRUCTIONS in ended.reason
        assert watchdog.heard[0] == "The disk hangs"
        assert "The disk hangs" in watchdog.heard[1]
    else:
        assert watchdog.heard == []


class Noted:
    """A session that notes what the supervisor does."""

    def __init__(self) -> None:
        self.done: list[str] = []

    def signs(self) -> Signs:
        return Signs()

    @property
    def runner(self) -> "Noted":
        return self

    def live_warning(self, _reason: str) -> str:
        return "warned"

    def say(self, event: object) -> None:
        self.done.append(event if isinstance(event, str) else "said")

    def give_up(self, hangs: str) -> None:
        self.done.append("given-up")


LIVE = Signs(running=True, may_be_live=True)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("signs", "done"),
    [
        ([replace(LIVE, silent_s=0.2, watchdog_acts=True)], []),
        ([replace(LIVE, silent_s=0.4)], []),  # a busy computer: the watchdog knows
        ([replace(LIVE, silent_s=0.4, watchdog_acts=True)] * 3, ["warned"]),
        ([replace(LIVE, silent_s=0.4, watchdog_acts=True, may_be_live=False)], []),
        ([replace(LIVE, silent_s=0.4, watchdog_acts=True, running=False)], []),
        ([replace(LIVE, silent_s=0.4, watchdog_acts=True), Signs()] * 2, ["warned", "warned"]),
        ([replace(LIVE, silent_s=0.4, watchdog_acts=True), LIVE] * 2, ["warned"]),  # once in a run
        ([replace(LIVE, quiet_s=1.6, stopped_s=1.6)] * 3, ["said"]),
        ([replace(LIVE, quiet_s=1.6, stopped_s=1.4)], []),
        ([replace(LIVE, silent_s=15.1, watchdog_acts=True)], ["warned", "given-up"]),
    ],
)
def test_the_supervisor_warns_and_answers_once(signs: list[Signs], done: list[str]) -> None:
    session = Noted()
    supervisor = Supervisor(session, Deadline.STOP_ANSWER)
    for each in signs:
        supervisor.look(each)
    assert session.done == done


def test_a_computer_that_stood_still_is_no_run_that_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    session, now_s = Noted(), 100.0
    supervisor = Supervisor(session, Deadline.STOP_ANSWER)
    monkeypatch.setattr("app.session.supervisor.time.monotonic", lambda: now_s)
    for _ in range(2):  # the second one is counted from the sign of life between them
        supervisor.look(LIVE)
        now_s += 20.0  # nothing ran, the supervisor neither
        supervisor.look(replace(LIVE, silent_s=19.0))
    now_s -= 20.0
    supervisor._looked_s -= 20.0
    assert session.done == []
    while now_s < 134.0:
        now_s += 0.1
        supervisor.look(replace(LIVE, silent_s=now_s - 101.0))
    assert session.done == []
    while "given-up" not in session.done and now_s < 140.0:
        now_s += 0.1
        supervisor.look(replace(LIVE, silent_s=now_s - 101.0))
    assert session.done[-1] == "given-up"
    assert now_s < 136.5
