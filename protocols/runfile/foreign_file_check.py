"""Structure of an HDF5 file: walk through its objects, and check of links, storage, sizes, nesting and text heaps before reading."""

import math
import re
import struct
from collections.abc import Iterator
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import h5py

MAX_DEPTH = 16
"""Largest depth of groups; a run has four. Also ends groups that contain themselves."""
MAX_OBJECTS = 100_000
"""Largest number of groups and datasets of a file; a run has some 70, and a few for every curve."""
UNWRITTEN_BYTES = 4_000_000
"""Largest excess of the declared size of datasets over the size of a growing or interrupted file."""
MAX_CHUNK_BYTES = 64_000_000
"""Longest chunk of a dataset; HDF5 reads complete chunks."""
MAX_COMPRESSED_BYTES = 256_000_000
"""Largest total uncompressed size of compressed datasets."""

DEFLATE, SHUFFLE, FLETCHER32 = 1, 2, 3
PLAIN_FILTERS = frozenset({SHUFFLE, FLETCHER32})
"""Filters that do not change the size of the data."""

CONTINUED_RUN_LINK = b"entry/earlier"
"""The only permitted link to another file: the run that a resumed run continues."""

HEAP_SIGNATURE = re.compile(rb"GCOL\x01\x00\x00\x00")  # found in two thirds of the time of bytes.find
HEAP_HEADER_BYTES = HEAP_OBJECT_BYTES = 16
HEAP_WINDOW_BYTES = 4_000_000
"""Length of the searches for heaps at the begin and the end of a file; one of at most both is searched as a whole.

Texts are written at the begin of a run, and after its end.
"""
MAX_HEAP_OBJECTS = 1_000_000
"""Largest number of objects of all heaps."""


class StructureError(Exception):
    """A file has a structure unlike any file of this program; the message names the place."""


class FileItem(NamedTuple):
    """An object or a link of a file."""

    path: bytes
    """Path without a slash at either end; empty for the root."""
    depth: int
    """Number of groups around it."""
    id: Any
    """Low-level identifier; None for a link or an unreadable object."""
    link: int
    """Kind of its link, as in `h5py.h5l`."""
    target: Any
    """Target of a link: a path, or file and path."""
    names: tuple[bytes, ...]
    """Names in a group, in alphabetical order."""
    problem: Exception | None
    """Error of opening the object or listing the group."""

    @property
    def name(self) -> str:
        """The path as text."""
        return as_text(self.path)


READ_ERRORS = (OSError, RuntimeError, KeyError, ValueError, TypeError)
"""Errors of h5py for a damaged object."""


def walk(file: "h5py.File") -> Iterator[FileItem]:
    """Yield all objects and links of a file, the root first. Objects are opened one by one, so that a caller can end the walk."""
    from h5py import h5g, h5l, h5o

    soft = h5l.TYPE_SOFT, h5l.TYPE_EXTERNAL
    pending: list[tuple[bytes, int, Any, bytes, int]] = [(b"", 0, None, b"", int(h5l.TYPE_HARD))]
    while pending:
        path, depth, group, name, kind = pending.pop()
        opened: Any = None
        target: Any = ""
        problem: Exception | None = None
        kinds: dict[bytes, int] = {}
        try:
            if group is None:
                opened = file.id
            elif kind == h5l.TYPE_HARD:
                opened = h5o.open(group, name)
            elif kind in soft:
                target = group.links.get_val(name)
            if isinstance(opened, h5g.GroupID):
                opened.links.iterate(lambda inside, info, kinds=kinds: kinds.update({inside: info.type}), info=True)
        except READ_ERRORS as error:
            problem = error
        yield FileItem(path, depth, opened, kind, target, tuple(kinds), problem)
        if kinds:
            before = path + b"/" if path else b""
            pending.extend((before + each, depth + 1, opened, each, kinds[each]) for each in kinds)


def as_text(name: bytes | str) -> str:
    """Return a name in a file, or the target of a link, as text that preserves every byte."""
    return name if isinstance(name, str) else name.decode("utf-8", "surrogateescape")


def check_structure(file: "h5py.File", path: str | Path) -> None:
    """Reject a file with forbidden links, storage or sizes. No link is followed.

    Raises:
        StructureError: the first forbidden place.
        OSError, RuntimeError, ValueError, KeyError: the file is damaged.
    """
    from h5py import h5d, h5g, h5l, h5t

    variable = h5t.VLEN, h5t.STRING
    declared = compressed = objects = 0
    for item in walk(file):
        if item.problem is not None:
            raise item.problem
        if item.link != h5l.TYPE_HARD:
            _check_link(item, h5l.TYPE_EXTERNAL)
        elif isinstance(item.id, h5d.DatasetID):
            size, is_compressed = _checked_size(item, h5d.CHUNKED, h5d.VIRTUAL, variable)
            declared += 0 if is_compressed else size
            compressed += size if is_compressed else 0
        elif isinstance(item.id, h5g.GroupID):
            objects += len(item.names)
            if objects > MAX_OBJECTS:
                raise StructureError(f"there are more than {MAX_OBJECTS} objects in it")
            if item.depth > MAX_DEPTH:
                raise StructureError(f"its groups are nested more than {MAX_DEPTH} deep")
    # The size is read last: a file of a running measurement grows meanwhile.
    size = Path(path).stat().st_size
    if declared > size + UNWRITTEN_BYTES or compressed > MAX_COMPRESSED_BYTES:
        raise StructureError(
            f"its datasets declare {(declared + compressed) / 1e6:.4g} MB, and the file has {size / 1e6:.4g} MB"
        )


def check_file_structure(path: str | Path) -> None:
    """Check an HDF5 file before another library reads it.

    Raises:
        StructureError: as `check_structure`.
        OSError: it is no readable HDF5 file.
    """
    import h5py  # slow to import

    with h5py.File(path, "r") as file:
        check_structure(file, path)


def is_run_beside(name: str) -> bool:
    """Whether the name of a continued run is a run file's name, relative to the folder of the resumed run."""
    if not name or not name.isprintable() or not name.endswith(".h5"):
        return False
    return not any(kind(name).is_absolute() or kind(name).anchor for kind in (PurePosixPath, PureWindowsPath))


def _check_link(item: FileItem, external: int) -> None:
    beside = item.link == external and item.path == CONTINUED_RUN_LINK and is_run_beside(_text(item.target[0]))
    if not beside:
        raise StructureError(f"{_text(item.path)} is {_describe_link(item.link, item.target)}")


def _checked_size(item: FileItem, chunked: int, virtual: int, variable: tuple[int, int]) -> tuple[int, bool]:
    """Return the bytes that a dataset declares, and whether they are compressed."""
    kind = item.id.get_type()
    width, elements = kind.get_size(), item.id.get_space().get_simple_extent_npoints()
    if elements > 1 and (of := kind.get_class()) in variable and (of == variable[0] or kind.is_variable_str()):
        raise StructureError(f"{_text(item.path)} is an array of texts of any length")
    if item.id.get_offset() is not None:  # in one piece in this file, without filters
        return elements * width, False
    created = item.id.get_create_plist()
    layout = created.get_layout()
    if layout == virtual:
        raise StructureError(f"{_text(item.path)} is a virtual dataset, whose data is in other files")
    if created.get_external_count():
        name = _text(created.get_external(0)[0])
        raise StructureError(f"{_text(item.path)} has its data in another file, '{name}'")
    filters = {created.get_filter(i)[0] for i in range(created.get_nfilters())}
    if unknown := filters - PLAIN_FILTERS - {DEFLATE}:
        raise StructureError(
            f"{_text(item.path)} is stored with a filter that this program does not use (number {min(unknown)})"
        )
    if layout == chunked and (size := math.prod(created.get_chunk()) * width) > MAX_CHUNK_BYTES:
        raise StructureError(f"{_text(item.path)} has chunks of {size / 1e6:.4g} MB")
    return elements * width, DEFLATE in filters


def _describe_link(kind: int, target: Any) -> str:
    if isinstance(target, tuple) and target:
        return f"a link to another file, '{_text(target[0])}'"
    return f"a link to another place, '{_text(target)}'" if target else f"a link of an unknown kind ({kind})"


def _text(name: bytes) -> str:
    return name.decode("utf-8", "replace")


def find_endless_heap(path: Path) -> int | None:
    """Return the offset of a global heap that HDF5 would read without end, or None."""
    size = path.stat().st_size
    window = HEAP_WINDOW_BYTES if size > 2 * HEAP_WINDOW_BYTES else size
    with path.open("rb") as file:
        for start in sorted({0, size - window}):
            file.seek(start)
            at = _find_endless_heap_in(file.read(window), size - start)
            if at is not None:
                return start + at
    return None


def stated_size(path: Path) -> int:
    """Return the size of a file by its superblock (version 2 or 3, with offsets of 8 bytes); 0 if it states none."""
    with path.open("rb") as file:
        head = file.read(36)
    return int(struct.unpack_from("<Q", head, 28)[0]) if len(head) == 36 and head[8] in (2, 3) and head[9] == 8 else 0


def _find_endless_heap_in(data: bytes, held: int) -> int | None:
    """Return the place of an endless heap in a window with `held` bytes of the file from its begin; None without one."""
    objects = 0
    for found in HEAP_SIGNATURE.finditer(data, 0, len(data) - HEAP_HEADER_BYTES + 8):
        heap = found.start()
        declared = heap + struct.unpack_from("<Q", data, heap + 8)[0]
        if declared > held:  # cut off; HDF5 reads zeros beyond the end
            return heap
        end = min(declared, len(data))
        at = heap + HEAP_HEADER_BYTES
        while at + HEAP_OBJECT_BYTES <= end:
            index, _, length = struct.unpack_from("<HH4xQ", data, at)
            objects += 1
            # Free space of length 0 is its own successor.
            if (index == 0 and length == 0) or objects > MAX_HEAP_OBJECTS:
                return heap
            at += length if index == 0 else HEAP_OBJECT_BYTES + -(-length // 8) * 8
    return None
