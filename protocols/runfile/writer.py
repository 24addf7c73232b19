"""Run file writer: one HDF5 file, created before the first volt and readable at every moment; verdict and estimates at its end.

Survival of `kill -9` was measured (docs/decisions/0004-run-file.md): the file is created completely with every dataset, then SWMR
is switched on, then rows are only appended and each block is flushed. Raw data is never rewritten, and not compressed during the
run. Status, series, estimates and checksums are written at the end of the run.
"""

import contextlib
import errno
import json
import logging
import math
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import MappingProxyType
from typing import Any, Concatenate, ParamSpec, Self, TypeVar

import h5py
import numpy as np

from drivers import Block, CallThread, Deadline, Drive, InputChannel, OverdueError, Scale, as_record
from protocols.base import (
    EntryStarted,
    EstimatedQuantity,
    Event,
    Quality,
    RunStatus,
    Series,
    SpecimenMounted,
    Verdict,
    event_record,
    last_mountings,
)
from protocols.runfile.checksums import changed_names, compute_digests, store_checksums, stored_digests
from protocols.runfile.creation import create_file, create_group, free_name
from protocols.runfile.errors import (
    WRITE_FAILURES,
    FileLostError,
    NotesError,
    RunReadError,
    StorageError,
    os_error_text,
    translate_write_errors,
)
from protocols.runfile.mountings import mountings_text
from protocols.runfile.names import run_path, truncate_utf8
from protocols.runfile.presence import FilePresence
from protocols.runfile.record import RunRecord
from protocols.runfile.schema import (
    AIR_COLUMNS,
    BLOCK_DTYPE,
    CHANNELS,
    CONTINUED_EVENT,
    ENTRY_COLUMN,
    EVENT_DTYPE,
    MAX_SCALING_COEFFICIENTS,
    MAX_TEXT_BYTES,
    RECORDING_DTYPE,
    RESERVE_BYTES,
    point_columns,
)
from protocols.runfile.series import append_passes, append_series
from protocols.runfile.trace import append_time_axis
from protocols.runfile.transaction import announced_transaction, transaction

log = logging.getLogger(__name__)

NOT_JUDGED = Verdict()

Results = tuple[Sequence[EstimatedQuantity], Sequence[Series], Verdict]

_OPEN: dict[Path, tuple[h5py.File, dict[str, h5py.Dataset]]] = {}
"""Files that cannot be closed, and their datasets, kept because HDF5 prints a traceback for each that Python releases."""


P = ParamSpec("P")
R = TypeVar("R")

SLOWEST_DISK_BYTES_PER_S = 10e6


def _within_deadline(
    method: Callable[Concatenate["RunFileWriter", P], R],
) -> Callable[Concatenate["RunFileWriter", P], R]:
    """Let a method run in the thread of the file; raise StorageError if it does not return in time."""

    def call(self: "RunFileWriter", /, *args: P.args, **kwargs: P.kwargs) -> R:
        written_bytes = 2 * len(self._channels) * self.row_count
        seconds = Deadline.DISK.seconds + written_bytes / SLOWEST_DISK_BYTES_PER_S
        try:
            return self.calls.call(lambda: method(self, *args, **kwargs), seconds)
        except OverdueError as error:
            raise StorageError(
                f"the disk of the run file {self.path} does not answer ({error}); what was written before is in the file when it answers again"
            ) from error

    call.__doc__ = method.__doc__
    return call


class RunFileWriter:
    """Writes one run file: create, `start_stream` when the card runs, append, `finish`. Errors are StorageError."""

    def __init__(
        self,
        path: Path,
        record: RunRecord,
        point_type: type,
        channels: Sequence[InputChannel] = (),
        hold_s: float = 0.0,
        air: Sequence[str] = (),
    ) -> None:
        """Create the file with all its datasets.

        Args:
            path: the run file.
            record: record of the run before its start; a missing start time becomes the present time.
            point_type: type of the points.
            channels: further inputs, in the order of a block's rows from the third.
            hold_s: longest real time for which blocks are held and then written together; other appended data, and reading, write
                them first. A killed program loses held blocks.
            air: columns of `AIR_COLUMNS` that the points have.

        Raises:
            StorageError: no permission, no space, or not a folder.
            FileExistsError: there is such a file.
        """
        self.path = self._first_path = path
        self._begun_with = record, point_type, channels, hold_s, air
        self._channels = (*CHANNELS, *(channel.name for channel in channels))
        self._created_at, self._created_s = datetime.now(UTC), time.monotonic()
        self._mountings, self._is_measuring = tuple(record.mountings), False
        self.row_count = 0
        self._air = {name: AIR_COLUMNS[name] for name in air}
        self._columns = {**point_columns(point_type), **self._air}
        self._point_count = 0
        self._hold_s, self._written_s = hold_s, -math.inf
        self._held: list[tuple[Block, int, float]] = []
        """Blocks not yet written, with row and time."""
        self._closed = False
        self._open_datasets: dict[str, h5py.Dataset] = {}
        """Open datasets: closing one writes to the file, and its error cannot be reported."""
        self._tables: list[tuple[str, np.ndarray]] = []
        """Rows of events and points, for another file after a loss of this one."""
        self.calls = CallThread(f"run file {path}")
        try:
            self._create()
        except BaseException:
            self.calls.end()
            raise

    @_within_deadline
    def _create(self) -> None:
        path, (record, _, channels, _, _) = self.path, self._begun_with
        if os.path.exists(path):  # noqa: PTH110 - Path.exists raises where a folder's name is too long
            raise FileExistsError(path)
        try:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
            except FileExistsError:
                raise NotADirectoryError(errno.ENOTDIR, "not a folder") from None
            begun = record.start_time or self._created_at.isoformat(timespec="milliseconds")
            create_file(path, replace(record, start_time=begun), self._columns, channels)
            self._file = h5py.File(path, "r+", libver="latest")
            _OPEN[path] = self._file, self._open_datasets
            self._file.swmr_mode = True
            # Opening one reads the file with Python's lock held: a silent disk would stop all threads in mid-drive.
            traces = (f"trace/{name}" for name in self._channels)
            points = (f"points/{name}" for name in (*self._columns, ENTRY_COLUMN))
            facts = ("status", "reason", "verdict", "end_time", "mountings")
            for name in (*traces, *points, "blocks", "events", "recordings", *facts):
                self._dataset(name)
            self._presence = FilePresence(path, self._file.id.get_vfd_handle())
        except FileExistsError:
            raise
        except WRITE_FAILURES as error:
            raise StorageError(
                f"the run file {path} cannot be created: {os_error_text(error)}; choose another folder"
            ) from error

    @classmethod
    def new(
        cls,
        folder: Path,
        record: RunRecord,
        point_type: type,
        channels: Sequence[InputChannel] = (),
        hold_s: float = 0.0,
        air: Sequence[str] = (),
    ) -> Self:
        """Create a file in `folder`, named by time, specimen and protocol; numbered within the same second.

        Raises:
            StorageError: it cannot be created.
        """
        begun = datetime.fromisoformat(record.start_time) if record.start_time else datetime.now(UTC)
        first = run_path(folder, record.specimen, record.protocol, begun)
        for attempt in range(1, 1000):
            path = first if attempt == 1 else first.with_stem(f"{first.stem}-{attempt}")
            with contextlib.suppress(FileExistsError):
                return cls(path, record, point_type, channels, hold_s, air)
        raise StorageError(f"the folder {folder} holds a thousand runs of this second; choose another folder")

    @_within_deadline
    def start_stream(self, rate_hz: float, scales: Sequence[Scale]) -> None:
        """Store the card's true rate and scaling; afterwards rows are only appended."""
        with translate_write_errors("run", self.path):
            self._dataset("trace/sample_rate")[()] = rate_hz
            for name, scale in zip(self._channels, scales, strict=False):
                padded = [*scale.coefficients, *[0.0] * MAX_SCALING_COEFFICIENTS][:MAX_SCALING_COEFFICIENTS]
                self._dataset(f"trace/{name}_scaling_coefficients")[:] = padded
                self._dataset(f"trace/{name}_skew")[()] = scale.skew_s
                gain, offset = self._dataset(f"trace/{name}_volts_to_units")[:]
                factor = padded[1] * gain
                self._dataset(f"trace/{name}_scaling_factor")[()] = factor
                self._dataset(f"trace/{name}_offset")[()] = (padded[0] * gain + offset) / factor
            self._file.flush()

    def append_block(self, block: Block, time_s: float) -> int:
        """Append a block, counts of both channels, and flush it unless blocks are held; return the row of its first scan.

        Raises:
            StorageError: the disk is nearly full, or the file cannot be written.
        """
        row = self.row_count
        self._held.append((block, row, time_s))
        self.row_count = row + block.raw.shape[1]
        if not self._hold_s or time.monotonic() - self._written_s >= self._hold_s:
            self._write_held()
        return row

    @_within_deadline
    def _write_held(self) -> None:
        """Write and flush the held blocks."""
        if not self._held:
            return
        held, self._held = self._held, []
        with self._checked():
            free = math.inf if self._presence.problem else shutil.disk_usage(self.path.parent).free
        if free < RESERVE_BYTES:
            raise StorageError(
                f"the disk of {self.path.parent} is full: {free / 1e6:.0f} MB are left and {RESERVE_BYTES / 1e6:.0f} MB are "
                "kept to close the run in order; free some space or choose another folder. Everything before is in the file"
            )
        raw = held[0][0].raw if len(held) == 1 else np.concatenate([block.raw for block, _, _ in held], axis=1)
        with self._checked():
            for name, counts in zip(self._channels, raw, strict=False):
                self._append_rows(f"trace/{name}", counts)
            rows = [(row, block.start, time_s) for block, row, time_s in held]
            self._append_rows("blocks", np.array(rows, BLOCK_DTYPE))
        self._written_s = time.monotonic()

    @_within_deadline
    def read_raw(self, channel: str, rows: tuple[int, int]) -> np.ndarray:
        """Return the raw counts of a channel in appended rows, (stop - start,)."""
        self._write_held()
        with translate_write_errors("run", self.path):
            return np.asarray(self._dataset(f"trace/{channel}")[slice(*rows)])

    @_within_deadline
    def append_event(self, event: Event, time_s: float) -> None:
        """Append an event as JSON; a long text continues in further rows."""
        text = json.dumps(event_record(event), ensure_ascii=False, allow_nan=False)
        encoded = text.encode("utf-8", "replace")  # of a path that is not UTF-8
        with self._appending():
            for start in range(0, len(encoded), MAX_TEXT_BYTES):
                piece = encoded[start : start + MAX_TEXT_BYTES]
                kind = event.kind if start == 0 else CONTINUED_EVENT
                self._append_row("events", np.array((time_s, self.row_count, kind, piece), EVENT_DTYPE))
            if isinstance(event, EntryStarted):
                self._is_measuring = True
            if isinstance(event, SpecimenMounted) and not self._is_measuring:
                self._mountings = last_mountings((*self._mountings, event))
                self._dataset("mountings")[()] = mountings_text(self._mountings)

    @_within_deadline
    def append_recording(self, rows: tuple[int, int], quality: int, drive: Drive, entry: int = 0) -> None:
        """Append a recording: rows start..stop, quality flags, drive, entry of the plan."""
        with self._appending():
            row = np.array((*rows, quality, entry, json.dumps(as_record(drive))), RECORDING_DTYPE)
            self._append_row("recordings", row)

    @_within_deadline
    def append_point(self, point: Any, entry: int = 0, air: Mapping[str, float] = MappingProxyType({})) -> int:
        """Append one row to every column of the points, with the values of `air` by column; return its index."""
        row = self._point_count
        with self._appending():
            for name in self._columns:
                value = air.get(name, math.nan) if name in self._air else getattr(point, name)
                self._append_row(f"points/{name}", np.asarray(value, np.float64))
            self._append_row(f"points/{ENTRY_COLUMN}", np.asarray(entry))
        self._point_count += 1
        return row

    @_within_deadline
    def flag_point(self, row: int, flag: Quality) -> None:
        """Add a flag to a point: the only value ever changed in place."""
        if "quality" in self._columns:
            with self._appending():
                quality = self._dataset("points/quality")
                quality[row] = int(quality[row]) | flag
                quality.flush()

    @_within_deadline
    def check_presence(self) -> None:
        """Check that the file is still at its path, with all written data.

        Raises:
            FileLostError: another program deleted, cut, moved or detached it.
        """
        with translate_write_errors("run", self.path):
            self._presence.check()

    @_within_deadline
    def finish(
        self,
        status: RunStatus,
        reason: str,
        estimates: Sequence[EstimatedQuantity] = (),
        series: Sequence[Series] = (),
        verdict: Verdict = NOT_JUDGED,
    ) -> str:
        """Store the status, append verdict, series, estimates and checksums, and close the file in any case.

        Returns the stored reason. All measured data is already in the file; if series and estimates, which can be recomputed,
        cannot be appended, the status is kept and the reason states it. The rest of a file that another program deleted, cut or
        moved is saved; `path` is then its new file.
        """
        if self._closed:
            return reason
        try:
            return self._finish(status, reason, (estimates, series, verdict))
        finally:
            self.calls.end()

    def _finish(self, status: RunStatus, reason: str, results: Results) -> str:
        try:
            self._write_held()
        except FileLostError:  # `problem` states it
            pass
        except StorageError as error:
            reason += f"; the last samples could not be stored: {error}"
        if self._presence.problem:
            return self._finish_lost(status, reason, results)
        with announced_transaction(self.path):  # otherwise a kill would leave an ended run without results
            self._finish_open(status, reason, results[-1])
            try:
                return self._append_results(self.path, reason, results)
            finally:
                self._presence.close()

    def _finish_open(self, status: RunStatus, reason: str, verdict: Verdict) -> None:
        """Store the end of the run visibly for readers of the open file, and close the file."""
        try:
            with translate_write_errors("run", self.path):
                self._store_end(self._dataset, status, reason, verdict)
                self._file.flush()
        finally:
            self._close()

    def _store_end(
        self, dataset: Callable[[str], h5py.Dataset], status: RunStatus, reason: str, verdict: Verdict
    ) -> None:
        # A change of the computer's clock does not affect the elapsed time.
        end_time = self._created_at + timedelta(seconds=time.monotonic() - self._created_s)
        dataset("status")[()] = str(status)
        dataset("reason")[()] = truncate_utf8(reason, MAX_TEXT_BYTES)
        dataset("verdict")[()] = str(verdict.outcome)
        dataset("end_time")[()] = end_time.isoformat(timespec="milliseconds")

    def _append_results(self, path: Path, reason: str, results: Results, status: RunStatus | None = None) -> str:
        """Append the results; also how the run ended, with `status`, to a copy that may have it as it was before."""
        estimates, series, verdict = results
        record = self._begun_with[0]
        try:
            with append_results(path, new=True) as file:
                if status is not None:
                    self._store_end(lambda name: file[f"entry/{name}"], status, reason, verdict)
                file["entry/reason"][()] = truncate_utf8(reason, MAX_TEXT_BYTES)
                store_verdict(file, verdict)
                append_series(file, series, record.default_plot, record.sensor.gain_relative_uncertainty)
                append_passes(file)
                append_estimates(file, estimates)
                append_time_axis(path, file, record.sensor)
        except StorageError as error:
            if path == self.path and not self._presence.problem:
                self.check_presence()
            reason += f"; the identified parameters could not be stored: {error}"
            with contextlib.suppress(StorageError), append_results(path, new=True) as file:
                file["entry/reason"][()] = truncate_utf8(reason, MAX_TEXT_BYTES)
                store_verdict(file, verdict)
        return reason

    def _finish_lost(self, status: RunStatus, reason: str, results: Results) -> str:
        """Finish a file that another program deleted, cut, moved or detached: save its rest."""
        presence, folder = self._presence, self.path.parent
        with contextlib.suppress(StorageError):
            self._finish_open(status, reason, results[-1])
        try:
            if presence.moved_to is not None:
                self.path = presence.moved_to
                message = f"{reason}; the measured data are in {self.path}"
                return self._append_results(self.path, message, results)
            if not presence.is_cut:
                saved = _free_path(self.path)
                try:
                    presence.restore(saved)
                except OSError as error:
                    log.warning("the run file cannot be saved at %s: %s", saved, os_error_text(error))
                else:
                    if _is_whole(saved, self._channels):
                        self.path = saved
                        message = f"{reason}; the measured data are saved in {saved}"
                        return self._append_results(saved, message, results, status)
                    saved.unlink(missing_ok=True)
            rest = RunFileWriter.new(folder, *self._begun_with)
            self.path = rest.path
            for name, row in self._tables:
                rest._append_row(name, row)  # noqa: SLF001 - of this class
            return rest.finish(status, f"{reason}; events, points and results are saved in {rest.path}", *results)
        except StorageError as error:
            return f"{reason}; its points cannot be saved either: {error}"
        finally:
            presence.close()

    @_within_deadline
    def close_after_error(self) -> None:
        """Close after a storage error; data on the disk are kept."""
        try:
            if not self._closed:
                with contextlib.suppress(StorageError):
                    self._write_held()
                self._close()
        finally:
            self._presence.close()
            self.calls.end()

    def _close(self) -> None:
        self._closed = True
        try:
            self._file.close()
        except WRITE_FAILURES as error:
            raise StorageError(f"the run file {self.path} could not be closed: {os_error_text(error)}") from error
        self._open_datasets.clear()
        _OPEN.pop(self._first_path, None)

    @contextlib.contextmanager
    def _appending(self) -> Iterator[None]:
        """As `_checked`, with held blocks written first."""
        self._write_held()
        with self._checked():
            yield

    @contextlib.contextmanager
    def _checked(self) -> Iterator[None]:
        """Check the file before a write, and its size afterwards; a lost file is reported once."""
        if self._closed:
            raise StorageError(f"the run file {self.path} is closed")
        with translate_write_errors("run", self.path):
            if not self._presence.problem:
                self._presence.check()
            yield
        self._presence.note_size()

    def _dataset(self, name: str) -> h5py.Dataset:
        """Return a dataset of the entry, which stays open."""
        if name not in self._open_datasets:
            self._open_datasets[name] = self._file[f"entry/{name}"]
        return self._open_datasets[name]

    def _append_rows(self, name: str, rows: np.ndarray) -> None:
        """Append rows, (N, ...), by low-level calls, which take a sixth of the time of h5py's indexing."""
        data = self._dataset(name).id
        have, *beside = data.shape
        data.set_extent((have + len(rows), *beside))
        place = data.get_space()
        place.select_hyperslab((have, *(0 for _ in beside)), rows.shape)
        data.write(h5py.h5s.create_simple(rows.shape), place, np.ascontiguousarray(rows))
        data.flush()

    def _append_row(self, name: str, row: np.ndarray) -> None:
        self._append_rows(name, row[None])
        if name != "recordings":  # datasets of samples
            self._tables.append((name, row))


def _is_whole(path: Path, channels: Sequence[str]) -> bool:
    """Whether the samples of a saved copy can be read to their end."""
    try:
        with h5py.File(path, "r") as file:
            for name in channels:
                file[f"entry/trace/{name}"][-1:]
    except (OSError, RuntimeError, ValueError, KeyError):
        return False
    return True


def _free_path(path: Path) -> Path:
    """Return the path, or a numbered one if the file exists."""
    numbered = (path.with_stem(f"{path.stem}-{i}") for i in range(2, 1000))
    return next((each for each in (path, *numbered) if not each.exists()), path)


def has_unclosable_file() -> bool:
    """Whether HDF5 holds a file that it cannot close, because its disk vanished or is full.

    The library then crashes at interpreter shutdown; the program must exit without it.
    """
    return bool(h5py.h5f.get_obj_count(h5py.h5f.OBJ_ALL, h5py.h5f.OBJ_ALL))


@contextmanager
def append_results(path: Path, new: bool = False) -> Iterator[h5py.File]:
    """Open a run that has ended, for its results; afterwards its checksums are computed, and lists find its record in the sidecar.

    All changes are applied together at the end; a kill or an error leaves all or none of them.

    Args:
        path: the run file.
        new: whether the run has just ended and has no checksums yet.

    Raises:
        StorageError: the file cannot be written, or it is damaged, which new checksums would hide.
    """
    with (
        translate_write_errors("run", path),
        transaction(path) as changed,
        h5py.File(changed, "r+", libver="latest") as file,
    ):
        stored = stored_digests(file)
        if stored is not None and (different := changed_names(stored, compute_digests(file))):
            raise StorageError(
                f"nothing is added to {path}: its contents differ from its checksums ({', '.join(different[:3])}); take "
                "another copy of it"
            )
        yield file
        if new or stored is not None:
            store_checksums(file)
        record = _record_for_lists(path, file)
    with suppress(*NOT_LISTED):
        from protocols.runfile.sidecar import store_listed  # not needed before the end of a run

        if record is not None and record.status is not RunStatus.RUNNING:
            store_listed(path, record)


NOT_LISTED = (RunReadError, NotesError, OSError, ValueError, TypeError, LookupError, ImportError)
"""Lists then read the run from its data. ImportError: the program was replaced or removed during the run."""


def _record_for_lists(path: Path, file: h5py.File) -> RunRecord | None:
    """Return the record; from the open file, since HDF5 gives a path's as another reader in this program has read it before."""
    with suppress(*NOT_LISTED):
        from protocols.runfile.reader import Run

        return Run(path, file).stored_record()
    return None


def store_verdict(file: h5py.File, verdict: Verdict) -> None:
    """Store the verdict in place of an earlier one."""
    entry = file["entry"]
    for name, value in (("verdict", str(verdict.outcome)), ("verdict_details", verdict.to_json())):
        if name in entry:
            del entry[name]
        entry.create_dataset(name, data=value)


def append_estimates(file: h5py.File, estimates: Sequence[EstimatedQuantity]) -> None:
    """Append identified quantities in order, the most important first."""
    if not estimates:
        return
    group = file["entry"].create_group("estimates", track_order=True)
    group.attrs["NX_class"] = "NXcollection"
    for estimate in estimates:
        one = create_group(group, free_name(group, estimate.name.replace(" ", "_")), "NXcollection")
        one.attrs["name"] = estimate.name
        for name, value in (("value", estimate.value), ("standard_error", estimate.standard_error)):
            one.create_dataset(name, data=value).attrs["units"] = estimate.unit
        one["source"] = estimate.source
