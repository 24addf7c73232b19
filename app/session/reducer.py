"""Reducer: the next window state from the last one and an event. Pure."""

import math
import re
from dataclasses import replace

from app.common import Severity
from app.session.messages import LogLine, describe_event, describe_verdict, protocol_title
from app.session.session import BenchFailed, BenchOpened, MonitorFailed, RunRejected
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
from protocols import PROTOCOLS
from protocols.base import (
    DISABLE_HIGH_VOLTAGE,
    ENABLE_HIGH_VOLTAGE,
    BenchArmed,
    DriveReadbackChanged,
    DriveStarted,
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


def reduce(view: WindowState, timed_event: TimedEvent) -> WindowState:
    """Return the window state after an event."""
    event = timed_event.event
    after = _transition(view, event, timed_event.streamed_s)
    if isinstance(event, OperatorAction):
        resumed = event is OperatorAction.PAUSE and not after.pause_requested
        message = None if after is view else RESUME_MESSAGE if resumed else ACTION_MESSAGES[event]
    else:
        message = _describe_window_event(view, after, event)
    if message is None:
        return after
    messages = (*after.messages, LogLine(timed_event.time, *message))[-MAX_LOG_LINES:]
    return replace(after, messages=messages, message_count=after.message_count + 1)


def _describe_window_event(before: WindowState, view: WindowState, event: WindowEvent) -> tuple[Severity, str] | None:
    """Return severity and log message of an event other than the operator's; None if it is not logged."""
    match event:
        case RunRequested() | OperatorAction():
            return None
        case CommissioningEnded(message, passed):
            return (Severity.SUCCESS if passed else Severity.WARNING), message
        case DriveReadbackChanged() if view.bench_state is before.bench_state:
            return None
        case DriveReadbackChanged(lost=True):
            return Severity.ERROR, f"The drive is not seen: {view.voltage_text} on the specimen {view.voltage_note}"
        case DriveReadbackChanged():
            return Severity.INFO, "The card sees the drive again"
        case _:
            return describe_event(event)


def _transition(view: WindowState, event: WindowEvent, streamed_s: float) -> WindowState:
    return (
        _after_action(view, event)
        or _after_connection(view, event)
        or _after_prompt(view, event)
        or _after_run_event(view, event, streamed_s)
        or _after_safety_event(view, event)
        or view
    )


def _after_action(view: WindowState, event: WindowEvent) -> WindowState | None:
    """Return the window state after an action of the operator; None after another event."""
    match event:
        case OperatorAction.RECONNECT:
            state = BenchState.UNSAFE if view.rest_lost else BenchState.CONNECTING
            return replace(view, bench_state=state, instruments=_with_lamps(view, Lamp.WAITING), problem="")
        case OperatorAction.PAUSE if view.can_pause:
            return replace(view, pause_requested=not view.paused)
        case OperatorAction.STOP if view.busy and view.bench_state not in (BenchState.GOING_TO_REST, BenchState.UNSAFE):
            return replace(view, bench_state=BenchState.GOING_TO_REST, prompt=None)
        case OperatorAction.ACKNOWLEDGE if view.unsafe or view.problem or view.verdict_message:
            return replace(view, unsafe="", problem="", verdict_message="")
        case _:
            return None


def _after_connection(view: WindowState, event: WindowEvent) -> WindowState | None:
    """Return the window state after a bench was opened or lost, or a run was requested or rejected; None after another event."""
    match event:
        case BenchOpened(name, simulated, identities, gain):
            there = tuple(InstrumentStatus(role, identity, Lamp.READY) for role, identity in identities.items())
            state = _state_between_runs(view)
            view = replace(view, bench_name=name, simulated=simulated, instruments=there, connected=True, problem="")
            return replace(view, gain_uncertainty=gain, bench_state=state)
        case BenchFailed(reason):
            gone = _with_lamps(view, Lamp.MISSING)
            state = BenchState.UNSAFE if view.rest_lost else BenchState.NO_BENCH
            view = replace(view, bench_state=state, connected=False, instruments=gone)
            return replace(view, busy=False, problem=reason, prompt=None)
        case RunRequested(title, reads):
            progress = RunProgress(title, 0, 0.0, label=f"reading {reads}" if reads else "")
            view = replace(
                view, busy=True, progress=progress, problem="", prompt=None, pause_requested=False, paused=False,
                verdict_message="",
            )  # fmt: skip
            return view if reads else _without_results(view)
        case MonitorFailed(reason) if not view.busy:
            return replace(view, problem=reason)
        case CommissioningEnded():
            waiting = _with_lamps(view, Lamp.WAITING)
            view = replace(view, busy=False, progress=None, connected=False, rest=None, instruments=waiting)
            return replace(view, bench_state=BenchState.UNSAFE if view.rest_lost else BenchState.CONNECTING)
        case RunRejected(reason):
            before = view.outcome or RunEnded(RunStatus.FAILED, reason, "")
            outcome = replace(
                before, status=RunStatus.FAILED, reason=reason
            )  # entries of the run that was read can be repeated
            return replace(
                view, busy=False, progress=None, problem=reason, bench_state=_state_between_runs(view), outcome=outcome
            )
        case _:
            return None


def _after_prompt(view: WindowState, event: WindowEvent) -> WindowState | None:
    """Return the window state after a prompt, arming, a pause or its end; None after another event."""
    match event:
        case PromptShown() if view.bench_state is BenchState.GOING_TO_REST:
            return view  # shown just before Stop: nothing that it asks for is to be done any more
        case PromptShown(_, prompt):
            # The operator switches high voltage on before answering: the specimen is live from now on.
            off = view.bench_state in (BenchState.ARMING, BenchState.HV_OFF)
            live = prompt.action == ENABLE_HIGH_VOLTAGE.action and off
            return replace(view, prompt=event, bench_state=BenchState.LIVE if live else view.bench_state)
        case PromptAnswered(ask_id, _) if view.prompt is not None and view.prompt.ask_id == ask_id:
            # In a run, rest is measured before the prompt to switch off.
            off = view.prompt.prompt.action == DISABLE_HIGH_VOLTAGE.action and view.bench_state in ENERGIZED
            return replace(
                view,
                prompt=None,
                drive=None if off else view.drive,
                bench_state=BenchState.HV_OFF if off else view.bench_state,
            )
        case BenchArmed(high_voltage):
            view = replace(view, rest_lost=False, instruments=_with_lamps(view, Lamp.READY), high_voltage=high_voltage)
            return _with_live_state(view)
        case RunPaused() if view.bench_state is not BenchState.GOING_TO_REST:
            state = BenchState.PAUSED if view.high_voltage else BenchState.HV_OFF
            return replace(view, bench_state=state, pause_requested=False, paused=True, drive=None, prompt=None)
        case RunResumed():
            return _with_live_state(replace(view, pause_requested=False, paused=False))
        case _:
            return None


def _after_run_event(view: WindowState, event: WindowEvent, streamed_s: float) -> WindowState | None:
    """Return the window state after the start, progress, results or end of a run; None after another event."""
    match event:
        case RunStarted():
            progress = RunProgress(
                protocol_title(event.protocol), event.entries, event.expected_s, remaining_s=event.expected_s
            )
            state = view.bench_state if view.bench_state is BenchState.GOING_TO_REST else BenchState.ARMING
            view = replace(
                _without_results(view), busy=True, bench_state=state, progress=progress, simulated=event.simulated
            )
            return replace(view, rest=None, drive=None, seen_v=None, protocol=event.protocol)
        case ProgressUpdated(done, entries, left_s, label) if view.progress is not None:
            progress = replace(
                view.progress, done=done, entries=entries, remaining_s=left_s, label=label, updated_at_s=streamed_s
            )
            return replace(view, progress=progress)
        case PointMeasured(_, point, entry, replaces):
            points = list(view.points)
            if replaces is not None and replaces < len(points):
                points[replaces] = replace(points[replaces], quality=points[replaces].quality | Quality.SUPERSEDED)
            return replace(view, points=(*points, point), entries=(*view.entries, entry))
        case SeriesReady(curve):
            which = (curve.entry, curve.name, curve.label)
            others = tuple(c for c in view.curves if (c.entry, c.name, c.label) != which)
            return replace(view, curves=(*others, curve))
        case RunEnded():
            return _with_outcome(view, event)
        case _:
            return None


def _after_safety_event(view: WindowState, event: WindowEvent) -> WindowState | None:
    """Return the window state after a drive began or was lost, or the bench went to rest; None after another event."""
    match event:
        case DriveStarted(drive):
            return _with_live_state(replace(view, drive=drive))
        case ShutdownStarted():
            return replace(view, bench_state=BenchState.GOING_TO_REST, prompt=None)
        case SpecimenMayBeLive(low_v, high_v, words):
            seen_v = _finite_range(low_v, high_v) or view.seen_v
            return replace(
                view, bench_state=BenchState.GOING_TO_REST, prompt=None, problem=words, seen_v=seen_v, may_be_live=True
            )
        case DriveReadbackChanged(lost, low_v, high_v) if view.bench_state in ENERGIZED:
            state = BenchState.DRIVE_LOST if lost else BenchState.LIVE
            return replace(view, bench_state=state, seen_v=(low_v, high_v) if lost else None)
        case RestMeasured(confirmed, measured_v):
            state = BenchState.AT_REST if confirmed else BenchState.UNSAFE
            seen_v = None if confirmed else _finite_range(measured_v, measured_v) or view.seen_v
            view = replace(view, bench_state=state, rest=event, rest_lost=not confirmed, may_be_live=False)
            return replace(view, drive=None, seen_v=seen_v)
        case _:
            return None


def _finite_range(low_v: float, high_v: float) -> tuple[float, float] | None:
    """Return a range of volts; None if the card saw nothing."""
    return (low_v, high_v) if math.isfinite(low_v) and math.isfinite(high_v) else None


def _without_results(view: WindowState) -> WindowState:
    """Clear the results of the previous run."""
    return replace(view, outcome=None, points=(), entries=(), curves=())


def _with_live_state(view: WindowState) -> WindowState:
    # A run that is to stop may still report earlier events, and a drive that is lost is not back with the next entry.
    if view.bench_state in (BenchState.GOING_TO_REST, BenchState.DRIVE_LOST):
        return view
    return replace(view, bench_state=BenchState.LIVE if view.high_voltage else BenchState.HV_OFF)


def _state_between_runs(view: WindowState) -> BenchState:
    """Return the bench state between runs: unsafe until rest is measured."""
    if view.rest_lost:
        return BenchState.UNSAFE
    return BenchState.AT_REST if view.rest is not None else BenchState.IDLE


def _with_outcome(view: WindowState, event: RunEnded) -> WindowState:
    unsafe = event.status is RunStatus.UNSAFE
    failed = event.status is RunStatus.FAILED
    instruments = view.instruments
    if failed or unsafe:
        named = [
            i.role for i in instruments if re.search(INSTRUMENT_PATTERN.format(role=re.escape(i.role)), event.reason)
        ]
        instruments = tuple(replace(i, lamp=Lamp.SUSPECT) if i.role in named else i for i in instruments)
    return replace(
        view,
        bench_state=BenchState.UNSAFE if unsafe else _state_between_runs(view),
        rest_lost=unsafe or view.rest_lost,
        busy=False,
        pause_requested=False,
        paused=False,
        drive=None,
        prompt=None,
        outcome=event,
        instruments=instruments,
        unsafe=event.reason if unsafe else view.unsafe,
        problem=event.reason if failed else "" if unsafe else view.problem,
        verdict_message=describe_verdict(event.verdict, reasons_shown=_shows_checks(view.protocol)),
    )


def _shows_checks(protocol: str) -> bool:
    """Return whether the checks of a run are shown as a table."""
    kind = PROTOCOLS.get(protocol)
    return kind is not None and kind.passes_or_fails


def _with_lamps(view: WindowState, lamp: Lamp) -> tuple[InstrumentStatus, ...]:
    return tuple(replace(instrument, lamp=lamp) for instrument in view.instruments)
