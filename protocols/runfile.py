"""Writing a run: one HDF5 file, open before the first volt and readable at every moment.

What survives `kill -9` was measured (docs/decisions/0004-run-file.md): every dataset is created first, then SWMR is
switched on, then rows are only appended and each block is flushed. Nothing raw is ever rewritten or compressed while
running. Status and results go in when the run ends.
"""

import contextlib
import json
import os
import shutil
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np

from drivers.bench import DISPLACEMENT, DRIVE
from drivers.drive import Drive, as_record
from drivers.ports import Block, Scale
from protocols.events import Event, Status, event_record
from protocols.fresh_run import Header, create
from protocols.layout import (
    BLOCK,
    CHANNELS,
    ENTRY,
    EVENT,
    LARGEST_POLYNOMIAL,
    RECORDING,
    RESERVE_BYTES,
    TEXT_BYTES,
    columns,
)
from protocols.names import cut, run_path
from protocols.quality import Quality
from protocols.run_results import append_curves, append_estimates
from protocols.storing import StoreError, Storing, reason_of
from protocols.values import Curve, Estimate


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
