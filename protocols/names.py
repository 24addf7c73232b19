"""Names of run files, and texts that must fit into so many bytes."""

from datetime import datetime
from pathlib import Path

NAME_BYTES = 100
"""Longest part of a run file's name that tells the specimen: a file's name ends at 255 bytes, the specimen is in the file."""


def run_path(folder: Path, specimen: str, protocol: str, now: datetime) -> Path:
    """A name that sorts by time and tells specimen and protocol: `20261121T091502Z_T7_sine-dwell.h5`."""
    return folder / f"{now:%Y%m%dT%H%M%SZ}_{safe_name(specimen)}_{protocol}.h5"


def safe_name(specimen: str) -> str:
    """The name of a specimen as it can stand in a file's name."""
    return cut("".join(c if c.isalnum() or c in "-." else "-" for c in specimen), NAME_BYTES).decode() or "unnamed"


def cut(text: str, length: int) -> bytes:
    """The text in at most `length` bytes, no character cut in two."""
    return text.encode()[:length].decode(errors="ignore").encode()
