"""Log messages of session events."""

from dataclasses import dataclass
from datetime import datetime
from pathlib import PurePath

from app.common import (
    Severity,
    format_duration,
    format_point,
    format_series,
    outcome_severity,
    pluralize,
    sentence_case,
)
from app.session.session import BenchFailed, BenchOpened, MonitorFailed, RunRejected, SessionEvent
from model import format_estimate, format_quantity, format_time
from protocols import PROTOCOLS
from protocols.base import (
    MOUNTED_PARTS,
    BenchArmed,
    InjectedFaultChanged,
    InterferenceLine,
    InterferenceMeasured,
    LevelExceeded,
    LogMessage,
    Outcome,
    PointMeasured,
    PromptAnswered,
    PromptShown,
    Quality,
    RestMeasured,
    RunEnded,
    RunPaused,
    RunResumed,
    RunStarted,
    SeriesReady,
    SettlingFinished,
    ShutdownStarted,
    SpecimenMayBeLive,
    SpecimenMounted,
    StopRequested,
    StreamStarted,
    Verdict,
)
from protocols.signals import MAINS_HZ

MAINS_TOLERANCE = 5e-3
"""Relative distance from a multiple of the mains that counts as the mains."""
PRESETS_MENU = "menu Presets"
"""Where the window has the setting; the command line names its option there."""
OFF_MAINS_REMEDY = f"; the setting Mains shift of 3 Hz measures beside the mains ({PRESETS_MENU})"


@dataclass(frozen=True, slots=True)
class LogLine:
    """One line of the log."""

    time: datetime
    severity: Severity
    text: str


def describe_event(event: SessionEvent) -> tuple[Severity, str] | None:
    """Return severity and log message of an event; None if the event is not logged."""
    return _describe_bench_event(event) or _describe_safety_event(event) or _describe_run_event(event)


def _describe_bench_event(event: SessionEvent) -> tuple[Severity, str] | None:
    """Return severity and message of an event of the bench."""
    match event:
        case BenchOpened(name, simulated, identities):
            have = ", ".join(f"{role} {identity}" for role, identity in identities.items())
            return Severity.SUCCESS, f"{name} is open{' (SIMULATED)' if simulated else ''}: {have}"
        case BenchFailed(reason) | RunRejected(reason) | MonitorFailed(reason):
            return Severity.ERROR, reason
        case StreamStarted():
            return Severity.INFO, f"The card runs at {event.rate_hz:g} scans per second"
        case BenchArmed(high_voltage, _, safety):
            if not high_voltage:
                return Severity.SUCCESS, "Rest is measured; high voltage is off and stays off"
            stated = f". Safety: {safety}" if safety else ""
            return (
                Severity.WARNING,
                f"Armed: rest is measured; high voltage is on, as confirmed by the operator{stated}",
            )
        case InterferenceMeasured(_, lines) if lines:
            remedy = "" if all(line.folded or not _mains_of(line) for line in lines) else OFF_MAINS_REMEDY
            return Severity.WARNING, f"At rest the laser sees {', '.join(map(_describe_line, lines))}{remedy}"
    return None


def _describe_safety_event(event: SessionEvent) -> tuple[Severity, str] | None:
    """Return severity and message of an event of abort levels, faults and rest."""
    match event:
        case LevelExceeded():
            return (Severity.WARNING if event.action == "warning" else Severity.ERROR), event.words
        case InjectedFaultChanged(fault, description, active):
            return Severity.WARNING, f"Fault {'injected' if active else 'cleared'}: {description} ({fault})"
        case StopRequested(by):
            return Severity.WARNING, f"A stop was requested by {by}"
        case ShutdownStarted():
            return Severity.INFO, "Going to rest"
        case SpecimenMayBeLive():
            return Severity.ERROR, event.words
        case RestMeasured(confirmed, _, text):
            return (Severity.SUCCESS, f"At rest: {text}") if confirmed else (Severity.ERROR, f"NOT AT REST: {text}")
    return None


def _describe_run_event(event: SessionEvent) -> tuple[Severity, str] | None:
    """Return severity and message of an event of a run."""
    match event:
        case RunStarted():
            points = pluralize(event.entries, "point")
            begun = f"{protocol_title(event.protocol)}: {points}, about {format_duration(event.expected_s)}"
            return Severity.INFO, f"{begun}, into {PurePath(event.path).name}"
        case RunPaused(reason, high_voltage):
            return Severity.WARNING, f"Paused, high voltage {'still on' if high_voltage else 'off'}: {reason}"
        case RunResumed():
            return Severity.INFO, "The run continues with the entry that was interrupted"
        case SettlingFinished(settled=False, after_s=after_s):
            return Severity.WARNING, f"The response did not settle within {after_s:.1f} s; it is recorded and flagged"
        case PointMeasured(_, point):
            usable = Quality(point.quality).usable
            return (Severity.INFO if usable else Severity.WARNING), format_point(point)
        case SeriesReady(curve) if text := format_series(curve):
            return Severity.INFO, text
        case LogMessage(text):
            return Severity.INFO, text
        case PromptShown(_, prompt):
            return Severity.WARNING, f"Asked: {prompt.text}"
        case PromptAnswered(_, choice):
            return Severity.INFO, f"Answered: {choice}"
        case SpecimenMounted(part, time):
            return Severity.INFO, f"Recorded: {MOUNTED_PARTS[part]}, {format_time(time)} UTC"
        case RunEnded():
            return _describe_outcome(event)
    return None


def _mains_of(line: InterferenceLine) -> float:
    """Return the mains frequency that a line is a multiple of; 0 if of none."""
    return next((f for f in MAINS_HZ if abs(line.frequency_hz / f - round(line.frequency_hz / f)) < MAINS_TOLERANCE), 0)


def _describe_line(line: InterferenceLine) -> str:
    """`0.31 ± 0.01 µm at 50.02 Hz (mains)`."""
    size = format_quantity(line.amplitude_m, line.error_m, "m")
    mains = _mains_of(line)
    kind = f" (mains, {mains:g} Hz)" if mains else ""
    if line.folded:
        kind = f" (folded back from {line.folded_from_hz:.6g} Hz, above half the sample rate)"
    return f"{size} at {line.frequency_hz:.6g} Hz{kind}"


def protocol_title(protocol: str) -> str:
    """Return the title of a protocol by its name; the name itself if it is unknown."""
    return PROTOCOLS.title(protocol) if protocol in PROTOCOLS else protocol


MAX_REASONS = 3
"""Reasons of a verdict in a notice; all are in the log."""


def describe_verdict(verdict: Verdict, reasons_shown: bool = False) -> str:
    """Return the verdict on a run that ended but is not good, and its reasons, line by line; else an empty text.

    Args:
        verdict: of the run.
        reasons_shown: the window shows the checks with their remedies: only the outcome and the names follow.
    """
    match verdict.outcome:
        case Outcome.NO_RESULT | Outcome.DOUBTFUL:
            lines = [f"{verdict.outcome}: {verdict.reasons[0]}", *verdict.reasons[1:]]
        case Outcome.DID_NOT_PASS:
            lines = [f"{verdict.outcome}: {', '.join(check.name for check in verdict.failed_checks)}"]
            lines += () if reasons_shown else verdict.reasons
        case _:
            return ""
    if len(lines) > MAX_REASONS:
        lines = [*lines[:MAX_REASONS], f"… and {len(lines) - MAX_REASONS} more in the log"]
    return "\n".join(sentence_case(line) for line in lines)


def _describe_outcome(event: RunEnded) -> tuple[Severity, str]:
    estimates = "".join(f"; {format_estimate(estimate)}" for estimate in event.estimates)
    text = event.summary
    return outcome_severity(event.verdict.outcome), sentence_case(text) + estimates
