"""Run file schema: format version, names, and record types.

NeXus: /entry (NXentry) with NXinstrument, NXdata groups and units on every dataset, so that a NeXus viewer shows a plot; simple
enough for MATLAB's `h5read`.
"""

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np
from annotated_types import Unit

from model import QUANTITIES
from protocols.base import AIR_KINDS

FORMAT = "tactor-bench-run"
FORMAT_VERSION = 3
"""3: the verdict on the run."""
VERDICT_VERSION = 3
"""The first version with a verdict; earlier runs are not judged."""

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"

MAX_TEXT_BYTES = 1000
"""Longest text of one event row; longer texts continue in rows of kind `+`."""
CONTINUED_EVENT = b"+"

EVENT_DTYPE = np.dtype([("time_s", "f8"), ("row", "i8"), ("kind", "S24"), ("text", f"S{MAX_TEXT_BYTES}")])
BLOCK_DTYPE = np.dtype([("row", "i8"), ("scan", "i8"), ("time_s", "f8")])
RECORDING_DTYPE = np.dtype(
    [("start_row", "i8"), ("stop_row", "i8"), ("quality", "i8"), ("entry", "i8"), ("drive", f"S{MAX_TEXT_BYTES}")]
)
ENTRY_COLUMN = "entry"
"""Column of the points with their plan entries."""

RESTED_COLUMN = "rested"
"""Column of points of the time at which rest was reached before them."""

AIR_COLUMNS = {
    f"air_{kind}": (QUANTITIES[f"air_{kind}"].unit, QUANTITIES[f"air_{kind}"].definition, 0) for kind in AIR_KINDS
}
"""Columns of the points of a bench with sensors of the air; NaN where a sensor gave no reading."""

REPAIRED = "repaired"
"""Time at which a crashed run was repaired; absent from all other runs."""

RESERVE_BYTES = 32_000_000
"""Smallest free space of a disk: HDF5 cannot recover from a failed write."""

CHANNELS = ("drive", "displacement")
FURTHER_CHANNELS = "further_channels"
"""Attribute of /entry/trace with the names of the further inputs; absent without further inputs."""
MAX_FURTHER_CHANNELS = 64
MAX_SCALING_COEFFICIENTS = 4
"""Number of scaling coefficients per channel."""


def is_hdf5(path: Path) -> bool:
    """Whether a readable file has the HDF5 signature."""
    try:
        with path.open("rb") as file:
            return file.read(len(HDF5_SIGNATURE)) == HDF5_SIGNATURE
    except OSError:
        return False


def point_columns(point_type: type) -> dict[str, tuple[str, str, int]]:
    """Return the columns of a point type: name -> (unit, description, width); width 0 is a scalar.

    A tuple field has a fixed width, which its protocol always fills. A field without `Annotated` has the unit 1.
    """
    hints = get_type_hints(point_type, include_extras=True)
    columns: dict[str, tuple[str, str, int]] = {}
    for field in fields(point_type):
        hint = hints[field.name]
        inner, *metadata = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        unit = next((m.unit for m in metadata if isinstance(m, Unit)), "1")
        description = next((m for m in metadata if isinstance(m, str)), "")
        columns[field.name] = (unit, description, 8 if get_origin(inner) is tuple else 0)
    return columns


RESPONSE_COLUMNS = frozenset([
    "frequency", "peak_to_peak", "peak_to_peak_errors", "fundamental", "fundamental_errors", "phase", "phase_errors",
    "drive_amplitude", "drive_offset", "quality",
])  # fmt: skip
"""Columns of points under a sine. Points of any protocol that has them are drawn over frequency with the curve of the model."""


def is_response(point: Any) -> bool:
    """Return whether a point, or a type of points, has the columns of a response to a sine."""
    return ({field.name for field in fields(point)} if is_dataclass(point) else vars(point).keys()) >= RESPONSE_COLUMNS
