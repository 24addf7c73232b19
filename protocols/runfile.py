"""Writing a run: one HDF5 file, open before the first volt and readable at every moment.

What survives `kill -9` was measured (docs/decisions/0004-run-file.md): every dataset is created first, then SWMR is
switched on, then rows are only appended and each block is flushed. Nothing raw is ever rewritten or compressed while
running. Status and results go in when the run ends.
"""

import contextlib
import json
import os
import platform
import re
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

from drivers.bench import DISPLACEMENT, DRIVE
from drivers.drive import Drive, as_record
from drivers.ports import Block, Scale
from drivers.sensor import LaserSensor
from protocols.events import Event, Status, event_record
from protocols.layout import (
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
)
from protocols.plain import plain
from protocols.quality import Quality
from protocols.values import Curve, Estimate

RAW_CHUNK = 16_384
TABLE_CHUNK = 64

NAME_BYTES = 100
"""Longest part of a run file's name that tells the specimen: a file's name ends at 255 bytes, the specimen is in the file."""


class StoreError(Exception):
    """The run file cannot be written. The sentence says where and why; what was written before stays readable."""


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


def run_path(folder: Path, specimen: str, protocol: str, now: datetime) -> Path:
    """A name that sorts by time and tells specimen and protocol: `20261121T091502Z_T7_sine-dwell.h5`."""
    return folder / f"{now:%Y%m%dT%H%M%SZ}_{safe_name(specimen)}_{protocol}.h5"


def safe_name(specimen: str) -> str:
    """The name of a specimen as it can stand in a file's name."""
    return _cut("".join(c if c.isalnum() or c in "-." else "-" for c in specimen), NAME_BYTES).decode() or "unnamed"


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
            self._create(header)
            self._file.flush()
        except (OSError, ValueError) as error:
            raise StoreError(
                f"the run file {path} cannot be created: {_reason(error)}; choose another folder"
            ) from error

    @classmethod
    def new(cls, folder: Path, header: Header) -> Self:
        """A new file in `folder`, named by time, specimen and protocol; a second one within a second gets a number."""
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
        """Append a block and flush it; the row of its first scan."""
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
        kind = type(event).__name__
        with self._storing():
            for start in range(0, len(text), TEXT_BYTES):
                piece = text[start : start + TEXT_BYTES]
                self._append("events", np.array((time_s, self.rows, kind if start == 0 else "+", piece), EVENT))

    def recording(self, rows: tuple[int, int], quality: int, drive: Drive, entry: int = 0) -> None:
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
                self._file["entry/reason"][()] = _cut(reason, TEXT_BYTES)
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
                _Storing(self.path),
                h5py.File(self.path, "r+", locking=False) as file,
            ):
                file["entry/reason"][()] = _cut(reason, TEXT_BYTES)
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
            raise StoreError(f"the run file {self.path} could not be closed: {_reason(error)}") from error

    def _create(self, header: Header) -> None:
        self._file.attrs.update(
            {"default": "entry", "creator": "tactor-bench", "format": FORMAT, "format_version": FORMAT_VERSION}
        )
        entry = _group(self._file, "entry", "NXentry", default="points")
        now = (header.begun or datetime.now(UTC)).isoformat(timespec="milliseconds")
        for name, value, length in (
            ("status", str(Status.RUNNING), 16),
            ("reason", "", TEXT_BYTES),
            ("start_time", now, 32),
            ("end_time", "", 32),
            ("title", f"{header.title} of {header.specimen}", TEXT_BYTES),
        ):
            entry.create_dataset(name, data=np.array(_cut(value, length), f"S{length}"))
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
        earlier = os.path.relpath(header.continues, self.path.parent) if header.continues else ""
        entry["continues"] = earlier
        if earlier:
            entry["earlier"] = h5py.ExternalLink(earlier, "/entry")
        self._create_trace(entry, header.sensor)
        self._create_points(entry, header)
        for name, kind in (("events", EVENT), ("blocks", BLOCK), ("recordings", RECORDING)):
            entry.create_dataset(name, (0,), kind, maxshape=(None,), chunks=(TABLE_CHUNK,))
        self._create_instrument(entry, header)

    def _create_trace(self, entry: h5py.Group, sensor: LaserSensor) -> None:
        trace = _group(entry, "trace", "NXdata", signal="displacement", auxiliary_signals=["drive"])
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

    def _create_points(self, entry: h5py.Group, header: Header) -> None:
        x, y = header.axes
        points = _group(entry, "points", "NXdata", signal=y, axes=[x])
        for name, (unit, words, width) in self._columns.items():
            shape, longest = ((0, width), (None, width)) if width else ((0,), (None,))
            column = points.create_dataset(name, shape, "f8", maxshape=longest, chunks=(TABLE_CHUNK, *shape[1:]))
            column.attrs.update({"units": unit, "long_name": f"{words} ({unit})"})
        entries = points.create_dataset(ENTRY, (0,), "i8", maxshape=(None,), chunks=(TABLE_CHUNK,))
        entries.attrs.update({"units": "1", "long_name": "entry of the plan"})

    def _create_instrument(self, entry: h5py.Group, header: Header) -> None:
        instrument = _group(entry, "instrument", "NXinstrument")
        sensor = _group(instrument, "displacement_sensor", "NXsensor")
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
            _group(instrument, role, "NXcollection")["name"] = str(identity)

    def _extend(self, name: str, rows: np.ndarray) -> None:
        """Append rows, (N,), by HDF5's own calls: they take a sixth of the time of h5py's indexing, twenty times a second."""
        data = self._growing.get(name)
        if data is None:
            data = self._growing[name] = self._file[f"entry/{name}"].id
        (have,) = data.shape
        data.set_extent((have + rows.size,))
        place = data.get_space()
        place.select_hyperslab((have,), rows.shape)
        data.write(h5py.h5s.create_simple(rows.shape), place, np.ascontiguousarray(rows))
        data.flush()

    def _append(self, name: str, row: np.ndarray) -> None:
        data = self._file[f"entry/{name}"]
        data.resize(data.shape[0] + 1, axis=0)
        data[-1] = row
        data.flush()

    def _storing(self) -> "_Storing":
        return _Storing(self.path)


def unclosable() -> bool:
    """Whether HDF5 holds a file it cannot close (its disk vanished or filled up against all care).

    The library then crashes when the interpreter tears it down; a program in that state leaves without tearing down.
    """
    return bool(h5py.h5f.get_obj_count(h5py.h5f.OBJ_ALL, h5py.h5f.OBJ_ALL))


def append_curves(path: Path, curves: Sequence[Curve], locking: bool = True) -> None:
    """Append curves to a finished run, each a group that a NeXus viewer draws; raw data is not touched.

    Raises:
        StoreError: the file cannot be written.
    """
    if not curves:
        return
    with _Storing(path), h5py.File(path, "r+", libver="latest", locking=locking) as file:
        every = _group(file["entry"], "curves", "NXcollection")
        for curve in curves:
            group = _group(every, f"{curve.name}_{len(every):03d}", "NXdata", signal=curve.y, axes=[curve.x])
            group["title"] = f"{curve.name} {curve.label}".strip()
            group.attrs.update({"name": curve.name, "label": curve.label, "entry": curve.entry})
            for name, column in curve.columns.items():
                group.create_dataset(name, data=column.values).attrs.update(
                    {"units": column.unit, "long_name": f"{column.words} ({column.unit})"}
                )


def append_estimates(path: Path, estimates: Sequence[Estimate], locking: bool = True) -> None:
    """Append identified quantities to a finished run; raw data is not touched.

    Raises:
        StoreError: the file cannot be written.
    """
    if not estimates:
        return
    with _Storing(path), h5py.File(path, "r+", libver="latest", locking=locking) as file:
        group = _group(file["entry"], "estimates", "NXcollection")
        for estimate in estimates:
            one = _group(group, estimate.name.replace(" ", "_"), "NXcollection")
            for name, value in (("value", estimate.value), ("standard_error", estimate.standard_error)):
                one.create_dataset(name, data=value).attrs["units"] = estimate.unit
            one["source"] = estimate.source


@dataclass(frozen=True, slots=True)
class _Storing:
    """Turns what HDF5 raises into one sentence."""

    path: Path

    def __enter__(self) -> None: ...

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, (OSError, RuntimeError, ValueError, KeyError)):
            raise StoreError(
                f"the run file {self.path} cannot be written: {_reason(error)}; everything before this moment is in it"
            ) from error


def _group(parent: h5py.Group, name: str, kind: str, **attributes: Any) -> h5py.Group:
    group = parent.create_group(name)
    group.attrs["NX_class"] = kind
    group.attrs.update(attributes)
    return group


def _reason(error: BaseException) -> str:
    number = getattr(error, "errno", None)
    if number:
        return os.strerror(number)
    text = str(error)
    hidden = re.search(r"errno = (\d+)", text)  # HDF5 has the number in its own words
    return os.strerror(int(hidden[1])) if hidden else text


def _cut(text: str, length: int) -> bytes:
    """The text in at most `length` bytes, no character cut in two."""
    return text.encode()[:length].decode(errors="ignore").encode()
