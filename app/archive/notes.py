"""Tags, note and checks by a second person in the sidecar of a run, with an entry in the audit trail."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from app.common import UsageError, record_audit
from protocols.base import RunStatus, file_hash
from protocols.runfile import Run, RunCheck, change_notes, notes_path, translate_read_errors


def read_tags(text: str) -> tuple[str, ...]:
    """Parse `good, second try` into tags, each once, in order."""
    return tuple(dict.fromkeys(" ".join(tag.split()) for tag in text.split(",") if tag.strip()))


def write_notes(run: Path, **changes: Any) -> None:
    """Replace tags, note or checks of a run as `change_notes` does.

    Raises:
        NotesError: the file cannot be written, or the one that is there cannot be understood and would be lost.
    """
    notes = change_notes(run, **changes)
    names = [check.name for check in notes.checks]
    record_audit("notes", notes_path(run), subject=run.name, tags=list(notes.tags), note=notes.note, checked_by=names)


def check_run(path: Path, name: str, remark: str = "") -> RunCheck:
    """Store that a second person checked a run, and return the record.

    Raises:
        UsageError: it is the person who measured, or the run has not ended.
        RunReadError: the file cannot be read.
        NotesError: the record cannot be written.
    """
    with Run(path) as run, translate_read_errors(path):
        operator, status = run.record.conditions.operator, run.record.status
        sha256 = file_hash(path)
    if operator.casefold() == name.casefold():
        raise UsageError(f"{name} measured {path.name}; a second person has to check it: name another one with --by")
    if status is RunStatus.RUNNING:
        raise UsageError(f"{path.name} has not ended; check it when it has")
    check = RunCheck(name, datetime.now(UTC).isoformat(timespec="seconds"), sha256, remark)
    write_notes(path, checks=lambda notes: (*notes.checks, check))
    return check


def describe_check(path: Path, check: RunCheck) -> str:
    """Return a check as text, with a note if the file has changed since."""
    changed = "" if file_hash(path) == check.sha256 else "; the file has changed since"
    remark = f": {check.remark}" if check.remark else ""
    return f"checked by {check.name} on {check.time[:16].replace('T', ' ')} UTC{remark}{changed}"
