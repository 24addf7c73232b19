"""Writing a run: one HDF5 file, open before the first volt and readable at every moment.

What survives `kill -9` was measured (docs/decisions/0004-run-file.md): every dataset is created first, then SWMR is
switched on, then rows are only appended and each block is flushed. Nothing raw is ever rewritten or compressed while
running. Status and results go in when the run ends.

What a run file holds before its first sample: who measures what with which bench, and every dataset that will grow.

What is found in a run after it was measured, appended to its finished file; raw data is not touched.
"""

import contextlib
import json
import os
import platform
import shutil
import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np

from drivers.bench.bench import DISPLACEMENT, DRIVE
from drivers.drive import Drive, as_record
from drivers.interfaces import Block, Scale
from drivers.sensors.laser_sensor import LaserSensor
from protocols.base.events import Event, Status, event_record
from protocols.base.jsonable import plain
from protocols.base.quality import Quality
from protocols.base.records import Curve, Estimate
from protocols.runfile.errors import StoreError, Storing, reason_of
from protocols.runfile.schema import (
    BLOCK,
    CHANNELS,
    ENTRY,
    EVENT,
    FORMAT,
    FORMAT_VERSION,
    LARGEST_POLYNOMIAL,
    RECORDING,
    RESERVE_BYTES,
    TEXT_BYTES,
    columns,
    cut,
    run_path,
)

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
    """Fill a new file at `path`; `points` are the columns of its points (protocols.runfile.schema.columns)."""
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


def append_curves(path: Path, curves: Sequence[Curve], locking: bool = True) -> None:
    """Append curves to a finished run, each a group that a NeXus viewer draws.

    Raises:
        StoreError: the file cannot be written.
    """
    if not curves:
        return
    with Storing(path), h5py.File(path, "r+", libver="latest", locking=locking) as file:
        every = group(file["entry"], "curves", "NXcollection")
        for curve in curves:
            found = group(every, f"{curve.name}_{len(every):03d}", "NXdata", signal=curve.y, axes=[curve.x])
            found["title"] = f"{curve.name} {curve.label}".strip()
            found.attrs.update({"name": curve.name, "label": curve.label, "entry": curve.entry})
            for name, column in curve.columns.items():
                found.create_dataset(name, data=column.values).attrs.update(
                    {"units": column.unit, "long_name": f"{column.words} ({column.unit})"}
                )


def append_estimates(path: Path, estimates: Sequence[Estimate], locking: bool = True) -> None:
    """Append identified quantities to a finished run.

    Raises:
        StoreError: the file cannot be written.
    """
    if not estimates:
        return
    with Storing(path), h5py.File(path, "r+", libver="latest", locking=locking) as file:
        found = group(file["entry"], "estimates", "NXcollection")
        for estimate in estimates:
            one = group(found, estimate.name.replace(" ", "_"), "NXcollection")
            for name, value in (("value", estimate.value), ("standard_error", estimate.standard_error)):
                one.create_dataset(name, data=value).attrs["units"] = estimate.unit
            one["source"] = estimate.source


class RunFile:
    """The writer. Create it, `begin` when the card runs, append, `finish`. Every error is a StoreError."""

    def __init__(self, path: Path, header: Header) -> None:
        """Create the file and every dataset it will ever append to.

        Raises:
            StoreError: no permission, no space, or the folder is none.
        """
        self.path = path
        self.rows = 0
        self._columns = columns(header.point_type)
        self._points = 0
        self._closed = False
        self._growing: dict[str, Any] = {}
        """Identifiers of the datasets that grow with every block."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = h5py.File(path, "x", libver="latest")
            create(self._file, path, header, self._columns)
            self._file.flush()
        except (OSError, ValueError) as error:
            raise StoreError(
                f"the run file {path} cannot be created: {reason_of(error)}; choose another folder"
            ) from error

    @classmethod
    def new(cls, folder: Path, header: Header) -> Self:
        """A new file in `folder`, named by time, specimen and protocol; a second one within a second gets a number.

        Raises:
            StoreError: it cannot be created.
        """
        wanted = run_path(folder, header.specimen, header.protocol, header.begun or datetime.now(UTC))
        for attempt in range(1, 1000):
            path = wanted if attempt == 1 else wanted.with_stem(f"{wanted.stem}-{attempt}")
            if not os.path.exists(path):  # noqa: PTH110 - Path.exists raises where a folder's name is too long
                return cls(path, header)
        raise StoreError(f"the folder {folder} holds a thousand runs of this second; choose another folder")

    def begin(self, rate_hz: float, scales: Sequence[Scale]) -> None:
        """Note the card's true rate and scaling; from here on rows are only appended."""
        with self._storing():
            trace = self._file["entry/trace"]
            trace["sample_rate"][()] = rate_hz
            for name, scale in zip(CHANNELS, scales, strict=False):
                padded = [*scale.coefficients, *[0.0] * LARGEST_POLYNOMIAL][:LARGEST_POLYNOMIAL]
                trace[f"{name}_scaling_coefficients"][:] = padded
                trace[f"{name}_skew"][()] = scale.skew_s
                gain, offset = trace[f"{name}_volts_to_units"][:]
                factor = padded[1] * gain
                trace[f"{name}_scaling_factor"][()] = factor
                trace[f"{name}_offset"][()] = (padded[0] * gain + offset) / factor
            self._file.flush()
            self._file.swmr_mode = True

    def block(self, block: Block, time_s: float) -> int:
        """Append a block, counts of both channels, and flush it; the row of its first scan.

        Raises:
            StoreError: the disk is as good as full, or the file cannot be written.
        """
        row = self.rows
        free = shutil.disk_usage(self.path.parent).free
        if free < RESERVE_BYTES:
            raise StoreError(
                f"the disk of {self.path.parent} is full: {free / 1e6:.0f} MB are left and {RESERVE_BYTES / 1e6:.0f} MB are "
                "kept to close the run in order; free some space or choose another folder. Everything before is in the file"
            )
        with self._storing():
            for name, channel in zip(CHANNELS, (DRIVE, DISPLACEMENT), strict=True):
                self._extend(f"trace/{name}", block.raw[channel])
            self._extend("blocks", np.array([(row, block.start, time_s)], BLOCK))
        self.rows = row + block.raw.shape[1]
        return row

    def raw(self, channel: str, rows: tuple[int, int]) -> np.ndarray:
        """The integers of a channel in rows that were appended, (stop - start,)."""
        with self._storing():
            return np.asarray(self._file[f"entry/trace/{channel}"][slice(*rows)])

    def event(self, event: Event, time_s: float) -> None:
        """Append what happened, as JSON; a long text goes on in further rows."""
        text = json.dumps(event_record(event), ensure_ascii=False, allow_nan=False).encode()
        with self._storing():
            for start in range(0, len(text), TEXT_BYTES):
                piece = text[start : start + TEXT_BYTES]
                self._append("events", np.array((time_s, self.rows, event.kind if start == 0 else "+", piece), EVENT))

    def recording(self, rows: tuple[int, int], quality: int, drive: Drive, entry: int = 0) -> None:
        """Append what was recorded: rows from start to stop, flags of its quality, its drive, its entry of the plan."""
        with self._storing():
            self._append("recordings", np.array((*rows, quality, entry, json.dumps(as_record(drive))), RECORDING))

    def point(self, point: Any, entry: int = 0) -> int:
        """Append one row to every column of the points; its index."""
        row = self._points
        with self._storing():
            for name in self._columns:
                self._append(f"points/{name}", np.asarray(getattr(point, name), np.float64))
            self._append(f"points/{ENTRY}", np.asarray(entry))
        self._points += 1
        return row

    def supersede(self, row: int) -> None:
        """Flag a point whose entry was measured again. The one thing that is ever changed in place: a flag."""
        if "quality" in self._columns:
            with self._storing():
                quality = self._file["entry/points/quality"]
                quality[row] = int(quality[row]) | Quality.SUPERSEDED
                quality.flush()

    def finish(
        self, status: Status, reason: str, estimates: Sequence[Estimate] = (), curves: Sequence[Curve] = ()
    ) -> str:
        """Say how the run ended and append curves and what was identified. The file is closed whatever happens.

        Returns the reason as it stands in the file. Everything measured is in it by then; where curves and estimates, which
        can be found again, cannot be appended, the status stands and the reason says so.
        """
        if self._closed:
            return reason
        try:
            with self._storing():
                # First where a reader of the still open file sees it; the rest needs the file out of SWMR.
                self._file["entry/status"][()] = str(status)
                self._file["entry/reason"][()] = cut(reason, TEXT_BYTES)
                self._file["entry/end_time"][()] = datetime.now(UTC).isoformat(timespec="milliseconds")
                self._file.flush()
        finally:
            self._close()
        try:
            append_curves(self.path, curves, locking=False)
            append_estimates(self.path, estimates, locking=False)  # a reader of ours or not must not stand in the way
        except StoreError as error:
            reason += f"; what was identified could not be stored: {error}"
            with (
                contextlib.suppress(StoreError),
                Storing(self.path),
                h5py.File(self.path, "r+", locking=False) as file,
            ):
                file["entry/reason"][()] = cut(reason, TEXT_BYTES)
        return reason

    def abandon(self) -> None:
        """Close after a store error, keeping whatever reached the disk."""
        if not self._closed:
            self._close()

    def _close(self) -> None:
        self._closed = True
        self._growing.clear()  # an open identifier would keep the file open
        try:
            self._file.close()
        except (OSError, RuntimeError) as error:
            raise StoreError(f"the run file {self.path} could not be closed: {reason_of(error)}") from error

    def _extend(self, name: str, rows: np.ndarray) -> None:
        """Append rows, (N, ...), by HDF5's own calls: they take a sixth of the time of h5py's indexing, many times a second."""
        data = self._growing.get(name)
        if data is None:
            data = self._growing[name] = self._file[f"entry/{name}"].id
        have, *beside = data.shape
        data.set_extent((have + len(rows), *beside))
        place = data.get_space()
        place.select_hyperslab((have, *(0 for _ in beside)), rows.shape)
        data.write(h5py.h5s.create_simple(rows.shape), place, np.ascontiguousarray(rows))
        data.flush()

    def _append(self, name: str, row: np.ndarray) -> None:
        self._extend(name, row[None])

    def _storing(self) -> Storing:
        return Storing(self.path)


def unclosable() -> bool:
    """Whether HDF5 holds a file it cannot close (its disk vanished or filled up against all care).

    The library then crashes when the interpreter tears it down; a program in that state leaves without tearing down.
    """
    return bool(h5py.h5f.get_obj_count(h5py.h5f.OBJ_ALL, h5py.h5f.OBJ_ALL))
