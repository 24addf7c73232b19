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
    digests: dict[str, str] = {}
    pending: list[tuple[str, Any]] = [("", file)]
    while pending:  # each object is looked up once, which takes most of the time
        path, found = pending.pop()
        digests[path] = _object_digest(found)
        try:
            names = sorted(found) if isinstance(found, h5py.Group) else []
        except (OSError, RuntimeError, KeyError, ValueError):
            continue
        for name in names:
            inside = f"{path}/{name}" if path else name
            if inside == CHECKSUMS:
                continue
            try:
                if found.id.links.get_info(name.encode("utf-8", "surrogateescape")).type == h5py.h5l.TYPE_HARD:
                    pending.append((inside, found[name]))
                else:
                    digests[inside] = _link_digest(found.get(name, getlink=True))
            except (OSError, RuntimeError, KeyError, ValueError):
                digests[inside] = ""
    return digests


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


def _new_digest(*parts: Any) -> "hashlib.blake2b":
    digest = hashlib.blake2b(digest_size=DIGEST_BYTES)
    _add(digest, *parts)
    return digest


def _add(digest: "hashlib.blake2b", *parts: Any) -> None:
    for part in parts:
        data = part if isinstance(part, bytes) else str(part).encode("utf-8", "surrogateescape")
        digest.update(len(data).to_bytes(8, "little") + data)


def _link_digest(link: Any) -> str:
    if isinstance(link, h5py.ExternalLink):
        return _new_digest("external link", link.filename, link.path).hexdigest()
    return _new_digest("link", link.path).hexdigest()


def _object_digest(found: Any) -> str:
    try:
        digest = _new_digest(type(found).__name__)
        for name in sorted(found.attrs):
            attribute = found.attrs.get_id(name)
            value = np.empty(attribute.shape, attribute.dtype)
            attribute.read(value)
            _add(digest, name, attribute.shape, attribute.dtype.str, _value_bytes(value))
        if isinstance(found, h5py.Group):
            _add(digest, *(name for name in sorted(found) if f"{found.name}/{name}".strip("/") != CHECKSUMS))
        elif isinstance(found, h5py.Dataset):
            kind, chunks, checked = found.dtype, found.chunks, has_chunk_checksums(found)
            _add(digest, found.shape, found.maxshape, kind.descr, chunks, checked)
            if not found.shape:
                _add(digest, _value_bytes(found[()]))
            elif not checked:
                for start, stop in pieces(found):
                    _add(digest, _value_bytes(found[start:stop]))
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
