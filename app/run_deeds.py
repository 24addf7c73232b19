"""What is done with several run files at once: noted, exported, taken in, read for comparison. No Qt, no terminal."""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from app.explore_answer import Measured, read_measured
from app.export import Format, export
from app.notes import Notes, read_tags, write_notes
from protocols.runreader import Run, RunError


def annotate(runs: Sequence[tuple[Path, str, str]], tags: str, note: str) -> None:
    """Tags and a note for runs; with several, the tags are added to each and notes stay.

    Args:
        runs: path of each, its tags and its note as they are.
        tags: separated by commas.
        note: for a single run.
    """
    new = read_tags(tags)
    for path, its_tags, its_note in runs:
        if len(runs) == 1:
            write_notes(path, Notes(new, note))
        else:
            write_notes(path, Notes(read_tags(f"{its_tags},{','.join(new)}"), its_note))


def export_runs(paths: Sequence[Path], folder: Path, kind: Format, stopped: Callable[[], bool]) -> int:
    """Write runs as files for other programs; how many files."""
    count = 0
    for path in paths:
        with Run(path) as run:
            count += len(export(run, folder, kind, stopped=stopped))
    return count


def take_in(paths: Sequence[Path], folder: Path) -> list[str]:
    """Copy run files into a folder; the names that were there already: those are never replaced.

    Raises:
        RunError: a file is none of a run.
    """
    folder.mkdir(parents=True, exist_ok=True)
    left = []
    for path in paths:
        if (folder / path.name).exists():
            left.append(path.name)
            continue
        with Run(path):  # nothing but runs
            pass
        working = folder / f".{path.name}.part"
        shutil.copy2(path, working)
        working.replace(folder / path.name)
    return left


def measured_of(paths: Sequence[Path]) -> list[Measured]:
    """The responses of those runs that have one."""
    runs = []
    for path in paths:
        try:
            runs.append(read_measured(path))
        except RunError:
            continue
    return runs
