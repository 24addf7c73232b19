"""Transaction on a file: changes are collected in memory and applied through a journal, so that a kill leaves all changes or none."""

import contextlib
import errno
import hashlib
import importlib
import io
import os
import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from protocols.runfile.errors import StorageError

fcntl: Any = importlib.import_module("fcntl") if os.name == "posix" else None

PAGE_BYTES = 4096
_HEADER = struct.Struct("<8sQQ")
_PAGE = struct.Struct("<QQ")
"""Header of a piece: offset and length."""
_MAGIC = b"TBJRNL01"
_DIGEST_BYTES = 16
_RUN = re.compile(b"\1+")


class BufferedFile(io.RawIOBase):
    """A file with changes in memory, for HDF5's driver of Python file objects."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb")
        self._size = self._disk_size = os.fstat(self._file.fileno()).st_size
        self._place = 0
        self._pages: dict[int, bytearray] = {}
        self._written: dict[int, bytearray] = {}
        """Of each page, a 1 for each byte that was written."""
        self.failure: OSError | None = None
        """The first error of the disk: HDF5 reports another, or none."""

    @property
    def size(self) -> int:
        """Length of the changed file."""
        return self._size

    def changes(self) -> Iterator[tuple[int, bytes]]:
        """Yield the written bytes as offset and bytes, in order; bytes that were only read are not written back."""
        for number in sorted(self._pages):
            start = number * PAGE_BYTES
            for run in _RUN.finditer(self._written[number]):
                if start + run.start() < self._size:
                    yield (
                        start + run.start(),
                        bytes(self._pages[number][run.start() : min(run.end(), self._size - start)]),
                    )

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._place

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._place = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._place, os.SEEK_END: self._size}[whence]
        return self._place

    def readinto(self, buffer: Any) -> int:
        target = memoryview(buffer).cast("B")
        count = max(min(len(target), self._size - self._place), 0)
        target[:count] = self._read(self._place, count)
        for number in range(self._place // PAGE_BYTES, -(-(self._place + count) // PAGE_BYTES)):
            if (page := self._pages.get(number)) is not None:
                start, stop = max(number * PAGE_BYTES, self._place), min((number + 1) * PAGE_BYTES, self._place + count)
                target[start - self._place : stop - self._place] = page[start % PAGE_BYTES :][: stop - start]
        self._place += count
        return count

    def write(self, data: Any) -> int:
        piece = bytes(memoryview(data).cast("B"))
        written = 0
        while written < len(piece):
            number, inside = divmod(self._place + written, PAGE_BYTES)
            if number not in self._pages:
                self._pages[number] = bytearray(self._read(number * PAGE_BYTES, PAGE_BYTES))
                self._written[number] = bytearray(PAGE_BYTES)
            part = piece[written : written + PAGE_BYTES - inside]
            self._pages[number][inside : inside + len(part)] = part
            self._written[number][inside : inside + len(part)] = b"\1" * len(part)
            written += len(part)
        self._place += written
        self._size = max(self._size, self._place)
        return written

    def _read(self, place: int, count: int) -> bytes:
        """Return bytes of the file on the disk, zeros beyond its end."""
        expected = max(min(count, self._disk_size - place), 0)
        try:
            self._file.seek(place)
            found = self._file.read(expected)
            if len(found) < expected:
                raise OSError(errno.EIO, f"it ends after {place + len(found)} of {self._disk_size} bytes")
        except OSError as error:
            self.failure = self.failure or error
            raise
        return found.ljust(count, b"\0")

    def truncate(self, size: int | None = None) -> int:
        self._size = self._place if size is None else size
        return self._size

    def close(self) -> None:
        self._file.close()
        super().close()


@contextmanager
def transaction(path: Path) -> Iterator[BufferedFile]:
    """Collect changes of a file, and apply them all at the end; an error changes nothing.

    Raises:
        OSError: the file cannot be read or written.
        StorageError: another program changes it.
    """
    replay_journal(path, keep_announcement=True)
    with BufferedFile(path) as changed:
        try:
            yield changed
        finally:
            if changed.failure is not None:
                raise changed.failure
        body = b"".join(_PAGE.pack(start, len(data)) + data for start, data in changed.changes())
        size = changed.size
    text = _HEADER.pack(_MAGIC, size, len(body)) + body
    journal = journal_path(path)
    with journal.open("ab") as file:
        _lock(path, file)  # the start of another program does not consider this journal abandoned
        try:
            file.truncate(0)
            file.write(text + _digest(text))
            file.flush()
            os.fsync(file.fileno())
        except OSError:
            journal.unlink(missing_ok=True)
            raise
        _apply(path, size, body)
        _remove_locked(journal)
    journal.unlink(missing_ok=True)


@contextmanager
def announced_transaction(path: Path) -> Iterator[None]:
    """Mark the file as needing repair, by an empty journal, until a transaction within the block is complete."""
    with contextlib.suppress(OSError):  # a full disk: the transaction also fails
        journal_path(path).touch()
    try:
        yield
    finally:
        with contextlib.suppress(OSError, StorageError):
            replay_journal(path)


def journal_path(path: Path) -> Path:
    """Return the path of a file's journal, a hidden file."""
    return path.with_name(f".{path.name}.journal")


def has_journal(path: Path) -> bool:
    """Whether changes of a file are or were being stored, so that the file may be neither old nor new."""
    return journal_path(path).is_file()


def replay_journal(path: Path, keep_announcement: bool = False) -> bool:
    """Apply the journal of a killed program; return whether it was complete. An incomplete one is removed.

    Args:
        path: the file.
        keep_announcement: keep an incomplete journal, which a transaction replaces.

    Raises:
        OSError: the file cannot be written.
        StorageError: the program that stores the changes still runs.
    """
    journal = journal_path(path)
    if not has_journal(path):
        return False
    try:
        file = journal.open("r+b")
    except FileNotFoundError:
        return False
    with file:
        _lock(path, file)
        changes = _parse(file.read())
        if changes is not None:
            _apply(path, *changes)
        elif keep_announcement:
            return False
        _remove_locked(journal)
    journal.unlink(missing_ok=True)
    return changes is not None


def _parse(text: bytes) -> tuple[int, bytes] | None:
    """Return size and pages of a complete journal; None for another."""
    if len(text) < _HEADER.size + _DIGEST_BYTES or _digest(text[:-_DIGEST_BYTES]) != text[-_DIGEST_BYTES:]:
        return None
    magic, size, length = _HEADER.unpack_from(text)
    body = text[_HEADER.size : -_DIGEST_BYTES]
    try:
        fits = all(start + len(data) <= size for start, data in _pages(body))
    except struct.error:
        return None
    return (size, body) if magic == _MAGIC and length == len(body) and fits else None


def _pages(body: bytes) -> Iterator[tuple[int, bytes]]:
    place = 0
    while place < len(body):
        start, length = _PAGE.unpack_from(body, place)
        place += _PAGE.size
        yield start, body[place : place + length]
        place += length


def _lock(path: Path, journal: IO[bytes]) -> None:
    """Lock a journal until it is closed, if the system has such locks.

    Raises:
        StorageError: another program has it locked.
    """
    if fcntl is not None:
        try:
            fcntl.flock(journal, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StorageError(f"another program is storing results in {path}; wait until it has ended") from None
        except OSError:  # a file system without locks
            return


def _apply(path: Path, size: int, body: bytes) -> None:
    with path.open("r+b") as file:
        for start, data in _pages(body):
            file.seek(start)
            file.write(data)
        file.flush()
        file.truncate(size)
        with contextlib.suppress(OSError):  # some file systems lack them
            os.fsync(file.fileno())


def _remove_locked(journal: Path) -> None:
    """Remove an applied journal under its lock, if the system removes open files."""
    with contextlib.suppress(OSError):
        journal.unlink()


def _digest(text: bytes) -> bytes:
    return hashlib.blake2b(text, digest_size=_DIGEST_BYTES).digest()
