"""Checks of runs by a second person, stored with the hash of the run file as it was checked."""

import hashlib
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from app.archive.notes import RunCheck, notes_path, read_notes, write_notes
from app.common import UsageError
from protocols.base import RunStatus
from protocols.runfile.reader import Run, RunReadError


def check_run(path: Path, name: str, remark: str = "") -> RunCheck:
    """Store that a second person checked a run, and return the record.

    Raises:
        UsageError: it is the person who measured, or the run has not ended.
        RunReadError: the file cannot be read.
        NotesError: the record cannot be written.
    """
    with Run(path) as run:
        operator, status = run.conditions.operator, run.status
    if operator.casefold() == name.casefold():
        raise UsageError(f"{name} measured {path.name}; a second person has to check it: name another one with --by")
    if status is RunStatus.RUNNING:
        raise UsageError(f"{path.name} has not ended; check it when it has")
    check = RunCheck(name, datetime.now(UTC).isoformat(timespec="seconds"), hash_file(path), remark)
    notes = read_notes(notes_path(path))
    write_notes(path, replace(notes, checks=(*notes.checks, check)))
    return check


def describe_check(path: Path, check: RunCheck) -> str:
    """Return a check as text, with whether the file is still the one that was checked."""
    changed = "" if hash_file(path) == check.sha256 else "; the file has changed since"
    remark = f": {check.remark}" if check.remark else ""
    return f"checked by {check.name} on {check.time[:16].replace('T', ' ')} UTC{remark}{changed}"


def hash_file(path: Path) -> str:
    """Return the SHA-256 of a file.

    Raises:
        RunReadError: it cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise RunReadError(f"{path} cannot be read: {error.strerror or error}") from None
