"""Frequency response of a sweep that is still running, computed in the background from the samples so far."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from app.live.latest_only import LatestOnlyWorker
from drivers import Block, Drive, LaserSensor, LinearSweep, PeriodicSweep, Scale, channel_skew_s
from protocols.base import (
    BlockStored,
    ChannelCalibration,
    CurveReady,
    DriveStarted,
    EntryStarted,
    ResultCurve,
    RunEnded,
    RunStarted,
    ShutdownStarted,
)

if TYPE_CHECKING:  # slow to import, and not needed for the first picture of the window
    from protocols.signals import FrequencyResponse

PAUSE_S = 0.5
"""Shortest time between two computations."""

MAX_SCANS = 2_000_000
"""A longer record is not computed before it ends."""


@dataclass(frozen=True, slots=True)
class SweepRecord:
    """The samples of one sweep so far: the drive, and the blocks since its start."""

    drive: PeriodicSweep | LinearSweep
    blocks: tuple[NDArray[np.int16], ...]
    rate_hz: float
    channels: tuple[ChannelCalibration, ...]
    delay_s: float

    def response(self) -> "FrequencyResponse | None":
        """Return the response so far; None while the samples do not suffice."""
        from protocols.measurements.sweep_pieces import SETTLED_S
        from protocols.signals import estimate_periodic_response, estimate_swept_response

        raw = np.concatenate([block[:2] for block in self.blocks], axis=1)
        volts, metres = (channel.to_si(samples) for channel, samples in zip(self.channels, raw, strict=True))
        drive, band = self.drive, (self.drive.start_hz, self.drive.stop_hz)
        try:
            if isinstance(drive, LinearSweep):
                found = estimate_swept_response(volts, metres, self.rate_hz, band, delay_s=self.delay_s)
            else:
                # Samples before the drive belong to the periods that are dropped.
                used = round(self._periods * drive.period_s * self.rate_hz)
                dropped = max(math.ceil(SETTLED_S / drive.period_s), 1)
                found = estimate_periodic_response(
                    volts[-used:], metres[-used:], self.rate_hz, drive.period_s, band, dropped, self.delay_s
                )
        except ValueError:
            return None
        return found if found.frequency_hz.size else None

    @property
    def progress(self) -> str:
        """How far the sweep has come."""
        drive = self.drive
        if isinstance(drive, LinearSweep):
            share = min(self._seconds / drive.duration_s, 1.0)
            return f"running, at {drive.start_hz + share * (drive.stop_hz - drive.start_hz):.0f} Hz"
        return f"running, {min(self._periods, drive.periods)} of {drive.periods} periods"

    @property
    def _seconds(self) -> float:
        return float(sum(block.shape[1] for block in self.blocks) / self.rate_hz)

    @property
    def _periods(self) -> int:
        assert isinstance(self.drive, PeriodicSweep)
        return int(self._seconds / self.drive.period_s)


class RunningResponse:
    """Collects the samples of a sweep in the bench thread, and computes the response of the entry so far in another.

    Args:
        pause_s: shortest time between two computations.
        clock: in seconds.
    """

    def __init__(self, pause_s: float = PAUSE_S, clock: Callable[[], float] = time.monotonic) -> None:
        self._worker = LatestOnlyWorker(self._compute, self._store, "running response")
        self._pause_s, self._clock, self._submitted_s = pause_s, clock, -math.inf
        self._rate_hz, self._delay_s = 1.0, 0.0
        self._channels: tuple[ChannelCalibration, ...] = ()
        self._drive: PeriodicSweep | LinearSweep | None = None
        self._blocks: list[NDArray[np.int16]] = []
        self._scans = 0
        self._earlier: tuple[SweepRecord, ...] = ()
        """The finished sweeps of the entry, such as the pieces of a long one."""
        self._entry: object = None
        """Identifies the entry: what was computed for another one is not shown."""
        self._computed: tuple[object, list[FrequencyResponse | None]] = None, []
        """An entry, and the responses of its finished sweeps; used in the worker thread only."""
        self.latest: ResultCurve | None = None
        """Response of the entry so far; None while no sweep is running."""

    def start_stream(self, rate_hz: float, scales: Sequence[Scale], sensor: LaserSensor) -> None:
        """Take the calibration of the samples that follow."""
        self._rate_hz, self._channels = rate_hz, ChannelCalibration.pair(scales, sensor)
        self._delay_s = sensor.delay_s - channel_skew_s(scales)
        self._reset()

    def observe(self, event: object) -> None:
        """Follow the events of a run; called in the bench thread."""
        match event:
            case DriveStarted(drive):
                self._start_drive(drive)
            case BlockStored(block) if self._drive is not None:
                self._add_block(self._drive, block)
            case EntryStarted() | CurveReady() | RunStarted() | ShutdownStarted() | RunEnded():
                self._reset()

    def close(self) -> None:
        """Stop the thread."""
        self._worker.close()

    def _reset(self) -> None:
        self._entry, self._drive, self.latest = object(), None, None
        self._blocks, self._scans, self._earlier = [], 0, ()

    def _start_drive(self, drive: Drive) -> None:
        if self._drive is not None and self._blocks:
            self._earlier = (*self._earlier, self._record(self._drive))
        self._drive = drive if isinstance(drive, PeriodicSweep | LinearSweep) and self._channels else None
        self._blocks, self._scans = [], 0

    def _add_block(self, drive: PeriodicSweep | LinearSweep, block: Block) -> None:
        if self._scans > min(drive.duration_s * self._rate_hz, MAX_SCANS):  # the ringing afterwards
            return
        self._blocks.append(block.raw)
        self._scans += block.raw.shape[1]
        now_s = self._clock()
        if now_s - self._submitted_s >= self._pause_s:
            self._submitted_s = now_s
            self._worker.submit((self._entry, (*self._earlier, self._record(drive))))

    def _record(self, drive: PeriodicSweep | LinearSweep) -> SweepRecord:
        return SweepRecord(drive, tuple(self._blocks), self._rate_hz, self._channels, self._delay_s)

    def _compute(self, request: tuple[object, tuple[SweepRecord, ...]]) -> Iterator[ResultCurve | None]:
        from protocols.measurements.response_curve import frequency_response_curve

        entry, (*earlier, running) = request
        if self._computed[0] is not entry:
            self._computed = entry, []
        done = self._computed[1]
        done += [record.response() for record in earlier[len(done) :]]
        parts = [part for part in (*done, running.response()) if part is not None]
        curve = frequency_response_curve(_joined(parts), running.progress) if parts else None
        yield None if curve is None else _over_the_band(curve, running.drive.start_hz, running.drive.stop_hz)

    def _store(self, request: tuple[object, tuple[SweepRecord, ...]], result: ResultCurve | Exception | None) -> None:
        if request[0] is self._entry and not isinstance(result, Exception):
            self.latest = result


def _joined(parts: "Sequence[FrequencyResponse]") -> "FrequencyResponse":
    """Return responses of sweeps that follow each other as one, each up to where the next begins."""
    from protocols.signals.response import concatenate_responses

    parts = sorted(parts, key=lambda part: float(part.frequency_hz[0]))
    starts = [float(part.frequency_hz[0]) for part in parts[1:]]
    kept = [part.within(0.0, math.nextafter(start, 0.0)) for part, start in zip(parts, starts, strict=False)]
    return concatenate_responses([*kept, parts[-1]])


def _over_the_band(curve: ResultCurve, *ends_hz: float) -> ResultCurve:
    """Return the curve with empty lines at the ends of the running sweep's band, so that its axis does not grow with it."""
    frequency = curve.columns[curve.x].values
    low = np.array([end for end in ends_hz if end < frequency[0]])
    high = np.array([end for end in ends_hz if end > frequency[-1]])
    columns = {}
    for name, column in curve.columns.items():
        before, after = (low, high) if name == curve.x else (np.full(low.size, np.nan), np.full(high.size, np.nan))
        columns[name] = replace(column, values=np.concatenate((before, column.values, after)))
    return replace(curve, columns=columns)
