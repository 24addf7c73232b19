"""Reading of a run's summary from its file."""

import json
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath

from app.archive.figures import run_figures
from app.archive.run_search import search_words
from app.archive.run_summary import RunState, RunSummary
from model import format_estimate
from protocols import PROTOCOLS, measured_points
from protocols.base import Outcome, RunStatus, Verdict
from protocols.runfile import (
    NewerFormatError,
    NotARunError,
    Notes,
    NotesError,
    Run,
    RunReadError,
    RunRecord,
    listed_record,
    notes_path,
    read_notes,
    translate_read_errors,
    with_later_verdict,
)

LARGEST_FIGURES = ("amplitude_at_resonance", "square_wave_amplitude")
STALE_AFTER_S = 600.0
"""A file with status `running` that was not written for this time gets another reason."""


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
