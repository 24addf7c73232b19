"""Curve of an entry that is still being measured, computed in the background from the samples so far."""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.live.latest_only import LatestOnlyWorker
from drivers import Block, Drive, LaserSensor, Scale, channel_skew_s
from protocols import aspects_of
from protocols.base import (
    Aspects,
    BlockStored,
    ChannelCalibration,
    DriveStarted,
    EntryStarted,
    Quality,
    Recording,
    RunEnded,
    RunStarted,
    Series,
    SeriesReady,
    ShutdownStarted,
)

PAUSE_S = 0.5
"""Shortest time between two computations."""

MAX_SCANS = 2_000_000
"""A longer record is not computed before it ends."""


@dataclass(frozen=True, slots=True)
class LiveSamples:
    """The samples under one drive so far: the blocks since its start."""

    drive: Drive
    blocks: tuple[NDArray[np.int16], ...]
    rate_hz: float
    channels: tuple[ChannelCalibration, ...]
    delay_s: float

    def recording(self) -> Recording:
        """Return the samples in SI."""
        raw = np.concatenate([block[:2] for block in self.blocks], axis=1)
        volts, metres = (channel.to_si(samples) for channel, samples in zip(self.channels, raw, strict=True))
        sensor = self.channels[1].sensor
        corner_hz = sensor.corner_hz if sensor is not None and sensor.measures_velocity else None
        rows = (0, volts.size)
        return Recording(
            0, rows, self.rate_hz, self.drive, volts, metres, Quality.GOOD, self.delay_s, velocity_corner_hz=corner_hz
        )


@dataclass(frozen=True, slots=True)
class CurveTask:
    """The drives of an entry so far, the last one running; `entry` identifies it: a curve of another one is not shown."""

    entry: object
    aspects: Aspects
    samples: tuple[LiveSamples, ...]


class RunningCurve:
    """Collects samples in the bench thread, and computes the curve of the entry so far in another.

    Args:
        pause_s: shortest time between two computations.
    """

    def __init__(self, pause_s: float = PAUSE_S) -> None:
        self._worker = LatestOnlyWorker(self._compute, self._store, "running curve")
        self._pause_s, self._submitted_s = pause_s, -math.inf
        self._rate_hz, self._delay_s = 1.0, 0.0
        self._channels: tuple[ChannelCalibration, ...] = ()
        self._aspects = Aspects()
        """Of the protocol of the run."""
        self._drive: Drive | None = None
        self._blocks: list[NDArray[np.int16]] = []
        self._scans = 0
        self._earlier: tuple[LiveSamples, ...] = ()
        """Of the finished drives of the entry, such as the pieces of a long sweep."""
        self._entry = object()
        self._computed: tuple[object, list[object]] = None, []
        """An entry, and the parts of its finished drives; used in the worker thread only."""
        self.latest: Series | None = None
        """Curve of the entry so far; None while there is none."""

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
            case RunStarted(protocol=protocol):
                self._aspects = aspects_of(protocol)
                self._reset()
            case EntryStarted() | SeriesReady() | ShutdownStarted() | RunEnded():
                self._reset()

    def close(self) -> None:
        """Stop the thread."""
        self._worker.close()

    def _reset(self) -> None:
        self._entry, self._drive, self.latest = object(), None, None
        self._blocks, self._scans, self._earlier = [], 0, ()

    def _start_drive(self, drive: Drive) -> None:
        if self._drive is not None and self._blocks:
            self._earlier = (*self._earlier, self._samples(self._drive))
        self._drive = drive if self._channels and isinstance(drive, tuple(self._aspects.live_drives)) else None
        self._blocks, self._scans = [], 0

    def _add_block(self, drive: Drive, block: Block) -> None:
        if self._scans > min(drive.duration_s * self._rate_hz, MAX_SCANS):  # the ringing afterwards
            return
        self._blocks.append(block.raw)
        self._scans += block.raw.shape[1]
        now_s = time.monotonic()
        if now_s - self._submitted_s >= self._pause_s:
            self._submitted_s = now_s
            self._worker.submit(CurveTask(self._entry, self._aspects, (*self._earlier, self._samples(drive))))

    def _samples(self, drive: Drive) -> LiveSamples:
        return LiveSamples(drive, tuple(self._blocks), self._rate_hz, self._channels, self._delay_s)

    def _compute(self, task: CurveTask) -> Iterator[Series | None]:
        *earlier, running = task.samples
        if self._computed[0] is not task.entry:
            self._computed = task.entry, []
        done = self._computed[1]
        done += [task.aspects.live_part(samples.recording()) for samples in earlier[len(done) :]]
        recording = running.recording()
        parts = [part for part in (*done, task.aspects.live_part(recording)) if part is not None]
        yield task.aspects.live_curve(parts, recording) if parts else None

    def _store(self, task: CurveTask, result: Series | Exception | None) -> None:
        if task.entry is self._entry and not isinstance(result, Exception):
            self.latest = result
