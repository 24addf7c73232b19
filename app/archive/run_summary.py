"""Summary of a run file, the row of the catalogue."""

import json
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from app.archive.figures import run_figures
from app.archive.run_search import search_words
from app.common import OUTCOME_SYMBOLS, Severity, outcome_severity
from model import format_estimate
from protocols import BUILT_IN_PROTOCOLS, PROTOCOLS, measured_points
from protocols.base import Outcome, RunFigure, RunStatus, Verdict
from protocols.runfile import (
    NewerFormatError,
    NotARunError,
    Notes,
    NotesError,
    Run,
    RunReadError,
    RunRecord,
    decode_record,
    listed_record,
    notes_path,
    read_notes,
    translate_read_errors,
    with_later_verdict,
)

LARGEST_FIGURES = ("amplitude_at_resonance", "square_wave_amplitude")
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
    """Row of the catalogue: record of a run, contents of its sidecar, and the columns by which lists are sorted and filtered.

    A plain tuple, as a list may have ten thousand.
    """

    path: str
    """Relative to the folder, with slashes."""
    state: str
    record_json: str = "{}"
    protocol: str = ""
    specimen: str = ""
    start_time: str = ""
    """ISO, UTC: sorts as text."""
    simulated: int = 0
    points: int = 0
    seconds: float = 0.0
    verdict: str = str(Outcome.NOT_JUDGED)
    """The outcome of the verdict."""
    failed_checks: str = ""
    """Names of the failed checks of a run that did not pass."""
    estimates_text: str = ""
    """Estimates as text."""
    operator: str = ""
    instruments: str = ""
    """Identities with serial numbers, and the state of the sensor's calibration, as text."""
    bench: str = ""
    sensor: str = ""
    figures_json: str = "[]"
    """Figures of a built-in protocol as they were read; use `figures`."""
    tags: str = ""
    note: str = ""
    checked_by: str = ""
    """Second persons who checked it."""
    search_text: str = ""
    """Searched words (see `search_words`): words of specimen and tags on the first line, other words on the second."""
    natural_hz: float = -1.0
    largest_m: float = -1.0
    """Figures by which lists are sorted; -1 for a missing figure."""
    modified_ns: int = 0
    size: int = 0
    notes_ns: int = 0

    @property
    def record(self) -> RunRecord:
        """The record of the run; for an unreadable file, the facts from its name and the error."""
        return decode_record(self.record_json)

    @property
    def figures(self) -> tuple[RunFigure, ...]:
        """Figures for comparisons with other runs and specimens, see `app.archive.figures`.

        Figures of a laboratory's protocol are made anew: its file may be another one than when the run was indexed, or was not loaded.
        """
        if self.protocol not in BUILT_IN_PROTOCOLS and (record := self.record).title:
            return run_figures(record)
        return tuple(RunFigure(*figure) for figure in json.loads(self.figures_json))

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
    def requested_parameters(self) -> dict[str, Any]:
        """The parameters as they were requested, before they were adapted to the source."""
        return {**self.record.parameters, **self.record.requested}

    @property
    def outcome(self) -> Outcome:
        return Outcome(self.verdict)

    @property
    def has_result(self) -> bool:
        """Whether the run gave a result; a run of an earlier version if it was completed without a failed check."""
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
        """The symbol of the verdict, for readers without colours."""
        return self._symbol_and_severity[0]

    @property
    def severity(self) -> Severity:
        return self._symbol_and_severity[1]

    @property
    def _symbol_and_severity(self) -> tuple[str, Severity]:
        shown = STATE_SYMBOLS.get(RunState(self.state)) if self.outcome is Outcome.NOT_JUDGED else None
        return shown or (OUTCOME_SYMBOLS[self.outcome], outcome_severity(self.outcome))

    @property
    def verdict_reasons(self) -> str:
        """Reasons of the verdict, with remedies."""
        return "; ".join(self.record.verdict.reasons)

    @property
    def explanation(self) -> str:
        """The reasons of the verdict; how the run ended where there are none; and why a later verdict is not used."""
        return "; ".join(filter(None, (self.verdict_reasons or self.record.reason, self.record.caution)))

    @property
    def running(self) -> bool:
        return self.state == RunState.RUNNING

    @property
    def resumable(self) -> bool:
        """Whether the run was interrupted with points that a resumed run keeps."""
        interrupted = (RunState.STOPPED, RunState.FAILED, RunState.UNSAFE, RunState.CRASHED)
        return self.state in interrupted and self.record.entry_count > 0


def summarize_run(
    path: str,
    record: RunRecord,
    notes: Notes | None = None,
    state: str = "",
    failed_checks: Sequence[str] = (),
    record_json: str = "",
) -> RunSummary:
    """Return the row of a run; `state`: of its file, where it differs from the record's; `record_json`: JSON form of the record, where it was made already."""
    notes, is_read = notes or Notes(), bool(record.title)
    row = RunSummary(
        path,
        state or record.state,
        record_json or record.to_json(),
        record.protocol,
        record.specimen,
        record.start_time,
        int(record.simulated),
        record.point_count,
        record.duration_s,
        str(record.verdict.outcome),
        ", ".join(failed_checks),
        "; ".join(map(format_estimate, record.estimates)),
        record.conditions.operator,
        instruments_text(record) if is_read else "",
        record.bench_name,
        record.sensor_text,
        json.dumps(run_figures(record) if is_read else ()),
        ", ".join(notes.tags),
        notes.note,
        ", ".join(dict.fromkeys(check.name for check in notes.checks)),
    )
    begun, air = row.started_at, record.conditions
    figures = {figure.name: figure.value for figure in row.figures}
    words = (
        row.state,
        record.reason,
        row.verdict_text,
        *record.verdict.reasons,
        record.caution,
        row.protocol,
        f"{begun:%Y-%m-%d %H:%M}" if begun else "",
        "simulated" if row.simulated else "",
        row.estimates_text,
        row.note,
        row.operator,
        f"checked by {row.checked_by}" if row.checked_by else "not checked",
        "" if air.temperature_c is None else f"{air.temperature_c:.1f} °C",
        "" if air.humidity is None else f"{100 * air.humidity:.0f} %",
    )
    return row._replace(
        search_text=f"{search_words(row.specimen, row.tags)}\n{search_words(row.specimen, row.tags, *words)}",
        natural_hz=figures.get("natural_frequency", -1.0),
        largest_m=max((figures.get(name, -1.0) for name in LARGEST_FIGURES), default=-1.0),
    )


def read_run_summary(file: Path, path: str, notes_file: Path | None = None) -> RunSummary | None:
    """Read the summary of a file, `path` relative to the folder; None for an HDF5 file of another kind.

    A file that cannot be read has a summary too, with the reason. `notes_file` is its sidecar where that is not beside it.
    """
    try:
        notes = read_notes(notes_file or notes_path(file))
    except NotesError as error:
        notes = Notes(note=str(error))
    try:
        record, record_json, failed = _read_record(file, notes)
    except NotARunError as error:
        # A truncated run may lack its format attribute; its name still identifies it.
        reason = f"{error}; or it is damaged: copy it again"
        entry = summary_from_file_name(path, RunState.DAMAGED, reason, notes)
        return entry if entry.start_time else None
    except NewerFormatError as error:
        return summary_from_file_name(path, RunState.NEWER, str(error), notes)
    except RunReadError as error:
        return summary_from_file_name(path, RunState.DAMAGED, str(error), notes) if file.exists() else None
    return summarize_run(path, record, notes, failed_checks=failed, record_json=record_json)


def _read_record(file: Path, notes: Notes) -> tuple[RunRecord, str, Sequence[str]]:
    """Return the record of a run, from its sidecar if possible, its JSON form if available, and the names of the failed checks.

    Raises:
        RunReadError: the file cannot be read.
    """
    with translate_read_errors(file):
        if (listed := listed_record(file, notes)) is not None:
            record = with_later_verdict(listed[0], file, notes)
            if not _needs_points(record):
                return record, listed[1] if record is listed[0] else "", _named_failures(record.verdict)
    with Run(file) as run, translate_read_errors(file):
        record = with_later_verdict(run.stored_record(), file, notes)
        failed = _failed_checks(run) if _needs_points(record) else _named_failures(record.verdict)
    if record.status is RunStatus.RUNNING and not record.reason:
        gone = "the program that wrote it is gone; everything up to its end is in the file"
        record = replace(record, reason=gone if record.crashed else _running_reason(file))
    return record, "", failed


def instruments_text(record: RunRecord) -> str:
    """Return the identities of the instruments with serial numbers, and the state of the sensor's calibration."""
    others = (str(identity) for role, identity in record.identities.items() if role != "sensor")
    return "; ".join((*others, calibration_text(record)))


def calibration_text(record: RunRecord) -> str:
    """Return serial number and state of calibration of the displacement sensor at the time of a run."""
    sensor = record.sensor
    dates = f"calibrated {sensor.calibrated}" if sensor.calibrated else "date of calibration unknown"
    state = "validity unknown"
    if sensor.expires:
        state = f"{'expired' if record.start_time[:10] > sensor.expires else 'valid until'} {sensor.expires}"
    return f"{record.sensor_text} {dates}, {state}"


def _needs_points(run: RunRecord) -> bool:
    """Whether the checks of a run need its points only; checks of other protocols need a fit."""
    kind = PROTOCOLS.get(run.protocol)
    ended = run.state in (RunState.COMPLETED, RunState.IMPORTED)
    return run.verdict.outcome is Outcome.NOT_JUDGED and ended and kind is not None and kind.passes_or_fails


def _named_failures(verdict: Verdict) -> list[str]:
    return [check.name for check in verdict.failed_checks if check.consequence is Outcome.DID_NOT_PASS]


def _failed_checks(run: Run) -> list[str]:
    kind = PROTOCOLS[run.record.protocol]
    points = [point for _, point in measured_points(run, kind.point_type)]
    return _named_failures(Verdict(checks=tuple(kind(**run.record.parameters).checks(points))))


def summary_from_file_name(path: str, state: RunState, reason: str, notes: Notes | None = None) -> RunSummary:
    """Make a summary from the file name alone: `20261121T091502Z_T7_sine-dwell.h5`."""
    stamp, _, rest = PurePosixPath(path).stem.partition("_")
    specimen, _, protocol = rest.rpartition("_")
    try:
        begun = datetime.strptime(stamp, "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC).isoformat(timespec="milliseconds")
    except ValueError:
        begun = specimen = protocol = ""
    record = RunRecord(protocol=protocol, specimen=specimen, start_time=begun, reason=reason)
    return summarize_run(path, record, notes, str(state))


def _running_reason(file: Path) -> str:
    written = datetime.fromtimestamp(file.stat().st_mtime).astimezone()
    if (datetime.now().astimezone() - written).total_seconds() < STALE_AFTER_S:
        return "still being written"
    return f"is marked as running, but was last written {written:%Y-%m-%d %H:%M}"


assert {s.value for s in RunStatus} <= {s.value for s in RunState}
