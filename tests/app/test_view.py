"""Window state: a function of the events alone; it never claims more than is known."""

from dataclasses import replace
from datetime import UTC, datetime

import pytest

from app.session.reducer import reduce
from app.session.session import BenchFailed, BenchOpened, InstrumentAwaited, RunRejected
from app.session.state import (
    BenchState,
    Lamp,
    OperatorAction,
    RunProgress,
    RunRequested,
    TimedEvent,
    WindowEvent,
    WindowState,
    initial_window_state,
)
from drivers.drive_shapes import Sine
from model.amplifier_map import AmplifierMap
from protocols.base import (
    DISABLE_HIGH_VOLTAGE,
    ENABLE_HIGH_VOLTAGE,
    BenchArmed,
    CheckResult,
    DriveReadbackChanged,
    DriveStarted,
    LogMessage,
    Outcome,
    PointMeasured,
    ProgressUpdated,
    PromptAnswered,
    PromptShown,
    Quality,
    RestMeasured,
    RunEnded,
    RunStarted,
    RunStatus,
    SettlingFinished,
    ShutdownStarted,
    StreamStarted,
    Verdict,
)
from protocols.measurements.sine_dwell import SinePoint

pytestmark = pytest.mark.one_in(1)

WHEN = datetime(2026, 11, 21, 9, 15, tzinfo=UTC)
ROLES = {"generator": "Keysight 33511B #1", "amplifier": "AMT2012", "card": "NI USB-6341 #2", "sensor": "laser"}
OPENED = BenchOpened("bench", True, ROLES)
STARTED = RunStarted("sine-dwell", "/somewhere/run.h5", 27.0, 18, True)
SINE = Sine(160.0, 2.5, 2.5, 1000)
BEGUN = (OPENED, RunRequested("Sine dwell"), STARTED)
LIVE = (*BEGUN, BenchArmed(), DriveStarted(SINE))
AT_REST = RestMeasured(True, 2.5, "the card sees 2.500 V")
NOT_AT_REST = RestMeasured(False, 0.0, "the card sees 0.000 V")
COMPLETED = RunEnded(RunStatus.COMPLETED, "all points measured", "run.h5")
STOPPED = RunEnded(RunStatus.STOPPED, "stopped by the operator", "run.h5")
FAILED = RunEnded(RunStatus.FAILED, "function generator 33511B: no answer; check its cable to the card", "run.h5")
UNSAFE = RunEnded(RunStatus.UNSAFE, "UNSAFE: switch the high voltage off by hand", "run.h5")
POLARITY = CheckResult("polarity", -1.0, "1", 1.0, None, "swap the sign", Outcome.DID_NOT_PASS)
DRIVE_GONE = DriveReadbackChanged(True, -0.0001, 0.0002)
LOST = (*LIVE, ShutdownStarted(), NOT_AT_REST, UNSAFE)


def point(quality: Quality = Quality.SIMULATED) -> SinePoint:
    return SinePoint(
        160.0, 1.1157e-3, 1e-6, 5.577e-4, 1e-8, 0, 0, 0.1, (5.6e-4,), 2.5, 2.5, 0, 0, 1e-6, 80, int(quality)
    )


def view_after(*events: WindowEvent) -> WindowState:
    view = initial_window_state(AmplifierMap(), "bench", True, ROLES)
    for event in events:
        view = reduce(view, TimedEvent(event, WHEN))
    return view


@pytest.mark.parametrize(
    ("events", "state"),
    [
        ((), BenchState.CONNECTING),
        ((OPENED,), BenchState.IDLE),
        ((BenchFailed("no generator"),), BenchState.NO_BENCH),
        ((BenchFailed("no generator"), OperatorAction.RECONNECT), BenchState.CONNECTING),
        (BEGUN, BenchState.ARMING),
        ((*BEGUN, PromptShown(1, DISABLE_HIGH_VOLTAGE)), BenchState.ARMING),
        ((*BEGUN, PromptShown(2, ENABLE_HIGH_VOLTAGE)), BenchState.LIVE),
        (LIVE, BenchState.LIVE),
        ((*LIVE, OperatorAction.STOP), BenchState.GOING_TO_REST),
        ((*LIVE, OperatorAction.STOP, DriveStarted(SINE)), BenchState.GOING_TO_REST),
        ((OPENED, RunRequested("x"), OperatorAction.STOP, STARTED, BenchArmed()), BenchState.GOING_TO_REST),
        ((*LIVE, ShutdownStarted()), BenchState.GOING_TO_REST),
        ((*LIVE, ShutdownStarted(), AT_REST), BenchState.AT_REST),
        ((*LIVE, ShutdownStarted(), AT_REST, COMPLETED), BenchState.AT_REST),
        ((*LIVE, DRIVE_GONE), BenchState.DRIVE_LOST),
        ((*LIVE, DRIVE_GONE, OperatorAction.STOP), BenchState.DRIVE_LOST),
        ((*LIVE, OperatorAction.STOP, DRIVE_GONE), BenchState.GOING_TO_REST),
        ((*BEGUN, FAILED), BenchState.IDLE),
        ((*LIVE, ShutdownStarted(), NOT_AT_REST), BenchState.UNSAFE),
        ((*LIVE, ShutdownStarted(), NOT_AT_REST, OperatorAction.STOP), BenchState.UNSAFE),
        (LOST, BenchState.UNSAFE),
        ((*LOST, OperatorAction.ACKNOWLEDGE), BenchState.UNSAFE),
        ((*LOST, OperatorAction.ACKNOWLEDGE, RunRequested("x"), STARTED, FAILED), BenchState.UNSAFE),
        ((*LOST, OperatorAction.ACKNOWLEDGE, *(RunRequested("x"), STARTED, FAILED) * 2), BenchState.UNSAFE),
        ((*LOST, OperatorAction.ACKNOWLEDGE, RunRequested("x"), RunRejected("no permission")), BenchState.UNSAFE),
        ((*LOST, OperatorAction.ACKNOWLEDGE, RunRequested("x"), STARTED, BenchArmed()), BenchState.LIVE),
        ((*LOST, BenchFailed("gone")), BenchState.UNSAFE),
        ((*LOST, BenchFailed("gone"), OperatorAction.RECONNECT), BenchState.UNSAFE),
        ((*LOST, BenchFailed("gone"), OperatorAction.RECONNECT, OPENED), BenchState.UNSAFE),
    ],
)
def test_the_bench_state_says_what_is_known(events: tuple[WindowEvent, ...], state: BenchState) -> None:
    assert view_after(*events).bench_state is state


VERDICTS = [
    (Verdict(Outcome.GOOD), "plain-good", ""),
    (
        Verdict(Outcome.NO_RESULT, ("no usable point of 18 (18 out of range); bring the target into the range",)),
        "attention",
        "No result: no usable point of 18 (18 out of range); bring the target into the range",
    ),
    (
        Verdict(Outcome.DID_NOT_PASS, ("polarity: -1, limit at least 1; swap the sign",), (POLARITY,)),
        "bad",
        "Did not pass: polarity\nPolarity: -1, limit at least 1; swap the sign",
    ),
    (Verdict(Outcome.DOUBTFUL, tuple("abcde")), "attention", "Doubtful: a\nB\nC\n… and 2 more in the log"),
]


@pytest.mark.parametrize(("verdict", "severity", "notice"), VERDICTS)
def test_a_verdict_that_is_not_good_stays_until_it_is_dismissed(verdict: Verdict, severity: str, notice: str) -> None:
    ended = replace(COMPLETED, verdict=verdict)
    view = view_after(*LIVE, ShutdownStarted(), AT_REST, ended)
    assert view.verdict_message == notice
    assert severity.endswith(view.messages[-1].severity)
    assert view.messages[-1].text.casefold().startswith(verdict.outcome)
    for dismissed in (OperatorAction.ACKNOWLEDGE, RunRequested("Sine dwell")):
        assert view_after(*LIVE, ended, dismissed).verdict_message == ""


def test_the_unsafe_sentence_stays_until_it_is_acknowledged() -> None:
    later = (LogMessage("something else"), BenchFailed("the bench is gone"), OperatorAction.RECONNECT, OPENED)
    view = view_after(*LOST, *later)
    assert view.unsafe == UNSAFE.reason
    assert not view.can_run
    assert reduce(view, TimedEvent(OperatorAction.ACKNOWLEDGE, WHEN)).unsafe == ""


@pytest.mark.parametrize(
    ("events", "code"),
    [
        ((OPENED,), 0),
        ((BenchFailed("x"),), 1),
        ((*LIVE, AT_REST, COMPLETED), 0),
        ((*LIVE, AT_REST, STOPPED), 0),
        ((*LIVE, AT_REST, FAILED), 1),
        ((*LIVE, AT_REST, FAILED, RunRequested("x"), STARTED, BenchArmed(), AT_REST, COMPLETED), 0),
        ((OPENED, RunRequested("x"), RunRejected("no permission")), 1),
        (LOST, 3),
        ((*LOST, OperatorAction.ACKNOWLEDGE), 3),
        ((*LOST, OperatorAction.ACKNOWLEDGE, RunRequested("x"), STARTED, FAILED), 3),
        ((*LOST, OperatorAction.ACKNOWLEDGE, RunRequested("x"), STARTED, BenchArmed(), AT_REST, COMPLETED), 0),
    ],
)
def test_the_exit_code_follows_the_last_outcome(events: tuple[WindowEvent, ...], code: int) -> None:
    assert view_after(*events).exit_code == code


@pytest.mark.parametrize(
    ("events", "can_run", "busy"),
    [
        ((), False, False),
        ((OPENED,), True, False),
        ((OPENED, RunRequested("x")), False, True),
        (LIVE, False, True),
        ((*LIVE, AT_REST, COMPLETED), True, False),
        ((OPENED, RunRequested("x"), RunRejected("no")), True, False),
        (LOST, False, False),
        ((*LOST, OperatorAction.ACKNOWLEDGE), True, False),
        ((*LOST, BenchFailed("gone"), OperatorAction.ACKNOWLEDGE), False, False),
        ((OPENED, BenchFailed("x")), False, False),
    ],
)
def test_a_run_may_begin_only_on_an_open_bench_that_nobody_uses(
    events: tuple[WindowEvent, ...], can_run: bool, busy: bool
) -> None:
    view = view_after(*events)
    assert (view.can_run, view.busy) == (can_run, busy)


def test_lamps_tell_what_is_known_of_each_instrument() -> None:
    def lamps(*events: WindowEvent) -> dict[str, Lamp]:
        return {i.role: i.lamp for i in view_after(*events).instruments}

    assert set(lamps().values()) == {Lamp.WAITING}
    asked = InstrumentAwaited("generator"), InstrumentAwaited("card")
    assert [i.role for i in view_after(*asked).instruments if i.remark] == ["card"]
    assert not any(i.remark for i in view_after(*asked, BenchFailed("x"), OperatorAction.RECONNECT).instruments)
    assert set(lamps(OPENED).values()) == {Lamp.READY}
    assert set(lamps(BenchFailed("x")).values()) == {Lamp.MISSING}
    after_failure = lamps(*LIVE, AT_REST, FAILED)
    assert after_failure["generator"] is Lamp.SUSPECT
    assert after_failure["card"] is Lamp.READY
    assert set(lamps(*LIVE, AT_REST, FAILED, RunRequested("x"), STARTED, BenchArmed()).values()) == {Lamp.READY}


def test_points_that_no_fit_may_use_are_counted() -> None:
    view = view_after(*LIVE, PointMeasured(0, point()), PointMeasured(1, point(Quality.CLIPPED)))
    assert view.unusable == 1


def test_a_prompt_that_arrives_after_stop_is_not_shown() -> None:
    view = view_after(*BEGUN, OperatorAction.STOP, PromptShown(2, ENABLE_HIGH_VOLTAGE))
    assert view.prompt is None
    assert view.bench_state is BenchState.GOING_TO_REST


def test_a_prompt_is_there_until_it_is_answered_or_the_run_ends() -> None:
    prompt = PromptShown(2, ENABLE_HIGH_VOLTAGE)
    assert view_after(*BEGUN, prompt).prompt == prompt
    assert view_after(*BEGUN, prompt, PromptAnswered(1, "done")).prompt == prompt
    for end in (PromptAnswered(2, "done"), OperatorAction.STOP, STOPPED, RunRequested("x")):
        assert view_after(*BEGUN, prompt, end).prompt is None


def test_answered_prompts_are_counted_from_the_begin_of_a_run() -> None:
    answered = (PromptShown(2, ENABLE_HIGH_VOLTAGE), PromptAnswered(2, "done"))
    assert view_after(*BEGUN, *answered, *answered).answered == 2
    assert view_after(*BEGUN, *answered, *BEGUN).answered == 0


def test_points_are_those_of_the_present_run() -> None:
    view = view_after(*LIVE, PointMeasured(0, point()), PointMeasured(1, point()))
    assert len(view.points) == 2
    assert len(reduce(view, TimedEvent(AT_REST, WHEN)).points) == 2
    assert reduce(view, TimedEvent(RunRequested("x"), WHEN)).points == ()


def test_time_left_counts_down_with_the_samples_and_stays_within_the_entry() -> None:
    view = initial_window_state(AmplifierMap(), "bench", True, ROLES)
    for event, streamed_s in (
        (OPENED, 0),
        (RunRequested("x"), 0),
        (STARTED, 0),
        (ProgressUpdated(1, 18, 25.5, "50 Hz"), 4.0),
    ):
        view = reduce(view, TimedEvent(event, WHEN, streamed_s))
    progress = view.progress
    assert progress is not None
    assert progress.remaining_at(4.0) == 25.5
    assert progress.remaining_at(5.0) == 24.5
    assert progress.remaining_at(99.0) == pytest.approx(24.0)
    assert progress.fraction_at(4.0) == pytest.approx(1.5 / 27.0)


def test_a_run_that_expects_no_time_is_not_divided_by() -> None:
    assert RunProgress("x", 0, 0.0).fraction_at(1.0) == 0.0


@pytest.mark.parametrize(
    ("event", "said"),
    [
        (OPENED, "bench is open (SIMULATED): generator Keysight 33511B #1"),
        (STARTED, "Sine dwell: 18 points, about 27 s, into run.h5"),
        (StreamStarted(5000.0, ()), "5000 scans per second"),
        (SettlingFinished(False, 5.0), "did not settle within 5.0 s"),
        (PointMeasured(0, point()), "160.000 Hz: max - min 1115.7 ± 1.0 µm"),
        (PointMeasured(0, point(Quality.CLIPPED | Quality.UNSETTLED)), "not usable: clipped, unsettled"),
        (NOT_AT_REST, "NOT AT REST: the card sees 0.000 V"),
        (UNSAFE, "UNSAFE: switch the high voltage off by hand"),
        (STOPPED, "Stopped by the operator"),
        (RunRejected("runs cannot be written"), "runs cannot be written"),
    ],
)
def test_the_log_says_it_in_a_sentence(event: WindowEvent, said: str) -> None:
    view = view_after(*LIVE)
    after = reduce(view, TimedEvent(event, WHEN))
    assert after.message_count == view.message_count + 1
    assert said in after.messages[-1].text
    assert after.messages[-1].time == WHEN


def test_what_nobody_needs_to_read_is_not_logged() -> None:
    view = view_after(*LIVE)
    for event in (SettlingFinished(True, 0.2), DriveStarted(SINE), ProgressUpdated(1, 18, 3.0, "x")):
        assert reduce(view, TimedEvent(event, WHEN)).message_count == view.message_count


def test_the_log_keeps_the_last_lines_only() -> None:
    view = view_after(OPENED, *(LogMessage(str(i)) for i in range(1200)))
    assert len(view.messages) == 500
    assert view.message_count == 1201
    assert view.messages[-1].text == "1199"
