"""Check of an HDF5 file's global heaps, in which texts are stored: the library reads a damaged one without end."""

import struct
from pathlib import Path

SIGNATURE = b"GCOL\x01\x00\x00\x00"
HEADER_BYTES = OBJECT_HEADER_BYTES = 16
WINDOW_BYTES = 4_000_000
"""Length at the beginning and the end of a file that is searched for heaps: texts are written when a run begins, and after
its end."""


MAX_OBJECTS = 1_000_000
"""Objects of all heaps together."""


def find_endless_heap(path: Path) -> int | None:
    """Return the offset of a global heap that HDF5 would read without end, or None."""
    size = path.stat().st_size
    with path.open("rb") as file:
        for start in sorted({0, max(size - WINDOW_BYTES, 0)}):
            file.seek(start)
            at = _find_in(file.read(WINDOW_BYTES), size - start)
            if at is not None:
                return start + at
    return None


def _find_in(data: bytes, held: int) -> int | None:
    """Return the place of an endless heap in a window, after whose beginning the file holds so many bytes."""
    objects = 0
    heap = data.find(SIGNATURE)
    while 0 <= heap <= len(data) - HEADER_BYTES:
        declared = heap + struct.unpack_from("<Q", data, heap + 8)[0]
        if declared > held:  # cut off; HDF5 reads zeros there
            return heap
        end = min(declared, len(data))
        at = heap + HEADER_BYTES
        while at + OBJECT_HEADER_BYTES <= end:
            index, _, length = struct.unpack_from("<HH4xQ", data, at)
            objects += 1
            # Free space of no length is followed by itself.
            if (index == 0 and length == 0) or objects > MAX_OBJECTS:
                return heap
            at += length if index == 0 else OBJECT_HEADER_BYTES + -(-length // 8) * 8
        heap = data.find(SIGNATURE, heap + 1)
    return None
