"""Structure check of an HDF5 file before anything in it is read: links, storage, sizes and nesting."""

import math
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import h5py

MAX_DEPTH = 16
"""Groups within groups; a run has four. Also ends groups that contain themselves."""
MAX_OBJECTS = 100_000
"""Groups and datasets of a file; a run has some 70, and a few for every curve."""
UNWRITTEN_BYTES = 4_000_000
"""How much more the datasets of a growing or broken-off file may declare than the file holds."""
MAX_CHUNK_BYTES = 64_000_000
"""Longest chunk of a dataset; HDF5 reads a chunk whole."""
MAX_COMPRESSED_BYTES = 256_000_000
"""Limit of all compressed datasets together, uncompressed."""

DEFLATE, SHUFFLE, FLETCHER32 = 1, 2, 3
PLAIN_FILTERS = frozenset({SHUFFLE, FLETCHER32})
"""Filters that do not change the size of the data."""

CONTINUED_RUN_LINK = b"entry/earlier"
"""The one link to another file that this program writes: the run that a resumed run continues."""


class StructureError(Exception):
    """A file has a structure that no file of this program has; the message says where and which."""


def check_structure(file: "h5py.File") -> None:
    """Refuse a file with links, storage or sizes that must not be followed or read. No link is followed.

    Raises:
        StructureError: the first such place.
        OSError, RuntimeError, ValueError, KeyError: the file is damaged.
    """
    from h5py import h5d, h5g, h5l, h5o

    declared = compressed = objects = 0
    pending: list[tuple[bytes, Any, int]] = [(b"", file.id, 0)]
    while pending:
        path, group, depth = pending.pop()
        links = group.links
        names: list[bytes] = []
        links.iterate(names.append)
        objects += len(names)
        if objects > MAX_OBJECTS:
            raise StructureError(f"there are more than {MAX_OBJECTS} objects in it")
        for name in names:
            inside = path + b"/" + name if path else name
            kind = links.get_info(name).type
            if kind != h5l.TYPE_HARD:
                target: Any = links.get_val(name) if kind in (h5l.TYPE_SOFT, h5l.TYPE_EXTERNAL) else ""
                if kind != h5l.TYPE_EXTERNAL or inside != CONTINUED_RUN_LINK or not is_run_beside(_text(target[0])):
                    raise StructureError(f"{_text(inside)} is {_describe_link(kind, target)}")
                continue
            opened = h5o.open(group, name)
            if isinstance(opened, h5g.GroupID):
                if depth == MAX_DEPTH:
                    raise StructureError(f"its groups are nested more than {MAX_DEPTH} deep")
                pending.append((inside, opened, depth + 1))
            elif isinstance(opened, h5d.DatasetID):
                size, is_compressed = _checked_size(_text(inside), opened)
                declared += 0 if is_compressed else size
                compressed += size if is_compressed else 0
    # The size is asked for last: a file that is being written grows meanwhile.
    size = Path(file.filename).stat().st_size
    if declared > size + UNWRITTEN_BYTES or compressed > MAX_COMPRESSED_BYTES:
        raise StructureError(
            f"its datasets declare {(declared + compressed) / 1e6:.4g} MB, and the file has {size / 1e6:.4g} MB"
        )


def is_run_beside(name: str) -> bool:
    """Whether the name of a continued run is that of a run file, relative to the folder of the file that names it."""
    if not name or not name.isprintable() or not name.endswith(".h5"):
        return False
    return not any(kind(name).is_absolute() or kind(name).anchor for kind in (PurePosixPath, PureWindowsPath))


def _checked_size(name: str, dataset: Any) -> tuple[int, bool]:
    """Return the bytes that a dataset declares, and whether they are compressed."""
    from h5py import h5d, h5t

    created, kind, space = dataset.get_create_plist(), dataset.get_type(), dataset.get_space()
    layout = created.get_layout()
    if layout == h5d.VIRTUAL:
        raise StructureError(f"{name} is a virtual dataset, whose data is in other files")
    if created.get_external_count():
        raise StructureError(f"{name} has its data in another file, '{_text(created.get_external(0)[0])}'")
    filters = {created.get_filter(i)[0] for i in range(created.get_nfilters())}
    if unknown := filters - PLAIN_FILTERS - {DEFLATE}:
        raise StructureError(f"{name} is stored with a filter that this program does not use (number {min(unknown)})")
    width = kind.get_size()
    if layout == h5d.CHUNKED and math.prod(created.get_chunk()) * width > MAX_CHUNK_BYTES:
        raise StructureError(f"{name} has chunks of {math.prod(created.get_chunk()) * width / 1e6:.4g} MB")
    elements = space.get_simple_extent_npoints()
    if elements > 1 and kind.get_class() in (h5t.STRING, h5t.VLEN) and _is_variable(kind):
        raise StructureError(f"{name} is an array of texts of any length")
    return elements * width, DEFLATE in filters


def _is_variable(kind: Any) -> bool:
    from h5py import h5t

    return kind.get_class() == h5t.VLEN or bool(kind.is_variable_str())


def _describe_link(kind: int, target: Any) -> str:
    if isinstance(target, tuple) and target:
        return f"a link to another file, '{_text(target[0])}'"
    return f"a link to another place, '{_text(target)}'" if target else f"a link of an unknown kind ({kind})"


def _text(name: bytes) -> str:
    return name.decode("utf-8", "replace")
