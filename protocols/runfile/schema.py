"""Where everything stands in a run file: names and record types shared by its writer and its reader.

NeXus at heart: /entry (NXentry) with NXinstrument, NXdata groups and units on every dataset, so that a NeXus viewer
opens it to a plot; plain enough for MATLAB's `h5read`.

Names of run files, and texts that must fit into so many bytes.
"""

from dataclasses import fields
from datetime import datetime
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
from annotated_types import Unit

FORMAT = "tactor-bench-run"
FORMAT_VERSION = 2

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"

MAX_TEXT_BYTES = 1000
"""Longest text of one event row; longer texts go on in rows of kind `+`."""

EVENT_DTYPE = np.dtype([("time_s", "f8"), ("row", "i8"), ("kind", "S24"), ("text", f"S{MAX_TEXT_BYTES}")])
BLOCK_DTYPE = np.dtype([("row", "i8"), ("scan", "i8"), ("time_s", "f8")])
RECORDING_DTYPE = np.dtype(
    [("start_row", "i8"), ("stop_row", "i8"), ("quality", "i8"), ("entry", "i8"), ("drive", f"S{MAX_TEXT_BYTES}")]
)
ENTRY_COLUMN = "entry"
"""Column of the points beside those of their type: the entry of the plan each belongs to."""

RESERVE_BYTES = 32_000_000
"""A disk with less than this left counts as full: HDF5 cannot recover from a failed write, so none may fail."""

CHANNELS = ("drive", "displacement")
MAX_SCALING_COEFFICIENTS = 4
"""Scaling coefficients kept per channel."""


def is_hdf5(path: Path) -> bool:
    """Whether a file that can be read begins as every HDF5 file does."""
    try:
        with path.open("rb") as file:
            return file.read(len(HDF5_SIGNATURE)) == HDF5_SIGNATURE
    except OSError:
        return False


def point_columns(point_type: type) -> dict[str, tuple[str, str, int]]:
    """The columns of a point type: name -> (unit, words, width); width 0 is a plain number.

    A tuple-valued field has the width that its protocol always fills.
    """
    hints = get_type_hints(point_type, include_extras=True)
    found: dict[str, tuple[str, str, int]] = {}
    for field in fields(point_type):
        inner, *metadata = get_args(hints[field.name])
        unit = next((m.unit for m in metadata if isinstance(m, Unit)), "1")
        words = next((m for m in metadata if isinstance(m, str)), "")
        found[field.name] = (unit, words, _column_width(inner))
    return found


def _column_width(annotation: Any) -> int:
    return 8 if get_origin(annotation) is tuple else 0


MAX_NAME_BYTES = 100
"""Longest part of a run file's name that tells the specimen: a file's name ends at 255 bytes, the specimen is in the file."""


def run_path(folder: Path, specimen: str, protocol: str, started_at: datetime) -> Path:
    """A name that sorts by time and tells specimen and protocol: `20261121T091502Z_T7_sine-dwell.h5`."""
    return folder / f"{started_at:%Y%m%dT%H%M%SZ}_{safe_name(specimen)}_{protocol}.h5"


def safe_name(specimen: str) -> str:
    """The name of a specimen as it can stand in a file's name."""
    return (
        truncate_utf8("".join(c if c.isalnum() or c in "-." else "-" for c in specimen), MAX_NAME_BYTES).decode()
        or "unnamed"
    )


def truncate_utf8(text: str, length: int) -> bytes:
    """The text in at most `length` bytes, no character cut in two."""
    return text.encode()[:length].decode(errors="ignore").encode()
