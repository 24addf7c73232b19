"""Tags, notes and checks of a run by a second person, in a small JSON file next to it.

Not inside the run file: adding attributes to a finished HDF5 file damaged it when the program was killed meanwhile
(docs/decisions/0030-archive.md).
"""

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from app.common import read_json_file, write_atomic
from app.common.audit import record_audit

NOTES_SUFFIX = ".notes.json"


class NotesError(Exception):
    """Notes cannot be read or written; the message gives file, reason and remedy."""


@dataclass(frozen=True, slots=True)
class RunCheck:
    """A run was checked by a second person.

    Attributes:
        name: of that person.
        time: ISO 8601, UTC.
        sha256: of the run file as it was checked.
        remark: what was found.
    """

    name: str
    time: str
    sha256: str
    remark: str = ""


@dataclass(frozen=True, slots=True)
class Notes:
    """Tags, each a word or a few without a comma, and free text."""

    tags: tuple[str, ...] = ()
    note: str = ""
    checks: tuple[RunCheck, ...] = ()
    """Second persons who checked the run; kept by `write_notes` where it is given none."""


def notes_path(run: Path) -> Path:
    """Return the path of a run's notes."""
    return run.with_suffix(NOTES_SUFFIX)


def read_tags(text: str) -> tuple[str, ...]:
    """Parse `good, second try` into tags, each once, in order."""
    return tuple(dict.fromkeys(" ".join(tag.split()) for tag in text.split(",") if tag.strip()))


def read_notes(path: Path) -> Notes:
    """Read the notes in a file; empty notes if there is no file.

    Raises:
        NotesError: the file is there and cannot be understood.
    """
    try:
        record = read_json_file(path)
        tags, note = record.get("tags", []), record.get("note", "")
        if not (isinstance(tags, list) and isinstance(note, str) and all(isinstance(tag, str) for tag in tags)):
            raise ValueError("tags are a list of texts, and a note is a text")
        checks = tuple(
            RunCheck(*(_storable(str(each.get(key, ""))) for key in ("name", "time", "sha256", "remark")))
            for each in record.get("checks", [])
        )
        return Notes(tuple(map(_storable, tags)), _storable(note), checks)
    except FileNotFoundError:
        return Notes()
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise NotesError(
            f"the notes {path} cannot be read ({error}); correct the file or take it away, the run itself is untouched"
        ) from None


def _storable(text: str) -> str:
    """Return a text without halves of characters, which no file and no index can hold."""
    return text.encode("utf-8", "replace").decode()


def write_notes(run: Path, notes: Notes) -> None:
    """Write the notes of a run, atomically; empty notes without checks remove the file.

    Raises:
        NotesError: the file cannot be written, or the one that is there cannot be understood and would be lost.
    """
    path = notes_path(run)
    checks = notes.checks or read_notes(path).checks
    try:
        if not (notes.tags or notes.note or checks):
            path.unlink(missing_ok=True)
            record_audit("notes", path, subject=run.name, tags=[], note="", checked_by=[])
            return
        record: dict[str, Any] = {"tags": list(notes.tags), "note": notes.note}
        if checks:
            record["checks"] = [asdict(check) for check in checks]
        text = json.dumps(record, indent=2, ensure_ascii=False) + "\n"
        write_atomic(path, text)
        names = [check.name for check in checks]
        record_audit("notes", path, subject=run.name, tags=list(notes.tags), note=notes.note, checked_by=names)
    except OSError as error:
        raise NotesError(f"the notes {path} cannot be written: {os.strerror(error.errno or 5)}") from None
