"""What a run file holds before its first sample: who measures what with which bench, and every dataset that will grow."""

import json
import os
import platform
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from drivers.sensor import LaserSensor
from protocols.events import Status
from protocols.layout import BLOCK, ENTRY, EVENT, FORMAT, FORMAT_VERSION, LARGEST_POLYNOMIAL, RECORDING, TEXT_BYTES
from protocols.names import cut
from protocols.plain import plain

RAW_CHUNK = 16_384
TABLE_CHUNK = 64


@dataclass(frozen=True, slots=True)
class Header:
    """What a run is, known before it begins."""

    protocol: str
    title: str
    parameters: Mapping[str, Any]
    point_type: type
    axes: tuple[str, str]
    sensor: LaserSensor
    bench: Mapping[str, Any]
    simulated: bool
    specimen: str = "unnamed"
    continues: Path | None = None
    """The run this one goes on with: its points are carried over, its raw data is linked to."""
    imported: Mapping[str, Any] = field(default_factory=dict)
    """Where the points come from if no bench measured them for this file: source files, hashes, columns."""
    begun: datetime | None = None
    """When it was measured, if not now."""


def software() -> dict[str, str]:
    """Versions of everything that had a hand in the numbers."""
    packages = ("tactor-bench", "numpy", "scipy", "h5py", "nidaqmx", "pyvisa", "pyvisa-py")
    return {"python": platform.python_version(), **{name: _version(name) for name in packages}}


@cache
def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"


def create(file: h5py.File, path: Path, header: Header, points: Mapping[str, tuple[str, str, int]]) -> None:
    """Fill a new file at `path`; `points` are the columns of its points (protocols.layout.columns)."""
    file.attrs.update(
        {"default": "entry", "creator": "tactor-bench", "format": FORMAT, "format_version": FORMAT_VERSION}
    )
    entry = group(file, "entry", "NXentry", default="points")
    now = (header.begun or datetime.now(UTC)).isoformat(timespec="milliseconds")
    for name, value, length in (
        ("status", str(Status.RUNNING), 16),
        ("reason", "", TEXT_BYTES),
        ("start_time", now, 32),
        ("end_time", "", 32),
        ("title", f"{header.title} of {header.specimen}", TEXT_BYTES),
    ):
        entry.create_dataset(name, data=np.array(cut(value, length), f"S{length}"))
    for name, value in {
        "protocol": header.protocol,
        "parameters": json.dumps(header.parameters),
        "specimen": header.specimen,
        "configuration": json.dumps(plain(header.bench), allow_nan=False),
        "software": json.dumps(software()),
        "host": socket.gethostname(),
    }.items():
        entry.create_dataset(name, data=value)
    if header.imported:
        entry["imported"] = json.dumps(plain(header.imported), ensure_ascii=False, allow_nan=False)
    entry["process_id"] = os.getpid()
    entry["simulated"] = header.simulated
    # Relative, so that a folder of runs can be moved.
    earlier = os.path.relpath(header.continues, path.parent) if header.continues else ""
    entry["continues"] = earlier
    if earlier:
        entry["earlier"] = h5py.ExternalLink(earlier, "/entry")
    _create_trace(entry, header.sensor)
    _create_points(entry, header.axes, points)
    for name, kind in (("events", EVENT), ("blocks", BLOCK), ("recordings", RECORDING)):
        entry.create_dataset(name, (0,), kind, maxshape=(None,), chunks=(TABLE_CHUNK,))
    _create_instrument(entry, header)


def _create_trace(entry: h5py.Group, sensor: LaserSensor) -> None:
    trace = group(entry, "trace", "NXdata", signal="displacement", auxiliary_signals=["drive"])
    trace.create_dataset("sample_rate", data=0.0).attrs["units"] = "Hz"
    # Volts become units as gain * volts + offset; the card's polynomial gives the volts.
    gains = {
        "drive": (1.0, 0.0, "V"),
        "displacement": (sensor.gain_m_per_v, -sensor.zero_v * sensor.gain_m_per_v, "m"),
    }
    for name, (gain, offset, unit) in gains.items():
        raw = trace.create_dataset(name, (0,), "i2", maxshape=(None,), chunks=(RAW_CHUNK,))
        raw.attrs.update({"units": "counts", "long_name": f"{name} (counts)", "scaled_units": unit})
        # NXdata's own convention; the straight line through the middle of the card's polynomial.
        factor = trace.create_dataset(f"{name}_scaling_factor", data=1.0)
        shift = trace.create_dataset(f"{name}_offset", data=0.0)
        factor.attrs.update({"units": f"{unit}/count", "long_name": f"{unit} = ({name} + offset) * scaling_factor"})
        shift.attrs.update({"units": "counts", "long_name": f"{unit} = ({name} + offset) * scaling_factor"})
        trace.create_dataset(f"{name}_volts_to_units", data=[gain, offset]).attrs["units"] = unit
        card = trace.create_dataset(f"{name}_scaling_coefficients", data=np.zeros(LARGEST_POLYNOMIAL))
        skew = trace.create_dataset(f"{name}_skew", data=0.0)
        skew.attrs.update({"units": "s", "long_name": "how much later than its scan this channel was converted"})
        card.attrs["units"] = "V"
        card.attrs["long_name"] = "card polynomial: volts = c0 + c1 n + c2 n^2 + c3 n^3"


def _create_points(entry: h5py.Group, axes: tuple[str, str], wanted: Mapping[str, tuple[str, str, int]]) -> None:
    x, y = axes
    points = group(entry, "points", "NXdata", signal=y, axes=[x])
    for name, (unit, words, width) in wanted.items():
        shape, longest = ((0, width), (None, width)) if width else ((0,), (None,))
        column = points.create_dataset(name, shape, "f8", maxshape=longest, chunks=(TABLE_CHUNK, *shape[1:]))
        column.attrs.update({"units": unit, "long_name": f"{words} ({unit})"})
    entries = points.create_dataset(ENTRY, (0,), "i8", maxshape=(None,), chunks=(TABLE_CHUNK,))
    entries.attrs.update({"units": "1", "long_name": "entry of the plan"})


def _create_instrument(entry: h5py.Group, header: Header) -> None:
    instrument = group(entry, "instrument", "NXinstrument")
    sensor = group(instrument, "displacement_sensor", "NXsensor")
    for name, value, unit in (
        ("gain", header.sensor.gain_m_per_v, "m/V"),
        ("zero", header.sensor.zero_v, "V"),
        ("delay", header.sensor.delay_s, "s"),
        ("gain_relative_uncertainty", header.sensor.gain_relative_uncertainty, "1"),
        ("valid_low", header.sensor.valid_low_v, "V"),
        ("valid_high", header.sensor.valid_high_v, "V"),
    ):
        sensor.create_dataset(name, data=value).attrs["units"] = unit
    for name in ("name", "serial", "calibrated", "expires"):
        sensor[name] = getattr(header.sensor, name)
    for role, identity in dict(header.bench.get("identities", {})).items():
        group(instrument, role, "NXcollection")["name"] = str(identity)


def group(parent: h5py.Group, name: str, kind: str, **attributes: Any) -> h5py.Group:
    """A new group of a NeXus class."""
    made = parent.create_group(name)
    made.attrs["NX_class"] = kind
    made.attrs.update(attributes)
    return made
