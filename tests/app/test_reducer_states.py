"""Window state between events: what an answered prompt, a request and an armed bench leave as it was, and what the log says."""

import pytest

from app.session.state import BenchState, OperatorAction, RunRequested, WindowEvent
from protocols.base import (
    DISABLE_HIGH_VOLTAGE,
    ENABLE_HIGH_VOLTAGE,
    BenchArmed,
    DriveReadbackChanged,
    DriveStarted,
    PromptAnswered,
    PromptShown,
    RunPaused,
    RunResumed,
    ShutdownStarted,
    SpecimenMayBeLive,
)
from protocols.base.events import Prompt
from tests.app.test_view import AT_REST, BEGUN, COMPLETED, FAILED, LIVE, LOST, OPENED, SINE, STARTED, UNSAFE, view_after

pytestmark = pytest.mark.one_in(1)

DISABLE = (PromptShown(7, DISABLE_HIGH_VOLTAGE), PromptAnswered(7, "done"))
OTHER = (PromptShown(7, Prompt("weight-off", "Take the weight off")), PromptAnswered(7, "done"))


@pytest.mark.parametrize(
    ("events", "state", "plays"),
    [
        ((*LIVE, *DISABLE), BenchState.HV_OFF, False),
        ((*LIVE, *OTHER), BenchState.LIVE, True),
        ((*LIVE, DriveReadbackChanged(True, 0.0, 0.0), *OTHER), BenchState.DRIVE_LOST, True),
        ((*LIVE, ShutdownStarted(), *DISABLE), BenchState.GOING_TO_REST, True),
        ((*BEGUN, *DISABLE), BenchState.ARMING, False),
        ((*BEGUN, BenchArmed(False), *DISABLE), BenchState.HV_OFF, False),
        ((*BEGUN, BenchArmed(False), PromptShown(8, ENABLE_HIGH_VOLTAGE)), BenchState.LIVE, False),
    ],
)
def test_only_the_prompt_to_switch_off_ends_the_state_in_which_the_specimen_is_live(
    events: tuple[WindowEvent, ...], state: BenchState, plays: bool
) -> None:
    view = view_after(*events)
    assert view.bench_state is state
    assert (view.drive == SINE) == plays


def test_nothing_that_was_measured_of_an_earlier_bench_or_run_is_present_in_the_next_one() -> None:
    warned = (*LIVE, DriveReadbackChanged(True, 0.0, 0.0), SpecimenMayBeLive(2.0, 3.0, ""))
    left, opened = view_after(*warned), view_after(*warned, OPENED)
    assert (left.warned, left.off_aim) == (True, True)
    assert (opened.high_voltage, opened.warned, opened.off_aim, opened.suspects) == (None, False, False, frozenset())
    ended = (*LIVE, ShutdownStarted(), AT_REST, COMPLETED)
    again = view_after(*ended, RunRequested("again"), STARTED)
    assert view_after(*ended).rest is not None
    assert (again.rest, again.drive, again.warned, again.unread) == (None, None, False, False)


def test_a_run_that_was_given_up_unsafe_without_a_measurement_is_unsafe_until_rest_is_measured() -> None:
    """The thread that would have measured rest hangs."""
    left = (*LIVE, UNSAFE)
    for events in (left, (*left, OperatorAction.ACKNOWLEDGE), (*left, OPENED), (*left, OperatorAction.RECONNECT)):
        view = view_after(*events)
        assert view.bench_state is BenchState.UNSAFE
        assert view.exit_code == 3
    armed = view_after(*left, OperatorAction.ACKNOWLEDGE, RunRequested("Sine dwell"), STARTED)
    assert armed.bench_state is BenchState.ARMING
    assert armed.exit_code == 3
    failed = (*left, OperatorAction.ACKNOWLEDGE, RunRequested("Sine dwell"), STARTED, FAILED)
    for events in (failed, (*failed, OPENED)):
        assert view_after(*events).bench_state is BenchState.UNSAFE, "before it was armed it has measured nothing"
    assert view_after(*left, STARTED, AT_REST, COMPLETED).exit_code == 0


def test_a_run_without_high_voltage_is_at_no_time_live() -> None:
    off = (*BEGUN, BenchArmed(False))
    for events in ((), (DriveStarted(SINE),), (RunPaused("at rest"),), (RunPaused("at rest"), RunResumed())):
        assert view_after(*off, *events).bench_state is BenchState.HV_OFF
        assert view_after(*BEGUN, BenchArmed(True), *events).bench_state in (BenchState.LIVE, BenchState.PAUSED)


def test_a_run_that_was_asked_for_has_measured_nothing_yet() -> None:
    title = "Sine dwell"
    progress = view_after(OPENED, RunRequested(title)).progress
    assert progress is not None
    assert (progress.title, progress.entries, progress.expected_s, progress.done, progress.label) == (
        title,
        0,
        0.0,
        0,
        "",
    )
    progress = view_after(OPENED, RunRequested(title, "run.h5")).progress
    assert progress is not None
    assert progress.label == "reading run.h5"


def test_a_bench_that_was_armed_is_at_a_rest_that_was_measured() -> None:
    """Arming measures rest: that an earlier run could not bring it there counts no more."""
    again = (*LOST, OperatorAction.ACKNOWLEDGE, RunRequested("x"), STARTED)
    assert view_after(*again, FAILED).bench_state is BenchState.UNSAFE
    assert view_after(*again, BenchArmed(), FAILED).bench_state is not BenchState.UNSAFE


@pytest.mark.parametrize(
    ("events", "said"),
    [
        ((OperatorAction.PAUSE,), "Pause was requested"),
        ((OperatorAction.PAUSE, RunPaused("paused"), OperatorAction.PAUSE), "Resume was requested"),
        (
            (OperatorAction.PAUSE, RunPaused("paused"), OperatorAction.PAUSE, RunResumed(), OperatorAction.PAUSE),
            "Pause was requested",
        ),
        ((OperatorAction.STOP,), "Stop was requested; the bench goes to rest"),
        ((FAILED, OperatorAction.RECONNECT), "Connecting again"),
    ],
)
def test_the_log_says_what_the_operator_asked_for(events: tuple[WindowEvent, ...], said: str) -> None:
    assert view_after(*LIVE, *events).messages[-1].text == said


def test_a_drive_that_is_lost_and_seen_again_is_in_the_log_while_the_bench_is_live_only() -> None:
    lost = DriveReadbackChanged(True, 0.0, 0.0)
    assert view_after(*LIVE, lost).messages[-1].text.startswith("The card does not see the drive, but ")
    again = view_after(*LIVE, lost, DriveReadbackChanged(False, 0.0, 5.0))
    assert again.messages[-1].text == "The card sees the drive again"
    stopped = view_after(*LIVE, ShutdownStarted())
    assert view_after(*LIVE, ShutdownStarted(), lost).messages == stopped.messages
