"""Verification of a run file: checksums of all chunks, and digests of everything else."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import h5py

from protocols.base import RunStatus
from protocols.runfile.checksums import changed_objects, has_chunk_checksums, object_names, pieces, stored_digests
from protocols.runfile.fields import read_integer, read_text
from protocols.runfile.open import NewerFormatError, NotARunError, RunReadError, open_run
from protocols.runfile.superblock import Superblock
from protocols.runfile.transaction import journal_path
from protocols.runfile.writing_process import writer_is_alive


class FileState(StrEnum):
    """What a verification finds."""

    GOOD = "good"
    DAMAGED = "damaged"
    NOT_CHECKABLE = "not checkable"
    """Without checksums of its own, or not closed; what can be checked is good."""
    NO_RUN = "no run"


@dataclass(frozen=True, slots=True)
class Verification:
    """State of a file, and a sentence for each finding."""

    path: Path
    state: FileState
    findings: tuple[str, ...] = ()


def verify_run(path: Path) -> Verification:
    """Read everything in a run file and compare it with its checksums. Never raises."""
    try:
        with open_run(path) as file:
            damage = tuple(_unreadable(file, skip_tails=_is_open_for_writing(path)))
            try:
                has_digests = stored_digests(file) is not None
                damage += tuple(f"{name} is not as it was stored" for name in changed_objects(file))
            except (OSError, RuntimeError, ValueError, KeyError, TypeError):
                has_digests, damage = True, (*damage, "its checksums cannot be read")
            if damage:
                return Verification(path, FileState.DAMAGED, damage)
            if _is_open_for_writing(path) or not has_digests or journal_path(path).exists():
                return Verification(path, FileState.NOT_CHECKABLE, (_why_not_checkable(path, file),))
    except (NotARunError, NewerFormatError) as error:
        return Verification(path, FileState.NO_RUN, (str(error),))
    except RunReadError as error:
        return Verification(path, FileState.DAMAGED, (str(error),))
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, AttributeError) as error:
        return Verification(path, FileState.DAMAGED, (f"it cannot be read: {error}",))
    return Verification(path, FileState.GOOD)


def _unreadable(file: Any, skip_tails: bool) -> Iterator[str]:
    """Yield a finding for every dataset that cannot be read; the last two chunks of a growing one may be incomplete."""
    for name in object_names(file):
        with suppress(KeyError):
            found = file.get(name or "/", getlink=True) if name else None
            if found is not None and not isinstance(found, h5py.HardLink):
                continue
        try:
            data = file[name or "/"]
            if not isinstance(data, h5py.Dataset) or not data.chunks:
                continue
            whole = data.shape[0] - (data.shape[0] - 1) % data.chunks[0] - 1 - data.chunks[0]
            bad = [rows for rows in pieces(data) if not _can_read(data, rows, max(whole, 0) if skip_tails else None)]
            if bad:
                kind = "their checksum is wrong" if has_chunk_checksums(data) else "HDF5 cannot read them"
                yield f"{name}: rows {bad[0][0]} to {bad[-1][1]} of {data.shape[0]} cannot be read, {kind}"
        except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
            yield f"{name or '/'} cannot be read: {error}"


def _can_read(data: Any, rows: tuple[int, int], stop: int | None) -> bool:
    try:
        data[rows[0] : rows[1] if stop is None else min(rows[1], stop)]
    except (OSError, RuntimeError, ValueError):
        return False
    return True


def _is_open_for_writing(path: Path) -> bool:
    with suppress(OSError):
        block = Superblock.read(path)
        return block is not None and block.is_marked
    return False


def _why_not_checkable(path: Path, file: Any) -> str:
    entry = file["entry"]
    if "verdict" not in entry:
        return "written by a version of the program without checksums; it opens, and everything in it can be read"
    if _is_open_for_writing(path):
        if writer_is_alive(path, read_integer(entry, "process_id")) and read_text(entry, "status") == RunStatus.RUNNING:
            return "the run is still being written; verify it when it has ended"
        return "its program was killed, and it has no checksums of its texts; its samples are as they were written: repair it with --repair"
    return (
        "its program was killed before the checksums were stored; what was measured can be read: add them with --repair"
    )
