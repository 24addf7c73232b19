"""Presence of a growing run file, its writing process, and the mark of an open file in its superblock."""

import contextlib
import os
import stat
import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from protocols.runfile.errors import FileLostError
from protocols.runfile.schema import HDF5_SIGNATURE


class FilePresence:
    """Compares the path of an open file with the file itself.

    Args:
        path: path at creation.
        descriptor: descriptor of the open file; duplicated, so that a deleted file can still be read.
    """

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path = path
        self._descriptor = os.dup(descriptor) if os.name == "posix" else None
        status = path.stat()
        self._identity, self._size = (status.st_dev, status.st_ino), status.st_size
        self.problem = ""
        """Loss of the file as text; empty while it is at its path."""
        self.moved_to: Path | None = None
        self.is_cut = False
        """Whether samples are lost, because the file was truncated."""
        self._head = self._read_head()
        self.is_overwritten = False

    def check(self) -> None:
        """Compare path and file.

        Raises:
            FileLostError: the path leads to no file, to another file, or to fewer bytes than written.
        """
        if self.problem:
            raise FileLostError(f"the run file {self._path} {self.problem}")
        status: os.stat_result | None = None
        with contextlib.suppress(OSError):
            status = self._path.stat()
        if status is None or (status.st_dev, status.st_ino) != self._identity:
            self.problem = self._describe_loss(replaced=status is not None)
        elif status.st_size < self._size:
            self.is_cut = True
            self.problem = f"was cut from {self._size} to {status.st_size} bytes while it was being written; the samples in it are lost"
        elif self._head[:COMPARED_HEAD] != self._read_head()[:COMPARED_HEAD]:
            self.is_overwritten = True
            self.problem = "was overwritten at its beginning while it was being written"
        else:
            self._size = status.st_size
            return
        raise FileLostError(f"the run file {self._path} {self.problem}")

    def _read_head(self) -> bytes:
        """Return the beginning of the file without the parts that the library changes: flags, length and checksum of the superblock."""
        if self._descriptor is None:
            return b""
        head = os.pread(self._descriptor, HEAD_BYTES, 0)
        return (
            head[:FLAGS_PLACE]
            + head[FLAGS_PLACE + 1 : _END_PLACE]
            + head[_END_PLACE + 8 : _LAYOUT.size]
            + head[SUPERBLOCK_BYTES:]
        )

    def note_size(self) -> None:
        """Use the present size as the smallest valid size of the file from now on."""
        with contextlib.suppress(OSError):
            status = os.fstat(self._descriptor) if self._descriptor is not None else self._path.stat()
            self._size = max(self._size, status.st_size)

    def restore(self, path: Path) -> None:
        """Copy the deleted or detached file to the new file `path`.

        Raises:
            OSError: it cannot be copied.
        """
        if self._descriptor is None:
            raise OSError("the system gives no access to a deleted file")
        path.parent.mkdir(parents=True, exist_ok=True)
        offset = 0
        with path.open("xb") as copy:
            while piece := os.pread(self._descriptor, 1 << 20, offset):
                copy.write(piece)
                offset += len(piece)
            if self.is_overwritten:  # the library has written the superblock anew when it closed the file
                copy.seek(SUPERBLOCK_BYTES)
                copy.write(self._head[SUPERBLOCK_BYTES - _CHANGING_BYTES :])
            copy.flush()
            os.fsync(copy.fileno())

    def close(self) -> None:
        """Close the duplicate descriptor; a deleted file is lost afterwards."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def _describe_loss(self, replaced: bool) -> str:
        if self._descriptor is not None:
            status = os.fstat(self._descriptor)
            if not stat.S_ISREG(status.st_mode) or status.st_nlink == 0:
                return f"was {'replaced by another file' if replaced else 'deleted'} while it was being written"
            with contextlib.suppress(OSError):
                candidate = Path(f"/proc/self/fd/{self._descriptor}").readlink()
                if os.path.samestat(candidate.stat(), status):
                    self.moved_to = candidate
                    return f"was moved to {candidate} while it was being written"
        return "can no longer be reached: it, its folder or its disk was moved or removed while it was being written"


def writer_is_alive(path: Path, pid: int) -> bool:
    """Whether the process that created a run file on this computer still writes it; its number may have been reused."""
    return process_is_alive(pid) and (os.name == "nt" or pid == os.getpid() or _has_open(path, pid))


def process_is_alive(pid: int) -> bool:
    """Whether a process has this number."""
    if os.name == "nt":  # Windows has no harmless signal: a stale number counts as a running program
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


def _has_open(path: Path, pid: int) -> bool:
    """Whether a process has a file open; also true on a system that cannot answer."""
    try:
        file = path.stat()
        handles = list(Path(f"/proc/{pid}/fd").iterdir())
    except OSError:
        return True
    for handle in handles:
        with contextlib.suppress(OSError):
            if os.path.samestat(handle.stat(), file):
                return True
    return False


HEAD_BYTES, COMPARED_HEAD = 4096, 512
"""Bytes at the beginning of a run file that do not change until its end, and how many of them are compared before each write."""

_LAYOUT = struct.Struct("<8sBBBBQQQQ")
_CHECKSUM = struct.Struct("<I")
SUPERBLOCK_BYTES = _LAYOUT.size + _CHECKSUM.size
FLAGS_PLACE, _END_PLACE = 11, 28
_CHANGING_BYTES = 1 + 8 + _CHECKSUM.size
"""Where flags and length of the file are in the superblock, and how many of its bytes change."""
WRITING_VERSION = 3
"""Superblock version with the mark of a file open for writing."""
SWMR_FLAG = 0b100
WRITE_FLAGS = 0b001 | SWMR_FLAG
"""Marks: open for writing, and open in SWMR mode."""


@dataclass(frozen=True, slots=True)
class Superblock:
    """The first bytes of an HDF5 file, of versions 2 and 3 with offsets of eight bytes."""

    version: int
    flags: int
    base: int
    extension: int
    end: int
    """Stored length of the file."""
    root: int

    @classmethod
    def read(cls, path: Path) -> Self | None:
        """Return the superblock of a file; None if it is of another kind or damaged.

        Raises:
            OSError: the file cannot be read.
        """
        with path.open("rb") as file:
            text = file.read(SUPERBLOCK_BYTES)
        if len(text) < SUPERBLOCK_BYTES or _CHECKSUM.unpack(text[-4:])[0] != jenkins_lookup3(text[:-4]):
            return None
        signature, version, offset_bytes, length_bytes, flags, *places = _LAYOUT.unpack(text[:-4])
        if signature != HDF5_SIGNATURE or version not in (2, 3) or (offset_bytes, length_bytes) != (8, 8):
            return None
        return cls(version, flags, *places)

    @property
    def is_marked(self) -> bool:
        """Whether the file is marked as open for writing."""
        return self.version == WRITING_VERSION and bool(self.flags & WRITE_FLAGS)

    @property
    def is_readable(self) -> bool:
        """Whether the file can be opened for reading, at least in SWMR mode."""
        return not self.is_marked or bool(self.flags & SWMR_FLAG)

    def cleared(self, size: int) -> Self:
        """Return the superblock of the same file, closed, of at least `size` bytes."""
        return replace(self, flags=self.flags & ~WRITE_FLAGS, end=max(self.end, size))

    def pack(self) -> bytes:
        """Return the bytes with their checksum."""
        text = _LAYOUT.pack(
            HDF5_SIGNATURE, self.version, 8, 8, self.flags, self.base, self.extension, self.end, self.root
        )
        return text + _CHECKSUM.pack(jenkins_lookup3(text))


def jenkins_lookup3(text: bytes) -> int:
    """Return Bob Jenkins' lookup3 hash, HDF5's checksum of metadata."""
    a = b = c = (0xDEADBEEF + len(text)) & 0xFFFFFFFF
    *blocks, last = [text[i : i + 12] for i in range(0, len(text), 12)] or [b""]
    for block in blocks:
        x, y, z = struct.unpack("<III", block)
        a, b, c = _mix(a + x, b + y, c + z)
    if not last:
        return c
    x, y, z = struct.unpack("<III", last.ljust(12, b"\0"))
    return _final(a + x, b + y, c + z)


def _rotate(value: int, by: int) -> int:
    return ((value << by) | (value >> (32 - by))) & 0xFFFFFFFF


def _mix(a: int, b: int, c: int) -> tuple[int, int, int]:
    a, b, c = a & 0xFFFFFFFF, b & 0xFFFFFFFF, c & 0xFFFFFFFF
    for by in (4, 6, 8, 16, 19, 4):
        a = ((a - c) & 0xFFFFFFFF) ^ _rotate(c, by)
        c = (c + b) & 0xFFFFFFFF
        a, b, c = b, c, a
    return a, b, c


def _final(a: int, b: int, c: int) -> int:
    a, b, c = a & 0xFFFFFFFF, b & 0xFFFFFFFF, c & 0xFFFFFFFF
    for by in (14, 11, 25, 16, 4, 14, 24):
        a, b, c = b, ((c ^ b) - _rotate(b, by)) & 0xFFFFFFFF, a
    return b
