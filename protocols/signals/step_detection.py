"""Weight step detector: finds a weight placed on the tactor in the laser's trace, block by block.

The trace is looked at in windows of whole cycles of the mains. Where a few windows in a row agree in mean and in spread, the
trace is quiet: that is the zero, and it follows slow drift while nothing happens. A move is a landing once the trace is quiet again at another
level; back at the old one it was a bump. Nothing is decided from a single sample.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from model import Array
from protocols.signals.checks import check_positive
from protocols.signals.held_level import MAINS_HZ, combine_errors, estimate_level


class StepDetectionState(StrEnum):
    """State of the detector; see `WeightStepDetector`."""

    ZEROING = "zeroing"
    READY = "ready"
    MOVING = "moving"
    SETTLED = "settled"


@dataclass(frozen=True, slots=True)
class WeightStep:
    """A mass has landed (or was lifted) and the trace has settled. Times in s since the first sample that was fed.

    Attributes:
        crossed_at_s: when the trace crossed the middle between the two levels for the last time.
        settled_at_s: from when on it was quiet.
        size: level after - level before, in the unit of the samples.
        standard_error: of the size, mains and slow noise included.
        degrees_of_freedom: of the standard error; see `coverage_factor`.
        bumps: moves since the detector was ready that came back.
    """

    crossed_at_s: float
    settled_at_s: float
    size: float
    standard_error: float
    degrees_of_freedom: float
    bumps: int


@dataclass
class WeightStepDetector:
    """Detector of one weight step: takes the trace in blocks and returns one `WeightStep`.

        ZEROING -- quiet --> READY -- leaves the zero --> MOVING -- quiet elsewhere --> SETTLED
                               ^------- quiet at the zero, a bump -------/

    Args:
        rate_hz: samples per second.
        min_step: smallest change that counts as a landing, in the unit of the samples.
        tolerance: windows that agree this well are quiet; None: a twentieth of `min_step`. Creep after the landing is
            tolerated up to a hundredth of the step besides.
        window_s: of one window; 0.1 s is whole cycles of both 50 and 60 Hz.
        window_count: that must agree.
        mains_hz: see `level`.
        history_s: of a move are kept; a longer one loses its start, and its landing is at worst detected late.
    """

    rate_hz: float
    min_step: float
    tolerance: float | None = None
    window_s: float = 0.1
    window_count: int = 5
    mains_hz: float | None = MAINS_HZ
    history_s: float = 60.0
    state: StepDetectionState = StepDetectionState.ZEROING
    zero_level: float = math.nan
    """The level taken as zero; NaN before there is one."""

    _pending: Array = field(default_factory=lambda: np.empty(0))
    _quiet_windows: deque[Array] = field(default_factory=deque)
    _window_statistics: deque[tuple[float, float]] = field(default_factory=deque)
    """Mean and standard deviation of each of the quiet windows: a trace may be watched for hours."""
    _moving_windows: deque[Array] = field(default_factory=deque)
    _zero_samples: Array = field(default_factory=lambda: np.empty(0))
    _samples_seen: int = 0
    _bumps: int = 0

    CREEP_SHARE = 0.01

    def __post_init__(self) -> None:
        check_positive(rate_hz=self.rate_hz, min_step=self.min_step, window_s=self.window_s)
        if self.tolerance is None:
            self.tolerance = self.min_step / 20
        if not 0 < 2 * self.tolerance < self.min_step:
            raise ValueError(
                f"tolerance {self.tolerance:g} must be positive and less than half of the smallest step, {self.min_step:g}"
            )
        if self._window_length < 8 or self.window_count < 3:
            raise ValueError(
                f"{self.window_count} windows of {self.window_s:g} s at {self.rate_hz:g} Hz cannot tell quiet: "
                "at least 3 windows of 8 samples are needed"
            )

    @property
    def _window_length(self) -> int:
        return round(self.window_s * self.rate_hz)

    def feed(self, samples: Array) -> WeightStep | None:
        """Take more samples, (N,); NaN where the sensor was out of range. The landing, once it is settled."""
        if self.state is StepDetectionState.SETTLED:
            return None
        self._pending = np.concatenate([self._pending, np.asarray(samples, float)])
        while len(self._pending) >= self._window_length:
            window, self._pending = self._pending[: self._window_length], self._pending[self._window_length :]
            self._samples_seen += self._window_length
            if landing := self._process_window(window):
                self.state = StepDetectionState.SETTLED
                return landing
        return None

    def _process_window(self, window: Array) -> WeightStep | None:
        mean = float(window.mean())
        about = window - mean
        self._quiet_windows.append(window)
        self._window_statistics.append((mean, math.sqrt(float(about @ about) / window.size)))
        if len(self._quiet_windows) > self.window_count:
            self._quiet_windows.popleft()
            self._window_statistics.popleft()
        means, spreads = zip(*self._window_statistics, strict=True)
        together = sum(means) / len(means)
        gap = abs(mean - self.zero_level)  # NaN, out of range, is not within any tolerance
        assert self.tolerance is not None
        if self.state is StepDetectionState.READY and not gap <= self.tolerance:
            self.state = StepDetectionState.MOVING
            self._moving_windows = deque(
                [*list(self._quiet_windows)[-2:-1]], maxlen=math.ceil(self.history_s / self.window_s)
            )
        if self.state is StepDetectionState.MOVING:
            self._moving_windows.append(window)
        step = abs(together - self.zero_level) if self._zero_samples.size else 0.0
        allowed = (
            self.tolerance
            if self.state is not StepDetectionState.MOVING
            else max(self.tolerance, self.CREEP_SHARE * step)
        )
        if (
            len(means) < self.window_count
            or math.isnan(together)
            or max(means) - min(means) > allowed
            or max(spreads) - min(spreads) > min(spreads) + self.tolerance
        ):
            return None
        match self.state:
            case StepDetectionState.MOVING if step >= self.min_step:
                return self._measure_step()
            case StepDetectionState.MOVING:
                # Back at the zero, or near it: too little for a weight put on. The zero is measured again from here.
                self._bumps += 1
                self._set_zero()
            case _:
                self._set_zero()
        return None

    def _set_zero(self) -> None:
        self.state = StepDetectionState.READY
        self._zero_samples = np.concatenate(self._quiet_windows)
        self.zero_level = float(self._zero_samples.mean())

    def _measure_step(self) -> WeightStep:
        before, after = (
            estimate_level(self._zero_samples, self.rate_hz, self.mains_hz),
            estimate_level(np.concatenate(self._quiet_windows), self.rate_hz, self.mains_hz),
        )
        trace = np.concatenate(self._moving_windows)
        side = np.sign(after.value - before.value)
        short = np.flatnonzero(~(side * (trace - 0.5 * (before.value + after.value)) > 0))
        crossed = self._samples_seen - trace.size + (int(short[-1]) + 1 if short.size else 0)
        error, freedom = combine_errors(before, after)
        return WeightStep(
            crossed_at_s=crossed / self.rate_hz,
            settled_at_s=(self._samples_seen - self.window_count * self._window_length) / self.rate_hz,
            size=after.value - before.value,
            standard_error=error,
            degrees_of_freedom=freedom,
            bumps=self._bumps,
        )
