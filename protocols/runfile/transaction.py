"""Transaction on a file: changes are collected in memory and applied through a journal, so that a kill leaves all or nothing."""

import contextlib
import hashlib
import io
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

PAGE_BYTES = 4096
_HEADER = struct.Struct("<8sQQ")
_MAGIC = b"TBJRNL01"
_DIGEST_BYTES = 16


class BufferedFile(io.RawIOBase):
    """A file whose changes stay in memory, for HDF5's driver of Python file objects."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb")
        self._size = self._disk_size = os.fstat(self._file.fileno()).st_size
        self._place = 0
        self._pages: dict[int, bytearray] = {}

    @property
    def size(self) -> int:
        """Length of the changed file."""
        return self._size

    def changes(self) -> Iterator[tuple[int, bytes]]:
        """Yield the changed pages as offset and bytes, in order."""
        for number in sorted(self._pages):
            start = number * PAGE_BYTES
            if start < self._size:
                yield start, bytes(self._pages[number][: self._size - start])

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
        wanted = memoryview(buffer).cast("B")
        count = max(min(len(wanted), self._size - self._place), 0)
        self._file.seek(self._place)
        found = self._file.read(count)
        wanted[:count] = found + bytes(count - len(found))
        for number in range(self._place // PAGE_BYTES, -(-(self._place + count) // PAGE_BYTES)):
            if (page := self._pages.get(number)) is not None:
                start, stop = max(number * PAGE_BYTES, self._place), min((number + 1) * PAGE_BYTES, self._place + count)
                wanted[start - self._place : stop - self._place] = page[start % PAGE_BYTES :][: stop - start]
        self._place += count
        return count

    def write(self, data: Any) -> int:
        piece = bytes(memoryview(data).cast("B"))
        written = 0
        while written < len(piece):
            number, inside = divmod(self._place + written, PAGE_BYTES)
            if number not in self._pages:
                self._file.seek(number * PAGE_BYTES)
                self._pages[number] = bytearray(self._file.read(PAGE_BYTES).ljust(PAGE_BYTES, b"\0"))
            part = piece[written : written + PAGE_BYTES - inside]
            self._pages[number][inside : inside + len(part)] = part
            written += len(part)
        self._place += written
        self._size = max(self._size, self._place)
        return written

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
    """
    replay_journal(path)
    with BufferedFile(path) as changed:
        yield changed
        body = b"".join(struct.pack("<QQ", start, len(data)) + data for start, data in changed.changes())
        size = changed.size
    text = _HEADER.pack(_MAGIC, size, len(body)) + body
    journal = journal_path(path)
    try:
        with journal.open("wb") as file:
            file.write(text + _digest(text))
            file.flush()
            os.fsync(file.fileno())
    except OSError:
        journal.unlink(missing_ok=True)
        raise
    _apply(path, size, body)
    journal.unlink(missing_ok=True)


def journal_path(path: Path) -> Path:
    """Return the path of a file's journal, a hidden file."""
    return path.with_name(f".{path.name}.journal")


def replay_journal(path: Path) -> bool:
    """Apply the journal that a killed program left; return whether it was complete. An incomplete one is removed.

    Raises:
        OSError: the file cannot be written.
    """
    journal = journal_path(path)
    try:
        text = journal.read_bytes()
    except OSError:
        return False
    header, text_digest = text[: _HEADER.size], text[-_DIGEST_BYTES:]
    complete = len(text) >= _HEADER.size + _DIGEST_BYTES and _digest(text[:-_DIGEST_BYTES]) == text_digest
    if complete:
        _, size, length = _HEADER.unpack(header)
        _apply(path, size, text[_HEADER.size : _HEADER.size + length])
    journal.unlink(missing_ok=True)
    return complete


def _apply(path: Path, size: int, body: bytes) -> None:
    with path.open("r+b") as file:
        place = 0
        while place < len(body):
            start, length = struct.unpack_from("<QQ", body, place)
            place += 16
            file.seek(start)
            file.write(body[place : place + length])
            place += length
        file.flush()
        file.truncate(size)
        with contextlib.suppress(OSError):  # not on every file system
            os.fsync(file.fileno())


def _digest(text: bytes) -> bytes:
    return hashlib.blake2b(text, digest_size=_DIGEST_BYTES).digest()
