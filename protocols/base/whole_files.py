"""Whole files: opening regular files only, atomic writing, SHA-256."""

import errno
import hashlib
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def open_regular(path: Path, mode: str = "rb", **text: Any) -> Any:
    """Open a file that a user named, as `open` does: reading a pipe or a device in its place might not end.

    Raises:
        OSError: it cannot be opened, or is not a regular file.
    """
    return open(path, mode, opener=_open_regular, **text)


def _open_regular(path: str, flags: int) -> int:
    descriptor = os.open(path, flags | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    kind = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(kind):
        os.close(descriptor)
        if stat.S_ISDIR(kind):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), path)
        raise OSError(errno.EINVAL, "it is a pipe or a device, not a file", path)
    return descriptor


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path whose file replaces `path` at the end; after an exception `path` is unchanged."""
    working = path.with_name(f"{path.name}.part")
    try:
        yield working
        working.replace(path)
    finally:
        working.unlink(missing_ok=True)


def write_atomic(path: Path, text: str) -> None:
    """Replace the content of `path`; after a crash or a power cut the file holds either the old text or the new one.

    Raises:
        OSError: it cannot be written; the old content is unchanged.
    """
    with replacing(path) as working, working.open("w", encoding="utf-8", errors="backslashreplace") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())  # or a power cut may leave an empty file under the new name


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file; empty for a missing file.

    Raises:
        OSError: it cannot be read.
    """
    try:
        with open_regular(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError:
        return ""
