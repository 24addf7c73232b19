"""Sidecar of a run file: tags, note, checks, a later verdict and the record for lists, in a small JSON file beside it.

A run file is not touched after its end. Data about one state of the file are bound to it by SHA-256 and ignored for any other
state.
"""

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from drivers import Deadline
from model import format_time
from protocols.base import (
    Verdict,
    file_hash,
    read_json_file,
    to_jsonable,
    visible_text,
    visible_values,
    write_atomic,
)
from protocols.runfile.errors import NotesError
from protocols.runfile.names import notes_path
from protocols.runfile.record import RunRecord

MAX_HASHED_BYTES = 16_000_000
"""Longest file that is hashed at the end of a run, and for a copy in a list; reading longer files by HDF5 is faster."""
_DIGEST_BYTES = 16
_FIELDS = " ".join(field.name for field in fields(RunRecord))


@dataclass(frozen=True, slots=True)
class RunCheck:
    """A run was checked by a second person.

    Attributes:
        name: name of the person.
        time: ISO 8601, UTC.
        sha256: hash of the checked run file.
        remark: remark of the person.
    """

    name: str
    time: str
    sha256: str
    remark: str = ""


@dataclass(frozen=True, slots=True)
class LaterVerdict:
    """A verdict stored after the end of the run.

    Attributes:
        verdict: the verdict.
        time: ISO 8601, UTC.
        sha256: hash of the judged run file.
    """

    verdict: Verdict
    time: str
    sha256: str


@dataclass(frozen=True, slots=True)
class Notes:
    """Content of a sidecar: tags, each some words without a comma, free text, and data about one state of the file."""

    tags: tuple[str, ...] = ()
    note: str = ""
    checks: tuple[RunCheck, ...] = ()
    """Second persons who checked the run."""
    later_verdict: LaterVerdict | None = None
    listed: Mapping[str, Any] | None = None
    """The record for lists with size, time of modification and SHA-256 of its file, and its digest."""


def read_notes(path: Path) -> Notes:
    """Read a sidecar; empty notes without a file.

    Raises:
        NotesError: the file exists and is not understood.
    """
    try:
        record = read_json_file(path)
        tags, note, verdict = record.get("tags", []), record.get("note", ""), record.get("later_verdict")
        if not (isinstance(tags, list) and isinstance(note, str) and all(isinstance(tag, str) for tag in tags)):
            raise ValueError("tags are a list of texts, and a note is a text")
        return Notes(
            tuple(map(_storable, tags)),
            _storable(note),
            tuple(
                RunCheck(*(_storable(str(each.get(key, ""))) for key in ("name", "time", "sha256", "remark")))
                for each in record.get("checks", [])
            ),
            None if verdict is None else _later_verdict(verdict),
            record.get("listed"),
        )
    except FileNotFoundError:
        return Notes()
    except (OSError, ValueError, TypeError, AttributeError, LookupError) as error:
        raise NotesError(
            f"the notes {path} cannot be read ({error}); correct the file or take it away, the run itself is untouched"
        ) from None


def change_notes(run: Path, **changes: Any) -> Notes:
    """Replace fields of a run's sidecar, atomically, and return it; a sidecar without content is removed.

    A function among the changes is called with the present notes and returns the value. Other programs wait meanwhile.

    Raises:
        NotesError: the file cannot be written, or the existing file is not understood and would be lost.
    """
    path = notes_path(run)
    try:
        with _locked(path):
            before = read_notes(path)
            notes = replace(before, **{name: new(before) if callable(new) else new for name, new in changes.items()})
            record = {name: value for name, value in asdict(notes).items() if value}
            if record:
                shown = {"tags": [], "note": ""} | record if record.keys() - {"listed", "later_verdict"} else record
                write_atomic(path, json.dumps(to_jsonable(shown), indent=2, ensure_ascii=False) + "\n")
            else:
                path.unlink(missing_ok=True)
    except OSError as error:
        raise NotesError(f"the notes {path} cannot be written: {os.strerror(error.errno or 5)}") from None
    return notes


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold the lock of a sidecar, which ends with its process; the lock file is removed. A share without locks has none."""
    from filelock import FileLock, Timeout  # slow to import; reading does not need it

    lock = FileLock(path.with_name(f".{path.name}.lock"), Deadline.NOTES_LOCK.seconds)
    try:
        lock.acquire()
    except Timeout:
        raise NotesError(
            f"the notes {path} are locked by another program for more than {Deadline.NOTES_LOCK.seconds:g} s"
        ) from None
    except OSError:
        pass  # a file system without locks; in an unwritable folder the later writing fails
    try:
        yield
    finally:
        with suppress(OSError):  # Windows does not remove open files
            Path(lock.lock_file).unlink()
        lock.release()


def store_listed(run: Path, record: RunRecord) -> None:
    """Store the record of an ended run for lists; nothing for a record that its JSON form changes, e.g. by a NaN parameter.

    Raises:
        NotesError: the sidecar cannot be read or written.
        OSError: the run file cannot be read.
    """
    text = record.to_json()
    if repr(RunRecord.from_json(text)) != repr(record.for_lists()):
        return
    stat = run.stat()
    listed = {
        "size": stat.st_size,
        "modified_ns": stat.st_mtime_ns,
        "sha256": file_hash(run) if stat.st_size <= MAX_HASHED_BYTES else "",
        "digest": _digest(text),
        "record": json.loads(text),
    }
    change_notes(run, listed=listed)


def listed_record(run: Path, notes: Notes) -> tuple[RunRecord, str] | None:
    """Return the record for lists with its JSON form if it belongs to the present state of the file; None otherwise."""
    try:
        listed = notes.listed
        if listed is None:
            return None
        stat = run.stat()
        if (stat.st_size, stat.st_mtime_ns) != (listed["size"], listed["modified_ns"]):
            copied = stat.st_size == listed["size"] <= MAX_HASHED_BYTES and file_hash(run) == listed["sha256"]
            if not copied:
                return None
        text = json.dumps(listed["record"], ensure_ascii=False)
        return (RunRecord.from_plain(listed["record"], text), text) if _digest(text) == listed["digest"] else None
    except (OSError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        return None


def with_later_verdict(record: RunRecord, run: Path, notes: Notes) -> RunRecord:
    """Return the record with the verdict stored after the end of the run; with a caution if it belongs to another state of the file.

    Raises:
        OSError: the run file cannot be read.
    """
    later = notes.later_verdict
    if later is None:
        return record
    if file_hash(run) == later.sha256:
        return replace(record, verdict=later.verdict)
    caution = (
        f"the file has changed since {format_time(later.time)} UTC: the verdict '{later.verdict.outcome}', "
        f"which was then stored in {notes_path(run).name}, is not used; judge it again"
    )
    return replace(record, caution=caution)


def _later_verdict(record: Mapping[str, Any]) -> LaterVerdict:
    verdict = Verdict.from_record(visible_values(record["verdict"]))
    verdict.describe("".join(check.text for check in verdict.failed_checks))  # raises for values of a wrong type
    return LaterVerdict(verdict, visible_text(str(record["time"])), str(record["sha256"]))


def _digest(text: str) -> str:
    """Return the digest of a record's JSON form and of this version's fields, so that a new field is read from the run file."""
    return hashlib.blake2b((_FIELDS + text).encode("utf-8", "replace"), digest_size=_DIGEST_BYTES).hexdigest()


def _storable(text: str) -> str:
    """Return a text without surrogate halves, which files and indexes cannot store."""
    return text.encode("utf-8", "replace").decode()
