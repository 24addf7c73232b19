"""Superblock of an HDF5 file: whether a program has it open for writing, and clearing that mark as `h5clear` does."""

import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from protocols.runfile.schema import HDF5_SIGNATURE

_LAYOUT = struct.Struct("<8sBBBBQQQQ")
_CHECKSUM = struct.Struct("<I")
SUPERBLOCK_BYTES = _LAYOUT.size + _CHECKSUM.size
WRITING_VERSION = 3
"""The version that marks a file that is open for writing."""
SWMR_FLAG = 0b100
WRITE_FLAGS = 0b001 | SWMR_FLAG
"""Open for writing, and open in SWMR mode."""


@dataclass(frozen=True, slots=True)
class Superblock:
    """The first bytes of an HDF5 file, of versions 2 and 3 with offsets of eight bytes."""

    version: int
    flags: int
    base: int
    extension: int
    end: int
    """Length of the file as of the last time it was stored."""
    root: int

    @classmethod
    def read(cls, path: Path) -> Self | None:
        """Return the superblock of a file; None if it has none of this kind, or a damaged one.

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
        """Whether the file can be opened for reading, be it in SWMR mode."""
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
    """Return Bob Jenkins' lookup3 hash, with which HDF5 checks its metadata."""
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
    c = ((c ^ b) - _rotate(b, 14)) & 0xFFFFFFFF
    a = ((a ^ c) - _rotate(c, 11)) & 0xFFFFFFFF
    b = ((b ^ a) - _rotate(a, 25)) & 0xFFFFFFFF
    c = ((c ^ b) - _rotate(b, 16)) & 0xFFFFFFFF
    a = ((a ^ c) - _rotate(c, 4)) & 0xFFFFFFFF
    b = ((b ^ a) - _rotate(a, 14)) & 0xFFFFFFFF
    return ((c ^ b) - _rotate(b, 24)) & 0xFFFFFFFF
