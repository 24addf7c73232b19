"""Summary of a run file, the row of the catalogue; filters for lists of runs."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from app.archive.figures import run_figures
from app.archive.notes import Notes
from app.common import OUTCOME_SYMBOLS, Severity, outcome_severity
from drivers import LaserSensor
from model import EstimatedQuantity, format_estimate
from protocols.base import Outcome, RunStatus, Verdict
from protocols.registry import PROTOCOLS
from protocols.resume import measured_points
from protocols.runfile.overview import RunOverview, overview_of, read_overview
from protocols.runfile.reader import NewerFormatError, NotARunError, Run, RunReadError, translate_read_errors

STALE_AFTER_S = 600.0
"""A file with status `running` that was not written for this time gets another reason."""


class RunState(StrEnum):
    """State of a run; the first five are stored in the file."""

    COMPLETED = "completed"
    STOPPED = "stopped"
    FAILED = "failed"
    UNSAFE = "unsafe"
    RUNNING = "running"
    CRASHED = "crashed"
    """Status `running`, but the process that wrote it does not exist any more."""
    IMPORTED = "imported"
    """Points come from an imported table."""
    NEWER = "newer version"
    DAMAGED = "damaged"


STATE_SYMBOLS = {
    RunState.RUNNING: ("▶", Severity.WARNING),
    RunState.CRASHED: ("✕", Severity.ERROR),
    RunState.IMPORTED: ("⇥", Severity.INFO),
    RunState.NEWER: ("?", Severity.WARNING),
    RunState.DAMAGED: ("✕", Severity.ERROR),
}
"""Symbols and severities of states that come before the verdict."""


class RunSummary(NamedTuple):
    """Summary of one run; a plain tuple, as a list may have ten thousand."""

    path: str
    """Relative to the folder, with slashes."""
    state: str
    reason: str = ""
    protocol: str = ""
    specimen: str = ""
    start_time: str = ""
    """ISO, UTC: sorts as text."""
    simulated: int = 0
    points: int = 0
    entries: int = 0
    """Entries of the plan that have a point."""
    seconds: float = 0.0
    parameters_json: str = "{}"
    requested_json: str = "{}"
    estimates_json: str = "[]"
    verdict: str = str(Outcome.NOT_JUDGED)
    """The outcome of the verdict."""
    verdict_reasons: str = ""
    """Reasons of the verdict, with remedies."""
    failed_checks: str = ""
    """Names of the checks because of which the run did not pass."""
    found: str = ""
    """Estimates as text."""
    tags: str = ""
    note: str = ""
    operator: str = ""
    checked_by: str = ""
    """Second persons who checked it."""
    temperature_c: float | None = None
    humidity: float | None = None
    """Relative, 0 to 1."""
    bench: str = ""
    """Name of the bench."""
    instruments: str = ""
    """Identities with serial numbers, and the state of the sensor's calibration, as text."""
    sensor: str = ""
    """Name and serial number of the displacement sensor."""
    figures_json: str = "[]"
    """Figures for comparisons with other runs and specimens, see `app.archive.figures`."""
    modified_ns: int = 0
    size: int = 0
    notes_ns: int = 0
    words: str = ""
    """Text that is searched, casefolded."""

    @property
    def name(self) -> str:
        return PurePosixPath(self.path).name

    @property
    def started_at(self) -> datetime | None:
        """Start time in local time; None if unknown."""
        try:
            return datetime.fromisoformat(self.start_time).astimezone()
        except (ValueError, OverflowError, OSError):  # also years that the local time zone does not reach
            return None

    @property
    def readable(self) -> bool:
        """Whether the file can be opened."""
        return self.state not in (RunState.NEWER, RunState.DAMAGED)

    @property
    def parameters(self) -> dict[str, Any]:
        """The protocol's parameters by name, SI."""
        return dict(json.loads(self.parameters_json))

    @property
    def requested_parameters(self) -> dict[str, Any]:
        """The parameters as they were requested, before they were adapted to the source."""
        return {**self.parameters, **json.loads(self.requested_json)}

    @property
    def outcome(self) -> Outcome:
        return Outcome(self.verdict)

    @property
    def has_result(self) -> bool:
        """Whether the run gave a result; one of an earlier version if it was completed and no check of it failed."""
        if self.outcome is Outcome.NOT_JUDGED:
            return self.state == RunState.COMPLETED and not self.failed_checks
        return self.outcome.has_result

    @property
    def verdict_text(self) -> str:
        """The verdict as a word: `good`; of a run without one also its state: `imported, not judged`, `running`."""
        if self.outcome is not Outcome.NOT_JUDGED or self.state == RunState.COMPLETED:
            return self.verdict
        ended = self.readable and self.state not in (RunState.RUNNING, RunState.CRASHED)
        return f"{self.state}, {self.verdict}" if ended else str(self.state)

    @property
    def symbol(self) -> str:
        """The symbol of the verdict, by which it is known without colour."""
        return self._symbol_and_severity[0]

    @property
    def severity(self) -> Severity:
        return self._symbol_and_severity[1]

    @property
    def _symbol_and_severity(self) -> tuple[str, Severity]:
        shown = STATE_SYMBOLS.get(RunState(self.state)) if self.outcome is Outcome.NOT_JUDGED else None
        return shown or (OUTCOME_SYMBOLS[self.outcome], outcome_severity(self.outcome))

    @property
    def explanation(self) -> str:
        """The reasons of the verdict; how the run ended where there are none."""
        return self.verdict_reasons or self.reason

    @property
    def running(self) -> bool:
        return self.state == RunState.RUNNING

    @property
    def resumable(self) -> bool:
        """Whether the run was interrupted with points that a resumed run keeps."""
        interrupted = (RunState.STOPPED, RunState.FAILED, RunState.UNSAFE, RunState.CRASHED)
        return self.entries > 0 and self.state in interrupted

    @property
    def estimates(self) -> tuple[EstimatedQuantity, ...]:
        return tuple(EstimatedQuantity(**record) for record in json.loads(self.estimates_json))


@dataclass(frozen=True, slots=True)
class RunFilter:
    """Selection of runs; empty fields select all. Every word of `search_text` must occur."""

    search_text: str = ""
    specimen: str = ""
    protocol: str = ""
    state: str = ""
    since: str = ""
    """ISO, UTC."""
    verdict: str = ""
    """A word of the verdict: `good`, `not judged`, `crashed`."""
    operator: str = ""
    checked_by: str = ""
    """The person who checked the run; `nobody` selects runs that were not checked."""
    instrument: str = ""
    """Part of the identity of an instrument, such as a serial number."""

    def apply(self, entries: Iterable[RunSummary]) -> list[RunSummary]:
        """Return the selected entries in their order."""
        words = self.search_text.casefold().split()
        return [
            e
            for e in entries
            if (not self.specimen or e.specimen == self.specimen)
            and (not self.protocol or e.protocol == self.protocol)
            and (not self.state or e.state == self.state)
            and (not self.since or e.start_time >= self.since)
            and (not self.verdict or self.verdict in e.verdict_text.split(", "))
            and (not self.operator or e.operator.casefold() == self.operator.casefold())
            and (not self.checked_by or _is_checked_by(e, self.checked_by.casefold()))
            and (not self.instrument or self.instrument.casefold() in e.instruments.casefold())
            and all(word in e.words for word in words)
        ]


def _is_checked_by(summary: RunSummary, name: str) -> bool:
    return not summary.checked_by if name == "nobody" else name in summary.checked_by.casefold().split(", ")


def read_since(text: str, now: datetime | None = None) -> str:
    """Parse `2026-11-01`, `2026-11`, `today`, `7 d`, `12 h` into ISO time in UTC.

    Raises:
        ValueError: the text has none of these forms.
    """
    now = (now or datetime.now()).astimezone()
    text = text.strip().casefold()
    number, unit = text[:-1].strip(), text[-1:]
    if text == "today":
        begin = now.replace(hour=0, minute=0, second=0, microsecond=0)
    elif unit in ("h", "d") and number.isdigit():
        begin = now - timedelta(hours=int(number) * (24 if unit == "d" else 1))
    else:
        try:
            begin = datetime.fromisoformat(f"{text}-01" if len(text) == 7 else text)
        except ValueError:
            raise ValueError(f"'{text}' is not a date") from None
        begin = begin.astimezone() if begin.tzinfo is None else begin
    return begin.astimezone(UTC).isoformat(timespec="milliseconds")


def read_run_summary(file: Path, path: str) -> RunSummary | None:
    """Read the summary of a file, `path` relative to the folder; None for an HDF5 file of another kind.

    A file that cannot be read has a summary too, with the reason.
    """
    try:
        known = read_overview(file)
        if known is not None and not _needs_points(known):
            return _summary(file, path, known, _named_failures(known.verdict))
        with Run(file) as run, translate_read_errors(file):
            known = overview_of(run)
            failed = _failed_checks(run) if _needs_points(known) else _named_failures(known.verdict)
            return _summary(file, path, known, failed)
    except NotARunError as error:
        # A truncated run may lack its format attribute; its name still identifies it.
        entry = summary_from_file_name(path, RunState.DAMAGED, f"{error}; or it is damaged: copy it again")
        return entry if entry.start_time else None
    except NewerFormatError as error:
        return summary_from_file_name(path, RunState.NEWER, str(error))
    except RunReadError as error:
        return summary_from_file_name(path, RunState.DAMAGED, str(error)) if file.exists() else None


def _summary(file: Path, path: str, run: RunOverview, failed_checks: Sequence[str]) -> RunSummary:
    state, reason = RunState(run.state), run.reason
    if state is RunState.RUNNING and not reason:
        reason = _running_reason(file)
    elif state is RunState.CRASHED and not reason:
        reason = "the program that wrote it is gone; everything up to its end is in the file"
    return _with_search_text(
        RunSummary(
            path=path,
            state=state,
            reason=reason,
            protocol=run.protocol,
            specimen=run.specimen,
            start_time=run.start_time,
            simulated=int(run.simulated),
            points=run.point_count,
            entries=run.entry_count,
            seconds=run.duration_s,
            parameters_json=json.dumps(run.parameters),
            requested_json=json.dumps(run.requested),
            estimates_json=json.dumps([asdict(estimate) for estimate in run.estimates]),
            verdict=str(run.verdict.outcome),
            verdict_reasons="; ".join(run.verdict.reasons),
            failed_checks=", ".join(failed_checks),
            found="; ".join(map(format_estimate, run.estimates)),
            operator=run.conditions.operator,
            temperature_c=run.conditions.temperature_c,
            humidity=run.conditions.humidity,
            bench=run.bench_name,
            instruments=instruments_text(run),
            sensor=" ".join(filter(None, (run.sensor.name, run.sensor.serial and f"#{run.sensor.serial}"))),
            figures_json=json.dumps(tuple(run_figures(run))),
        )
    )


def instruments_text(run: Run | RunOverview) -> str:
    """Return the identities of the instruments with serial numbers, and the state of the sensor's calibration."""
    others = (str(identity) for role, identity in run.identities.items() if role != "sensor")
    return "; ".join((*others, calibration_text(run.sensor, run.start_time)))


def calibration_text(sensor: LaserSensor, start_time: str) -> str:
    """Return serial number and state of calibration of the displacement sensor at the time of a run."""
    dates = f"calibrated {sensor.calibrated}" if sensor.calibrated else "date of calibration unknown"
    state = "validity unknown"
    if sensor.expires:
        state = f"{'expired' if start_time[:10] > sensor.expires else 'valid until'} {sensor.expires}"
    return f"{' '.join(filter(None, (sensor.name, sensor.serial and f'#{sensor.serial}')))} {dates}, {state}"


def _needs_points(run: RunOverview) -> bool:
    """Whether the checks of a run are known from its points only; other protocols' checks cost a fit."""
    kind = PROTOCOLS.get(run.protocol)
    ended = run.state in (RunState.COMPLETED, RunState.IMPORTED)
    return run.verdict.outcome is Outcome.NOT_JUDGED and ended and kind is not None and kind.passes_or_fails


def _named_failures(verdict: Verdict) -> list[str]:
    return [check.name for check in verdict.failed_checks if check.consequence is Outcome.DID_NOT_PASS]


def _failed_checks(run: Run) -> list[str]:
    kind = PROTOCOLS[run.protocol]
    points = [point for _, point in measured_points(run, kind.point_type)]
    return _named_failures(Verdict(checks=tuple(kind(**run.parameters).checks(points))))


def summary_from_file_name(path: str, state: RunState, reason: str) -> RunSummary:
    """Make a summary from the file name alone: `20261121T091502Z_T7_sine-dwell.h5`."""
    stamp, _, rest = PurePosixPath(path).stem.partition("_")
    specimen, _, protocol = rest.rpartition("_")
    try:
        begun = datetime.strptime(stamp, "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC).isoformat(timespec="milliseconds")
    except ValueError:
        begun = specimen = protocol = ""
    return _with_search_text(RunSummary(path, state, reason, protocol, specimen, begun))


def with_notes(summary: RunSummary, notes: Notes) -> RunSummary:
    """Return the summary with the user's tags and note."""
    checked_by = ", ".join(dict.fromkeys(check.name for check in notes.checks))
    return _with_search_text(summary._replace(tags=", ".join(notes.tags), note=notes.note, checked_by=checked_by))


def _with_search_text(summary: RunSummary) -> RunSummary:
    begun = summary.started_at
    texts = (
        summary.path,
        summary.state,
        summary.reason,
        summary.verdict_text,
        summary.verdict_reasons,
        summary.protocol,
        summary.specimen,
        f"{begun:%Y-%m-%d %H:%M}" if begun else "",
        "simulated" if summary.simulated else "",
        summary.found,
        summary.tags,
        summary.note,
        summary.operator,
        f"checked by {summary.checked_by}" if summary.checked_by else "not checked",
        "" if summary.temperature_c is None else f"{summary.temperature_c:.1f} °C",
        "" if summary.humidity is None else f"{100 * summary.humidity:.0f} %",
        summary.bench,
        summary.instruments,
    )
    return summary._replace(words="\n".join(texts).casefold())


def _running_reason(file: Path) -> str:
    written = datetime.fromtimestamp(file.stat().st_mtime).astimezone()
    if (datetime.now().astimezone() - written).total_seconds() < STALE_AFTER_S:
        return "still being written"
    return f"is marked as running, but was last written {written:%Y-%m-%d %H:%M}"


assert {s.value for s in RunStatus} <= {s.value for s in RunState}
