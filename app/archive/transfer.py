"""Batch operations on run files: export, copy, import tables, read for comparison."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from app.archive.backup import CopyResult, copy_file
from app.archive.exporting import Format, export_run, raw_left_out
from app.archive.replay import MeasuredResponse, read_measured_response
from app.common import NO_PROGRESS, OperationCancelled, Progress, record_audit
from app.config import AmplifierTable
from protocols.base import UNNAMED, file_hash
from protocols.runfile import Run, RunReadError, notes_path


def export_runs(
    paths: Sequence[Path],
    folder: Path,
    kind: Format,
    progress: Progress = NO_PROGRESS,
) -> tuple[int, list[str]]:
    """Export runs and return the number of files written, and why the raw samples of some runs are left out."""
    count = 0
    left_out: list[str] = []
    for path, file_progress in zip(paths, progress.split_by_files(paths), strict=True):
        if progress.cancelled:
            break
        with Run(path) as run:
            count += len(export_run(run, folder, kind, progress=file_progress))
            left_out += filter(None, [raw_left_out(run, kind)])
    return count, left_out


def copy_runs_into(
    paths: Sequence[Path],
    folder: Path,
    progress: Progress = NO_PROGRESS,
) -> CopyResult:
    """Copy run files with their sidecars into a folder without replacing files. After cancellation, complete copies are kept.

    Raises:
        RunReadError: a file is not a run, cannot be copied, or has other notes in the folder.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunReadError(f"{folder} cannot be made: {error.strerror or error}; choose another folder") from None
    copied, there = list[str](), list[str]()
    for path, file_progress in zip(paths, progress.split_by_files(paths), strict=True):
        if (folder / path.name).exists():
            there.append(path.name)
            continue
        with Run(path):  # rejects files that are not runs
            pass
        if (left := notes_path(folder / path.name)).exists() and file_hash(left) != file_hash(notes_path(path)):
            raise RunReadError(
                f"{path.name} is not copied into {folder}: the notes {left.name} of another run are there; move them away"
            )
        try:
            copy_file(path, folder / path.name, file_progress)
            if notes_path(path).is_file():
                copy_file(notes_path(path), left)
        except OperationCancelled:
            break
        except OSError as error:
            raise RunReadError(
                f"{path.name} cannot be copied into {folder}: {error.strerror or error}; free space there, or choose another folder"
            ) from None
        copied.append(path.name)
        record_audit("copy", folder / path.name, left, source=str(path))
    return CopyResult(tuple(copied), tuple(there))


def import_tables(
    paths: Sequence[Path],
    folder: Path,
    specimen: str,
    amplifier: AmplifierTable,
    progress: Progress = NO_PROGRESS,
) -> tuple[int, list[str]]:
    """Import tables as run files with default options; return their number and warnings.

    Raises:
        UsageError: a table cannot be imported; the message gives file, place and remedy.
        OperationCancelled: cancelled by `progress`; nothing was written.
    """
    from app.archive.importing import (  # loads units and protocols, which no page needs at start-up
        ImportOptions,
        import_files,
    )

    options = ImportOptions(tuple(paths), folder, specimen=specimen or UNNAMED)
    taken, written = import_files(options, amplifier, progress)
    return len(written), [warning for each in taken for warning in each.warnings]


def measured_responses(paths: Sequence[Path]) -> list[MeasuredResponse]:
    """Read the frequency responses of those runs that have one."""
    runs = []
    for path in paths:
        with suppress(RunReadError):
            runs.append(read_measured_response(path))
    return runs
