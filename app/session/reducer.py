"""Reducer: the next window state from the last one and an event. Pure."""

import math
import re
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from time import monotonic

from app.common import Severity
from app.session.messages import LogLine, describe_event, describe_verdict, protocol_title
from app.session.session import (
    NO_LIVE_VALUES,
    BenchFailed,
    BenchOpened,
    InstrumentAwaited,
    MonitorFailed,
    MonitorStarted,
    Observation,
    RunRejected,
    SessionEvent,
)
from app.session.state import (
    ENERGIZED,
    BenchState,
    CommissioningEnded,
    InstrumentStatus,
    Lamp,
    OperatorAction,
    RunProgress,
    RunRequested,
    TimedEvent,
    WindowEvent,
    WindowState,
)
from app.session.strip import KNOWN_S, PRESENT_S, StripView, is_off_rest, monitor_disagrees, strip_view
from drivers import CardReading, Drive, describe_volts
from model import AmplifierMap
from protocols import PROTOCOLS
from protocols.base import (
    DISABLE_HIGH_VOLTAGE,
    ENABLE_HIGH_VOLTAGE,
    UNNAMED,
    BenchArmed,
    BlockDiscarded,
    BlockStored,
    DriveReadbackChanged,
    DriveStarted,
    LevelExceeded,
    PointMeasured,
    ProgressUpdated,
    PromptAnswered,
    PromptShown,
    Quality,
    RestMeasured,
    RunEnded,
    RunPaused,
    RunResumed,
    RunStarted,
    RunStatus,
    SeriesReady,
    ShutdownStarted,
    SpecimenMayBeLive,
)

MAX_LOG_LINES = 500

ACTION_MESSAGES = {
    OperatorAction.PAUSE: (Severity.INFO, "Pause was requested"),
    OperatorAction.STOP: (Severity.WARNING, "Stop was requested; the bench goes to rest"),
    OperatorAction.RECONNECT: (Severity.INFO, "Connecting again"),
    OperatorAction.ACKNOWLEDGE: (Severity.INFO, "The message was acknowledged"),
}
RESUME_MESSAGE = (Severity.INFO, "Resume was requested")

INSTRUMENT_PATTERN = r"\b{role} [^:.;,]{{1,40}}:"
"""A driver's message begins with its instrument: `function generator X: no answer ...`."""

PARTS_OF_LEVELS = {
    "drive": {"generator"},
    "voltage": {"amplifier"},
    "current": {"amplifier"},
    "no_response": {"amplifier", "sensor"},
}
"""Parts that an exceeded abort level points at; every other level is the sensor's."""

PARTS_OF_FLAGS = {
    Quality.DRIVE_OFF: {"generator"},
    Quality.DROPPED: {"card"},
    Quality.NO_RESPONSE: {"amplifier", "sensor"},
    Quality.CLIPPED | Quality.OUT_OF_RANGE: {"sensor"},
}
"""Parts that the flags of a point point at."""

BEFORE_HIGH_VOLTAGE = (BenchState.ARMING, BenchState.HV_OFF, BenchState.IDLE, BenchState.AT_REST)
"""Phases in which the operator is asked to switch high voltage on; the last two in a commissioning."""

OBEY_S, STOP_OBEY_S = 0.3, 1.0
"""How long a bench may stay as it is after the way to rest was begun, and after Stop, real seconds."""


def reduce(view: WindowState, timed_event: TimedEvent) -> WindowState:
    """Return the window state after an event."""
    event = timed_event.event
    after = _transition(view, timed_event)
    if isinstance(event, OperatorAction):
        resumed = event is OperatorAction.PAUSE and not after.pause_requested
        message = None if after is view else RESUME_MESSAGE if resumed else ACTION_MESSAGES[event]
    else:
        message = _describe_window_event(view, after, event)
    if message is None:
        return after
    return _with_message(after, LogLine(timed_event.time, *message))


FOLLOW_S = 0.05
"""Shortest real time between two evaluations of the card's reading: a virtual clock has thousands of blocks in a second."""


class BenchFollower:
    """Keeps the state of a bench for a front end without a window; `follow` is called with every event of the session.

    Args:
        amplifier: characteristic of the bench's amplifier.
    """

    def __init__(self, amplifier: AmplifierMap | None = None) -> None:
        self.state = WindowState(amplifier or AmplifierMap(), "", True, ())
        self.observe: Callable[[], Observation] = Observation
        """Returns the last answers of the instruments."""
        self._looked_s = -math.inf

    def follow(self, event: SessionEvent) -> tuple[LogLine, ...]:
        """Take an event; return the lines of the log that it leaves."""
        time, now_s, before = datetime.now().astimezone(), monotonic(), self.state.message_count
        if not isinstance(event, BlockStored | BlockDiscarded):
            self.state = reduce(self.state, TimedEvent(event, time, at_s=now_s))
        if now_s - self._looked_s >= FOLLOW_S:
            self._looked_s = now_s
            self.state = observe(self.state, self.observe(), now_s, time)
        added = self.state.message_count - before
        return self.state.messages[-added:] if added else ()

    def strip(self) -> StripView:
        """Return the present contents of the strip."""
        seen, now_s = self.observe(), monotonic()
        return strip_view(observe(self.state, seen, now_s, datetime.now().astimezone()), seen, now_s)


def _with_message(view: WindowState, line: LogLine) -> WindowState:
    return replace(view, messages=(*view.messages, line)[-MAX_LOG_LINES:], message_count=view.message_count + 1)


def _describe_window_event(before: WindowState, view: WindowState, event: WindowEvent) -> tuple[Severity, str] | None:
    """Return severity and log message of an event other than the operator's; None if it is not logged."""
    match event:
        case RunRequested(title) if view.queued:
            return Severity.INFO, f"{title} begins when the bench is connected"
        case RunRequested() | OperatorAction():
            return None
        case CommissioningEnded(message, passed):
            return (Severity.SUCCESS if passed else Severity.WARNING), message
        case DriveReadbackChanged(_, low_v, high_v):
            return _describe_aim(view, "the drive", (low_v, high_v)) if view.off_aim is not before.off_aim else None
        case _:
            return describe_event(event)


def _describe_aim(view: WindowState, aim: str, volts: tuple[float, float]) -> tuple[Severity, str]:
    """Return severity and log message of a change in the card's reading."""
    if not view.off_aim:
        return Severity.INFO, f"The card sees {aim} again"
    severity = Severity.WARNING if view.phase is BenchState.IDLE else Severity.ERROR
    return severity, f"The card does not see {aim}, but {describe_volts(volts, view.amplifier)}"


def _transition(view: WindowState, timed: TimedEvent) -> WindowState:
    event = timed.event
    return (
        _after_action(view, event, timed.at_s)
        or _after_connection(view, event)
        or _after_prompt(view, event)
        or _after_run_event(view, event, timed.streamed_s)
        or _after_safety_event(view, event, timed.at_s)
        or view
    )


def observe(view: WindowState, seen: Observation, now_s: float, time: datetime) -> WindowState:
    """Return the state with the instruments' last answers taken into account; the same object if nothing has changed.

    Args:
        view: the state.
        seen: what they answered.
        now_s: present time (time.monotonic).
        time: the same, for the log.
    """
    if (card := seen.card) is None:
        return view
    live, age_s = view.phase is BenchState.LIVE, card.age_s(now_s)
    is_read = view.phase in (*ENERGIZED, BenchState.HV_OFF) or (
        view.watched if not view.busy else view.phase is BenchState.GOING_TO_REST and view.high_voltage is True
    )
    unread = is_read and view.busy and age_s > KNOWN_S and view.high_voltage is not False
    off_aim, remarks = view.off_aim, {k: v for k, v in view.remarks.items() if k != "card"}
    if age_s <= PRESENT_S:
        is_set = now_s - seen.answered_s.get("generator", -math.inf) <= PRESENT_S
        off_aim = _is_off_aim(view, card, is_set) or _is_still(view, seen.commanded, card)
        remarks = {} if card.sensor_in_range else {"sensor": "sees no target"}
        if card.sensor_still:
            remarks["sensor"] = "stood still under the drive"
        if live and monitor_disagrees(card, view.amplifier):
            remarks["amplifier"] = "its monitor and its input disagree"
    if card.unread or (is_read and age_s > PRESENT_S):
        remarks["card"] = "is not read"
    if (unread, off_aim, remarks) == (view.unread, view.off_aim, view.remarks):
        return view
    after = replace(view, unread=unread, off_aim=off_aim, remarks=remarks)
    if off_aim is view.off_aim:
        return after
    aim = "rest" if view.drive is None or not live else "the drive"
    return _with_message(after, LogLine(time, *_describe_aim(after, aim, card.block_v)))


def _is_off_aim(view: WindowState, card: CardReading, is_set: bool) -> bool:
    """Return whether the last block shows another voltage than is wanted; `is_set`: the source has just answered, as between the steps of a ramp."""
    off_rest = is_off_rest(card.block_v, view.amplifier)
    match view.phase:
        case BenchState.LIVE if view.drive is not None:
            return view.off_aim  # compared with the drive by the abort levels
        case BenchState.LIVE:
            on_its_way = card.moves or is_set  # to a drive that begins
            return off_rest and (view.off_aim or not on_its_way)
        case BenchState.PAUSED | BenchState.HV_OFF | BenchState.AT_REST | BenchState.IDLE | BenchState.UNSAFE:
            return off_rest
        case BenchState.GOING_TO_REST:
            return off_rest and (view.off_aim or (card.measured_s > view.obey_by_s and not card.moves))
        case _:
            return False


def _is_still(view: WindowState, commanded: Drive | None, card: CardReading) -> bool:
    """Return whether the input stands still off rest although the present drive swings, and the one that may follow it by now."""
    return (
        view.phase is BenchState.LIVE
        and all(drive is not None and card.lacks_swing(drive) for drive in (view.drive, commanded))
        and is_off_rest(card.block_v, view.amplifier)
    )


def _after_action(view: WindowState, event: WindowEvent, at_s: float) -> WindowState | None:
    """Return the window state after an action of the operator; None after another event."""
    match event:
        case OperatorAction.RECONNECT if not view.busy:
            phase = BenchState.UNSAFE if view.rest_lost else BenchState.CONNECTING
            view = replace(view, phase=phase, problem="", off_aim=False, connecting_since_s=at_s)
            return _disconnected(view, Lamp.WAITING)
        case OperatorAction.PAUSE if view.can_pause:
            return replace(view, pause_requested=not view.paused)
        case OperatorAction.STOP if view.queued:
            return replace(view, queued="")
        case OperatorAction.STOP if view.busy and view.phase not in (BenchState.GOING_TO_REST, BenchState.UNSAFE):
            return _going_to_rest(view, at_s + STOP_OBEY_S)
        case OperatorAction.ACKNOWLEDGE if view.unsafe or view.problem or view.verdict_message:
            return replace(view, unsafe="", problem="", verdict_message="")
        case _:
            return None


def _going_to_rest(view: WindowState, obey_by_s: float) -> WindowState:
    return replace(view, phase=BenchState.GOING_TO_REST, prompt=None, obey_by_s=obey_by_s)


def _after_connection(view: WindowState, event: WindowEvent) -> WindowState | None:
    """Return the window state after a bench was opened or lost, or a run was requested or rejected; None after another event."""
    match event:
        case InstrumentAwaited(role) if not view.connected:
            return replace(view, awaited=role)
        case BenchOpened(name, simulated, identities, gain):
            there = tuple(InstrumentStatus(role, identity, Lamp.READY) for role, identity in identities.items())
            view = replace(
                view,
                bench_name=name,
                simulated=simulated,
                fitted=there,
                connected=True,
                awaited="",
                problem="",
                busy=False,
            )
            view = replace(view, high_voltage=None, warned=False, unread=False, off_aim=False, suspects=frozenset())
            return replace(view, gain_uncertainty=gain, phase=_phase_between_runs(view))
        case BenchFailed(reason):
            was_on = view.high_voltage is True and view.phase in (*ENERGIZED, BenchState.GOING_TO_REST)
            phase = BenchState.UNSAFE if view.rest_lost or view.danger or was_on else BenchState.NO_BENCH
            view = replace(view, phase=phase, unread=False, busy=False, queued="", problem=reason, prompt=None)
            return _disconnected(view, Lamp.MISSING)
        case RunRequested(title) if view.can_queue:
            return replace(view, queued=title)
        case RunRequested(title, reads):
            progress = RunProgress(title, 0, 0.0, label=f"reading {reads}" if reads else "")
            view = replace(
                view, busy=True, progress=progress, problem="", prompt=None, pause_requested=False, paused=False,
                verdict_message="", queued="",
            )  # fmt: skip
            return view if reads else _without_results(view)
        case MonitorStarted():
            problem = "" if view.problem.startswith(NO_LIVE_VALUES) else view.problem
            return replace(view, watched=True, problem=problem, suspects=view.suspects - {"card"})
        case MonitorFailed(reason) if not view.busy:
            return replace(view, problem=reason, watched=False, suspects=view.suspects | {"card"})
        case CommissioningEnded(message):
            phase, unsafe = BenchState.CONNECTING, view.unsafe
            if view.rest_lost:
                phase, unsafe = BenchState.UNSAFE, message
            view = replace(view, phase=phase, unsafe=unsafe, drive=None, prompt=None, rest=None)
            view = replace(view, connecting_since_s=math.nan)
            return _disconnected(replace(view, busy=False, progress=None), Lamp.WAITING)
        case RunRejected(reason):
            before = view.outcome or RunEnded(RunStatus.FAILED, reason, "")
            outcome = replace(
                before, status=RunStatus.FAILED, reason=reason
            )  # entries of the run that was read can be repeated
            return replace(
                view, busy=False, progress=None, problem=reason, phase=_phase_between_runs(view), outcome=outcome
            )
        case _:
            return None


def _after_prompt(view: WindowState, event: WindowEvent) -> WindowState | None:
    """Return the window state after a prompt, arming, a pause or its end; None after another event."""
    match event:
        case PromptShown() if view.phase is BenchState.GOING_TO_REST:
            return view  # shown just before Stop: nothing that it asks for is to be done any more
        case PromptShown(_, prompt):
            if prompt.action == ENABLE_HIGH_VOLTAGE.action and view.phase in BEFORE_HIGH_VOLTAGE:
                # The operator switches high voltage on before answering: the specimen is live from now on.
                return replace(view, prompt=event, phase=BenchState.LIVE, high_voltage=True, drive=None)
            # In a run, rest is measured before the prompt to switch off.
            off = prompt.action == DISABLE_HIGH_VOLTAGE.action and view.phase is BenchState.LIVE
            return replace(view, prompt=event, drive=None if off else view.drive)
        case PromptAnswered(ask_id, _) if view.prompt is not None and view.prompt.ask_id == ask_id:
            off = view.prompt.prompt.action == DISABLE_HIGH_VOLTAGE.action
            view = replace(
                view, prompt=None, answered=view.answered + 1, high_voltage=False if off else view.high_voltage
            )
            return replace(view, phase=BenchState.HV_OFF if off and view.phase in ENERGIZED else view.phase)
        case BenchArmed(high_voltage):
            return _with_live_phase(replace(view, rest_lost=False, suspects=frozenset(), high_voltage=high_voltage))
        case RunPaused() if view.phase is not BenchState.GOING_TO_REST:
            phase = BenchState.HV_OFF if view.high_voltage is False else BenchState.PAUSED
            return replace(view, phase=phase, pause_requested=False, paused=True, drive=None, prompt=None)
        case RunResumed():
            return _with_live_phase(replace(view, pause_requested=False, paused=False))
        case _:
            return None


def _after_run_event(view: WindowState, event: WindowEvent, streamed_s: float) -> WindowState | None:
    """Return the window state after the start, progress, results or end of a run; None after another event."""
    match event:
        case RunStarted():
            title = protocol_title(event.protocol)
            if event.specimen not in ("", UNNAMED):
                title += f" of {event.specimen}"
            progress = RunProgress(title, event.entries, event.expected_s, remaining_s=event.expected_s)
            phase = view.phase if view.phase is BenchState.GOING_TO_REST else BenchState.ARMING
            view = replace(_without_results(view), busy=True, phase=phase, progress=progress, simulated=event.simulated)
            view = replace(view, rest=None, drive=None, warned=False, unread=False, watched=False)
            return replace(view, high_voltage=None, off_aim=False, protocol=event.protocol, answered=0)
        case ProgressUpdated(done, entries, left_s, label, then) if view.progress is not None:
            progress = replace(view.progress, done=done, entries=entries, remaining_s=left_s, label=label, then=then)
            progress = replace(progress, updated_at_s=streamed_s)
            return replace(view, progress=progress)
        case PointMeasured(_, point, entry, replaces):
            points = list(view.points)
            if replaces is not None and replaces < len(points):
                points[replaces] = replace(points[replaces], quality=points[replaces].quality | Quality.SUPERSEDED)
            view = replace(view, suspects=_suspects_after_point(view, Quality(point.quality)))
            return replace(view, points=(*points, point), entries=(*view.entries, entry))
        case SeriesReady(curve):
            which = (curve.entry, curve.name, curve.label)
            others = tuple(c for c in view.curves if (c.entry, c.name, c.label) != which)
            return replace(view, curves=(*others, curve))
        case RunEnded():
            return _with_outcome(view, event)
        case _:
            return None


def _after_safety_event(view: WindowState, event: WindowEvent, at_s: float) -> WindowState | None:
    """Return the window state after a drive began or was lost, or the bench went to rest; None after another event."""
    match event:
        case DriveStarted(drive):
            return _with_live_phase(replace(view, drive=drive, off_aim=False))
        case ShutdownStarted(wait_s):
            return _going_to_rest(view, at_s + OBEY_S + wait_s)
        case SpecimenMayBeLive(words=words, part=part):
            if view.phase is not BenchState.GOING_TO_REST:
                view = _going_to_rest(view, at_s + STOP_OBEY_S)
            suspects = view.suspects | (_named_in(view, words) or {part})
            return replace(view, prompt=None, problem=words, warned=True, suspects=suspects)
        case DriveReadbackChanged(lost) if view.phase is BenchState.LIVE:
            return replace(view, off_aim=lost)
        case LevelExceeded(level):
            return replace(view, suspects=view.suspects | PARTS_OF_LEVELS.get(level, {"sensor"}))
        case RestMeasured(confirmed, measured_v):
            phase, suspects = BenchState.AT_REST, view.suspects
            if not confirmed:
                phase, suspects = BenchState.UNSAFE, suspects | {"card" if math.isnan(measured_v) else "generator"}
            view = replace(
                view, phase=phase, rest=event, rest_lost=not confirmed, warned=False, unread=False, drive=None
            )
            return replace(view, off_aim=not confirmed and view.off_aim, suspects=suspects)
        case _:
            return None


def _without_results(view: WindowState) -> WindowState:
    """Clear the results of the previous run, and its protocol."""
    return replace(view, protocol="", outcome=None, points=(), entries=(), curves=())


def _with_live_phase(view: WindowState) -> WindowState:
    if view.phase is BenchState.GOING_TO_REST:  # a run that is to stop may still report earlier events
        return view
    return replace(view, phase=BenchState.HV_OFF if view.high_voltage is False else BenchState.LIVE)


def _phase_between_runs(view: WindowState) -> BenchState:
    """Return the phase between runs: unsafe until rest is measured."""
    if view.rest_lost:
        return BenchState.UNSAFE
    return BenchState.AT_REST if view.rest is not None else BenchState.IDLE


def _with_outcome(view: WindowState, event: RunEnded) -> WindowState:
    unsafe = event.status is RunStatus.UNSAFE
    failed = event.status is RunStatus.FAILED
    return replace(
        view,
        phase=BenchState.UNSAFE if unsafe else _phase_between_runs(view),
        rest_lost=unsafe or view.rest_lost,
        busy=False,
        pause_requested=False,
        paused=False,
        drive=None,
        prompt=None,
        outcome=event,
        suspects=view.suspects | (_named_in(view, event.reason) if failed or unsafe else set()),
        unsafe=event.reason if unsafe else view.unsafe,
        problem=event.reason if failed else "" if unsafe else view.problem,
        verdict_message=describe_verdict(event.verdict, reasons_shown=_shows_checks(view.protocol)),
    )


def _shows_checks(protocol: str) -> bool:
    """Return whether the checks of a run are shown as a table."""
    kind = PROTOCOLS.get(protocol)
    return kind is not None and kind.passes_or_fails


def _disconnected(view: WindowState, lamp: Lamp) -> WindowState:
    """Return the state of a bench whose instruments are not connected."""
    fitted = tuple(replace(instrument, lamp=lamp) for instrument in view.fitted)
    return replace(view, fitted=fitted, connected=False, awaited="", watched=False, suspects=frozenset())


def _named_in(view: WindowState, message: str) -> set[str]:
    """Return the roles of the instruments with which a driver's message begins."""
    roles = (instrument.role for instrument in view.fitted)
    return {r for r in roles if re.search(INSTRUMENT_PATTERN.format(role=re.escape(r)), message)}


def _suspects_after_point(view: WindowState, quality: Quality) -> frozenset[str]:
    """Return the suspect parts after a point: those at which its flags point; a usable point clears all."""
    if quality.usable:
        return frozenset()
    return view.suspects.union(*(parts for flags, parts in PARTS_OF_FLAGS.items() if quality & flags))
