"""Backup of a folder of runs to a second folder or share: each copy is read back and compared by its hash."""

import hashlib
import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from app.common import NO_PROGRESS, OperationCancelled, Progress, UsageError
from protocols.base import file_hash, replacing
from protocols.runfile import FileState, verify_run

COPY_CHUNK_BYTES = 1 << 20
"""Bytes copied between two checks for cancellation."""

FAT_TIME_STEP_S, TIME_STEP_S = 2.0, 1e-3
"""Steps of the modification time on a FAT file system, as on memory sticks, where it is whole seconds, and on others."""


@dataclass(frozen=True, slots=True)
class CopyResult:
    """Names of copied or restored files, by result.

    Attributes:
        copied: copied, and read back with an equal hash.
        already_present: a file of this name existed; in a backup or archive, an equal one.
        problems: a sentence for each file that was not copied, or whose copy differs.
    """

    copied: tuple[str, ...]
    already_present: tuple[str, ...]
    problems: tuple[str, ...] = ()


def back_up(
    folder: Path,
    target: Path,
    paths: Sequence[Path] | None = None,
    compare_all: bool = False,
    progress: Progress = NO_PROGRESS,
) -> CopyResult:
    """Copy files below `folder` that are new or changed into `target`. Nothing in `target` is deleted.

    Args:
        folder: folder of the runs.
        target: second folder; created if missing.
        paths: files below `folder`; default is all except hidden ones.
        compare_all: compare the hashes of all copies, not only size and time of modification.
        progress: updated by bytes. After cancellation, complete copies are kept.

    Raises:
        UsageError: a folder is missing, cannot be used, or lies within the other one.
    """
    _check_folders(folder, target)
    chosen = list(_files(folder)) if paths is None else list(paths)
    copied, present, problems = list[str](), list[str](), list[str]()
    for path, part in zip(chosen, progress.split_by_files(chosen), strict=True):
        name = path.relative_to(folder).as_posix()
        try:
            progress.raise_if_cancelled()
            (copied if _copy_if_changed(path, target / name, compare_all, part) else present).append(name)
        except OperationCancelled:
            break
        except _CopyRefusedError as refused:
            problems.append(f"{name} {refused}")
        except OSError as error:
            problems.append(f"{name} was not copied: {error.strerror or error}")
    return CopyResult(tuple(copied), tuple(present), tuple(problems))


class _CopyRefusedError(Exception):
    """A file and its earlier copy are both left as they are; the message continues a sentence that begins with the name."""


def _copy_if_changed(path: Path, copy: Path, compare: bool, progress: Progress) -> bool:
    """Copy a file that is new or changed; return whether it was.

    Raises:
        _CopyRefusedError: the file, or its copy, is damaged.
        OSError: it cannot be copied.
        OperationCancelled: cancelled; the earlier copy is unchanged.
    """
    if copy.exists():
        if _has_same_size_and_time(path, copy):
            if not compare or file_hash(path) == file_hash(copy):
                return False
            damaged = [str(each) for each in (path, copy) if _is_damaged(each)]
            which = f": {' and '.join(damaged)} is damaged" if damaged else ""
            raise _CopyRefusedError(
                f"and its copy differ although neither was written since{which}. Both were left as they are"
            )
        if _is_damaged(path):
            raise _CopyRefusedError(f"is damaged and does not replace its earlier copy {copy}; restore it from there")
    copy.parent.mkdir(parents=True, exist_ok=True)
    copy_file(path, copy, progress)
    return True


def copy_file(path: Path, to: Path, progress: Progress = NO_PROGRESS) -> None:
    """Copy a file in pieces, cancellable between them; the copy is read back and compared by its SHA-256.

    Raises:
        OSError: it cannot be copied, changes meanwhile, or reads back differently; then `to` is unchanged.
        OperationCancelled: cancelled; `to` is unchanged.
    """
    before = path.stat()
    with replacing(to) as working:
        with path.open("rb") as source, working.open("wb") as copy:
            sha256 = copy_stream(source, copy, progress, before.st_size)
            copy.flush()
            os.fsync(copy.fileno())
        after = path.stat()
        if (before.st_size, before.st_mtime_ns) != (after.st_size, after.st_mtime_ns):
            raise OSError("it is being written; copy it when it is finished")
        if file_hash(working) != sha256:
            raise OSError("the copy reads back differently; its disk may be failing")
        shutil.copystat(path, working)


def copy_stream(source: IO[bytes], target: IO[bytes], progress: Progress, size: int = 0) -> str:
    """Copy bytes and return their SHA-256; `size` is their expected number for the progress, 0 to report none.

    Raises:
        OperationCancelled: `progress` is cancelled.
    """
    digest, done = hashlib.sha256(), 0
    while piece := source.read(COPY_CHUNK_BYTES):
        progress.raise_if_cancelled()
        digest.update(piece)
        target.write(piece)
        done += len(piece)
        if size:
            progress.update(min(done / size, 1.0))
    return digest.hexdigest()


def _is_damaged(path: Path) -> bool:
    return path.suffix == ".h5" and verify_run(path).state is FileState.DAMAGED


def _has_same_size_and_time(path: Path, copy: Path) -> bool:
    ours, theirs = path.stat(), copy.stat()
    step_s = FAT_TIME_STEP_S if theirs.st_mtime_ns % 1_000_000_000 == 0 else TIME_STEP_S
    return ours.st_size == theirs.st_size and abs(ours.st_mtime - theirs.st_mtime) <= step_s


def _files(folder: Path) -> Iterator[Path]:
    """Yield the regular files below a folder, without hidden files and folders, such as the trash, and without links."""
    for place, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(names):
            path = Path(place, name)
            if not name.startswith(".") and path.suffix != ".part" and path.is_file() and not path.is_symlink():
                yield path


def _check_folders(folder: Path, target: Path) -> None:
    if not folder.is_dir():
        raise UsageError(f"there is no folder {folder}; name the folder of your runs")
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{target} cannot be used for a backup: {error.strerror or error}; name a folder") from None
    ours, theirs = folder.resolve(), target.resolve()
    if ours == theirs or ours in theirs.parents or theirs in ours.parents:
        raise UsageError(f"{target} cannot hold the backup of {folder}: one is inside the other; name another folder")
