"""Card reading: the card's last measured values with their time, and the thread that reads the card while the program waits."""

import contextlib
import math
import queue
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drivers.clock import Clock, WallClock
from drivers.drive_shapes import Drive, swings
from drivers.errors import AcquisitionError, ScansLostError
from drivers.interfaces import Block, Closeable, InputChannel, RestartableStream, SkippingStream, Stream
from drivers.sensors import LaserSensor

DRIVE_CHANNEL, DISPLACEMENT_CHANNEL = 0, 1
"""Rows of a block."""

WINDOW_S = 0.15
"""Time over which lowest and highest volts are taken, and how much earlier the block ended with which the last is compared.

With a block and its way to a view it is the longest time for which the view shows volts that the last block contradicts: 0.3 s.
"""

STEADY_V, LEVEL_V, SWINGING_V = 0.02, 0.05, 0.5
"""Volts at the amplifier's input: noise of the card; largest swing of one level; least swing that a sensor must follow."""

STILL_RATIO = 1.5
"""Largest swing of a sensor that stands still under a drive, relative to its least swing without one: its noise."""

SILENT_S = 8.0
"""Real seconds without a block after which the card counts as silent; a driver that has a timeout of its own reports first."""

READ_AHEAD_S, SHARED_READ_AHEAD_S = 20.0, 1.0
"""Bench seconds of blocks kept for a program that is held up; fewer at raised speed, where bench time waits for the reader."""

CLOCK_DRIFT = 1e-4
"""Largest relative difference between the clocks of card and computer: 50 ppm each."""

Volts = tuple[float, float]
"""Lowest and highest."""


@dataclass(frozen=True, slots=True)
class CardReading:
    """What the card measured lately.

    Attributes:
        drive_v: volts at the amplifier's input over the last WINDOW_S.
        block_v: the same in the last block alone.
        measured_s: time (time.monotonic) of the last sample.
        earlier_v: volts of a block that ended WINDOW_S before the last; None where the acquisition is younger.
        monitor_v: volts at the specimen over the last WINDOW_S, by a channel of kind `voltage-monitor`; None without one.
        sensor_in_range: whether the displacement sensor has seen a target in the last block.
        sensor_still: whether its output stood still when the drive swung last.
        unread: whether the last attempt to read the card failed.
    """

    drive_v: Volts
    block_v: Volts
    measured_s: float
    earlier_v: Volts | None = None
    monitor_v: Volts | None = None
    sensor_in_range: bool = True
    sensor_still: bool = False
    unread: bool = False

    def age_s(self, now_s: float) -> float:
        """Return the age of the last sample at a time (time.monotonic)."""
        return max(now_s - self.measured_s, 0.0)

    @property
    def moves(self) -> bool:
        """Whether a block's lowest or highest volts have changed within WINDOW_S, or may have."""
        earlier = self.earlier_v or (-math.inf, math.inf)
        return any(abs(now - before) > STEADY_V for now, before in zip(self.block_v, earlier, strict=True))

    def lacks_swing(self, drive: Drive) -> bool:
        """Whether the input has stood at one level for WINDOW_S, in which this drive passes a whole cycle."""
        return self.drive_v[1] - self.drive_v[0] <= LEVEL_V and swings(drive, WINDOW_S)


class _Kept:
    """A block of the acquisition with lowest and highest counts of each channel, computed once."""

    def __init__(self, block: Block) -> None:
        self.block = block

    @cached_property
    def ends(self) -> list[tuple[int, int]]:
        return [(int(row.min()), int(row.max())) for row in self.block.raw]


class WatchedStream(Closeable):
    """A stream with its last measured values. In real time its blocks are read in a separate thread.

    So the card is read while the program waits for a reply, a ramp or the disk; `read` returns its blocks in order. After
    lost scans it acquires again, and `read` raises once; after any other error the next `read` tries again.

    Args:
        clock: bench time.
        block_s: duration of a block.
        sensor: displacement sensor.
        channels: further inputs, in the order of a block's rows from the third on.
        before: what the card measured before this acquisition.
        heartbeat: callback with the age of every block that was read, real seconds.
    """

    def __init__(
        self,
        stream: Stream,
        clock: Clock,
        block_s: float,
        sensor: LaserSensor,
        channels: Sequence[InputChannel] = (),
        before: CardReading | None = None,
        heartbeat: Callable[[float], object] = lambda _age_s: None,
    ) -> None:
        self.rate_hz, self.scales, self.start_time_s = stream.rate_hz, stream.scales, stream.start_time_s
        self._stream, self._clock, self._sensor, self._heartbeat = stream, clock, sensor, heartbeat
        self._reading, self._reading_of = before, tuple[_Kept, ...]()
        """The reading that was computed last, and its blocks."""
        self._before_s = 0.0 if before is None else before.age_s(time.monotonic())
        self._monitors = [(k, each) for k, each in enumerate(channels, 2) if each.kind == "voltage-monitor"]
        self.high_voltage_on = False
        """Whether the drive moves the specimen, so that the sensor must follow it."""
        self._noted: tuple[tuple[_Kept, ...], float] = (), math.inf
        """The last blocks, and `measured_s`; infinite on a clock that stands still between two reads."""
        self._failed_s, self._noise, self._still = math.inf, math.inf, False
        """Since when (time.monotonic) the card cannot be read; the sensor's least swing without a drive, counts; and whether it
        stood still under the last drive."""
        self._usual_s, self._stop = 0.0, 0
        """How long after its last sample a block usually arrives, bench seconds; and the scan after the last block."""
        self._speed = float(getattr(clock, "speed", 1.0))
        self._block_s = block_s / self._speed
        ahead_s = READ_AHEAD_S if getattr(clock, "shared", None) is None else SHARED_READ_AHEAD_S
        self._arrived: queue.Queue[Block | BaseException] = queue.Queue(max(round(ahead_s / block_s), 2))
        self._closing, self._runs = threading.Event(), isinstance(clock, WallClock)
        if self._runs:
            self._begin()

    @property
    def reading(self) -> CardReading | None:
        """What the card measured last, from any thread; None before the first block."""
        blocks, measured_s = self._noted
        if blocks is not self._reading_of:
            self._reading, self._reading_of = self._compute(blocks, measured_s), blocks
        if self._reading is None:
            return None
        unread = self._failed_s < math.inf
        if self._runs:
            return replace(self._reading, unread=True) if unread else self._reading
        stop_s = blocks[-1].block.stop / self.rate_hz if blocks else -self._before_s
        passed_s = self._clock.now() - (self.start_time_s + stop_s)
        measured_s = min(time.monotonic(), self._failed_s) - max(passed_s, 0.0)
        return replace(self._reading, measured_s=measured_s, unread=unread)

    def read(self) -> Block:
        """Return the next block.

        Raises:
            ScansLostError: scans were lost before it.
            AcquisitionError: the card is gone, or silent.
        """
        return self.read_within(SILENT_S + self._block_s)

    def read_within(self, seconds: float) -> Block:
        """Return the next block if it arrives within these real seconds; raises as `read`."""
        if not self._runs:
            return self._read()
        if self._ended and self._arrived.empty():
            self._begin()
        try:
            block = self._arrived.get(timeout=seconds)
        except queue.Empty:
            raise AcquisitionError(
                f"the card has delivered nothing for {seconds:.1f} s; check its cable or its network, and whether its server runs"
            ) from None
        if isinstance(block, BaseException):
            raise block
        return block

    def skip(self, seconds: float) -> float:
        """Let up to `seconds` pass without their samples, where the clock is virtual; return the skipped seconds, 0 elsewhere."""
        return self._stream.skip(seconds) if isinstance(self._stream, SkippingStream) and not self._runs else 0.0

    def close(self) -> None:
        """Stop the card."""
        self._closing.set()
        if self._runs:
            self._thread.join(2 * self._block_s + 0.5)  # a silent card's call does not return
        self._stream.__exit__(None, None, None)

    def _begin(self) -> None:
        self._ended = False
        self._thread = threading.Thread(target=self._read_on, name="card", daemon=True)
        self._thread.start()

    def _read_on(self) -> None:
        lost = False
        try:
            while not self._closing.is_set():
                try:
                    self._put(self._read())
                    lost = False
                except ScansLostError as error:
                    if not lost or self._arrived.empty():
                        self._put(error)
                    lost = True
                    self._closing.wait(self._block_s)
        except BaseException as error:  # noqa: BLE001 - raised by `read`, in the program's thread
            self._ended = True
            self._put(error)

    def _put(self, item: Block | BaseException) -> None:
        while not self._closing.is_set():
            with contextlib.suppress(queue.Full):
                self._arrived.put(item, timeout=self._block_s)
                return

    def _read(self) -> Block:
        try:
            block = self._stream.read()
        except BaseException as error:
            self._failed_s = min(self._failed_s, time.monotonic())
            if isinstance(error, ScansLostError) and isinstance(self._stream, RestartableStream):
                self._stream.restart()
            raise
        late_s = self._clock.now() - (self.start_time_s + block.stop / self.rate_hz)
        # The clocks of card and computer drift apart: only a block that is later than the ones before it is old.
        self._usual_s = min(late_s, self._usual_s + CLOCK_DRIFT * (block.stop - self._stop) / self.rate_hz)
        oldest, (kept, _) = block.start - WINDOW_S * self.rate_hz, self._noted
        blocks = (*(each for each in kept if each.block.stop >= oldest or each is kept[-1]), _Kept(block))
        measured_s = time.monotonic() - (late_s - self._usual_s) / self._speed if self._runs else math.inf
        self._noted, self._failed_s, self._stop = (blocks, measured_s), math.inf, block.stop
        self._heartbeat((late_s - self._usual_s) / self._speed)
        return block

    def _compute(self, blocks: Sequence[_Kept], measured_s: float) -> CardReading:
        last = blocks[-1]
        begin = last.block.stop - WINDOW_S * self.rate_hz
        present = [each.ends for each in blocks if each.block.stop > begin]
        earlier = [each.ends for each in blocks if each.block.stop <= begin]
        drive_v, block_v = self._volts(DRIVE_CHANNEL, present), self._volts(DRIVE_CHANNEL, [last.ends])
        low, high = _extremes(DISPLACEMENT_CHANNEL, present)
        swing, drive_swing_v = float(high - low), drive_v[1] - drive_v[0]
        if drive_swing_v <= LEVEL_V:
            self._noise = min(self._noise, swing)
        monitors = [channel.values(np.array(self._volts(row, present))) for row, channel in self._monitors]
        if self.high_voltage_on and drive_swing_v >= SWINGING_V and math.isfinite(self._noise):
            self._still = swing <= STILL_RATIO * self._noise
        return CardReading(
            drive_v,
            block_v,
            measured_s,
            self._volts(DRIVE_CHANNEL, earlier[-1:]) if earlier else None,
            (float(monitors[0].min()), float(monitors[0].max())) if monitors else None,
            self._sees_target(last),
            self._still,
        )

    def _sees_target(self, last: _Kept) -> bool:
        """Return whether any sample of a block is a displacement; its lowest and highest are looked at first."""
        for raw in (np.array(last.ends[DISPLACEMENT_CHANNEL], np.int16), last.block.raw[DISPLACEMENT_CHANNEL]):
            if self._sensor.is_valid(self.scales[DISPLACEMENT_CHANNEL].to_volts(raw)).any():
                return True
        return False

    def _volts(self, row: int, ends: Iterable[Sequence[tuple[int, int]]]) -> Volts:
        """Return lowest and highest volts of a channel in several blocks."""
        low_v, high_v = sorted(map(float, self.scales[row].to_volts(np.array(_extremes(row, ends), np.int16))))
        return low_v, high_v


def _extremes(row: int, ends: Iterable[Sequence[tuple[int, int]]]) -> tuple[int, int]:
    """Return lowest and highest counts of a channel in several blocks."""
    lows, highs = zip(*(each[row] for each in ends), strict=True)
    return min(lows), max(highs)
