"""Checksums of a run file: a digest of every object, stored when the run ends, beside HDF5's own of chunks."""

import hashlib
import json
from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np

CHECKSUMS = "entry/checksums"
"""Text dataset with the digests: JSON, path -> digest."""
DIGEST_BYTES = 8
PIECE_BYTES = 8_000_000
"""Length of the pieces in which a dataset is read."""


def store_checksums(file: h5py.File) -> None:
    """Store the digests of all objects in the place of earlier ones."""
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
    found = json.loads(bytes(file[CHECKSUMS][()]))
    if not isinstance(found, dict):
        raise ValueError(f"{CHECKSUMS} holds no digests")
    return found


def changed_objects(file: h5py.File) -> list[str]:
    """Return the objects whose digest is not the stored one; none if no digests are stored.

    Raises:
        ValueError, OSError: the digests are damaged.
    """
    stored = stored_digests(file)
    if stored is None:
        return []
    present = compute_digests(file)
    names = stored.keys() | present.keys()
    return sorted(name or "/" for name in names if not present.get(name) or stored.get(name) != present[name])


def compute_digests(file: h5py.File) -> dict[str, str]:
    """Return the digest of every object but the checksums: kind, shape, type, attributes, and what HDF5 does not check.

    The data of a dataset with checksums of its own (Fletcher-32) is left out. A damaged object has an empty digest.
    """
    return {name: _digest(file, name) for name in object_names(file)}


def object_names(file: h5py.File) -> Iterator[str]:
    """Yield the path of every object and link, the root as an empty one; links are not followed."""
    pending = [""]
    while pending:
        path = pending.pop()
        yield path
        try:
            group = file[path] if path else file
            names = sorted(group) if isinstance(group, h5py.Group) else []
            hard = [n for n in names if isinstance(group.get(n, getlink=True), h5py.HardLink)]
        except (OSError, RuntimeError, KeyError, ValueError):
            continue
        for name in names:
            inside = f"{path}/{name}" if path else name
            if name not in hard:
                yield inside
            elif inside != CHECKSUMS:
                pending.append(inside)


def has_chunk_checksums(data: Any) -> bool:
    """Whether HDF5 stores a checksum with every chunk of a dataset."""
    return bool(data.fletcher32)


def pieces(data: Any) -> Iterator[tuple[int, int]]:
    """Yield the rows of a dataset in pieces of whole chunks."""
    row_bytes = max(int(np.prod(data.shape[1:], dtype=np.int64)) * data.dtype.itemsize, 1)
    chunk = data.chunks[0] if data.chunks else 1
    step = max(PIECE_BYTES // row_bytes // chunk, 1) * chunk
    for start in range(0, data.shape[0], step):
        yield start, min(start + step, data.shape[0])


def _digest(file: h5py.File, path: str) -> str:
    digest = hashlib.blake2b(digest_size=DIGEST_BYTES)

    def add(*parts: Any) -> None:
        for part in parts:
            data = part if isinstance(part, bytes) else str(part).encode("utf-8", "surrogateescape")
            digest.update(len(data).to_bytes(8, "little") + data)

    try:
        link = file.get(path, getlink=True) if path else None
        if isinstance(link, h5py.ExternalLink):
            add("external link", link.filename, link.path)
            return digest.hexdigest()
        if isinstance(link, h5py.SoftLink):
            add("link", link.path)
            return digest.hexdigest()
        found = file[path] if path else file
        add(type(found).__name__)
        for name in sorted(found.attrs):
            kind = found.attrs.get_id(name)
            add(name, kind.shape, kind.dtype.str, _value_bytes(found.attrs[name]))
        if isinstance(found, h5py.Group):
            add(*(name for name in sorted(found) if f"{path}/{name}" != CHECKSUMS))
        if isinstance(found, h5py.Dataset):
            add(found.shape, found.maxshape, found.dtype.descr, found.chunks, found.fletcher32)
            if not found.shape:
                add(_value_bytes(found[()]))
            elif not has_chunk_checksums(found):
                for start, stop in pieces(found):
                    add(_value_bytes(found[start:stop]))
    except (OSError, RuntimeError, KeyError, ValueError, TypeError):
        return ""
    return digest.hexdigest()


def _value_bytes(value: Any) -> bytes:
    """Return a value as bytes: texts by their characters, not by their place in the file."""
    if isinstance(value, bytes):
        return value
    if isinstance(value, str):
        return value.encode("utf-8", "surrogateescape")
    array = np.asarray(value)
    if array.dtype.hasobject:
        return b"\0".join(_value_bytes(each) for each in array.ravel().tolist())
    return array.tobytes()
