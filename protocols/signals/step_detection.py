"""A mass lands on the tactor: told online from the laser's trace, block by block.

The trace is looked at in windows of whole cycles of the mains. Where a few windows in a row agree in mean and in spread, the
trace is quiet: that is the zero, and it follows slow drift while nothing happens. A move is a landing once the trace is quiet again at another
level; back at the old one it was a bump. Nothing is decided from a single sample.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from protocols.signals.checks import check_positive
from protocols.signals.levels import MAINS_HZ, combined, level

Array = NDArray[np.float64]


class LandingState(StrEnum):
    """What the detector is doing; see `LandingDetector`."""

    ZEROING = "zeroing"
    READY = "ready"
    MOVING = "moving"
    SETTLED = "settled"


@dataclass(frozen=True, slots=True)
class Landing:
    """A mass has landed (or was lifted) and the trace has settled. Times in s since the first sample that was fed.

    Attributes:
        landed_at_s: when the trace crossed the middle between the two levels for the last time.
        settled_at_s: from when on it was quiet.
        size: level after - level before, in the unit of the samples.
        standard_error: of the size, mains and slow noise included.
        degrees_of_freedom: of the standard error; see `coverage_factor`.
        bumps: moves since the detector was ready that came back.
    """

    landed_at_s: float
    settled_at_s: float
    size: float
    standard_error: float
    degrees_of_freedom: float
    bumps: int


@dataclass
class LandingDetector:
    """Feed it the trace; it answers once, with a `Landing`.

        ZEROING -- quiet --> READY -- leaves the zero --> MOVING -- quiet elsewhere --> SETTLED
                               ^------- quiet at the zero, a bump -------/

    Args:
        rate_hz: samples per second.
        least_step: smallest change that counts as a landing, in the unit of the samples.
        tolerance: windows that agree this well are quiet; None: a twentieth of `least_step`. Creep after the landing is
            forgiven up to a hundredth of the step besides.
        window_s: of one window; 0.1 s is whole cycles of both 50 and 60 Hz.
        windows: that must agree.
        mains_hz: see `level`.
        keep_s: of a move are kept; one that lasts longer loses its beginning, and its landing is told too late at worst.
    """

    rate_hz: float
    least_step: float
    tolerance: float | None = None
    window_s: float = 0.1
    windows: int = 5
    mains_hz: float | None = MAINS_HZ
    keep_s: float = 60.0
    state: LandingState = LandingState.ZEROING

    _rest: Array = field(default_factory=lambda: np.empty(0))
    _quiet: deque[Array] = field(default_factory=deque)
    _levels: deque[tuple[float, float]] = field(default_factory=deque)
    """Mean and standard deviation of each of the quiet windows: a trace may be watched for hours."""
    _moved: deque[Array] = field(default_factory=deque)
    _zero: Array = field(default_factory=lambda: np.empty(0))
    _zero_level: float = math.nan
    _seen: int = 0
    _bumps: int = 0

    CREEP_SHARE = 0.01

    def __post_init__(self) -> None:
        check_positive(rate_hz=self.rate_hz, least_step=self.least_step, window_s=self.window_s)
        if self.tolerance is None:
            self.tolerance = self.least_step / 20
        if not 0 < 2 * self.tolerance < self.least_step:
            raise ValueError(
                f"tolerance {self.tolerance:g} must be positive and less than half of the smallest step, {self.least_step:g}"
            )
        if self._length < 8 or self.windows < 3:
            raise ValueError(
                f"{self.windows} windows of {self.window_s:g} s at {self.rate_hz:g} Hz cannot tell quiet: "
                "at least 3 windows of 8 samples are needed"
            )

    @property
    def _length(self) -> int:
        return round(self.window_s * self.rate_hz)

    @property
    def zero(self) -> float:
        """The level taken as zero; NaN before there is one."""
        return self._zero_level

    @property
    def last(self) -> float:
        """Mean of the latest window, for a display; NaN before there is one."""
        return float(self._quiet[-1].mean()) if self._quiet else math.nan

    def feed(self, samples: Array) -> Landing | None:
        """Take more samples, (N,); NaN where the sensor was out of range. The landing, once it is settled."""
        if self.state is LandingState.SETTLED:
            return None
        self._rest = np.concatenate([self._rest, np.asarray(samples, float)])
        while len(self._rest) >= self._length:
            window, self._rest = self._rest[: self._length], self._rest[self._length :]
            self._seen += self._length
            if landing := self._take(window):
                self.state = LandingState.SETTLED
                return landing
        return None

    def _take(self, window: Array) -> Landing | None:
        mean = float(window.mean())
        about = window - mean
        self._quiet.append(window)
        self._levels.append((mean, math.sqrt(float(about @ about) / window.size)))
        if len(self._quiet) > self.windows:
            self._quiet.popleft()
            self._levels.popleft()
        means, spreads = zip(*self._levels, strict=True)
        together = sum(means) / len(means)
        gap = abs(mean - self.zero)  # NaN, out of range, is not within any tolerance
        assert self.tolerance is not None
        if self.state is LandingState.READY and not gap <= self.tolerance:
            self.state = LandingState.MOVING
            self._moved = deque([*list(self._quiet)[-2:-1]], maxlen=math.ceil(self.keep_s / self.window_s))
        if self.state is LandingState.MOVING:
            self._moved.append(window)
        step = abs(together - self.zero) if self._zero.size else 0.0
        allowed = (
            self.tolerance if self.state is not LandingState.MOVING else max(self.tolerance, self.CREEP_SHARE * step)
        )
        if (
            len(means) < self.windows
            or math.isnan(together)
            or max(means) - min(means) > allowed
            or max(spreads) - min(spreads) > min(spreads) + self.tolerance
        ):
            return None
        match self.state:
            case LandingState.MOVING if step >= self.least_step:
                return self._landed()
            case LandingState.MOVING:
                # Back at the zero, or near it: too little for a landing. The zero starts anew from here.
                self._bumps += 1
                self._ready()
            case _:
                self._ready()
        return None

    def _ready(self) -> None:
        self.state = LandingState.READY
        self._zero = np.concatenate(self._quiet)
        self._zero_level = float(self._zero.mean())

    def _landed(self) -> Landing:
        before, after = (
            level(self._zero, self.rate_hz, self.mains_hz),
            level(np.concatenate(self._quiet), self.rate_hz, self.mains_hz),
        )
        trace = np.concatenate(self._moved)
        side = np.sign(after.value - before.value)
        short = np.flatnonzero(~(side * (trace - 0.5 * (before.value + after.value)) > 0))
        crossed = self._seen - trace.size + (int(short[-1]) + 1 if short.size else 0)
        error, freedom = combined(before, after)
        return Landing(
            landed_at_s=crossed / self.rate_hz,
            settled_at_s=(self._seen - self.windows * self._length) / self.rate_hz,
            size=after.value - before.value,
            standard_error=error,
            degrees_of_freedom=freedom,
            bumps=self._bumps,
        )
