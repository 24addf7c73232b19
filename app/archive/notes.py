"""Tags and note in the sidecar of a run, and mountings of a specimen, each with an entry in the audit trail."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from app.common import current_conditions, record_audit
from protocols.base import SpecimenMounted
from protocols.runfile import Notes, add_mounting, change_notes, notes_path, read_mountings


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


def annotate_runs(runs: Sequence[tuple[Path, str, str]], tags: str, note: str) -> None:
    """Write tags and a note of one run; for several runs, add the tags to each and keep the notes.

    Args:
        runs: path, listed tags and listed note of each.
        tags: separated by commas.
        note: for a single run.
    """
    for path, listed_tags, listed_note in runs:
        if len(runs) == 1:
            write_notes(path, tags=read_tags(tags), note=note)
        else:
            added = partial(_with_tags, f"{listed_tags},{tags}")
            write_notes(path, tags=added, note=lambda notes, listed=listed_note: notes.note or listed)


def _with_tags(added: str, notes: Notes) -> tuple[str, ...]:
    return read_tags(",".join((*notes.tags, added)))


def mount_part(folder: Path, specimen: str, part: str, who: str = "") -> Path:
    """Record that a part was mounted anew, now, by the operator of the day or `who`; return the file of the mountings.

    Numbers, such as the mass, are those of the mounting before.

    Raises:
        NotesError: the file cannot be read or written.
    """
    before = next((each.values for each in reversed(read_mountings(folder, specimen)) if each.part == part), {})
    mounting = SpecimenMounted.now(part, who or current_conditions().operator, before)
    path = add_mounting(folder, specimen, mounting)
    record_audit("mounting", path, subject=specimen, part=part, by=mounting.who)
    return path
