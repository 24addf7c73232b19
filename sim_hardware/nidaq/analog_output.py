"""Simulated analogue output of the card: holds its last value; a reset or power-up gives 0 V."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model import Array
from sim_hardware.generators import SegmentFactory
from sim_hardware.plant import ConstantSegment, Segment, VoltageHistory

RANGE_V = 10.0
VOLTS_PER_COUNT = 2 * RANGE_V / 65536
_STEP_V = 0.04
"""Largest step of a rendered drive that is not reported as a jump."""

_PAGE_SAMPLES = 4_000_000
"""Number of samples per search for jumps: a drive may have 80 million."""

Counts = NDArray[np.int16]


@dataclass(frozen=True, slots=True, eq=False)
class SampledSegment:
    """A converter's output: count `k` at `origin_s + k / rate_hz`, the last one held; `before_v` until the first.

    Steps within the limit of a rendered drive are rendered as slopes, larger ones as jumps.
    """

    origin_s: float
    rate_hz: float
    counts: Counts
    volts_per_count: float
    initial_v: float

    @property
    def constant_from_s(self) -> float:
        return self.origin_s + (self.counts.size - 1) / self.rate_hz

    @property
    def breakpoints_s(self) -> tuple[float, ...]:
        if not math.isfinite(self.origin_s):
            return ()
        before, jumps = np.int32(np.rint(self.initial_v / self.volts_per_count)), []
        for first in range(0, self.counts.size, _PAGE_SAMPLES):
            page = self.counts[first : first + _PAGE_SAMPLES].astype(np.int32)
            steps = np.abs(np.diff(page, prepend=before)) * self.volts_per_count
            jumps += (first + np.flatnonzero(steps > _STEP_V)).tolist()
            before = page[-1]
        return tuple(self.origin_s + k / self.rate_hz for k in jumps)

    def volts(self, t: Array) -> Array:
        if not math.isfinite(self.origin_s):
            return np.full(np.shape(t), self.initial_v)
        place = (np.asarray(t, float) - self.origin_s) * self.rate_hz
        below = np.floor(place).astype(np.int64)
        here = self.counts[np.clip(below, 0, self.counts.size - 1)] * self.volts_per_count
        step = self.counts[np.clip(below + 1, 0, self.counts.size - 1)] * self.volts_per_count - here
        volts = here + np.where(np.abs(step) > _STEP_V, 0.0, step * (place - below))
        return np.where(below < 0, self.initial_v, volts)


def to_counts(volts: Array) -> Counts:
    """Return the converter's counts for these volts."""
    return np.rint(volts / VOLTS_PER_COUNT).clip(-32768, 32767).astype(np.int16)


class SimulatedAnalogOutput:
    """One output.

    Args:
        emit: function that outputs the segment of the given factory.

    Attributes:
        owner: playing task, if any.
    """

    def __init__(self, emit: Callable[[SegmentFactory], None]) -> None:
        self._emit = emit
        self._history = VoltageHistory(0.0)
        self._segment: Segment = ConstantSegment(0.0)
        self.owner: object | None = None
        self.reset()

    def reset(self) -> None:
        """Power-up or device reset: 0 V."""
        self.emit(lambda _: ConstantSegment(0.0))

    def hold(self, volts: float) -> None:
        """Hold a level."""
        level = float(to_counts(np.array([volts]))[0]) * VOLTS_PER_COUNT
        self.emit(lambda _: ConstantSegment(level))

    def play(self, counts: Counts, rate_hz: float, start: Callable[[float], float]) -> float:
        """Play samples from `start(now)`; return this time."""
        origin = [0.0]

        def make(t: float) -> Segment:
            origin[0] = start(t)
            before = float(self._segment.volts(np.array([t]))[0])
            return SampledSegment(origin[0], rate_hz, counts, VOLTS_PER_COUNT, before)

        self.emit(make)
        return origin[0]

    def freeze(self) -> None:
        """Hold the present level, like a stopped task."""
        self.emit(lambda t: ConstantSegment(float(self._segment.volts(np.array([t]))[0])))

    def volts(self, t: Array) -> Array:
        """Volts at the output at past times `t`, ascending."""
        return self._history.volts(t)

    def emit(self, make: SegmentFactory) -> None:
        """Output the segment that is made for the present time."""

        def kept(t: float) -> Segment:
            self._segment = make(t)
            self._history.append(t, self._segment)
            return self._segment

        self._emit(kept)
