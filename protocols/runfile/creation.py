"""Layout of a new run file: metadata, and every dataset created empty before the first volt."""

import json
import os
import platform
import socket
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from drivers import InputChannel, LaserSensor
from protocols.base import Outcome, RunConditions, RunStatus, to_jsonable
from protocols.runfile.mountings import MAX_MOUNTINGS_BYTES, mountings_text
from protocols.runfile.names import truncate_utf8
from protocols.runfile.record import RunRecord
from protocols.runfile.schema import (
    BLOCK_DTYPE,
    ENTRY_COLUMN,
    EVENT_DTYPE,
    FORMAT,
    FORMAT_VERSION,
    FURTHER_CHANNELS,
    MAX_SCALING_COEFFICIENTS,
    MAX_TEXT_BYTES,
    RECORDING_DTYPE,
)

PointColumns = Mapping[str, tuple[str, str, int]]
"""Columns of points, see `protocols.runfile.schema.point_columns`."""

RAW_CHUNK = 16_384
TABLE_CHUNK = 64


def software_versions() -> dict[str, str]:
    """Return the versions of the software that computed the results."""
    packages = ("tactor-bench", "numpy", "scipy", "h5py", "nidaqmx", "pyvisa", "pyvisa-py")
    return {"python": platform.python_version(), **{name: _version(name) for name in packages}}


@cache
def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"


def create_file(path: Path, record: RunRecord, columns: PointColumns, channels: Sequence[InputChannel]) -> None:
    """Create the file of a run with all datasets, in one step: a killed program leaves a complete file or none.

    Raises:
        FileExistsError: there is such a file.
        OSError: it cannot be written.
    """
    with h5py.File(path, "w", driver="core", backing_store=False, libver="latest") as file:
        _create_datasets(file, record, columns, channels)
        file.flush()
        image = file.id.get_file_image()
    working = path.with_name(f".{path.name}.{os.getpid()}")  # not yet a run, and hidden
    try:
        working.write_bytes(image)
        try:
            os.link(working, path)
        except FileExistsError:
            raise
        except OSError:  # the file system has no links
            with path.open("xb") as file_without_link:
                file_without_link.write(image)
    finally:
        working.unlink(missing_ok=True)


def creator_of(name: str) -> int | None:
    """Return the process number in the name of a file that is being created; None for other names."""
    begin, _, process = name.rpartition(".")
    return int(process) if name.startswith(".") and begin.endswith(".h5") and process.isdecimal() else None


def _create_datasets(
    file: h5py.File, record: RunRecord, columns: PointColumns, channels: Sequence[InputChannel]
) -> None:
    file.attrs.update(
        {"default": "entry", "creator": "tactor-bench", "format": FORMAT, "format_version": FORMAT_VERSION}
    )
    entry = create_group(file, "entry", "NXentry", default="points")
    for name, value, length in (
        ("status", str(RunStatus.RUNNING), 16),
        ("reason", "", MAX_TEXT_BYTES),
        ("verdict", str(Outcome.NOT_JUDGED), 16),
        ("start_time", record.start_time, 32),
        ("end_time", "", 32),
        ("title", record.title, MAX_TEXT_BYTES),
        ("mountings", mountings_text(record.mountings), MAX_MOUNTINGS_BYTES),
    ):
        entry.create_dataset(name, data=np.array(truncate_utf8(value, length), f"S{length}"))
    for name, value in {
        "protocol": record.protocol,
        "parameters": json.dumps(record.parameters),
        "specimen": record.specimen,
        "configuration": json.dumps(to_jsonable(record.configuration), allow_nan=False),
        "software": json.dumps(software_versions()),
        "host": socket.gethostname(),
        **({"requested": json.dumps(record.requested)} if record.requested else {}),
        **({"reference": json.dumps(to_jsonable(record.reference))} if record.reference else {}),
    }.items():
        entry.create_dataset(name, data=value)
    if record.imported:
        entry["imported"] = json.dumps(to_jsonable(record.imported), ensure_ascii=False, allow_nan=False)
    entry["process_id"] = os.getpid()
    entry["simulated"] = record.simulated
    entry["continues"] = record.continues
    if record.continues:
        entry["earlier"] = h5py.ExternalLink(record.continues, "/entry")
    _create_trace(entry, record.sensor, channels)
    _create_points(entry, record.axes, columns)
    for name, kind in (("events", EVENT_DTYPE), ("blocks", BLOCK_DTYPE), ("recordings", RECORDING_DTYPE)):
        entry.create_dataset(name, (0,), kind, maxshape=(None,), chunks=(TABLE_CHUNK,), fletcher32=True)
    _create_instrument(entry, record)
    _create_conditions(entry, record.conditions)


def _create_trace(entry: h5py.Group, sensor: LaserSensor, channels: Sequence[InputChannel]) -> None:
    trace = create_group(entry, "trace", "NXdata", signal="displacement", auxiliary_signals=["drive"])
    trace.create_dataset("sample_rate", data=0.0).attrs["units"] = "Hz"
    # Volts become units as gain * volts + offset; the card's polynomial gives the volts.
    gains = {
        "drive": (1.0, 0.0, "V"),
        "displacement": (sensor.gain_m_per_v, -sensor.zero_v * sensor.gain_m_per_v, sensor.unit),
        **{channel.name: (channel.gain, channel.offset, channel.unit) for channel in channels},
    }
    if channels:
        trace.attrs[FURTHER_CHANNELS] = [channel.name for channel in channels]
    for name, (gain, offset, unit) in gains.items():
        raw = trace.create_dataset(name, (0,), "i2", maxshape=(None,), chunks=(RAW_CHUNK,), fletcher32=True)
        raw.attrs.update({"units": "counts", "long_name": f"{name} (counts)", "scaled_units": unit})
        # NXdata's own convention; the straight line through the middle of the card's polynomial.
        factor = trace.create_dataset(f"{name}_scaling_factor", data=1.0)
        shift = trace.create_dataset(f"{name}_offset", data=0.0)
        factor.attrs.update({"units": f"{unit}/count", "long_name": f"{unit} = ({name} + offset) * scaling_factor"})
        shift.attrs.update({"units": "counts", "long_name": f"{unit} = ({name} + offset) * scaling_factor"})
        trace.create_dataset(f"{name}_volts_to_units", data=[gain, offset]).attrs["units"] = unit
        card = trace.create_dataset(f"{name}_scaling_coefficients", data=np.zeros(MAX_SCALING_COEFFICIENTS))
        skew = trace.create_dataset(f"{name}_skew", data=0.0)
        skew.attrs.update({"units": "s", "long_name": "how much later than its scan this channel was converted"})
        card.attrs["units"] = "V"
        card.attrs["long_name"] = "card polynomial: volts = c0 + c1 n + c2 n^2 + c3 n^3"
    for channel in channels:
        trace[channel.name].attrs.update({"kind": channel.kind, "terminal": channel.terminal})


def _create_points(entry: h5py.Group, axes: tuple[str, str], columns: PointColumns) -> None:
    x, y = axes
    points = create_group(entry, "points", "NXdata", signal=y, axes=[x])
    for name, (unit, description, width) in columns.items():
        shape, longest = ((0, width), (None, width)) if width else ((0,), (None,))
        column = points.create_dataset(
            name, shape, "f8", maxshape=longest, chunks=(TABLE_CHUNK, *shape[1:]), fletcher32=True
        )
        column.attrs.update({"units": unit, "long_name": f"{description} ({unit})"})
    entries = points.create_dataset(ENTRY_COLUMN, (0,), "i8", maxshape=(None,), chunks=(TABLE_CHUNK,), fletcher32=True)
    entries.attrs.update({"units": "1", "long_name": "entry of the plan"})


def _create_instrument(entry: h5py.Group, record: RunRecord) -> None:
    instrument = create_group(entry, "instrument", "NXinstrument")
    sensor = create_group(instrument, "displacement_sensor", "NXsensor")
    for name, value, unit in (
        ("gain", record.sensor.gain_m_per_v, f"{record.sensor.unit}/V"),
        ("zero", record.sensor.zero_v, "V"),
        ("delay", record.sensor.delay_s, "s"),
        ("delay_uncertainty", record.sensor.delay_uncertainty_s, "s"),
        ("gain_relative_uncertainty", record.sensor.gain_relative_uncertainty, "1"),
        ("corner", record.sensor.corner_hz, "Hz"),
        ("valid_low", record.sensor.valid_low_v, "V"),
        ("valid_high", record.sensor.valid_high_v, "V"),
    ):
        sensor.create_dataset(name, data=value).attrs["units"] = unit
    if record.sensor.curve:
        sensor.create_dataset("curve", data=record.sensor.curve).attrs["units"] = "m, V"
    for name in ("name", "quantity", "serial", "calibrated", "expires"):
        sensor[name] = getattr(record.sensor, name)
    for role, identity in record.identities.items():
        create_group(instrument, role, "NXcollection")["name"] = str(identity)


def _create_conditions(entry: h5py.Group, conditions: RunConditions) -> None:
    """Create the operator (NXuser), and a sensor of the air for each stated quantity."""
    if conditions.operator:
        user = create_group(entry, "operator", "NXuser")
        user["name"], user["role"], user["origin"] = conditions.operator, "operator", conditions.operator_origin
    for name, value, unit in (
        ("air_temperature", conditions.temperature_c, "degC"),
        ("air_humidity", conditions.humidity, "1"),
    ):
        if value is not None:
            sensor = create_group(entry["instrument"], name, "NXsensor")
            sensor.create_dataset("value", data=float(value)).attrs["units"] = unit
    if conditions.origin:
        entry["air_origin"] = conditions.origin


def free_name(parent: h5py.Group, name: str) -> str:
    """Return a free name in a group, the given one where HDF5 allows it: `/` would begin another group."""
    free = name.replace("/", " ").strip(" .") or "unnamed"
    while free in parent:
        free += "_"
    return free


def create_group(parent: h5py.Group, name: str, nx_class: str, **attributes: Any) -> h5py.Group:
    """Create a group of a NeXus class."""
    made = parent.create_group(name)
    made.attrs["NX_class"] = nx_class
    made.attrs.update(attributes)
    return made
