"""Live feed of samples to the screen: scaled and min/max decimated in the bench thread, block by block."""

import math
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.live.minmax_trace import MinMaxTrace
from app.live.running_curve import RunningCurve
from drivers import Block, InputChannel, LaserSensor, Scale
from protocols.base import ChannelCalibration


@dataclass(frozen=True, slots=True)
class TimeSpan:
    """A displayed and a buffered duration. A triggered span buffers more, so that its cycles can be aligned."""

    shown_s: float
    buffer_s: float
    triggered: bool = False

    @property
    def columns(self) -> int:
        return round(COLUMNS * self.buffer_s / self.shown_s)

    def make_trace(self) -> MinMaxTrace:
        """Return an empty trace of this span."""
        return MinMaxTrace(self.buffer_s, self.columns)


COLUMNS = 1000
MAX_DELAY_S = 0.4
"""Largest delay of the display behind the newest sample: twice a change of the drive, during which no block is read."""

SPANS = (
    TimeSpan(0.1, 0.2 + MAX_DELAY_S, triggered=True),
    TimeSpan(1.0, 1.0 + MAX_DELAY_S),
    TimeSpan(10.0, 10.0 + MAX_DELAY_S),
)

ARRIVALS = 40
"""Number of blocks for the timing of the display: two seconds in real time."""

READING_BLOCKS = 10
"""Number of blocks averaged for a reading: two seconds in real time."""


@dataclass(frozen=True, slots=True)
class LiveValues:
    """Mean volts of the last two seconds while the card is watched between runs.

    Attributes:
        drive_v: at the amplifier's input.
        sensor_v: of the displacement sensor's output.
        sensor_error_v: standard error of its mean, from the scatter of the blocks.
        displacement_um: by the bench's calibration; NaN out of range.
        blocks: number of blocks averaged.
        age_s: seconds since the last block arrived.
    """

    drive_v: float
    sensor_v: float
    sensor_error_v: float
    displacement_um: float
    blocks: int
    age_s: float


class LiveFeed:
    """Drive in volts at the amplifier's input and displacement in micrometres (a vibrometer's velocity in mm/s), the last of each of `SPANS`."""

    def __init__(self) -> None:
        self._traces = {span: [span.make_trace() for _ in range(2)] for span in SPANS}
        """Of drive, displacement and the further channels."""
        self._inputs: tuple[InputChannel, ...] = ()
        self._scales: tuple[Scale, ...] = ()
        self._lock = threading.Lock()
        self._channels: tuple[ChannelCalibration, ...] = ()
        self._is_velocity = False
        self._rate_hz = 1.0
        self._scans = 0
        self._arrivals: deque[tuple[float, float, float]] = deque(maxlen=ARRIVALS)
        """Monotonic time of arrival, bench time before and after each of the last blocks."""
        self._latest_um: float | None = None
        self._monitored: deque[tuple[float, float]] = deque(maxlen=READING_BLOCKS)
        """Mean volts of drive and sensor, block by block."""
        self._monitored_at_s = 0.0
        self.running_curve = RunningCurve()
        """Curve of the entry that is being measured."""

    @property
    def streamed_s(self) -> float:
        """Bench time of the samples since the stream began."""
        with self._lock:
            return self._scans / self._rate_hz

    @property
    def last_block_s(self) -> float:
        """Time (time.monotonic) at which the last block arrived; NaN without one."""
        with self._lock:
            return self._arrivals[-1][0] if self._arrivals else math.nan

    def displayed_s(self, now_s: float) -> float:
        """Return the bench time to display at a monotonic time: it moves evenly and is never beyond the last sample.

        Samples arrive in blocks, and late after a change of the drive. A line through the arrivals of the last blocks, moved
        until the latest of them is on time, is where a display has samples at any time; it is `MAX_DELAY_S` behind the
        earliest at most.
        """
        with self._lock:
            arrivals, streamed_s = tuple(self._arrivals), self._scans / self._rate_hz
        arrived_s, before_s, after_s = np.array(arrivals).reshape(-1, 3).T
        half = len(arrivals) // 2
        elapsed_s = arrived_s[half:] - arrived_s[: len(arrivals) - half]
        if not half or not elapsed_s.all():
            return streamed_s
        rate = np.median(
            (after_s[half:] - after_s[: len(arrivals) - half]) / elapsed_s
        )  # a few late blocks do not count
        latest_s, earliest_s = (before_s - rate * arrived_s).min(), (after_s - rate * arrived_s).max()
        return float(min(max(latest_s, earliest_s - MAX_DELAY_S) + rate * now_s, streamed_s))

    def start_stream(
        self, rate_hz: float, scales: tuple[Scale, ...], sensor: LaserSensor, inputs: Sequence[InputChannel] = ()
    ) -> None:
        """Start a stream; drops earlier samples. `inputs` are the further channels, in the order of a block's rows."""
        self.running_curve.start_stream(rate_hz, scales, sensor)
        with self._lock:
            self._inputs, self._scales = tuple(inputs), scales[2:]
            for span, traces in self._traces.items():
                self._traces[span] = [*traces[:2], *(span.make_trace() for _ in inputs)]
                for trace in self._traces[span]:
                    trace.reset(rate_hz)
            self._channels, self._is_velocity = ChannelCalibration.pair(scales, sensor), sensor.measures_velocity
            self._rate_hz, self._scans = rate_hz, 0
            self._arrivals.clear()
            self._monitored.clear()

    def add_block(self, block: Block, monitored: bool = False) -> None:
        """Append a block; a block before `start_stream` is dropped, because its scale is unknown.

        Args:
            block: of the card.
            monitored: whether it was read between runs, and contributes to `reading`.
        """
        if not self._channels:
            return
        drive_v, displacement_m = (channel.to_si(raw) for channel, raw in zip(self._channels, block.raw, strict=False))
        displacement_um = (1e3 if self._is_velocity else 1e6) * displacement_m
        further = zip(self._inputs, self._scales, block.raw[2:], strict=False)
        values = [drive_v, displacement_um, *(channel.values(scale.to_volts(raw)) for channel, scale, raw in further)]
        for traces in self._traces.values():
            for trace, samples in zip(traces, values, strict=False):
                trace.append(samples)
        with self._lock:
            before_s = self._scans / self._rate_hz
            self._scans += block.raw.shape[1]
            self._arrivals.append((time.monotonic(), before_s, self._scans / self._rate_hz))
            self._latest_um = None if self._is_velocity else float(displacement_um.mean())
            if monitored:
                volts = self._channels[1].scale.to_volts(block.raw[1])
                self._monitored.append((float(drive_v.mean()), float(volts.mean())))
                self._monitored_at_s = time.monotonic()

    def restart_reading(self) -> None:
        """Begin a new mean: the target has moved."""
        with self._lock:
            self._monitored.clear()

    @property
    def reading(self) -> LiveValues | None:
        """Mean of the last two seconds while the card is watched between runs; None without one."""
        with self._lock:
            if not self._monitored or not self._channels:
                return None
            drive_v, sensor_v = np.mean(self._monitored, axis=0)
            blocks = len(self._monitored)
            error_v = (
                float(np.std([v for _, v in self._monitored], ddof=1)) / math.sqrt(blocks) if blocks > 1 else math.nan
            )
            sensor = self._channels[1].sensor
            metres = sensor.displacement_m(np.array([sensor_v]))[0] if sensor is not None else math.nan
            if sensor is not None and (self._is_velocity or not sensor.is_valid(np.array([sensor_v])).all()):
                metres = math.nan
            age_s = time.monotonic() - self._monitored_at_s
            return LiveValues(float(drive_v), float(sensor_v), error_v, 1e6 * float(metres), blocks, age_s)

    @property
    def latest_um(self) -> float | None:
        """Mean displacement of the latest block; None before the first, and with a vibrometer."""
        with self._lock:
            return self._latest_um

    @property
    def moved(self) -> tuple[str, str]:
        """Name and shown unit of the quantity that the sensor measures."""
        with self._lock:
            return ("Velocity", "mm/s") if self._is_velocity else ("Displacement", "µm")

    @property
    def channels(self) -> tuple[tuple[str, str], ...]:
        """Names and units of the further channels."""
        with self._lock:
            return tuple((channel.name, channel.unit) for channel in self._inputs)

    def channel_traces(self, span: TimeSpan) -> Sequence[MinMaxTrace]:
        """Return the further channels over one of `SPANS`."""
        return self._traces[span][2:]

    def traces(self, span: TimeSpan) -> Sequence[MinMaxTrace]:
        """Return drive and displacement over one of `SPANS`."""
        return self._traces[span][:2]
