"""Whole files: atomic writing, SHA-256."""

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drivers import open_regular


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
