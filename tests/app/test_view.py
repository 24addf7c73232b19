"""What the window says follows from what happened, and nothing else; it never says more than is known."""

from datetime import UTC, datetime

import pytest

from app.session.reducer import reduce
from app.session.session import BenchFailed, BenchOpened, Refused
from app.session.state import (
    Acknowledged,
    BenchState,
    ConnectAsked,
    Heard,
    Lamp,
    Progress,
    RunAsked,
    StopAsked,
    View,
    ViewEvent,
    opening,
)
from drivers.drive import Hold, LinearSweep, Sine
from model.amplifier_map import AmplifierMap
from protocols.base.events import (
    Answered,
    Armed,
    Asked,
    AtRest,
    GoingToRest,
    Noted,
    Playing,
    PointMeasured,
    Progressed,
    RunEnded,
    RunStarted,
    SettleEnded,
    Status,
    StreamStarted,
)
from protocols.base.operator import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE
from protocols.base.quality import Quality
from protocols.measurements.sine_dwell import SinePoint

WHEN = datetime(2026, 11, 21, 9, 15, tzinfo=UTC)
ROLES = {"generator": "Keysight 33511B #1", "amplifier": "AMT2012", "card": "NI USB-6341 #2", "sensor": "laser"}
OPENED = BenchOpened("bench", True, ROLES)
STARTED = RunStarted("sine-dwell", "/somewhere/run.h5", 27.0, 18, True)
SINE = Sine(160.0, 2.5, 2.5, 1000)
BEGUN = (OPENED, RunAsked("Sine dwell"), STARTED)
LIVE = (*BEGUN, Armed(), Playing(SINE))
AT_REST = AtRest(True, 2.5, "the card sees 2.500 V")
NOT_AT_REST = AtRest(False, 0.0, "the card sees 0.000 V")
COMPLETED = RunEnded(Status.COMPLETED, "all points measured", "run.h5")
STOPPED = RunEnded(Status.STOPPED, "stopped by the operator", "run.h5")
FAILED = RunEnded(Status.FAILED, "function generator 33511B: no answer; check its cable to the card", "run.h5")
UNSAFE = RunEnded(Status.UNSAFE, "UNSAFE: switch the high voltage off by hand", "run.h5")
LOST = (*LIVE, GoingToRest(), NOT_AT_REST, UNSAFE)


def point(quality: Quality = Quality.SIMULATED) -> SinePoint:
    return SinePoint(
        160.0, 1.1157e-3, 1e-6, 5.577e-4, 1e-8, 0, 0, 0.1, (5.6e-4,), 2.5, 2.5, 0, 0, 1e-6, 80, int(quality)
    )


def view_after(*events: ViewEvent) -> View:
    view = opening(AmplifierMap(), "bench", True, ROLES)
    for event in events:
        view = reduce(view, Heard(event, WHEN))
    return view


@pytest.mark.parametrize(
    ("events", "state"),
    [
        ((), BenchState.CONNECTING),
        ((OPENED,), BenchState.IDLE),
        ((BenchFailed("no generator"),), BenchState.NO_BENCH),
        ((BenchFailed("no generator"), ConnectAsked()), BenchState.CONNECTING),
        (BEGUN, BenchState.ARMING),
        ((*BEGUN, Asked(1, DISABLE_HIGH_VOLTAGE)), BenchState.ARMING),
        ((*BEGUN, Asked(2, ENABLE_HIGH_VOLTAGE)), BenchState.LIVE),
        (LIVE, BenchState.LIVE),
        ((*LIVE, StopAsked()), BenchState.GOING_TO_REST),
        ((*LIVE, StopAsked(), Playing(SINE)), BenchState.GOING_TO_REST),
        ((OPENED, RunAsked("x"), StopAsked(), STARTED, Armed()), BenchState.GOING_TO_REST),
        ((*LIVE, GoingToRest()), BenchState.GOING_TO_REST),
        ((*LIVE, GoingToRest(), AT_REST), BenchState.AT_REST),
        ((*LIVE, GoingToRest(), AT_REST, COMPLETED), BenchState.AT_REST),
        ((*BEGUN, FAILED), BenchState.IDLE),
        ((*LIVE, GoingToRest(), NOT_AT_REST), BenchState.UNSAFE),
        ((*LIVE, GoingToRest(), NOT_AT_REST, StopAsked()), BenchState.UNSAFE),
        (LOST, BenchState.UNSAFE),
        ((*LOST, Acknowledged()), BenchState.UNSAFE),
        ((*LOST, Acknowledged(), RunAsked("x"), STARTED, FAILED), BenchState.UNSAFE),
        ((*LOST, Acknowledged(), RunAsked("x"), Refused("no permission")), BenchState.UNSAFE),
        ((*LOST, Acknowledged(), RunAsked("x"), STARTED, Armed()), BenchState.LIVE),
        ((*LOST, BenchFailed("gone")), BenchState.UNSAFE),
        ((*LOST, BenchFailed("gone"), ConnectAsked()), BenchState.UNSAFE),
        ((*LOST, BenchFailed("gone"), ConnectAsked(), OPENED), BenchState.UNSAFE),
    ],
)
def test_the_bench_state_says_what_is_known(events: tuple[ViewEvent, ...], state: BenchState) -> None:
    assert view_after(*events).state is state


@pytest.mark.parametrize(
    ("events", "volts", "note"),
    [
        ((), "unknown", "volts"),
        ((OPENED,), "not measured", "rest first"),
        ((*BEGUN, Armed()), "0 V", "high voltage on"),
        (LIVE, "−500 … +1500 V", "160 Hz"),
        ((*LIVE, Playing(Sine(50.0, 1.0, 2.5, 10))), "−200 … +600 V", "50 Hz"),
        ((*LIVE, Playing(LinearSweep(25, 525, 300, 2.5, 2.5))), "−500 … +1500 V", "25 … 525 Hz"),
        ((*LIVE, Playing(Hold(5.0, 1.0))), "+1500 V", "held"),
        ((*LIVE, GoingToRest()), "to 0 V", "next"),
        ((*LIVE, GoingToRest(), AT_REST), "0 V", "rest measured 2.500 V"),
        (LOST, "unknown", "the card sees 0.000 V"),
        ((*LIVE, AtRest(False, float("nan"), "blind")), "unknown", "may carry high voltage"),
    ],
)
def test_volts_on_the_specimen_follow_the_drive(events: tuple[ViewEvent, ...], volts: str, note: str) -> None:
    view = view_after(*events)
    assert view.volts == volts
    assert note in view.volts_note


def test_the_unsafe_sentence_stays_until_it_is_acknowledged() -> None:
    later = (Noted("something else"), BenchFailed("the bench is gone"), ConnectAsked(), OPENED)
    view = view_after(*LOST, *later)
    assert view.unsafe == UNSAFE.reason
    assert not view.can_run
    assert reduce(view, Heard(Acknowledged(), WHEN)).unsafe == ""


@pytest.mark.parametrize(
    ("events", "code"),
    [
        ((OPENED,), 0),
        ((BenchFailed("x"),), 1),
        ((*LIVE, AT_REST, COMPLETED), 0),
        ((*LIVE, AT_REST, STOPPED), 0),
        ((*LIVE, AT_REST, FAILED), 1),
        ((*LIVE, AT_REST, FAILED, RunAsked("x"), STARTED, Armed(), AT_REST, COMPLETED), 0),
        ((OPENED, RunAsked("x"), Refused("no permission")), 1),
        (LOST, 3),
        ((*LOST, Acknowledged()), 3),
        ((*LOST, Acknowledged(), RunAsked("x"), STARTED, FAILED), 3),
        ((*LOST, Acknowledged(), RunAsked("x"), STARTED, Armed(), AT_REST, COMPLETED), 0),
    ],
)
def test_the_exit_code_follows_the_last_outcome(events: tuple[ViewEvent, ...], code: int) -> None:
    assert view_after(*events).exit_code == code


@pytest.mark.parametrize(
    ("events", "can_run", "busy"),
    [
        ((), False, False),
        ((OPENED,), True, False),
        ((OPENED, RunAsked("x")), False, True),
        (LIVE, False, True),
        ((*LIVE, AT_REST, COMPLETED), True, False),
        ((OPENED, RunAsked("x"), Refused("no")), True, False),
        (LOST, False, False),
        ((*LOST, Acknowledged()), True, False),
        ((*LOST, BenchFailed("gone"), Acknowledged()), False, False),
        ((OPENED, BenchFailed("x")), False, False),
    ],
)
def test_a_run_may_begin_only_on_an_open_bench_that_nobody_uses(
    events: tuple[ViewEvent, ...], can_run: bool, busy: bool
) -> None:
    view = view_after(*events)
    assert (view.can_run, view.busy) == (can_run, busy)


def test_lamps_tell_what_is_known_of_each_instrument() -> None:
    def lamps(*events: ViewEvent) -> dict[str, Lamp]:
        return {i.role: i.lamp for i in view_after(*events).instruments}

    assert set(lamps().values()) == {Lamp.WAITING}
    assert set(lamps(OPENED).values()) == {Lamp.READY}
    assert set(lamps(BenchFailed("x")).values()) == {Lamp.ABSENT}
    after_failure = lamps(*LIVE, AT_REST, FAILED)
    assert after_failure["generator"] is Lamp.DOUBTED
    assert after_failure["card"] is Lamp.READY
    assert set(lamps(*LIVE, AT_REST, FAILED, RunAsked("x"), STARTED, Armed()).values()) == {Lamp.READY}


def test_points_that_no_fit_may_use_are_counted() -> None:
    view = view_after(*LIVE, PointMeasured(0, point()), PointMeasured(1, point(Quality.CLIPPED)))
    assert view.unusable == 1


def test_a_prompt_is_there_until_it_is_answered_or_the_run_ends() -> None:
    asked = Asked(2, ENABLE_HIGH_VOLTAGE)
    assert view_after(*BEGUN, asked).prompt == asked
    assert view_after(*BEGUN, asked, Answered(1, "done")).prompt == asked
    for end in (Answered(2, "done"), StopAsked(), STOPPED, RunAsked("x")):
        assert view_after(*BEGUN, asked, end).prompt is None


def test_points_are_those_of_the_present_run() -> None:
    view = view_after(*LIVE, PointMeasured(0, point()), PointMeasured(1, point()))
    assert len(view.points) == 2
    assert len(reduce(view, Heard(AT_REST, WHEN)).points) == 2
    assert reduce(view, Heard(RunAsked("x"), WHEN)).points == ()


def test_time_left_counts_down_with_the_samples_and_stays_within_the_entry() -> None:
    view = opening(AmplifierMap(), "bench", True, ROLES)
    for event, streamed_s in ((OPENED, 0), (RunAsked("x"), 0), (STARTED, 0), (Progressed(1, 18, 25.5, "50 Hz"), 4.0)):
        view = reduce(view, Heard(event, WHEN, streamed_s))
    progress = view.progress
    assert progress is not None
    assert progress.left_at(4.0) == 25.5
    assert progress.left_at(5.0) == 24.5
    assert progress.left_at(99.0) == pytest.approx(24.0)
    assert progress.fraction_at(4.0) == pytest.approx(1.5 / 27.0)


def test_a_run_that_expects_no_time_is_not_divided_by() -> None:
    assert Progress("x", 0, 0.0).fraction_at(1.0) == 0.0


@pytest.mark.parametrize(
    ("event", "said"),
    [
        (OPENED, "bench is open (SIMULATED): generator Keysight 33511B #1"),
        (STARTED, "Sine dwell: 18 points, about 27 s, into run.h5"),
        (StreamStarted(5000.0, ()), "5000 scans per second"),
        (SettleEnded(False, 5.0), "did not settle within 5.0 s"),
        (PointMeasured(0, point()), "160 Hz: max − min 1115.7 ± 1.0 µm"),
        (PointMeasured(0, point(Quality.CLIPPED | Quality.UNSETTLED)), "not usable: clipped, unsettled"),
        (NOT_AT_REST, "NOT AT REST: the card sees 0.000 V"),
        (UNSAFE, "UNSAFE: switch the high voltage off by hand"),
        (STOPPED, "Stopped by the operator"),
        (Refused("runs cannot be written"), "runs cannot be written"),
    ],
)
def test_the_log_says_it_in_a_sentence(event: ViewEvent, said: str) -> None:
    view = view_after(*LIVE)
    after = reduce(view, Heard(event, WHEN))
    assert after.told == view.told + 1
    assert said in after.messages[-1].words
    assert after.messages[-1].at == WHEN


def test_what_nobody_needs_to_read_is_not_logged() -> None:
    view = view_after(*LIVE)
    for event in (SettleEnded(True, 0.2), Playing(SINE), Progressed(1, 18, 3.0, "x")):
        assert reduce(view, Heard(event, WHEN)).told == view.told


def test_the_log_keeps_the_last_lines_only() -> None:
    view = view_after(OPENED, *(Noted(str(i)) for i in range(1200)))
    assert len(view.messages) == 500
    assert view.told == 1201
    assert view.messages[-1].words == "1199"
