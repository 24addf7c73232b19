"""From what happens to what the window shows: `reduce` makes the next view from the last and an event. Pure."""

import re
from dataclasses import replace

from app.session.messages import Level, Message, sentence, title_of
from app.session.session import BenchFailed, BenchOpened, Refused
from app.session.state import (
    Acknowledged,
    BenchState,
    ConnectAsked,
    Heard,
    Instrument,
    Lamp,
    PauseAsked,
    Progress,
    RunAsked,
    StopAsked,
    View,
    ViewEvent,
)
from protocols.base.events import (
    Answered,
    Armed,
    Asked,
    AtRest,
    CurveReady,
    GoingToRest,
    Paused,
    Playing,
    PointMeasured,
    Progressed,
    Resumed,
    RunEnded,
    RunStarted,
    Status,
)
from protocols.base.operator import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE
from protocols.base.quality import Quality

LOG_LINES = 500

SPOKEN_FOR = r"\b{role} [^:.;,]{{1,40}}:"
"""A driver's sentence begins with its instrument: `function generator 33511B: no answer ...`."""


def reduce(view: View, heard: Heard) -> View:
    """The view after an event."""
    event = heard.event
    after = _next(view, event, heard.streamed_s)
    if isinstance(event, RunAsked | PauseAsked | StopAsked | Acknowledged | ConnectAsked):
        said = _asked_words(event, after) if after is not view else None
    else:
        said = sentence(event)
    if said is None:
        return after
    messages = (*after.messages, Message(heard.at, *said))[-LOG_LINES:]
    return replace(after, messages=messages, told=after.told + 1)


def _next(view: View, event: ViewEvent, streamed_s: float) -> View:
    match event:
        case BenchOpened(name, simulated, identities):
            there = tuple(Instrument(role, identity, Lamp.READY) for role, identity in identities.items())
            view = replace(view, bench=name, simulated=simulated, instruments=there, connected=True, trouble="")
            return replace(view, state=_resting(view))
        case BenchFailed(words):
            gone = _lamps(view, Lamp.ABSENT)
            state = BenchState.UNSAFE if view.rest_lost else BenchState.NO_BENCH
            view = replace(view, state=state, connected=False, instruments=gone)
            return replace(view, busy=False, trouble=words, prompt=None)
        case ConnectAsked():
            state = BenchState.UNSAFE if view.rest_lost else BenchState.CONNECTING
            return replace(view, state=state, instruments=_lamps(view, Lamp.WAITING), trouble="")
        case RunAsked(title, reads):
            progress = Progress(title, 0, 0.0, label=f"reading {reads}" if reads else "")
            view = replace(view, busy=True, progress=progress, trouble="", prompt=None, pausing=False, paused=False)
            return view if reads else _bare(view)
        case Refused(words):
            before = view.outcome or RunEnded(Status.FAILED, words, "")
            outcome = replace(before, status=Status.FAILED, reason=words)  # a run that was read can be asked for again
            return replace(view, busy=False, progress=None, trouble=words, state=_resting(view), outcome=outcome)
        case RunStarted():
            progress = Progress(title_of(event.protocol), event.entries, event.expected_s, left_s=event.expected_s)
            state = view.state if view.state is BenchState.GOING_TO_REST else BenchState.ARMING
            view = replace(_bare(view), busy=True, state=state, progress=progress, simulated=event.simulated)
            return replace(view, rest=None, drive=None, protocol=event.protocol)
        case Asked(_, prompt):
            # Whoever is asked to switch high voltage on does so before answering: it is live from now on.
            off = view.state in (BenchState.ARMING, BenchState.HV_OFF)
            live = prompt.action == ENABLE_HIGH_VOLTAGE.action and off
            return replace(view, prompt=event, state=BenchState.LIVE if live else view.state)
        case Answered(ask_id, _) if view.prompt is not None and view.prompt.ask_id == ask_id:
            # In a run, rest is measured before the operator is asked to switch off.
            off = view.prompt.prompt.action == DISABLE_HIGH_VOLTAGE.action and view.state is BenchState.LIVE
            return replace(
                view, prompt=None, drive=None if off else view.drive, state=_off(view) if off else view.state
            )
        case Armed(high_voltage):
            view = replace(view, rest_lost=False, instruments=_lamps(view, Lamp.READY), high_voltage=high_voltage)
            return _live(view)
        case Playing(drive):
            return _live(replace(view, drive=drive))
        case PauseAsked() if view.can_pause:
            return replace(view, pausing=not view.paused)
        case Paused() if view.state is not BenchState.GOING_TO_REST:
            state = BenchState.PAUSED if view.high_voltage else BenchState.HV_OFF
            return replace(view, state=state, pausing=False, paused=True, drive=None, prompt=None)
        case Resumed():
            return _live(replace(view, pausing=False, paused=False))
        case Progressed(done, entries, left_s, label) if view.progress is not None:
            progress = replace(view.progress, done=done, entries=entries, left_s=left_s, label=label, at_s=streamed_s)
            return replace(view, progress=progress)
        case PointMeasured(_, point, entry, replaces):
            points = list(view.points)
            if replaces is not None and replaces < len(points):
                points[replaces] = replace(points[replaces], quality=points[replaces].quality | Quality.SUPERSEDED)
            return replace(view, points=(*points, point), entries=(*view.entries, entry))
        case CurveReady(curve):
            which = (curve.entry, curve.name, curve.label)
            others = tuple(c for c in view.curves if (c.entry, c.name, c.label) != which)
            return replace(view, curves=(*others, curve))
        case StopAsked() if view.busy and view.state not in (BenchState.GOING_TO_REST, BenchState.UNSAFE):
            return replace(view, state=BenchState.GOING_TO_REST, prompt=None)
        case GoingToRest():
            return replace(view, state=BenchState.GOING_TO_REST, prompt=None)
        case AtRest(confirmed):
            state = BenchState.AT_REST if confirmed else BenchState.UNSAFE
            return replace(view, state=state, rest=event, rest_lost=not confirmed, drive=None)
        case RunEnded():
            return _ended(view, event)
        case Acknowledged() if view.unsafe or view.trouble:
            return replace(view, unsafe="", trouble="")
        case _:
            return view


def _bare(view: View) -> View:
    """Nothing of the run before."""
    return replace(view, outcome=None, points=(), entries=(), curves=())


def _live(view: View) -> View:
    # A run that was asked to stop may still tell what it did before it heard.
    if view.state is BenchState.GOING_TO_REST:
        return view
    return replace(view, state=BenchState.LIVE if view.high_voltage else BenchState.HV_OFF)


def _off(view: View) -> BenchState:
    return view.state if view.state is BenchState.GOING_TO_REST else BenchState.HV_OFF


def _resting(view: View) -> BenchState:
    """What is known between runs: unsafe stays unsafe until rest is measured."""
    if view.rest_lost:
        return BenchState.UNSAFE
    return BenchState.AT_REST if view.rest is not None else BenchState.IDLE


def _ended(view: View, event: RunEnded) -> View:
    unsafe = event.status is Status.UNSAFE
    failed = event.status is Status.FAILED
    instruments = view.instruments
    if failed or unsafe:
        named = [i.role for i in instruments if re.search(SPOKEN_FOR.format(role=re.escape(i.role)), event.reason)]
        instruments = tuple(replace(i, lamp=Lamp.DOUBTED) if i.role in named else i for i in instruments)
    return replace(
        view,
        state=BenchState.UNSAFE if unsafe else _resting(view),
        rest_lost=unsafe or view.rest_lost,
        busy=False,
        pausing=False,
        paused=False,
        drive=None,
        prompt=None,
        outcome=event,
        instruments=instruments,
        unsafe=event.reason if unsafe else view.unsafe,
        trouble=event.reason if failed else view.trouble,
    )


def _lamps(view: View, lamp: Lamp) -> tuple[Instrument, ...]:
    return tuple(replace(instrument, lamp=lamp) for instrument in view.instruments)


def _asked_words(
    event: RunAsked | PauseAsked | StopAsked | Acknowledged | ConnectAsked, view: View
) -> tuple[Level, str] | None:
    match event:
        case PauseAsked():
            return Level.PLAIN, "Pause was asked" if view.pausing else "Going on was asked"
        case StopAsked():
            return Level.ATTENTION, "Stop was asked; the bench goes to rest"
        case ConnectAsked():
            return Level.PLAIN, "Connecting again"
        case Acknowledged():
            return Level.PLAIN, "The message was acknowledged"
    return None
