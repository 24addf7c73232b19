"""Atomic writing of small files."""

import os
from pathlib import Path


def write_atomic(path: Path, text: str) -> None:
    """Replace the content of `path`; after a crash or a power cut the file holds either the old text or the new one.

    Raises:
        OSError: it cannot be written; the old content is unchanged.
    """
    working = path.with_name(f"{path.name}.part")
    try:
        with working.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())  # or a power cut may leave the new name with nothing in it
        working.replace(path)
    except OSError:
        working.unlink(missing_ok=True)
        raise
