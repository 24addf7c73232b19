"""Results of long computations kept in the user's cache beside the indexes, by the digest of everything that they depend on.

A kept result is trusted only if this user's own key signed it under its name: a damaged one, one of another user, or one put under
another name is removed and computed again. docs/decisions/0155-results-kept-by-hash.md.
"""

import hashlib
import hmac
import os
import pickle
import secrets
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")

FOLDER_NAME, KEY_NAME, SUFFIX = "results", "results.key", ".result"
KEY_BYTES = DIGEST_BYTES = 32
MAX_BYTES = 500_000_000
"""Size of all kept results; beyond it those that were not used for longest are removed."""
PACKAGES = ("model", "app/identification", "app/plotting", "app/report", "protocols/runfile")
"""Folders whose code computes the kept results and checks files; after a change of it they are computed anew."""
KEPT_FAILURES = (OSError, pickle.PickleError, EOFError, AttributeError, ImportError, IndexError, TypeError, ValueError)
"""Errors of a result of another version, or of a folder that cannot be used."""


def kept_result(kind: str, inputs: Any, compute: Callable[[], T]) -> T:
    """Return a result from an earlier call with the same inputs and code, or compute and keep it.

    Args:
        kind: name of the computation.
        inputs: everything that it depends on: numbers, texts, paths, enumerations, arrays, and mappings, sequences and data classes
            of them. A result of other inputs is computed and not kept.
        compute: the computation; its errors are raised and not kept.
    """
    path, key, found = None, b"", None
    with suppress(*KEPT_FAILURES):
        folder = own_cache_folder()
        key = _own_key(folder)
        path = folder / FOLDER_NAME / f"{kind}-{content_digest((_code_digest(), inputs))}{SUFFIX}"
        found = _load(path, key)
    if found is not None:
        return found[0]  # type: ignore[no-any-return]
    result = compute()
    if path is not None:
        with suppress(*KEPT_FAILURES, RecursionError):
            _store(path, key, pickle.dumps((result,), pickle.HIGHEST_PROTOCOL))
    return result


@contextmanager
def kept_table(kind: str, table: dict[Any, Any]) -> Iterator[None]:
    """Complete a table by what earlier programs with the same code kept of it, and keep what the block adds.

    Args:
        kind: name of the table.
        table: of a fact by an item, both of numbers and texts; entries of this program are not replaced.
    """
    path, key = None, b""
    with suppress(*KEPT_FAILURES):
        folder = own_cache_folder()
        key = _own_key(folder)
        path = folder / FOLDER_NAME / f"{kind}-{_code_digest()}{SUFFIX}"
        for item, fact in (_load(path, key) or ({},))[0].items():
            table.setdefault(item, fact)
    before = dict(table)
    try:
        yield
    finally:
        if path is not None and table != before:
            with suppress(*KEPT_FAILURES):
                _store(path, key, pickle.dumps((dict(table),), pickle.HIGHEST_PROTOCOL))


def forget_results() -> None:
    """Remove all kept results of this user."""
    for path in (own_cache_folder() / FOLDER_NAME).glob(f"*{SUFFIX}"):
        path.unlink(missing_ok=True)


def own_cache_folder() -> Path:
    """Return the folder of indexes and results: the user's cache, or a temporary folder if that is not writable."""
    from platformdirs import user_cache_path

    place = user_cache_path("tactor-bench", appauthor=False)
    with suppress(OSError):
        place.mkdir(parents=True, exist_ok=True)
        if os.access(place, os.W_OK):
            return place
    return _own_temporary_folder()


def content_digest(value: Any) -> str:
    """Return the SHA-256 of a value's content; equal values of one type have one digest.

    Raises:
        TypeError: a part is of a type whose content is not known.
    """
    digest = hashlib.sha256()
    _feed(digest, value)
    return digest.hexdigest()


def _feed(digest: Any, value: Any) -> None:
    import numpy as np

    kind = type(value).__name__
    if value is None or isinstance(
        value, bool | int | float | complex | str | bytes | Path | slice | Enum | np.generic
    ):
        digest.update(f"{kind}:{value!r};".encode())
    elif isinstance(value, np.ndarray) and not value.dtype.hasobject:
        digest.update(f"{kind}:{value.dtype.str}{value.shape};".encode() + value.tobytes())
    elif isinstance(value, Mapping):
        digest.update(f"mapping:{len(value)};".encode())
        for item in value.items():
            _feed(digest, item)
    elif isinstance(value, list | tuple):
        digest.update(f"{kind}:{len(value)};".encode())
        for each in value:
            _feed(digest, each)
    elif is_dataclass(value):
        digest.update(f"{type(value).__module__}.{type(value).__qualname__};".encode())
        for each in fields(value):
            _feed(digest, getattr(value, each.name))
    else:
        raise TypeError(f"the content of a {kind} is not known")


@cache
def _code_digest() -> str:
    """Return a digest of the names, sizes and modification times of the files that compute the kept results."""
    import numpy as np

    root = Path(__file__).resolve().parents[2]
    files = [Path(sys.executable)] if getattr(sys, "frozen", False) else []
    files += [path for package in PACKAGES for path in sorted((root / package).rglob("*.py"))]
    stats = tuple((str(path), (stat := path.stat()).st_size, stat.st_mtime_ns) for path in files)
    return content_digest((sys.version, np.__version__, stats))


def _own_key(folder: Path) -> bytes:
    """Return the user's key, made on first use; only this user may read it.

    Raises:
        OSError: the key or the folder is another user's, or others may write to it.
    """
    path = folder / KEY_NAME
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
    with suppress(FileExistsError), os.fdopen(os.open(path, flags, 0o600), "wb") as file:
        file.write(secrets.token_bytes(KEY_BYTES))
    stat = path.lstat()
    if hasattr(os, "getuid") and (stat.st_uid != os.getuid() or stat.st_mode & 0o077):
        raise PermissionError(f"{path} is not this user's own")
    key = path.read_bytes()
    if len(key) != KEY_BYTES:
        path.unlink()
        raise OSError(f"{path} is damaged")
    return key


def _signature(path: Path, key: bytes, content: bytes) -> bytes:
    return hmac.digest(key, path.name.encode() + content, "sha256")


def _load(path: Path, key: bytes) -> tuple[Any] | None:
    """Return a kept result in a tuple, or None if it is missing or was not signed by this user."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return None
    signature, content = data[:DIGEST_BYTES], data[DIGEST_BYTES:]
    try:
        if hmac.compare_digest(signature, _signature(path, key, content)):
            found = pickle.loads(content)  # noqa: S301 - signed by this user
            os.utime(path)
            return (found[0],)
    except KEPT_FAILURES:
        pass
    path.unlink(missing_ok=True)
    return None


def _store(path: Path, key: bytes, content: bytes) -> None:
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    handle, working = tempfile.mkstemp(dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(_signature(path, key, content) + content)
        Path(working).replace(path)
    except BaseException:
        Path(working).unlink(missing_ok=True)
        raise
    known = sorted(((p.stat().st_mtime_ns, p.stat().st_size, p) for p in path.parent.glob(f"*{SUFFIX}")), reverse=True)
    total = 0
    for _, size, old in known:
        total += size
        if total > MAX_BYTES and old != path:
            old.unlink(missing_ok=True)


def _own_temporary_folder() -> Path:
    """Return a folder in the temporary directory into which only this user writes, because the indexes are trusted."""
    if not hasattr(os, "getuid"):
        return Path(tempfile.gettempdir())
    place = Path(tempfile.gettempdir()) / f"tactor-bench-{os.getuid()}"
    place.mkdir(mode=0o700, exist_ok=True)
    stat = place.lstat()
    return place if stat.st_uid == os.getuid() and not stat.st_mode & 0o022 else Path(tempfile.mkdtemp())
