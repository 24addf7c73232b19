"""What is done with several run files at once: noted, exported, taken in, read for comparison. No Qt, no terminal."""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.archive.export import Format, export_run
from app.archive.notes import Notes, read_tags, write_notes
from app.archive.replay import MeasuredResponse, read_measured_response
from app.common.progress import ProgressCallback, ignore_progress, split_progress_by_files
from app.config.tables import AmplifierTable
from protocols.runfile.reader import Run, RunReadError

COPY_CHUNK_BYTES = 1 << 20
"""Bytes that are copied between two looks at whether to go on."""


def annotate_runs(runs: Sequence[tuple[Path, str, str]], tags: str, note: str) -> None:
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
    paths: Sequence[Path],
    folder: Path,
    kind: Format,
    cancelled: Callable[[], bool],
    progress: ProgressCallback = ignore_progress,
) -> int:
    """Write runs as files for other programs; how many files."""
    count = 0
    for path, told in zip(paths, split_progress_by_files(progress, paths), strict=True):
        if cancelled():
            break
        with Run(path) as run:
            count += len(export_run(run, folder, kind, progress=told, cancelled=cancelled))
    return count


@dataclass(frozen=True, slots=True)
class CopyResult:
    """Names of the runs that were copied, and of those that were there already."""

    copied: tuple[str, ...]
    already_present: tuple[str, ...]


def copy_runs_into(
    paths: Sequence[Path],
    folder: Path,
    cancelled: Callable[[], bool] = lambda: False,
    progress: ProgressCallback = ignore_progress,
) -> CopyResult:
    """Copy run files into a folder; what is there already is never replaced. Where `stopped` says so, whole files stay.

    Raises:
        RunError: a file is none of a run, or cannot be copied.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunReadError(f"{folder} cannot be made: {error.strerror or error}; choose another folder") from None
    copied, there = list[str](), list[str]()
    for path, told in zip(paths, split_progress_by_files(progress, paths), strict=True):
        if (folder / path.name).exists():
            there.append(path.name)
            continue
        with Run(path):  # nothing but runs
            pass
        try:
            whole = _copy_file(path, folder / path.name, cancelled, told)
        except OSError as error:
            raise RunReadError(
                f"{path.name} cannot be copied into {folder}: {error.strerror or error}; make room there, or choose another folder"
            ) from None
        if not whole:
            break
        copied.append(path.name)
    return CopyResult(tuple(copied), tuple(there))


def _copy_file(path: Path, to: Path, cancelled: Callable[[], bool], progress: ProgressCallback) -> bool:
    """Copy a file piece by piece; it has its name only when it is whole. False where it was stopped."""
    working, size = to.with_name(f".{to.name}.part"), max(path.stat().st_size, 1)
    try:
        with path.open("rb") as source, working.open("wb") as copy:
            while piece := source.read(COPY_CHUNK_BYTES):
                if cancelled():
                    return False
                copy.write(piece)
                progress(copy.tell() / size)
        shutil.copystat(path, working)
        working.replace(to)
        return True
    finally:
        working.unlink(missing_ok=True)


def import_tables(
    paths: Sequence[Path],
    folder: Path,
    specimen: str,
    amplifier: AmplifierTable,
    progress: ProgressCallback = ignore_progress,
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
    taken, written = import_files(options, amplifier, progress)
    return len(written), [words for each in taken for words in each.warnings]


def measured_responses(paths: Sequence[Path]) -> list[MeasuredResponse]:
    """The responses of those runs that have one."""
    runs = []
    for path in paths:
        try:
            runs.append(read_measured_response(path))
        except RunReadError:
            continue
    return runs
