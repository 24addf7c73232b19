"""Tags and note in the sidecar of a run, with an entry in the audit trail."""

from pathlib import Path
from typing import Any

from app.common import record_audit
from protocols.runfile import change_notes, notes_path


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
