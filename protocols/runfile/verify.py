"""Verification of a run file by its checksums."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import h5py

from protocols.base import RunStatus
from protocols.runfile.checksums import (
    CHECKSUMS,
    changed_names,
    compute_digest,
    has_chunk_checksums,
    pieces,
    stored_digests,
)
from protocols.runfile.errors import NewerFormatError, NotARunError, RunReadError, UnfinishedStorageError
from protocols.runfile.fields import read_integer, read_text
from protocols.runfile.foreign_file_check import READ_ERRORS, FileItem, walk
from protocols.runfile.open import open_run
from protocols.runfile.presence import Superblock, writer_is_alive
from protocols.runfile.transaction import has_journal


class FileState(StrEnum):
    """Result of a verification."""

    GOOD = "good"
    DAMAGED = "damaged"
    NOT_CHECKABLE = "not checkable"
    """Without checksums, or not closed; all checkable parts are good."""
    NO_RUN = "no run"


@dataclass(frozen=True, slots=True)
class Verification:
    """State of a file, and a sentence for each finding."""

    path: Path
    state: FileState
    findings: tuple[str, ...] = ()


def verify_run(path: Path) -> Verification:
    """Read a whole run file and compare it with its checksums. Read errors are findings and not raised."""
    verification = _verify(path)
    if verification.state is FileState.DAMAGED and has_journal(path):
        return Verification(path, FileState.NOT_CHECKABLE, (str(UnfinishedStorageError(path)),))
    return verification


def _verify(path: Path) -> Verification:
    try:
        with open_run(path) as file:
            block = Superblock.read(path)
            is_open = block is not None and block.is_marked
            present: dict[str, str] = {}
            damage: list[str] = []
            for item in walk(file):
                if item.name != CHECKSUMS:
                    damage += _unreadable(item, skip_tails=is_open)
                    present[item.name] = compute_digest(item)
            try:
                stored = stored_digests(file)
            except READ_ERRORS:
                return Verification(path, FileState.DAMAGED, (*damage, "its checksums cannot be read"))
            if stored is not None:
                damage += (f"{name} is not as it was stored" for name in changed_names(stored, present))
            if damage:
                return Verification(path, FileState.DAMAGED, tuple(damage))
            if is_open or stored is None or has_journal(path):
                return Verification(path, FileState.NOT_CHECKABLE, (_why_not_checkable(path, file, is_open),))
    except (NotARunError, NewerFormatError) as error:
        return Verification(path, FileState.NO_RUN, (str(error),))
    except RunReadError as error:
        return Verification(path, FileState.DAMAGED, (str(error),))
    except (*READ_ERRORS, AttributeError) as error:
        return Verification(path, FileState.DAMAGED, (f"it cannot be read: {error}",))
    return Verification(path, FileState.GOOD)


def _unreadable(item: FileItem, skip_tails: bool) -> Iterator[str]:
    """Yield a finding for an object that cannot be read; the last two chunks of a growing dataset may be incomplete."""
    if item.problem is not None:
        yield f"{item.name or '/'} cannot be read: {item.problem}"
    elif item.id is not None:
        try:
            h5py.h5o.get_info(item.id)  # including data of listings only, such as the free space of its names
        except READ_ERRORS as error:
            yield f"{item.name or '/'} cannot be listed by other programs: {error}"
    if not isinstance(item.id, h5py.h5d.DatasetID):
        return
    try:
        created = item.id.get_create_plist()
        if created.get_layout() != h5py.h5d.CHUNKED:
            return
        data, chunk = h5py.Dataset(item.id), created.get_chunk()[0]
        length = data.shape[0]
        whole = length - (length - 1) % chunk - 1 - chunk
        stop = max(whole, 0) if skip_tails else length
        bad = [rows for rows in pieces(item.id, chunk) if not _can_read(data, rows, stop)]
        if bad:
            kind = "their checksum is wrong" if has_chunk_checksums(created) else "HDF5 cannot read them"
            yield f"{item.name}: rows {bad[0][0]} to {bad[-1][1]} of {length} cannot be read, {kind}"
    except READ_ERRORS as error:
        yield f"{item.name} cannot be read: {error}"


def _can_read(data: Any, rows: tuple[int, int], stop: int) -> bool:
    try:
        data[rows[0] : min(rows[1], stop)]
    except (OSError, RuntimeError, ValueError):
        return False
    return True


def _why_not_checkable(path: Path, file: Any, is_open: bool) -> str:
    entry = file["entry"]
    if "verdict" not in entry:
        return "written by a version of the program without checksums; it opens, and everything in it can be read"
    if is_open:
        if writer_is_alive(path, read_integer(entry, "process_id")) and read_text(entry, "status") == RunStatus.RUNNING:
            return "the run is still being written; verify it when it has ended"
        return "its program was killed, and it has no checksums of its texts; its samples are as they were written: repair it with --repair"
    return "its program was killed before the checksums were stored; the measured data can be read: add the checksums with --repair"
