"""Checksums of a run file: a digest of every object, stored at the end of the run, in addition to HDF5's checksums of chunks."""

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

import h5py
import numpy as np

from protocols.runfile.foreign_file_check import READ_ERRORS, FileItem, as_text, walk

CHECKSUMS = "entry/checksums"
"""Text dataset with the digests: JSON, path -> digest."""
DIGEST_BYTES = 8
PIECE_BYTES = 8_000_000
"""Length of the pieces in which a dataset is read."""
MAX_KNOWN_TYPES = 1000


def store_checksums(file: h5py.File) -> None:
    """Store the digests of all objects in place of earlier ones."""
    if CHECKSUMS in file:
        del file[CHECKSUMS]
    file[CHECKSUMS] = np.array(json.dumps(compute_digests(file), sort_keys=True).encode())


def stored_digests(file: h5py.File) -> dict[str, str] | None:
    """Return the stored digests; None if the file has none.

    Raises:
        ValueError, OSError: they are damaged.
    """
    if CHECKSUMS not in file:
        return None
    digests = json.loads(bytes(file[CHECKSUMS][()]))
    if not isinstance(digests, dict):
        raise ValueError(f"{CHECKSUMS} holds no digests")
    return digests


def compute_digests(file: h5py.File) -> dict[str, str]:
    """Return the digest of every object but the checksums."""
    return {item.name: compute_digest(item) for item in walk(file) if item.name != CHECKSUMS}


def changed_names(stored: Mapping[str, str], present: Mapping[str, str]) -> list[str]:
    """Return the objects whose digest differs from the stored one."""
    names = stored.keys() | present.keys()
    return sorted(name or "/" for name in names if not present.get(name) or stored.get(name) != present[name])


def has_chunk_checksums(created: h5py.h5p.PropDCID) -> bool:
    """Whether HDF5 stores a checksum with every chunk of a dataset created with these properties."""
    return any(created.get_filter(i)[0] == h5py.h5z.FILTER_FLETCHER32 for i in range(created.get_nfilters()))


def pieces(data: h5py.h5d.DatasetID, chunk: int) -> Iterator[tuple[int, int]]:
    """Yield the rows of a dataset in pieces of whole chunks of so many rows."""
    rows, *beside = data.shape
    row_bytes = max(math.prod(beside) * data.dtype.itemsize, 1)
    step = max(PIECE_BYTES // row_bytes // chunk, 1) * chunk
    for start in range(0, rows, step):
        yield start, min(start + step, rows)


def compute_digest(item: FileItem) -> str:
    """Return the digest of an object: kind, shape, type, attributes, and data not checked by HDF5; for a link, its target.

    The data of a dataset with Fletcher-32 checksums is left out. A damaged object has an empty digest.
    """
    if item.problem is not None:
        return ""
    if item.link == h5py.h5l.TYPE_EXTERNAL:
        return _digest("external link", *map(as_text, item.target))
    if item.id is None:
        return _digest("link", as_text(item.target))
    try:
        if isinstance(item.id, h5py.h5g.GroupID):
            place = f"{item.name}/".lstrip("/")
            names = (name for name in map(as_text, item.names) if place + name != CHECKSUMS)
            return _digest("Group" if item.path else "File", *_attribute_parts(item.id), *names)
        if isinstance(item.id, h5py.h5d.DatasetID):
            return _digest("Dataset", *_attribute_parts(item.id), *_dataset_parts(item.id))
        return _digest("Datatype", *_attribute_parts(item.id))
    except READ_ERRORS:
        return ""


def _digest(*parts: Any) -> str:
    """Return the digest of parts, each with its length; other values by their text."""
    digest = hashlib.blake2b(digest_size=DIGEST_BYTES)
    for part in parts:
        data = part if isinstance(part, bytes) else str(part).encode("utf-8", "surrogateescape")
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.hexdigest()


def _attribute_parts(item: Any) -> Iterator[Any]:
    if not h5py.h5a.get_num_attrs(item):
        return
    names: list[bytes] = []
    h5py.h5a.iterate(item, names.append)
    for name in sorted(names):
        attribute = h5py.h5a.open(item, name)
        kind, memory = _types(attribute.get_type())
        value = np.empty(attribute.get_space().get_simple_extent_dims(), kind)
        attribute.read(value, memory)
        yield from (name, value.shape, kind.str, _value_bytes(value))


def _dataset_parts(data: h5py.h5d.DatasetID) -> Iterator[Any]:
    space = data.get_space()
    shape, longest = space.get_simple_extent_dims(), space.get_simple_extent_dims(True)
    if shape is None:
        raise ValueError("a dataset without data")
    kind, memory = _types(data.get_type())
    chunks, checked = None, False
    if shape:  # a single value has no chunks and no filters
        created = data.get_create_plist()
        checked = has_chunk_checksums(created)
        chunks = created.get_chunk() if created.get_layout() == h5py.h5d.CHUNKED else None
    yield shape
    yield tuple(None if length == h5py.h5s.UNLIMITED else length for length in longest)
    yield kind.descr if kind.names else [("", kind.str)]  # equal result in less time
    yield chunks
    yield checked
    if not shape:
        value = np.empty((), kind)
        data.read(h5py.h5s.ALL, h5py.h5s.ALL, value, memory)
        yield _value_bytes(value[()])
    elif not checked:
        rows = h5py.Dataset(data)
        for start, stop in pieces(data, chunks[0] if chunks else 1):
            yield _value_bytes(rows[start:stop])


_TYPES: dict[bytes, tuple[np.dtype[Any], Any]] = {}


def _types(stored: h5py.h5t.TypeID) -> tuple[np.dtype[Any], h5py.h5t.TypeID]:
    """Return the numpy type of a stored type and HDF5's type of it in memory, cached: composing them takes longer."""
    key = stored.encode()
    if key not in _TYPES:
        if len(_TYPES) >= MAX_KNOWN_TYPES:
            _TYPES.clear()
        _TYPES[key] = stored.dtype, h5py.h5t.py_create(stored.dtype)
    return _TYPES[key]


def _value_bytes(value: Any) -> bytes:
    """Return a value as bytes: texts by their characters, not by their address in the file."""
    if isinstance(value, bytes):
        return value
    if isinstance(value, str):
        return value.encode("utf-8", "surrogateescape")
    array = np.asarray(value)
    if array.dtype.hasobject:
        return b"\0".join(_value_bytes(each) for each in array.ravel().tolist())
    return array.tobytes()
