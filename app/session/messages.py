"""What happened, as a sentence a person reads in the log; one per event that is worth a line, nothing for the rest."""

from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from pathlib import PurePath
from typing import Any

from app.common.formatting import counted, curve_line, duration, quantity, uncertain
from app.session.session import BenchFailed, BenchOpened, Refused, SessionEvent
from protocols.base.events import (
    Answered,
    Armed,
    Asked,
    AtRest,
    CurveReady,
    FaultSwitched,
    GoingToRest,
    Noted,
    Paused,
    PointMeasured,
    Resumed,
    RunEnded,
    RunStarted,
    SettleEnded,
    Status,
    StreamStarted,
)
from protocols.base.quality import Quality
from protocols.base.records import Estimate
from protocols.registry import PROTOCOLS


class Level(StrEnum):
    """How much a sentence matters."""

    PLAIN = "plain"
    GOOD = "good"
    ATTENTION = "attention"
    BAD = "bad"


@dataclass(frozen=True, slots=True)
class Message:
    """One line of the log."""

    at: datetime
    level: Level
    words: str


def sentence(event: SessionEvent) -> tuple[Level, str] | None:
    """The event in words and how much they matter; None where a person need not read it."""
    match event:
        case BenchOpened(name, simulated, identities):
            have = ", ".join(f"{role} {identity}" for role, identity in identities.items())
            return Level.GOOD, f"{name} is open{' (SIMULATED)' if simulated else ''}: {have}"
        case BenchFailed(words) | Refused(words):
            return Level.BAD, words
        case RunStarted():
            points = counted(event.entries, "point")
            begun = f"{title_of(event.protocol)}: {points}, about {duration(event.expected_s)}"
            return Level.PLAIN, f"{begun}, into {PurePath(event.path).name}"
        case StreamStarted():
            return Level.PLAIN, f"The card runs at {event.rate_hz:g} scans per second"
        case Armed(high_voltage):
            if not high_voltage:
                return Level.GOOD, "Rest is measured; high voltage is off and stays off"
            return Level.ATTENTION, "Armed: rest is measured; high voltage is on, says the operator"
        case Paused(words, high_voltage):
            return Level.ATTENTION, f"Paused, high voltage {'still on' if high_voltage else 'off'}: {words}"
        case Resumed():
            return Level.PLAIN, "The run goes on with the entry that was interrupted"
        case SettleEnded(settled=False, after_s=after_s):
            return Level.ATTENTION, f"The response did not settle within {after_s:.1f} s; it is recorded and flagged"
        case PointMeasured(_, point):
            usable = Quality(point.quality).usable
            return (Level.PLAIN if usable else Level.ATTENTION), point_words(point)
        case CurveReady(curve) if words := curve_line(curve):
            return Level.PLAIN, words
        case Noted(text):
            return Level.PLAIN, text
        case FaultSwitched(fault, words, broken):
            return Level.ATTENTION, f"{'Broken on purpose' if broken else 'Mended'}: {words} ({fault})"
        case Asked(_, prompt):
            return Level.ATTENTION, f"Asked: {prompt.text}"
        case Answered(_, words):
            return Level.PLAIN, f"Answered: {words}"
        case GoingToRest():
            return Level.PLAIN, "Going to rest"
        case AtRest(confirmed, _, words):
            return (Level.GOOD, f"At rest: {words}") if confirmed else (Level.BAD, f"NOT AT REST: {words}")
        case RunEnded():
            return _ended(event)
    return None


def point_words(point: Any) -> str:
    """One point with its value, its uncertainty and what is wrong with it."""
    quality = Quality(point.quality)
    flags, said = quality & ~Quality.SIMULATED, getattr(point, "words", "")
    if not said:
        said = _dwell_words(point)
    return f"{said}; {'' if quality.usable else 'not usable: '}{flags.words}" if flags else said


def _dwell_words(point: Any) -> str:
    peaks = uncertain(1e6 * point.peak_to_peak, 1e6 * point.peak_to_peak_errors, "µm")
    twice = uncertain(2e6 * point.fundamental, 2e6 * point.fundamental_errors, "µm")
    return f"{point.frequency:.4g} Hz: max − min {peaks}, 2 × fundamental {twice}"


def estimate_words(estimate: Estimate) -> str:
    """`resonance frequency 158.3500 ± 0.0072 Hz`."""
    return f"{estimate.name} {quantity(estimate.value, estimate.standard_error, estimate.unit)}"


def title_of(protocol: str) -> str:
    """The title of a protocol by its name; the name itself where it is not known."""
    return PROTOCOLS.title(protocol) if protocol in PROTOCOLS else protocol


def _ended(event: RunEnded) -> tuple[Level, str]:
    level = {Status.COMPLETED: Level.GOOD, Status.STOPPED: Level.ATTENTION}.get(event.status, Level.BAD)
    found = "".join(f"; {estimate_words(estimate)}" for estimate in event.estimates)
    reason, status = event.reason, str(event.status)
    told = reason.casefold().startswith(status)
    return level, (f"{reason[:1].upper()}{reason[1:]}" if told else f"{status.capitalize()}: {reason}") + found
