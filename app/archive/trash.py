"""Trash of a folder of runs: a hidden folder for removed runs with their notes, from which they can be restored."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from app.common import record_audit
from protocols.runfile import RunReadError, notes_path

TRASH_FOLDER = ".trash"
"""Beside the run; hidden, so that lists and campaigns ignore its contents."""


@dataclass(frozen=True, slots=True)
class TrashedRun:
    """A run that was moved to the trash."""

    path: Path
    """Where it was."""
    trashed: Path


def move_to_trash(runs: Sequence[Path]) -> list[TrashedRun]:
    """Move runs with their notes to the trash; nothing is deleted or overwritten.

    Raises:
        RunReadError: a run cannot be moved; those before it are in the trash.
    """
    moved = list[TrashedRun]()
    for path in runs:
        folder = path.parent / TRASH_FOLDER
        try:
            folder.mkdir(exist_ok=True)
            trashed = _free_name(folder / path.name)
            path.rename(trashed)
        except OSError as error:
            done = f"; {len(moved)} before it are in {folder}" if moved else ""
            raise RunReadError(f"{path} cannot be moved to {folder}: {error.strerror or error}{done}") from None
        _move_notes(path, trashed)
        record_audit("delete", path, notes_path(path), trashed)
        moved.append(TrashedRun(path, trashed))
    return moved


def restore_from_trash(moved: Sequence[TrashedRun]) -> int:
    """Move runs back to where they were, and return how many.

    Raises:
        RunReadError: a run cannot be moved back.
    """
    for one in moved:
        if one.path.exists() or (notes_path(one.path).exists() and notes_path(one.trashed).exists()):
            raise RunReadError(f"{one.path} or its notes exist again; move {one.trashed} by hand under another name")
        try:
            one.trashed.rename(one.path)
        except OSError as error:
            raise RunReadError(f"{one.trashed} cannot be moved to {one.path}: {error.strerror or error}") from None
        _move_notes(one.trashed, one.path)
        record_audit("restore", one.path, notes_path(one.path), one.trashed)
    return len(moved)


def _move_notes(run: Path, moved_run: Path) -> None:
    with suppress(OSError):  # a run without notes; remaining notes are valid again after its restoration
        notes_path(run).rename(notes_path(moved_run))


def _free_name(path: Path) -> Path:
    """Return the path, or one with a number, without a run and notes."""
    numbered = (path.with_stem(f"{path.stem} ({at})") for at in range(2, 10_000))
    return next(free for free in chain((path,), numbered) if not free.exists() and not notes_path(free).exists())
