"""Check of a run by a second person, who is not the one who measured."""

from datetime import UTC, datetime
from pathlib import Path

from app.archive.notes import write_notes
from app.common import UsageError
from model import format_time
from protocols.base import RunStatus, file_hash
from protocols.runfile import Run, RunCheck, translate_read_errors


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
    return f"checked by {check.name} on {format_time(check.time)} UTC{remark}{changed}"
