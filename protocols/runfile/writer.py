"""Run file writer: one HDF5 file, created before the first volt and readable at every moment.

What survives `kill -9` was measured (docs/decisions/0004-run-file.md): every dataset is created first, then SWMR is
switched on, then rows are only appended and each block is flushed. Raw data is never rewritten, nor compressed while
running. Status, curves and estimates are written when the run ends.
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

from drivers import DISPLACEMENT_CHANNEL, DRIVE_CHANNEL, Block, Drive, LaserSensor, Scale, as_record
from protocols.base import (
    EstimatedQuantity,
    Event,
    Outcome,
    Quality,
    ResultCurve,
    RunStatus,
    Verdict,
    event_record,
    to_jsonable,
)
from protocols.runfile.errors import StorageError, os_error_text, translate_write_errors
from protocols.runfile.schema import (
    BLOCK_DTYPE,
    CHANNELS,
    CONTINUED_EVENT,
    ENTRY_COLUMN,
    EVENT_DTYPE,
    FORMAT,
    FORMAT_VERSION,
    MAX_SCALING_COEFFICIENTS,
    MAX_TEXT_BYTES,
    RECORDING_DTYPE,
    RESERVE_BYTES,
    point_columns,
    run_path,
    truncate_utf8,
)

NOT_JUDGED = Verdict()

RAW_CHUNK = 16_384
TABLE_CHUNK = 64


@dataclass(frozen=True, slots=True)
class RunMetadata:
    """Metadata of a run, known before it starts."""

    protocol: str
    title: str
    parameters: Mapping[str, Any]
    point_type: type
    axes: tuple[str, str]
    sensor: LaserSensor
    bench: Mapping[str, Any]
    simulated: bool
    specimen: str = "unnamed"
    resumed_from: Path | None = None
    """The resumed run: its points are carried over, its raw data is linked."""
    imported: Mapping[str, Any] = field(default_factory=dict)
    """Source files, hashes and columns of an imported run; empty for a measured one."""
    started_at: datetime | None = None
    """Time of the measurement, if not now."""


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


def create_datasets(
    file: h5py.File, path: Path, metadata: RunMetadata, point_columns: Mapping[str, tuple[str, str, int]]
) -> None:
    """Create all datasets of a new file; `point_columns` as of protocols.runfile.schema.point_columns."""
    file.attrs.update(
        {"default": "entry", "creator": "tactor-bench", "format": FORMAT, "format_version": FORMAT_VERSION}
    )
    entry = create_group(file, "entry", "NXentry", default="points")
    now = (metadata.started_at or datetime.now(UTC)).isoformat(timespec="milliseconds")
    for name, value, length in (
        ("status", str(RunStatus.RUNNING), 16),
        ("reason", "", MAX_TEXT_BYTES),
        ("verdict", str(Outcome.NOT_JUDGED), 16),
        ("start_time", now, 32),
        ("end_time", "", 32),
        ("title", f"{metadata.title} of {metadata.specimen}", MAX_TEXT_BYTES),
    ):
        entry.create_dataset(name, data=np.array(truncate_utf8(value, length), f"S{length}"))
    for name, value in {
        "protocol": metadata.protocol,
        "parameters": json.dumps(metadata.parameters),
        "specimen": metadata.specimen,
        "configuration": json.dumps(to_jsonable(metadata.bench), allow_nan=False),
        "software": json.dumps(software_versions()),
        "host": socket.gethostname(),
    }.items():
        entry.create_dataset(name, data=value)
    if metadata.imported:
        entry["imported"] = json.dumps(to_jsonable(metadata.imported), ensure_ascii=False, allow_nan=False)
    entry["process_id"] = os.getpid()
    entry["simulated"] = metadata.simulated
    # Relative, so that a folder of runs can be moved.
    earlier = os.path.relpath(metadata.resumed_from, path.parent) if metadata.resumed_from else ""
    entry["continues"] = earlier
    if earlier:
        entry["earlier"] = h5py.ExternalLink(earlier, "/entry")
    _create_trace(entry, metadata.sensor)
    _create_points(entry, metadata.axes, point_columns)
    for name, kind in (("events", EVENT_DTYPE), ("blocks", BLOCK_DTYPE), ("recordings", RECORDING_DTYPE)):
        entry.create_dataset(name, (0,), kind, maxshape=(None,), chunks=(TABLE_CHUNK,))
    _create_instrument(entry, metadata)


def _create_trace(entry: h5py.Group, sensor: LaserSensor) -> None:
    trace = create_group(entry, "trace", "NXdata", signal="displacement", auxiliary_signals=["drive"])
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
        card = trace.create_dataset(f"{name}_scaling_coefficients", data=np.zeros(MAX_SCALING_COEFFICIENTS))
        skew = trace.create_dataset(f"{name}_skew", data=0.0)
        skew.attrs.update({"units": "s", "long_name": "how much later than its scan this channel was converted"})
        card.attrs["units"] = "V"
        card.attrs["long_name"] = "card polynomial: volts = c0 + c1 n + c2 n^2 + c3 n^3"


def _create_points(entry: h5py.Group, axes: tuple[str, str], columns: Mapping[str, tuple[str, str, int]]) -> None:
    x, y = axes
    points = create_group(entry, "points", "NXdata", signal=y, axes=[x])
    for name, (unit, description, width) in columns.items():
        shape, longest = ((0, width), (None, width)) if width else ((0,), (None,))
        column = points.create_dataset(name, shape, "f8", maxshape=longest, chunks=(TABLE_CHUNK, *shape[1:]))
        column.attrs.update({"units": unit, "long_name": f"{description} ({unit})"})
    entries = points.create_dataset(ENTRY_COLUMN, (0,), "i8", maxshape=(None,), chunks=(TABLE_CHUNK,))
    entries.attrs.update({"units": "1", "long_name": "entry of the plan"})


def _create_instrument(entry: h5py.Group, metadata: RunMetadata) -> None:
    instrument = create_group(entry, "instrument", "NXinstrument")
    sensor = create_group(instrument, "displacement_sensor", "NXsensor")
    for name, value, unit in (
        ("gain", metadata.sensor.gain_m_per_v, "m/V"),
        ("zero", metadata.sensor.zero_v, "V"),
        ("delay", metadata.sensor.delay_s, "s"),
        ("gain_relative_uncertainty", metadata.sensor.gain_relative_uncertainty, "1"),
        ("valid_low", metadata.sensor.valid_low_v, "V"),
        ("valid_high", metadata.sensor.valid_high_v, "V"),
    ):
        sensor.create_dataset(name, data=value).attrs["units"] = unit
    for name in ("name", "serial", "calibrated", "expires"):
        sensor[name] = getattr(metadata.sensor, name)
    for role, identity in dict(metadata.bench.get("identities", {})).items():
        create_group(instrument, role, "NXcollection")["name"] = str(identity)


def create_group(parent: h5py.Group, name: str, nx_class: str, **attributes: Any) -> h5py.Group:
    """Create a group of a NeXus class."""
    made = parent.create_group(name)
    made.attrs["NX_class"] = nx_class
    made.attrs.update(attributes)
    return made


def append_curves(path: Path, curves: Sequence[ResultCurve], locking: bool = True) -> None:
    """Append curves to a finished run, each an NXdata group.

    Raises:
        StorageError: the file cannot be written.
    """
    if not curves:
        return
    with translate_write_errors("run", path), h5py.File(path, "r+", libver="latest", locking=locking) as file:
        every = create_group(file["entry"], "curves", "NXcollection")
        for curve in curves:
            found = create_group(every, f"{curve.name}_{len(every):03d}", "NXdata", signal=curve.y, axes=[curve.x])
            found["title"] = f"{curve.name} {curve.label}".strip()
            found.attrs.update({"name": curve.name, "label": curve.label, "entry": curve.entry})
            for name, column in curve.columns.items():
                found.create_dataset(name, data=column.values).attrs.update(
                    {"units": column.unit, "long_name": f"{column.words} ({column.unit})"}
                )


def store_verdict(path: Path, verdict: Verdict, locking: bool = True) -> None:
    """Store the verdict on a finished run in the place of an earlier one.

    Raises:
        StorageError: the file cannot be written.
    """
    with translate_write_errors("run", path), h5py.File(path, "r+", libver="latest", locking=locking) as file:
        entry = file["entry"]
        for name, value in (("verdict", str(verdict.outcome)), ("verdict_details", verdict.to_json())):
            if name in entry:
                del entry[name]
            entry.create_dataset(name, data=value)


def append_estimates(path: Path, estimates: Sequence[EstimatedQuantity], locking: bool = True) -> None:
    """Append identified quantities to a finished run.

    Raises:
        StorageError: the file cannot be written.
    """
    if not estimates:
        return
    with translate_write_errors("run", path), h5py.File(path, "r+", libver="latest", locking=locking) as file:
        found = create_group(file["entry"], "estimates", "NXcollection")
        for estimate in estimates:
            one = create_group(found, estimate.name.replace(" ", "_"), "NXcollection")
            for name, value in (("value", estimate.value), ("standard_error", estimate.standard_error)):
                one.create_dataset(name, data=value).attrs["units"] = estimate.unit
            one["source"] = estimate.source


class RunFileWriter:
    """Writes one run file: create, `start_stream` when the card runs, append, `finish`. Errors are StorageError."""

    def __init__(self, path: Path, metadata: RunMetadata) -> None:
        """Create the file with all its datasets.

        Raises:
            StorageError: no permission, no space, or not a folder.
        """
        self.path = path
        self.row_count = 0
        self._columns = point_columns(metadata.point_type)
        self._point_count = 0
        self._closed = False
        self._dataset_ids: dict[str, Any] = {}
        """HDF5 identifiers of the growing datasets."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = h5py.File(path, "x", libver="latest")
            create_datasets(self._file, path, metadata, self._columns)
            self._file.flush()
        except (OSError, ValueError) as error:
            raise StorageError(
                f"the run file {path} cannot be created: {os_error_text(error)}; choose another folder"
            ) from error

    @classmethod
    def new(cls, folder: Path, metadata: RunMetadata) -> Self:
        """Create a file in `folder`, named by time, specimen and protocol; numbered within the same second.

        Raises:
            StorageError: it cannot be created.
        """
        first = run_path(folder, metadata.specimen, metadata.protocol, metadata.started_at or datetime.now(UTC))
        for attempt in range(1, 1000):
            path = first if attempt == 1 else first.with_stem(f"{first.stem}-{attempt}")
            if not os.path.exists(path):  # noqa: PTH110 - Path.exists raises where a folder's name is too long
                return cls(path, metadata)
        raise StorageError(f"the folder {folder} holds a thousand runs of this second; choose another folder")

    def start_stream(self, rate_hz: float, scales: Sequence[Scale]) -> None:
        """Store the card's true rate and scaling; afterwards rows are only appended."""
        with translate_write_errors("run", self.path):
            trace = self._file["entry/trace"]
            trace["sample_rate"][()] = rate_hz
            for name, scale in zip(CHANNELS, scales, strict=False):
                padded = [*scale.coefficients, *[0.0] * MAX_SCALING_COEFFICIENTS][:MAX_SCALING_COEFFICIENTS]
                trace[f"{name}_scaling_coefficients"][:] = padded
                trace[f"{name}_skew"][()] = scale.skew_s
                gain, offset = trace[f"{name}_volts_to_units"][:]
                factor = padded[1] * gain
                trace[f"{name}_scaling_factor"][()] = factor
                trace[f"{name}_offset"][()] = (padded[0] * gain + offset) / factor
            self._file.flush()
            self._file.swmr_mode = True

    def append_block(self, block: Block, time_s: float) -> int:
        """Append a block, counts of both channels, and flush it; return the row of its first scan.

        Raises:
            StorageError: the disk is nearly full, or the file cannot be written.
        """
        row = self.row_count
        free = shutil.disk_usage(self.path.parent).free
        if free < RESERVE_BYTES:
            raise StorageError(
                f"the disk of {self.path.parent} is full: {free / 1e6:.0f} MB are left and {RESERVE_BYTES / 1e6:.0f} MB are "
                "kept to close the run in order; free some space or choose another folder. Everything before is in the file"
            )
        with translate_write_errors("run", self.path):
            for name, channel in zip(CHANNELS, (DRIVE_CHANNEL, DISPLACEMENT_CHANNEL), strict=True):
                self._append_rows(f"trace/{name}", block.raw[channel])
            self._append_rows("blocks", np.array([(row, block.start, time_s)], BLOCK_DTYPE))
        self.row_count = row + block.raw.shape[1]
        return row

    def read_raw(self, channel: str, rows: tuple[int, int]) -> np.ndarray:
        """Return the raw counts of a channel in appended rows, (stop - start,)."""
        with translate_write_errors("run", self.path):
            return np.asarray(self._file[f"entry/trace/{channel}"][slice(*rows)])

    def append_event(self, event: Event, time_s: float) -> None:
        """Append an event as JSON; a long text continues in further rows."""
        text = json.dumps(event_record(event), ensure_ascii=False, allow_nan=False).encode()
        with translate_write_errors("run", self.path):
            for start in range(0, len(text), MAX_TEXT_BYTES):
                piece = text[start : start + MAX_TEXT_BYTES]
                self._append_row(
                    "events",
                    np.array(
                        (time_s, self.row_count, event.kind if start == 0 else CONTINUED_EVENT, piece), EVENT_DTYPE
                    ),
                )

    def append_recording(self, rows: tuple[int, int], quality: int, drive: Drive, entry: int = 0) -> None:
        """Append a recording: rows start..stop, quality flags, drive, entry of the plan."""
        with translate_write_errors("run", self.path):
            self._append_row(
                "recordings", np.array((*rows, quality, entry, json.dumps(as_record(drive))), RECORDING_DTYPE)
            )

    def append_point(self, point: Any, entry: int = 0) -> int:
        """Append one row to every column of the points; return its index."""
        row = self._point_count
        with translate_write_errors("run", self.path):
            for name in self._columns:
                self._append_row(f"points/{name}", np.asarray(getattr(point, name), np.float64))
            self._append_row(f"points/{ENTRY_COLUMN}", np.asarray(entry))
        self._point_count += 1
        return row

    def flag_superseded(self, row: int) -> None:
        """Flag a point whose entry was measured again: the only value ever changed in place."""
        if "quality" in self._columns:
            with translate_write_errors("run", self.path):
                quality = self._file["entry/points/quality"]
                quality[row] = int(quality[row]) | Quality.SUPERSEDED
                quality.flush()

    def finish(
        self,
        status: RunStatus,
        reason: str,
        estimates: Sequence[EstimatedQuantity] = (),
        curves: Sequence[ResultCurve] = (),
        verdict: Verdict = NOT_JUDGED,
    ) -> str:
        """Store the status, append curves and estimates, and close the file in any case.

        Returns the reason as stored. All measured data is in the file by then; if curves and estimates, which can be
        recomputed, cannot be appended, the status is kept and the reason states it.
        """
        if self._closed:
            return reason
        try:
            with translate_write_errors("run", self.path):
                # First, where a reader of the open file sees it; curves and estimates need the file out of SWMR mode.
                self._file["entry/status"][()] = str(status)
                self._file["entry/reason"][()] = truncate_utf8(reason, MAX_TEXT_BYTES)
                self._file["entry/verdict"][()] = str(verdict.outcome)
                self._file["entry/end_time"][()] = datetime.now(UTC).isoformat(timespec="milliseconds")
                self._file.flush()
        finally:
            self._close()
        try:
            store_verdict(self.path, verdict, locking=False)
            append_curves(self.path, curves, locking=False)
            append_estimates(self.path, estimates, locking=False)  # a reader must not block the writer
        except StorageError as error:
            reason += f"; what was identified could not be stored: {error}"
            with (
                contextlib.suppress(StorageError),
                translate_write_errors("run", self.path),
                h5py.File(self.path, "r+", locking=False) as file,
            ):
                file["entry/reason"][()] = truncate_utf8(reason, MAX_TEXT_BYTES)
        return reason

    def close_after_error(self) -> None:
        """Close after a storage error, keeping what reached the disk."""
        if not self._closed:
            self._close()

    def _close(self) -> None:
        self._closed = True
        self._dataset_ids.clear()  # an open identifier would keep the file open
        try:
            self._file.close()
        except (OSError, RuntimeError) as error:
            raise StorageError(f"the run file {self.path} could not be closed: {os_error_text(error)}") from error

    def _append_rows(self, name: str, rows: np.ndarray) -> None:
        """Append rows, (N, ...), by low-level calls, which take a sixth of the time of h5py's indexing."""
        data = self._dataset_ids.get(name)
        if data is None:
            data = self._dataset_ids[name] = self._file[f"entry/{name}"].id
        have, *beside = data.shape
        data.set_extent((have + len(rows), *beside))
        place = data.get_space()
        place.select_hyperslab((have, *(0 for _ in beside)), rows.shape)
        data.write(h5py.h5s.create_simple(rows.shape), place, np.ascontiguousarray(rows))
        data.flush()

    def _append_row(self, name: str, row: np.ndarray) -> None:
        self._append_rows(name, row[None])


def has_unclosable_file() -> bool:
    """Whether HDF5 holds a file it cannot close, because its disk vanished or filled up.

    The library then crashes at interpreter shutdown; the program must exit without it.
    """
    return bool(h5py.h5f.get_obj_count(h5py.h5f.OBJ_ALL, h5py.h5f.OBJ_ALL))
