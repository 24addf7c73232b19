"""What is done with several run files at once: noted, exported, taken in, read for comparison. No Qt, no terminal."""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.archive.export import Format, export
from app.archive.notes import Notes, read_tags, write_notes
from app.archive.replay import Measured, read_measured
from app.common.progress import Tell, files, untold
from app.config.tables import AmplifierTable
from protocols.runfile.reader import Run, RunError

PIECE = 1 << 20
"""Bytes that are copied between two looks at whether to go on."""


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


def export_runs(
    paths: Sequence[Path], folder: Path, kind: Format, stopped: Callable[[], bool], tell: Tell = untold
) -> int:
    """Write runs as files for other programs; how many files."""
    count = 0
    for path, told in zip(paths, files(tell, paths), strict=True):
        if stopped():
            break
        with Run(path) as run:
            count += len(export(run, folder, kind, told=told, stopped=stopped))
    return count


@dataclass(frozen=True, slots=True)
class TakenIn:
    """Names of the runs that were copied, and of those that were there already."""

    copied: tuple[str, ...]
    there: tuple[str, ...]


def take_in(
    paths: Sequence[Path], folder: Path, stopped: Callable[[], bool] = lambda: False, tell: Tell = untold
) -> TakenIn:
    """Copy run files into a folder; what is there already is never replaced. Where `stopped` says so, whole files stay.

    Raises:
        RunError: a file is none of a run, or cannot be copied.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f"{folder} cannot be made: {error.strerror or error}; choose another folder") from None
    copied, there = list[str](), list[str]()
    for path, told in zip(paths, files(tell, paths), strict=True):
        if (folder / path.name).exists():
            there.append(path.name)
            continue
        with Run(path):  # nothing but runs
            pass
        try:
            whole = _copied(path, folder / path.name, stopped, told)
        except OSError as error:
            raise RunError(
                f"{path.name} cannot be copied into {folder}: {error.strerror or error}; make room there, or choose another folder"
            ) from None
        if not whole:
            break
        copied.append(path.name)
    return TakenIn(tuple(copied), tuple(there))


def _copied(path: Path, to: Path, stopped: Callable[[], bool], tell: Tell) -> bool:
    """Copy a file piece by piece; it has its name only when it is whole. False where it was stopped."""
    working, size = to.with_name(f".{to.name}.part"), max(path.stat().st_size, 1)
    try:
        with path.open("rb") as source, working.open("wb") as copy:
            while piece := source.read(PIECE):
                if stopped():
                    return False
                copy.write(piece)
                tell(copy.tell() / size)
        shutil.copystat(path, working)
        working.replace(to)
        return True
    finally:
        working.unlink(missing_ok=True)


def bring_in(
    paths: Sequence[Path], folder: Path, specimen: str, amplifier: AmplifierTable, tell: Tell = untold
) -> tuple[int, list[str]]:
    """Tables as run files, as `tactor-bench import` makes them without more words; how many, and what looks odd.

    Raises:
        UsageError: a table cannot be taken so; the sentence says which, where, and what would do.
        Stopped: `tell` wanted no more of it; nothing was written.
    """
    from app.archive.importing.importer import (  # loads units and protocols, which no page needs at start-up
        ImportOptions,
        import_files,
    )

    options = ImportOptions(tuple(paths), folder, specimen=specimen or "unnamed")
    taken, written = import_files(options, amplifier, tell)
    return len(written), [words for each in taken for words in each.cautions]


def measured_of(paths: Sequence[Path]) -> list[Measured]:
    """The responses of those runs that have one."""
    runs = []
    for path in paths:
        try:
            runs.append(read_measured(path))
        except RunError:
            continue
    return runs
