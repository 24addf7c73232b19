"""Strip: the states, the measured volts with their age, the aim and what to do, as a table; never a voltage that is assumed."""

import math
from dataclasses import replace
from typing import NamedTuple

import pytest

from app.common import Severity
from app.session.reducer import observe, reduce
from app.session.session import BenchFailed, InstrumentAwaited, MonitorFailed, MonitorStarted, Observation
from app.session.state import (
    BenchState,
    CommissioningEnded,
    Lamp,
    OperatorAction,
    RunRequested,
    TimedEvent,
    WindowEvent,
    WindowState,
)
from app.session.strip import StripView, format_measured_volts, strip_view
from drivers.bench.card_reading import CardReading
from drivers.drive_shapes import Hold, LinearSweep, Sine
from protocols.base import (
    DISABLE_HIGH_VOLTAGE,
    ENABLE_HIGH_VOLTAGE,
    BenchArmed,
    DriveReadbackChanged,
    DriveStarted,
    LevelExceeded,
    PointMeasured,
    ProgressUpdated,
    PromptShown,
    Quality,
    RestMeasured,
    RunPaused,
    RunResumed,
    ShutdownStarted,
    SpecimenMayBeLive,
)
from tests.app.test_reducer_states import DISABLE
from tests.app.test_view import (
    AT_REST,
    BEGUN,
    COMPLETED,
    DRIVE_GONE,
    LIVE,
    LOST,
    NOT_AT_REST,
    OPENED,
    SINE,
    STARTED,
    UNSAFE,
    WHEN,
    point,
    view_after,
)

pytestmark = pytest.mark.one_in(1)

NOW_S = 1000.0
"""Time at which the strip is looked at; every event before it was at 0."""
IF_ON = "if"


def card(low_v: float, high_v: float | None = None, age_s: float = 0.1, moves: bool = False) -> CardReading:
    """A reading of a level, or of a swing; `moves`: it was another one a moment before."""
    seen = (low_v, low_v if high_v is None else high_v)
    return CardReading(seen, seen, NOW_S - age_s, (9.0, 9.0) if moves else seen)


def look(view: WindowState, reading: CardReading | None) -> tuple[WindowState, StripView]:
    """Return state and strip after a look at what the card measured."""
    seen = Observation(reading)
    view = observe(view, seen, NOW_S, WHEN)
    return view, strip_view(view, seen, NOW_S)


SWING, REST, ZERO = card(0.0, 5.0), card(2.5), card(0.0)
STOPPING = (*LIVE, ShutdownStarted())
HV_OFF = (*LIVE, *DISABLE)


class Row(NamedTuple):
    """A row of the table: events, reading, and what is shown."""

    events: tuple[WindowEvent, ...]
    reading: CardReading | None
    state: BenchState
    danger: bool
    measured: str
    caption: str
    aim: str
    act: str


TABLE = {
    "connecting": Row((), None, BenchState.CONNECTING, False, "", "yet", "", ""),
    "connecting again": Row(
        (OPENED, OperatorAction.RECONNECT), REST, BenchState.CONNECTING, False, "", "yet", "", ""
    ),
    "never armed": Row((OPENED,), REST, BenchState.IDLE, False, "about 0 V", IF_ON, "", ""),
    "never armed, not at rest": Row(
        (OPENED,), ZERO, BenchState.IDLE, True, "about −500 V", IF_ON, "", "OFF"
    ),
    "never armed, not read yet": Row((OPENED,), None, BenchState.IDLE, False, "", "yet", "", ""),
    "arming": Row(BEGUN, ZERO, BenchState.ARMING, False, "about −500 V", IF_ON, "measure rest, 0 V", ""),
    "high voltage on": Row(
        (*BEGUN, PromptShown(2, ENABLE_HIGH_VOLTAGE)), REST, BenchState.LIVE, False, "0 V", "specimen,", "rest, 0 V", ""
    ),
    "high voltage on, a drive begins": Row(
        (*BEGUN, PromptShown(2, ENABLE_HIGH_VOLTAGE)), card(1.44, moves=True), BenchState.LIVE, False, "−212 V",
        "specimen,", "rest, 0 V", "",
    ),
    "high voltage on, another voltage": Row(
        (*BEGUN, PromptShown(2, ENABLE_HIGH_VOLTAGE)), ZERO, BenchState.DRIVE_LOST, True, "about −500 V", IF_ON,
        "rest, 0 V", "OFF",
    ),
    "commissioning, high voltage on": Row(
        (OPENED, RunRequested("Commissioning"), PromptShown(-1, ENABLE_HIGH_VOLTAGE), DriveStarted(Hold(3.0, 1.0))),
        card(3.0), BenchState.LIVE, False, "+300 V", "specimen,", "level held, +300 V", "",
    ),
    "commissioning, high voltage on, rest is not reached": Row(
        (OPENED, RunRequested("Commissioning"), PromptShown(-1, ENABLE_HIGH_VOLTAGE), DriveStarted(Hold(3.0, 1.0)),
         ShutdownStarted(), RestMeasured(False, 3.0, "3.0 V"), CommissioningEnded("UNSAFE: …", passed=False)),
        card(3.0), BenchState.UNSAFE, True, "about +300 V", IF_ON, "rest, not reached, 0 V", "OFF",
    ),
    "live": Row(
        LIVE, SWING, BenchState.LIVE, False, "−500 … +1500 V", "specimen,", "sine, 160 Hz, −500 … +1500 V", ""
    ),
    "live, in a ramp": Row(
        LIVE, card(1.44), BenchState.LIVE, False, "−212 V", "specimen,", "sine, 160 Hz, −500 … +1500 V", ""
    ),
    "pausing": Row(
        (*LIVE, OperatorAction.PAUSE), SWING, BenchState.PAUSING, False, "−500 … +1500 V", "specimen,",
        "sine, 160 Hz, −500 … +1500 V", "",
    ),
    "paused": Row(
        (*LIVE, OperatorAction.PAUSE, RunPaused("rest")), REST, BenchState.PAUSED, False, "0 V", "specimen,",
        "rest, 0 V", "still",
    ),
    "paused, rest is lost": Row(
        (*LIVE, RunPaused("rest")), ZERO, BenchState.DRIVE_LOST, True, "about −500 V", IF_ON, "rest, 0 V", "OFF"
    ),
    "high voltage off": Row(
        HV_OFF, REST, BenchState.HV_OFF, False, "0 V", "specimen,", "high voltage off, 0 V", ""
    ),
    "high voltage off, not at rest": Row(
        HV_OFF, ZERO, BenchState.HV_OFF, False, "about −500 V", IF_ON, "high voltage off, 0 V",
        "leave",
    ),
    "drive lost": Row(
        (*LIVE, DRIVE_GONE), ZERO, BenchState.DRIVE_LOST, True, "about −500 V", IF_ON, "sine, 160 Hz, −500 … +1500 V",
        "OFF",
    ),
    "going to rest": Row(
        STOPPING, card(1.44, moves=True), BenchState.GOING_TO_REST, False, "−212 V", "specimen,", "rest, 0 V", ""
    ),
    "going to rest, there": Row(
        STOPPING, REST, BenchState.GOING_TO_REST, False, "0 V", "specimen,", "rest, 0 V", ""
    ),
    "going to rest, without obedience": Row(
        STOPPING, ZERO, BenchState.DRIVE_LOST, True, "about −500 V", IF_ON, "rest, 0 V", "OFF"
    ),
    "going to rest, the drive plays on": Row(
        STOPPING, SWING, BenchState.DRIVE_LOST, True, "−500 … +1500 V", IF_ON, "rest, 0 V", "OFF"
    ),
    "going to rest, may be live": Row(
        (*LIVE, SpecimenMayBeLive(2.06, 2.06, "no answer")), card(2.06, moves=True), BenchState.GOING_TO_REST, True,
        "about −88 V", IF_ON, "rest, 0 V", "OFF",
    ),
    "at rest": Row(
        (*STOPPING, AT_REST, COMPLETED), REST, BenchState.AT_REST, False, "0 V", "specimen,",
        "rest, 2.500 V, 0 V", "",
    ),
    "at rest, after a warning": Row(
        (*LIVE, SpecimenMayBeLive(2.06, 2.06, "no answer"), AT_REST, COMPLETED), REST, BenchState.AT_REST, False, "0 V",
        "specimen,", "rest, 2.500 V, 0 V", "",
    ),
    "arming again, with high voltage on before": Row(
        (*STOPPING, AT_REST, COMPLETED, RunRequested("x"), STARTED), ZERO, BenchState.ARMING, False, "about −500 V", IF_ON,
        "measure rest, 0 V", "",
    ),
    "live, asked to switch off, rest is lost": Row(
        (*LIVE, PromptShown(7, DISABLE_HIGH_VOLTAGE)), ZERO, BenchState.DRIVE_LOST, True, "about −500 V", IF_ON, "rest, 0 V",
        "OFF",
    ),
    "at rest, lost": Row(
        (*STOPPING, AT_REST, COMPLETED), ZERO, BenchState.DRIVE_LOST, True, "about −500 V", IF_ON, "rest, 2.500 V, 0 V",
        "OFF",
    ),
    "unsafe": Row(
        LOST, ZERO, BenchState.UNSAFE, True, "about −500 V", IF_ON, "rest, not reached, 0 V", "OFF"
    ),
    "unsafe, at 0 V now": Row(
        LOST, REST, BenchState.UNSAFE, True, "about 0 V", "specimen,", "rest, not reached, 0 V", "OFF"
    ),
    "the card is gone with high voltage on": Row(
        (*LIVE, BenchFailed("gone")), card(0.0, 5.0, 4.0), BenchState.UNSAFE, True, "unknown", "4",
        "rest, not reached, 0 V", "OFF",
    ),
    "never read, may be live": Row(
        (*LIVE, SpecimenMayBeLive(math.nan, math.nan, "no card", "card")), None, BenchState.GOING_TO_REST, True, "unknown",
        "yet", "rest, 0 V", "OFF",
    ),
    "no bench": Row((BenchFailed("x"),), None, BenchState.NO_BENCH, False, "", "nothing", "", ""),
    "gone after rest": Row(
        (*STOPPING, AT_REST, COMPLETED, BenchFailed("gone")), REST, BenchState.NO_BENCH, False, "", "nothing", "", ""
    ),
    "gone after high voltage off": Row(
        (*HV_OFF, BenchFailed("gone")), REST, BenchState.NO_BENCH, False, "", "nothing", "", ""
    ),
}  # fmt: skip


@pytest.mark.one_in(1)
@pytest.mark.parametrize("row", TABLE.values(), ids=TABLE)
def test_every_state_shows_what_is_measured_and_what_is_wanted(row: Row) -> None:
    view, strip = look(view_after(*row.events), row.reading)
    assert (strip.state, strip.danger, strip.measured, strip.aim) == (row.state, row.danger, row.measured, row.aim)
    assert row.caption in strip.caption.split()
    assert row.act in strip.act
    assert bool(strip.act) == bool(row.act)
    assert (view.bench_state, view.danger) == (row.state, row.danger)


def test_all_states_are_in_the_table() -> None:
    assert {row.state for row in TABLE.values()} == set(BenchState)


@pytest.mark.parametrize(
    ("age_s", "present", "measured", "caption"),
    [
        (0.5, True, "−500 … +1500 V", "at the specimen, 0.5 s ago"),
        (0.6, False, "−500 … +1500 V", "at the specimen, 0.6 s ago"),
        (2.0, False, "−500 … +1500 V", "at the specimen, 2.0 s ago"),
        (2.1, False, "unknown", "last −500 … +1500 V, 2 s ago"),
        (4.0, False, "unknown", "last −500 … +1500 V, 4 s ago"),
        (240.0, False, "unknown", "last −500 … +1500 V, 4 min 00 s ago"),
    ],
)
@pytest.mark.one_in(1)
def test_volts_that_are_old_are_not_shown_as_present_and_very_old_ones_are_unknown(
    age_s: float, present: bool, measured: str, caption: str
) -> None:
    strip = strip_view(view_after(*LIVE), Observation(card(0.0, 5.0, age_s)), NOW_S)
    assert (strip.present, strip.measured, strip.caption) == (present, measured, caption)
    assert strip.age_s == pytest.approx(age_s)


def test_a_card_that_is_not_read_while_high_voltage_is_on_is_a_danger() -> None:
    for age_s, suspect, danger in ((0.5, False, False), (0.6, True, False), (2.1, True, True)):
        view, strip = look(view_after(*LIVE), card(0.0, 5.0, age_s))
        assert strip.danger is danger
        assert [bool(i.remark) for i in view.instruments if i.role == "card"] == [suspect]
    off, _ = look(view_after(*HV_OFF), card(0.0, 5.0, 5.0))
    assert not off.danger


@pytest.mark.parametrize(
    ("low_v", "high_v", "text"),
    [
        (-0.9, 1.1, "0 V"),
        (-4.9, -4.9, "0 V"),
        (-5.1, -5.1, "−5 V"),
        (-214.0, -210.0, "−212 V"),
        (-500.4, 1499.0, "−500 … +1500 V"),
        (-502.6, 1497.0, "−505 … +1495 V"),
    ],
)
def test_measured_volts_are_one_value_or_a_range_in_steps_of_five(low_v: float, high_v: float, text: str) -> None:
    assert format_measured_volts(low_v, high_v) == text


@pytest.mark.parametrize(
    ("drive", "aim"),
    [
        (Sine(50.0, 1.0, 2.5, 10), "sine, 50 Hz, −200 … +600 V"),
        (LinearSweep(25, 525, 300, 2.5, 2.5), "linear sweep, 25 … 525 Hz, −500 … +1500 V"),
        (Hold(5.0, 1.0), "level held, +1500 V"),
    ],
)
def test_the_aim_is_what_is_driven(drive: Sine | LinearSweep | Hold, aim: str) -> None:
    assert strip_view(view_after(*LIVE, DriveStarted(drive))).aim == aim


def monitored(low_v: float, high_v: float, reading: CardReading = SWING) -> CardReading:
    return replace(reading, monitor_v=(low_v, high_v))


@pytest.mark.parametrize(
    ("reading", "measured", "disagrees"),
    [
        (monitored(-498.0, 1480.0), "−500 … +1480 V", False),
        (monitored(-500.0, 1340.0), "−500 … +1340 V", True),
        (monitored(0.0, 0.0), "0 V", True),
        (monitored(49.0, 49.0, REST), "+49 V", False),
        (monitored(51.0, 51.0, REST), "+51 V", True),
    ],
)
def test_a_voltage_monitor_is_shown_and_a_disagreement_with_the_input_is_told(
    reading: CardReading, measured: str, disagrees: bool
) -> None:
    view, strip = look(view_after(*LIVE), reading)
    assert strip.measured == measured
    assert ("monitor;" in strip.caption) is disagrees
    assert ("amplifier" in {i.role for i in view.instruments if i.remark}) is disagrees
    clear, _ = look(view, replace(reading, monitor_v=None))
    assert not any(i.remark for i in clear.instruments)


def test_without_obedience_counts_from_the_delay_that_was_stated_and_for_what_was_measured_since() -> None:
    view = view_after(*LIVE)
    for wait_s, age_s, state in (
        (0.0, 0.1, BenchState.DRIVE_LOST),
        (0.5, 0.1, BenchState.GOING_TO_REST),
        (0.5, 0.0, BenchState.GOING_TO_REST),
        (0.19, 0.0, BenchState.DRIVE_LOST),
        (0.19, 0.05, BenchState.GOING_TO_REST),
    ):
        stopping = reduce(view, TimedEvent(ShutdownStarted(wait_s), WHEN, at_s=NOW_S - 0.5))
        assert look(stopping, card(0.0, age_s=age_s))[0].bench_state is state, (wait_s, age_s)


def test_a_drive_that_is_lost_stays_lost_on_the_way_to_rest_until_the_card_sees_rest() -> None:
    lost = view_after(*LIVE, DRIVE_GONE, ShutdownStarted())
    assert lost.bench_state is BenchState.DRIVE_LOST
    moving, _ = look(lost, card(1.0, moves=True))
    assert moving.bench_state is BenchState.DRIVE_LOST
    there, _ = look(moving, REST)
    assert there.bench_state is BenchState.GOING_TO_REST
    assert there.messages[-1].text == "The card sees rest again"


def test_a_card_that_is_not_read_is_told_where_it_is_not_known_whether_high_voltage_is_on() -> None:
    unknown = view_after(*BEGUN, DriveStarted(SINE))
    assert unknown.high_voltage is None
    assert look(unknown, card(0.0, 5.0, age_s=3.0))[0].unread
    assert not look(view_after(*HV_OFF), card(2.5, age_s=3.0))[0].unread


def test_an_input_that_stands_still_off_rest_between_two_drives_that_swing_is_told_at_once() -> None:
    """Between two drives the program waits for the source and compares no block with the drive."""
    view, slow, held = view_after(*LIVE), Sine(3.0, 2.5, 2.5, 10), Hold(4.0, 1.0)
    for reading, commanded, is_lost in (
        (ZERO, SINE, True),
        (card(5.0), LinearSweep(25.0, 525.0, 300.0, 2.5, 2.5), True),
        (REST, SINE, False),  # between two drives
        (SWING, SINE, False),
        (card(4.0), held, False),  # the ramp to it comes before its start is reported
        (card(4.0), slow, False),
        (ZERO, None, False),
        (card(0.0, age_s=0.6), SINE, False),
    ):
        seen = Observation(reading, commanded=commanded)
        after = observe(view, seen, NOW_S, WHEN)
        assert after.off_aim is is_lost, (reading, commanded)
        assert (after.bench_state is BenchState.DRIVE_LOST) is is_lost
        if is_lost:
            assert "generator" in suspect(after)
            assert "rest" not in after.messages[-1].text
    from_level = view_after(*LIVE, DriveStarted(held))
    assert not observe(from_level, Observation(card(4.0), commanded=SINE), NOW_S, WHEN).off_aim


def test_the_lamp_of_the_part_changes_in_the_same_message_as_the_state() -> None:
    assert suspect(view_after(*LIVE, DRIVE_GONE)) == {"generator"}
    assert suspect(view_after(*LIVE, DRIVE_GONE, DriveReadbackChanged(False, 0.0, 5.0))) == set()
    assert suspect(look(view_after(*LIVE, RunPaused("rest")), ZERO)[0]) == {"generator"}
    assert suspect(view_after(*LIVE, SpecimenMayBeLive(0, 5, "DAQ card Dev1: it is gone", "card"))) == {"card"}
    assert suspect(view_after(*LIVE, SpecimenMayBeLive(0, 5, "NI USB-6341 does not answer", "card"))) == {"card"}
    assert suspect(view_after(*LIVE, SpecimenMayBeLive(0, 5, "a level was left"))) == set()
    assert suspect(view_after(*STOPPING, RestMeasured(False, math.nan, "no card"))) == {"card"}
    assert suspect(view_after(*STOPPING, NOT_AT_REST, UNSAFE)) == {"generator"}
    for reading, roles in (
        (replace(SWING, sensor_in_range=False), {"sensor"}),
        (replace(SWING, sensor_still=True), {"sensor"}),
        (SWING, set()),
    ):
        seen, _ = look(view_after(*LIVE), reading)
        assert suspect(seen) == roles
        assert suspect(look(seen, SWING)[0]) == set()


def test_an_unsafe_end_of_a_commissioning_waits_for_its_acknowledgement() -> None:
    view = view_after(
        OPENED, RunRequested("Commissioning"), UNSAFE, CommissioningEnded("UNSAFE: by hand", passed=False)
    )
    assert view.unsafe == "UNSAFE: by hand"
    assert not reduce(view, TimedEvent(OPENED, WHEN)).can_run


def test_a_drive_that_begins_is_not_lost_before_the_card_was_compared_with_it() -> None:
    lost, _ = look(view_after(*BEGUN, PromptShown(2, ENABLE_HIGH_VOLTAGE)), ZERO)
    assert lost.bench_state is BenchState.DRIVE_LOST
    begun = reduce(lost, TimedEvent(DriveStarted(SINE), WHEN))
    assert look(begun, SWING)[0].bench_state is BenchState.LIVE


def test_an_unsafe_source_off_rest_stays_suspect_after_connecting_again() -> None:
    view = view_after(*LIVE, ShutdownStarted(), NOT_AT_REST, UNSAFE, OperatorAction.RECONNECT, OPENED)
    assert view.phase is BenchState.UNSAFE
    assert {i.role: i.lamp for i in look(view, ZERO)[0].instruments}["generator"] is not Lamp.READY
    assert {i.role: i.lamp for i in look(view, REST)[0].instruments}["generator"] is Lamp.READY


@pytest.mark.parametrize(("answered_ago_s", "state"), [(0.3, BenchState.LIVE), (0.6, BenchState.DRIVE_LOST)])
def test_a_source_that_is_set_step_by_step_over_a_slow_wire_is_not_lost(
    answered_ago_s: float, state: BenchState
) -> None:
    view = view_after(*BEGUN, PromptShown(2, ENABLE_HIGH_VOLTAGE))
    seen = Observation(card(1.44), {"generator": NOW_S - answered_ago_s})
    assert observe(view, seen, NOW_S, WHEN).bench_state is state


def test_a_card_that_is_not_read_sees_no_voltage() -> None:
    view, strip = look(view_after(OPENED, MonitorStarted(1e4, ())), ZERO)
    assert "; " in strip.act
    assert "; " not in look(view, card(0.0, age_s=4.0))[1].act


def test_old_volts_change_no_state() -> None:
    view = view_after(*LIVE, RunPaused("rest"))
    assert look(view, card(0.0, age_s=0.6))[0].bench_state is BenchState.PAUSED
    assert observe(view, Observation(), NOW_S, WHEN) is view
    assert observe(view, Observation(REST), NOW_S, WHEN) is view


def test_between_runs_a_card_that_is_watched_and_falls_silent_is_suspect() -> None:
    silent = card(2.5, age_s=0.6)
    assert not any(i.remark for i in look(view_after(OPENED), silent)[0].instruments)
    watched, strip = look(view_after(OPENED, MonitorStarted(1e4, ())), silent)
    assert [i.role for i in watched.instruments if i.remark] == ["card"]
    assert not strip.danger


def test_a_card_that_could_not_be_read_is_suspect_at_once() -> None:
    for events in ((OPENED,), BEGUN, LIVE):
        lost, _ = look(view_after(*events), replace(REST, unread=True))
        assert "card" in [i.role for i in lost.instruments if i.remark and i.lamp is Lamp.SUSPECT]
        again, _ = look(lost, REST)
        assert "card" not in [i.role for i in again.instruments if i.remark]


@pytest.mark.parametrize(
    ("events", "title", "note"),
    [
        ((), "bench", "waits for the instruments"),
        ((OPENED,), "bench", "no run yet"),
        ((RunRequested("Sine dwell"),), "Sine dwell", "begins when the bench is connected"),
        ((OPENED, RunRequested("Sine dwell")), "Sine dwell", "begins"),
        ((OPENED, RunRequested("Sine dwell"), STARTED), "Sine dwell", "0 of 18 points, 27 s left"),
        ((*LIVE, ProgressUpdated(1, 18, 25.5, "50 Hz")), "Sine dwell · 50 Hz", "1 of 18 points, 26 s left"),
        ((OPENED, replace(STARTED, specimen="T7")), "Sine dwell of T7", "0 of 18 points, 27 s left"),
        ((OPENED, replace(STARTED, specimen="unnamed")), "Sine dwell", "0 of 18 points, 27 s left"),
        ((*LIVE, AT_REST, COMPLETED), "Sine dwell", "– not judged, 0 of 18 points"),
    ],
)
def test_the_run_is_told_in_two_lines(events: tuple[WindowEvent, ...], title: str, note: str) -> None:
    run = strip_view(view_after(*events)).run
    assert (run.title[-len(title) :], run.note) == (title, note)


def test_a_bench_that_is_being_connected_tells_for_how_long() -> None:
    for events, note in (
        ((), "waits for the instruments"),
        ((RunRequested("Sine dwell"),), "begins when the bench is connected"),
    ):
        view = replace(view_after(*events), connecting_since_s=100.0)
        assert [strip_view(view, now_s=at_s).run.note for at_s in (100.9, 103.0)] == [note, f"{note}, 3 s"]
    for events in ((InstrumentAwaited("card"),), (RunRequested("Sine dwell"), InstrumentAwaited("card"))):
        assert "card" in strip_view(view_after(*events)).run.note
    opened = [replace(view_after(OPENED), connecting_since_s=since_s) for since_s in (100.0, math.nan)]
    assert strip_view(opened[0], now_s=103.0) == strip_view(opened[1], now_s=103.0), (
        "no time without a connection in progress"
    )


def test_the_last_answer_of_an_instrument_is_told_with_its_age() -> None:
    seen = Observation(replace(REST, sensor_in_range=False), {"generator": NOW_S - 12.0})
    view, _ = look(view_after(*LIVE), seen.card)
    told = strip_view(view, seen, NOW_S).instruments
    assert told == {
        "generator": "ready; last answer 12.0 s ago",
        "amplifier": "ready",
        "card": "ready; last answer 0.1 s ago",
        "sensor": "sees no target",
    }
    assert strip_view(view, Observation(REST), NOW_S).instruments["sensor"].endswith("last answer 0.1 s ago")


def test_resuming_is_live_again() -> None:
    paused = (*LIVE, OperatorAction.PAUSE, RunPaused("rest"), OperatorAction.PAUSE, RunResumed(), DriveStarted(SINE))
    assert view_after(*paused).bench_state is BenchState.LIVE


def suspect(view: WindowState) -> set[str]:
    return {each.role for each in view.instruments if each.lamp is Lamp.SUSPECT}


def flagged(quality: Quality) -> PointMeasured:
    return PointMeasured(0, point(quality))


def exceeded(level: str) -> LevelExceeded:
    return LevelExceeded(level, 0.0, "x", 1.0, 1.0, "V", "ask", "")


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("events", "roles"),
    [
        ((MonitorFailed("no"),), {"card"}),
        ((MonitorFailed("no"), MonitorStarted(1e4, ())), set()),
        ((exceeded("drive"),), {"generator"}),
        ((exceeded("current"),), {"amplifier"}),
        ((exceeded("voltage"),), {"amplifier"}),
        ((exceeded("no_response"),), {"amplifier", "sensor"}),
        ((exceeded("laser_lost"),), {"sensor"}),
        ((exceeded("laser_lost"), BenchArmed()), set()),
        ((flagged(Quality.NO_RESPONSE),), {"amplifier", "sensor"}),
        ((flagged(Quality.OUT_OF_RANGE | Quality.DRIVE_OFF),), {"sensor", "generator"}),
        ((flagged(Quality.DROPPED),), {"card"}),
        ((flagged(Quality.UNSETTLED),), set()),
        ((flagged(Quality.NO_RESPONSE), flagged(Quality.SIMULATED)), set()),
    ],
)
def test_levels_points_and_the_watch_between_runs_point_at_parts(
    events: tuple[WindowEvent, ...], roles: set[str]
) -> None:
    assert suspect(view_after(OPENED, *events)) == roles


def test_a_card_that_is_gone_while_its_input_was_off_rest_leaves_the_bench_unsafe() -> None:
    seen, _ = look(view_after(OPENED), ZERO)
    gone = reduce(seen, TimedEvent(BenchFailed("gone"), WHEN))
    assert (gone.bench_state, gone.danger) == (BenchState.UNSAFE, True)
    assert view_after(OPENED, BenchFailed("gone")).bench_state is BenchState.NO_BENCH


def test_in_a_run_connecting_again_changes_nothing() -> None:
    live = view_after(*LIVE)
    assert reduce(live, TimedEvent(OperatorAction.RECONNECT, WHEN)) is live


def test_the_log_says_once_what_the_card_sees_at_rest() -> None:
    idle, _ = look(view_after(OPENED), ZERO)
    assert idle.messages[-1].severity is Severity.WARNING
    assert look(idle, ZERO)[0] is idle
    lost, _ = look(view_after(*LIVE, RunPaused("rest")), ZERO)
    assert lost.messages[-1].severity is Severity.ERROR
