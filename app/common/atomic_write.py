"""Writing a small file whole or not at all."""

import os
from pathlib import Path


def write_atomic(path: Path, text: str) -> None:
    """Replace what stands in `path`; after a crash or a power cut either the old text is there or the new one.

    Raises:
        OSError: it cannot be written; what stood there still does.
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
