"""Run trace: samples of a run file as counts, volts and metres, and its recordings."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers import LaserSensor, Scale, channel_skew_s, from_record
from model import Array
from protocols.base import (
    MAX_RECORDING_SCANS,
    ChannelCalibration,
    FurtherInputs,
    InterferenceLine,
    Quality,
    Recording,
    StreamedRecording,
    parse_json_object,
    visible_text,
)
from protocols.runfile.errors import RunReadError
from protocols.runfile.fields import column, read_number, read_text, subgroup, table
from protocols.runfile.open import reads_run
from protocols.runfile.schema import (
    AIR_COLUMNS,
    CHANNELS,
    ENTRY_COLUMN,
    FURTHER_CHANNELS,
    MAX_FURTHER_CHANNELS,
    MAX_SCALING_COEFFICIENTS,
    RESTED_COLUMN,
)
from protocols.signals import find_lines, mark_folded, prediction_noise

if TYPE_CHECKING:
    import h5py


def read_sensor(entry: "h5py.Group") -> LaserSensor:
    """Return the displacement sensor of a run file."""
    group = subgroup(entry, "instrument/displacement_sensor")
    return LaserSensor(
        name=read_text(group, "name"),
        gain_m_per_v=read_number(group, "gain"),
        zero_v=read_number(group, "zero"),
        valid_low_v=read_number(group, "valid_low"),
        valid_high_v=read_number(group, "valid_high"),
        delay_s=read_number(group, "delay"),
        gain_relative_uncertainty=read_number(group, "gain_relative_uncertainty"),
        serial=read_text(group, "serial"),
        calibrated=read_text(group, "calibrated"),
        expires=read_text(group, "expires") if "expires" in group else "",
        delay_uncertainty_s=read_number(group, "delay_uncertainty") if "delay_uncertainty" in group else 0.0,
        quantity=read_text(group, "quantity") if "quantity" in group else "displacement",
        corner_hz=read_number(group, "corner") if "corner" in group else 0.0,
        curve=tuple((float(m), float(v)) for m, v in np.reshape(group["curve"], (-1, 2))) if "curve" in group else (),
    )


MAX_TIMED_SCANS, TIMES_PER_CHUNK = 30_000_000, 1 << 18
"""Longest trace with a time axis, and times of a chunk of it, which take 0.1 to 0.3 bytes each."""
SHORT_TRACE_SCANS = 1 << 20
"""Number of scans up to which a whole trace is read at once."""
MAX_RECORDED_SHARE = 4
"""Largest mean number of recordings per sample; recordings of a run do not overlap."""
MIN_RATE_HZ, MAX_RATE_HZ = 1e-3, 1e9
RECORDING_FIELDS = ("start_row", "stop_row", "quality", "drive")


@dataclass(frozen=True, slots=True)
class RestRecord:
    """Rows of the displacement at rest, and the true frequencies of folded lines."""

    rows: tuple[int, int]
    folded_from_hz: Mapping[float, float]


@reads_run
class RunTrace:
    """The samples of one run file. Rows are counted from its first sample; their number increases in a growing file.

    Args:
        path: the file.
        entry: its /entry.
        sensor: calibration from volts to metres.
        rest_record: record of interference at rest; None if not measured.
        configuration: the bench file at the time of the run.
    """

    def __init__(
        self,
        path: Path,
        entry: "h5py.Group",
        sensor: Callable[[], LaserSensor],
        rest_record: Callable[[], RestRecord | None] = lambda: None,
        configuration: Callable[[], Mapping[str, Any]] = dict,
    ) -> None:
        self.path = path
        self._configuration = configuration
        self._entry, self.sensor, self._rest_record = entry, sensor, rest_record
        self._calibrations: dict[str, ChannelCalibration] = {}
        self._blocks: NDArray[Any] | None = None
        self._stored: dict[int, dict[str, float]] | None = None

    @cached_property
    def interference(self) -> tuple[InterferenceLine, ...]:
        """Hum and other lines of the displacement at rest, before the first drive; none if not measured."""
        if (rest := self._rest_record()) is None:
            return ()
        samples = self._samples_at_rest(rest)
        lines = find_lines(samples, self.rate_hz)
        return mark_folded(lines, rest.folded_from_hz, tolerance_hz=0.5 * self.rate_hz / samples.size)

    @cached_property
    def rest_noise_m(self) -> float:
        """Noise of the displacement at rest, before the first drive; NaN if not measured."""
        rest = self._rest_record()
        return math.nan if rest is None else prediction_noise(self._samples_at_rest(rest))

    def _samples_at_rest(self, rest: RestRecord) -> Array:
        first, last = rest.rows
        if not 0 <= first < last <= self.sample_count:
            raise ValueError(f"interference was measured in rows {first} to {last}, which it does not have")
        return self.displacement_m(first, last)

    @property
    def rate_hz(self) -> float:
        """Scans per second; 0 without a start of the card."""
        rate_hz = read_number(self._entry, "trace/sample_rate")
        if rate_hz != 0 and not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
            raise ValueError(f"the sample rate is {rate_hz:g} Hz")
        return rate_hz

    @property
    def sample_count(self) -> int:
        """Number of rows common to all channels."""
        return min(len(column(self._entry, f"trace/{name}", "i")) for name in (*CHANNELS, *self.further_channels))

    @property
    def further_channels(self) -> dict[str, str]:
        """Units of the further inputs by name, in the order of the bench file; empty without further inputs."""
        names = self._entry["trace"].attrs.get(FURTHER_CHANNELS, ())
        if len(names) > MAX_FURTHER_CHANNELS:
            raise ValueError(f"it names {len(names)} further channels")
        units = {name: column(self._entry, f"trace/{name}", "i").attrs["scaled_units"] for name in map(str, names)}
        return {name: visible_text(str(unit)) for name, unit in units.items()}

    def _read_input(self, channel: str, rows: tuple[int, int]) -> tuple[Array, float]:
        """Return the volts at a further input, and the skew of its conversion behind the drive's."""
        if channel not in self.further_channels:
            raise ValueError(f"its bench file names a channel {channel!r} that it has no samples of")
        scale = self.channel_scale(channel)
        return scale.to_volts(self.read_raw(channel, *rows)), scale.skew_s - self.channel_scale("drive").skew_s

    def channel_values(self, channel: str, start: int = 0, stop: int | None = None) -> Array:
        """Return a further input in its unit, rows start..stop, (N,)."""
        if channel not in self.further_channels:
            raise ValueError(
                f"there is no channel {channel}; further channels: {', '.join(self.further_channels) or 'none'}"
            )
        gain, offset = column(self._entry, f"trace/{channel}_volts_to_units", "f")[:2]
        volts = self.channel_scale(channel).to_volts(self.read_raw(channel, start, stop))
        return np.asarray(gain * volts + offset)

    @property
    def duration_s(self) -> float:
        """Sampled time; gaps without stored samples do not count."""
        rate_hz = self.rate_hz
        return self.sample_count / rate_hz if rate_hz else 0.0

    def channel_scale(self, channel: str) -> Scale:
        """Return the scaling of counts to volts."""
        coefficients = tuple(
            column(self._entry, f"trace/{channel}_scaling_coefficients", "f")[:MAX_SCALING_COEFFICIENTS].tolist()
        )
        skew = f"trace/{channel}_skew"  # missing in files of format 1
        return Scale(coefficients, skew_s=read_number(self._entry, skew) if skew in self._entry else 0.0)

    def read_raw(self, channel: str, start: int = 0, stop: int | None = None) -> NDArray[np.int16]:
        """Return raw counts, rows start..stop, (N,)."""
        stop = self.sample_count if stop is None else min(stop, self.sample_count)
        return np.asarray(column(self._entry, f"trace/{channel}", "i")[start:stop], np.int16)

    def raw_recordings(self) -> Iterator[tuple[int, tuple[NDArray[np.int16], ...]]]:
        """Yield plan entry and raw counts of the channels, (N,) each, of every recording."""
        count, channels = self.sample_count, [column(self._entry, f"trace/{name}", "i") for name in CHANNELS]
        if count <= SHORT_TRACE_SCANS:  # a read for each recording takes ten times as long
            channels = [each[:count] for each in channels]
        for start, stop, entry in self.recording_rows():
            yield entry, tuple(np.asarray(each[start : min(stop, count)], np.int16) for each in channels)

    def time_s(self, start: int = 0, stop: int | None = None) -> Array:
        """Return scan times of rows start..stop, seconds since the stream began, (N,); gaps are jumps."""
        return self.times_of_rows(np.arange(start, self.sample_count if stop is None else min(stop, self.sample_count)))

    def times_of_rows(self, rows: ArrayLike) -> Array:
        """Return the scan times of these rows, seconds since the stream began, (N,)."""
        rows = np.asarray(rows, np.int64)
        stored = table(self._entry, "blocks", ("row", "scan"))
        if self._blocks is None or len(self._blocks) != len(stored):  # an export reads every stretch of its rows
            self._blocks = stored[:]
        blocks = self._blocks
        if not len(blocks):
            return np.asarray(rows / self.rate_hz)
        at = np.searchsorted(blocks["row"], rows, side="right") - 1
        return np.asarray((blocks["scan"][at] + rows - blocks["row"][at]) / self.rate_hz)

    def drive_v(self, start: int = 0, stop: int | None = None) -> Array:
        """Return volts at the amplifier's input, rows start..stop, (N,)."""
        return self._calibration("drive").to_si(self.read_raw("drive", start, stop))

    def displacement_m(self, start: int = 0, stop: int | None = None) -> Array:
        """Return the displacement, m, or a vibrometer's velocity, m/s, (N,); a Recording's quality states whether it is valid."""
        return self._calibration("displacement").to_si(self.read_raw("displacement", start, stop))

    def _calibration(self, channel: str) -> ChannelCalibration:
        """Return the conversion of a channel, read once because it takes as long as ten thousand samples."""
        if (calibration := self._calibrations.get(channel)) is None:
            sensor = self.sensor() if channel == "displacement" else None
            calibration = ChannelCalibration(self.channel_scale(channel), sensor)
            if calibration.scale.coefficients:  # a growing file may not have them yet
                self._calibrations[channel] = calibration
        return calibration

    def recordings(self) -> Iterator[Recording]:
        """Yield the recordings of this file, in order, exactly as in the live run."""
        delay_s = _displacement_delay_s(self.sensor(), self)
        rows = self._recordings[:]
        if (
            int(np.abs(rows["stop_row"] - rows["start_row"]).astype(float).sum())
            > MAX_RECORDED_SHARE * self.sample_count
        ):
            raise ValueError("its recordings overlap")
        for index, row in enumerate(rows):
            yield self._recording(index, row, delay_s)

    @property
    def recording_count(self) -> int:
        """Number of recordings, without reading them."""
        return len(self._recordings)

    def recording(self, index: int) -> Recording:
        """Return one recording, without reading the others; a negative index counts from the end."""
        return self._recording(
            index % self.recording_count, self._recordings[index], _displacement_delay_s(self.sensor(), self)
        )

    def recording_rows(self) -> list[tuple[int, int, int]]:
        """Return start row, stop row and plan entry of every recording, without reading their samples."""
        rows = self._recordings[:]
        entries = rows[ENTRY_COLUMN] if ENTRY_COLUMN in rows.dtype.names else range(len(rows))
        return [
            (int(start), int(stop), int(entry))
            for start, stop, entry in zip(rows["start_row"], rows["stop_row"], entries, strict=True)
        ]

    def last_recording(self) -> Recording | None:
        """Return the last recording, or None, without reading the others."""
        return self.recording(-1) if self.recording_count else None

    @property
    def _recordings(self) -> "h5py.Dataset":
        return table(self._entry, "recordings", RECORDING_FIELDS)

    def _recording(self, index: int, row: Any, delay_s: float) -> Recording:
        rows = (int(row["start_row"]), int(row["stop_row"]))
        if not 0 <= rows[0] <= rows[1]:
            raise ValueError(f"recording {index} begins at row {rows[0]} and ends at row {rows[1]}")
        attributes: dict[str, Any] = {
            "index": index,
            "rows": rows,
            "rate_hz": self.rate_hz,
            "drive": from_record(parse_json_object(row["drive"].decode())),
            "quality": Quality(int(row["quality"])),
            "sensor_delay_s": delay_s,
            "entry": int(row[ENTRY_COLUMN]) if ENTRY_COLUMN in row.dtype.names else index,  # format 1: one per entry
            "velocity_corner_hz": self.sensor().corner_hz if self.sensor().measures_velocity else None,
            "interference": self.interference,
            "start_s": float(self.times_of_rows(rows[0])),
            "rest_noise_m": self.rest_noise_m,
            "inputs": FurtherInputs(self._configuration(), self._read_input),
        }
        self._stored = _stored_by_entry(self._entry) if self._stored is None else self._stored
        values = self._stored.get(attributes["entry"], {})
        attributes["rested_s"] = values.get(RESTED_COLUMN, math.nan)
        attributes["air"] = {name: value for name, value in values.items() if name in AIR_COLUMNS}
        if rows[1] - rows[0] > MAX_RECORDING_SCANS:
            return StreamedRecording(
                lambda part, drive: (self.drive_v if drive else self.displacement_m)(*part), **attributes
            )
        return Recording(drive_v=self.drive_v(*rows), displacement_m=self.displacement_m(*rows), **attributes)


def _stored_by_entry(run: "h5py.Group") -> dict[int, dict[str, float]]:
    """Return the values of a recording that its points have, by entry: of the entry's last point."""
    points = subgroup(run, "points") if "points" in run else {}
    if not (names := [name for name in (*AIR_COLUMNS, RESTED_COLUMN) if name in points]) or ENTRY_COLUMN not in points:
        return {}
    rows = zip(points[ENTRY_COLUMN][:].tolist(), *(points[name][:].tolist() for name in names), strict=False)
    return {entry: dict(zip(names, values, strict=True)) for entry, *values in rows}


def _displacement_delay_s(sensor: LaserSensor, trace: RunTrace) -> float:
    """Return the delay of displacement against drive: the sensor's delay less the card's skew."""
    return sensor.delay_s - channel_skew_s([trace.channel_scale(name) for name in CHANNELS])


def append_time_axis(path: Path, file: "h5py.File", sensor: LaserSensor) -> None:
    """Append the times of the scans of a run that has ended, over which a NeXus viewer shows its samples; nothing if they are damaged."""
    trace = RunTrace(path, file["entry"], lambda: sensor)
    with suppress(RunReadError):  # the results of a run matter more than its axis
        count = trace.sample_count if trace.rate_hz else 0
        chunk = min(TIMES_PER_CHUNK, count)
        if not 0 < count <= MAX_TIMED_SCANS:
            return
        times = file["entry/trace"].create_dataset(
            "time", (count,), "f8", chunks=(chunk,), shuffle=True, compression=1, fletcher32=True
        )
        times.attrs.update({"units": "s", "long_name": "time since the stream began (s)"})
        for start in range(0, count, chunk):
            times[start : start + chunk] = trace.time_s(start, start + chunk)
        file["entry/trace"].attrs["axes"] = ["time"]
