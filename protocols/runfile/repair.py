"""Repair of a run file whose program was killed: afterwards every program can open it, and its checksums are complete."""

import importlib
import json
import os
import socket
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from protocols.base import RunStatus
from protocols.runfile.creation import creator_of
from protocols.runfile.errors import RunReadError, StorageError, os_error_text
from protocols.runfile.fields import read_integer, read_text
from protocols.runfile.names import truncate_utf8
from protocols.runfile.presence import Superblock, process_is_alive, writer_is_alive
from protocols.runfile.schema import CHANNELS, FURTHER_CHANNELS, MAX_TEXT_BYTES, REPAIRED

fcntl: Any = importlib.import_module("fcntl") if os.name == "posix" else None

RESULTS_LOST = "its program was killed before it had stored the results"

FOREIGN_IDLE_S = 3600.0
"""Time without change after which a file of another computer counts as abandoned."""


def repair_folder(folder: Path, complete: Callable[[Path], str] = lambda _: "") -> Iterator[str]:
    """Repair the run files that killed programs of this computer left in a folder; yield a sentence for each.

    Args:
        folder: folder of the run files.
        complete: function that stores missing results of an ended run and returns a sentence.
    """
    try:
        names = [entry.name for entry in os.scandir(folder)]
    except OSError:
        return
    for name in sorted(names):
        path = folder / name
        try:
            if name.endswith(".h5") and path.is_file() and needs_repair(path):
                yield repair_run(path, complete)
            elif (creator := creator_of(name)) is not None and not process_is_alive(creator):
                path.unlink()  # an incompletely created run file
        except (OSError, StorageError, RunReadError):  # in use, from another computer, damaged, or no run
            continue


def needs_repair(path: Path) -> bool:
    """Whether a file is not closed, or has unapplied changes.

    Raises:
        OSError: it cannot be read.
    """
    from protocols.runfile.transaction import has_journal  # a new folder has no file

    block = Superblock.read(path)
    return (block is not None and block.is_marked) or has_journal(path)


def repair_run(path: Path, complete: Callable[[Path], str] = lambda _: "") -> str:
    """Repair a run file whose program was killed; return a sentence, or an empty text without repair.

    Args:
        path: the run file.
        complete: stores the results of a run that had ended without them; returns a sentence.

    Raises:
        RunReadError: it is not a run, or damaged.
        StorageError: a program still writes it, or it is not writable.
    """
    from protocols.runfile.checksums import store_checksums, stored_digests  # a start finds no such file as a rule
    from protocols.runfile.open import open_run, translate_read_errors
    from protocols.runfile.transaction import replay_journal, transaction

    try:
        replayed = replay_journal(path, keep_announcement=True)  # first: a file with unapplied changes may not open
        block = Superblock.read(path)
        marked = block is not None and block.is_marked
        if block is not None and not block.is_readable:  # killed between creation and the first sample
            _clear_mark(path, block)
        with open_run(path) as file, translate_read_errors(path):
            entry = file["entry"]
            status, host = read_text(entry, "status"), read_text(entry, "host")
            pid, has_checksums = read_integer(entry, "process_id"), stored_digests(file) is not None
            old = "verdict" not in entry  # a version without checksums
        if marked or not (has_checksums or old):
            _check_not_in_use(path, host, pid)
        without_results = status != RunStatus.RUNNING and not (has_checksums or old)
        if not marked and (has_checksums or old):
            replay_journal(path)  # removes an incomplete one
            return f"{path}: the results that a killed program had not stored are stored now" if replayed else ""
        with transaction(path) as changed:
            if block is not None:
                changed.write(block.cleared(changed.size).pack())
                changed.truncate(max(changed.size, block.end))
            with translate_read_errors(path), h5py.File(changed, "r+", libver="latest") as file:
                rows, points = _mend(file["entry"])
                if status == RunStatus.RUNNING and REPAIRED not in file["entry"]:
                    file["entry"][REPAIRED] = datetime.now(UTC).isoformat(timespec="seconds")
                if without_results:
                    reason = f"{read_text(file['entry'], 'reason')}; {RESULTS_LOST}"
                    file["entry/reason"][()] = truncate_utf8(reason, MAX_TEXT_BYTES)
                store_checksums(file)
    except OSError as error:
        raise StorageError(f"{path} cannot be repaired: {os_error_text(error)}") from error
    return (
        f"{path} was left by a program that was killed; it is repaired and opens in every program: {rows} samples "
        f"and {points} points are in it"
        + (f". It had ended: {RESULTS_LOST}. {complete(path)}" if without_results else "")
    ).rstrip()


def _clear_mark(path: Path, block: Superblock) -> None:
    """Clear the mark of a complete file that was not yet open in SWMR mode.

    Raises:
        StorageError: a program has the file open.
    """
    with path.open("r+b") as file:
        if fcntl is not None:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # HDF5 locks it in this state
            except OSError:
                raise StorageError(f"{path} is open in another program; wait until it has closed the file") from None
        file.write(block.cleared(path.stat().st_size).pack())


def _check_not_in_use(path: Path, host: str, pid: int) -> None:
    if host != socket.gethostname():
        if time.time() - path.stat().st_mtime < FOREIGN_IDLE_S:
            raise StorageError(
                f"{path} is being written on the computer {host}, or was within the last hour; repair it there, or later"
            )
    elif writer_is_alive(path, pid):
        raise StorageError(f"{path} is being written by process {pid}; wait until that run has ended, or end it")


def _mend(entry: Any) -> tuple[int, int]:
    """Make the tables of an interrupted run consistent; return its numbers of samples and points."""
    for table in (entry["trace"], entry["points"], entry):
        for name in table:
            # The link to the continued run is not followed.
            data = table[name] if isinstance(table.get(name, getlink=True), h5py.HardLink) else None
            if isinstance(data, h5py.Dataset) and data.chunks:
                _mend_last_chunks(data)
    channels = [entry["trace"][name] for name in (*CHANNELS, *entry["trace"].attrs.get(FURTHER_CHANNELS, ()))]
    columns = [data for data in entry["points"].values() if data.chunks]
    for group in (channels, columns):
        rows = min(data.shape[0] for data in group)
        for data in group:
            data.resize(rows, axis=0)
    _drop_incomplete_event(entry["events"])
    return channels[0].shape[0], columns[0].shape[0]


def _mend_last_chunks(data: Any) -> None:
    """Recompute the checksums of the last two chunks if the program was killed while it overwrote them.

    Rows are only appended, so that older and newer content of such a chunk agree.
    """
    length = data.chunks[0]
    last = max(data.shape[0] - 1, 0) // length * length
    for start in (last - length, last):
        if start < 0 or not data.shape[0]:
            continue
        try:
            data[start : start + length]
        except OSError:
            place = (start, *(0 for _ in data.shape[1:]))
            _, stored = data.id.read_direct_chunk(place)
            values = np.frombuffer(stored[:-4], data.dtype).reshape(data.chunks)
            data.id.write_direct_chunk(place, _with_checksum(values))


def _with_checksum(values: np.ndarray) -> bytes:
    """Return a chunk as HDF5 stores it, with its checksum."""
    with h5py.File("chunk", "w", driver="core", backing_store=False) as file:
        chunk = file.create_dataset("chunk", data=values, chunks=values.shape, fletcher32=True)
        file.flush()
        return bytes(chunk.id.read_direct_chunk((0,) * values.ndim)[1])


def _drop_incomplete_event(events: Any) -> None:
    """Remove the rows of a last event with an incomplete text."""
    rows = events.shape[0]
    kinds = events["kind"] if rows else np.array([], "S1")
    first = max((i for i in range(rows) if kinds[i] != b"+"), default=0)
    try:
        json.loads(b"".join(events[first:rows]["text"].tolist()))
    except ValueError:
        events.resize(first, axis=0)
