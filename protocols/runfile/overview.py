"""Overview of a run file for lists: what a list of runs shows, stored behind the HDF5 data when the run ends.

A list of a thousand runs reads these few kilobytes of each file, and not the file through HDF5, whose check alone takes
milliseconds. HDF5 ignores bytes behind its own, and removes them when a program opens the file for writing: the overview of a
file that was changed is gone, and the file is read as one without an overview is.
"""

import hashlib
import json
import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import IO, Any

import numpy as np

from drivers import LaserSensor
from model import current_name
from protocols.base import (
    EstimatedQuantity,
    RunConditions,
    RunStatus,
    Verdict,
    parse_json_object,
    to_jsonable,
    usable_mask,
    visible_text,
    visible_values,
)
from protocols.runfile.reader import Run
from protocols.runfile.transaction import BufferedFile

_MAGIC = b"TBOVRV01"
_DIGEST_BYTES = 16
_FOOTER = struct.Struct(f"<8sQ{_DIGEST_BYTES}s")
"""End of the file: mark, length of the text before it, digest."""
HEAD_BYTES = 4096
"""Beginning of the file that the digest covers: HDF5 notes there that a program has the file open, and how long it is."""
MAX_BYTES = 1_000_000


@dataclass(frozen=True, slots=True)
class LargestPoint:
    """The usable point with the largest max - min; `median_drive_v` is the median drive amplitude of all usable points."""

    frequency_hz: float
    peak_to_peak_m: float
    error_m: float
    median_drive_v: float


@dataclass(frozen=True, slots=True)
class RunOverview:
    """What lists show of a run; fields without a description are those of `Run`."""

    state: str
    reason: str
    protocol: str
    specimen: str
    start_time: str
    simulated: bool
    point_count: int
    entry_count: int
    duration_s: float
    """Of the samples."""
    parameters: Mapping[str, Any]
    requested: Mapping[str, Any]
    verdict: Verdict
    estimates: tuple[EstimatedQuantity, ...]
    conditions: RunConditions
    bench_name: str
    identities: Mapping[str, Any]
    sensor: LaserSensor
    largest: LargestPoint | None
    """None for points without max - min."""


def overview_of(run: Run) -> RunOverview:
    """Return the overview of an open run.

    Raises:
        RunReadError: the file is damaged.
    """
    return RunOverview(
        run.state,
        run.reason,
        run.protocol,
        run.specimen,
        run.start_time,
        run.simulated,
        run.point_count,
        run.entry_count,
        run.trace.duration_s,
        run.parameters,
        run.requested,
        run.verdict,
        run.estimates(),
        run.conditions,
        run.bench_name,
        run.identities,
        run.sensor,
        _largest_point(run),
    )


def read_overview(path: Path) -> RunOverview | None:
    """Return the stored overview of a file; None if it has none, or was changed since."""
    try:
        if not path.is_file():  # opening a pipe waits
            return None
        with path.open("rb") as file:
            text = _read_text(file)
        return None if text is None else _from_text(text)
    except (OSError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        return None


def append_overview(file: BufferedFile, run: Run) -> None:
    """Append the overview of an ended run to its file, behind the HDF5 data; nothing for a run that has not ended."""
    if run.status is RunStatus.RUNNING:
        return
    overview = overview_of(run)
    text = json.dumps(to_jsonable(overview), ensure_ascii=False, allow_nan=False).encode("utf-8", "replace")
    if len(text) > MAX_BYTES or repr(_from_text(text)) != repr(
        overview
    ):  # what JSON changes, such as a parameter that is NaN
        return
    file.seek(0)
    head = bytes(file.read(HEAD_BYTES) or b"")
    file.seek(0, os.SEEK_END)
    file.write(text + _FOOTER.pack(_MAGIC, len(text), _digest(head, text)))


def _read_text(file: IO[bytes]) -> bytes | None:
    size = file.seek(0, os.SEEK_END)
    if size < HEAD_BYTES + _FOOTER.size:
        return None
    file.seek(-_FOOTER.size, os.SEEK_END)
    magic, length, digest = _FOOTER.unpack(file.read(_FOOTER.size))
    if magic != _MAGIC or length > min(MAX_BYTES, size - HEAD_BYTES - _FOOTER.size):
        return None
    file.seek(-_FOOTER.size - length, os.SEEK_END)
    text = file.read(length)
    file.seek(0)
    return text if _digest(file.read(HEAD_BYTES), text) == digest else None


def _from_text(text: bytes) -> RunOverview:
    """Return the overview of a JSON text.

    Raises:
        KeyError, TypeError, ValueError: it is none of this version.
    """
    record = dict(visible_values(parse_json_object(text.decode())))
    if any(not isinstance(record[name], kind) for name, kind in _PLAIN.items()):
        raise TypeError("a field has another type")
    return RunOverview(
        **{
            **record,
            **{name: visible_text(record[name]) for name, kind in _PLAIN.items() if kind is str},
            "verdict": Verdict.from_record(record["verdict"]),
            "estimates": tuple(_quantity(each) for each in record["estimates"]),
            "conditions": RunConditions(**record["conditions"]),
            "sensor": LaserSensor(**record["sensor"]),
            "largest": None if record["largest"] is None else LargestPoint(**_floats(record["largest"])),
        }
    )


_PLAIN = {field.name: field.type for field in fields(RunOverview) if field.type in (str, bool, int)} | {
    "duration_s": (int, float),
    "parameters": dict,
    "requested": dict,
    "identities": dict,
}
"""Types of the fields that are stored as they are."""


def _quantity(record: dict[str, Any]) -> EstimatedQuantity:
    numbers = _floats({name: record[name] for name in ("value", "standard_error")})
    return EstimatedQuantity(**{**record, **numbers, "name": current_name(record["name"])})


def _floats(record: dict[str, Any]) -> dict[str, float]:
    return {name: float("nan") if value is None else float(value) for name, value in record.items()}


def _largest_point(run: Run) -> LargestPoint | None:
    points = run.points()
    names = ("frequency", "peak_to_peak", "peak_to_peak_errors", "drive_amplitude", "quality")
    if not all(name in points for name in names):
        return None
    f, y, errors, drive, quality = (np.asarray(points[name], float) for name in names)
    good = usable_mask(quality) & np.isfinite(y) & np.isfinite(errors) & (f > 0) & (drive > 0)
    if not good.any():
        return None
    top = int(np.flatnonzero(good)[y[good].argmax()])
    return LargestPoint(float(f[top]), float(y[top]), float(errors[top]), float(np.median(drive[good])))


def _digest(head: bytes, text: bytes) -> bytes:
    return hashlib.blake2b(head + text, digest_size=_DIGEST_BYTES).digest()
