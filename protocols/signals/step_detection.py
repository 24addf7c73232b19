"""Weight step detector: detects a weight placed on the tactor in the laser's trace, block by block.

The trace is evaluated in windows of whole cycles of the mains. The trace is quiet if a few successive windows agree in mean and
spread: this level is the zero, which follows slow drift. A move is a landing if the trace becomes quiet at another level, and a
bump if it returns to the old one. No decision depends on a single sample.
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
    """A mass has landed (or was lifted) and the trace has settled. Times in s since the first sample.

    Attributes:
        crossed_at_s: time of the last crossing of the middle between both levels.
        settled_at_s: begin of the quiet trace.
        size: level after - level before, in the unit of the samples.
        standard_error: of the size, mains and slow noise included.
        degrees_of_freedom: of the standard error.
        bumps: number of moves that returned, since the detector was ready.
    """

    crossed_at_s: float
    settled_at_s: float
    size: float
    standard_error: float
    degrees_of_freedom: float
    bumps: int


@dataclass
class WeightStepDetector:
    """Detector of one weight step: processes the trace in blocks and returns one `WeightStep`.

        ZEROING -- quiet --> READY -- leaves the zero --> MOVING -- quiet elsewhere --> SETTLED
                               ^------- quiet at the zero, a bump -------/

    Args:
        rate_hz: samples per second.
        min_step: smallest change that counts as a landing, in the unit of the samples.
        tolerance: largest difference of quiet windows; None: a twentieth of `min_step`. In addition creep after the landing is
            tolerated up to a hundredth of the step.
        window_s: duration of a window; 0.1 s is a whole number of cycles of 50 and 60 Hz.
        window_count: number of windows that must agree.
        mains_hz: see `level`.
        history_s: stored part of a move; a longer move loses its start, and its landing is at worst detected late.
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
    """The zero level; NaN before the first quiet trace."""

    _pending: Array = field(default_factory=lambda: np.empty(0))
    _quiet_windows: deque[Array] = field(default_factory=deque)
    _window_statistics: deque[tuple[float, float]] = field(default_factory=deque)
    """Mean and standard deviation of the quiet windows, without samples, as a trace may last for hours."""
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
                f"{self.window_count} windows of {self.window_s:g} s at {self.rate_hz:g} Hz cannot detect a quiet trace: "
                "at least 3 windows of 8 samples are needed"
            )

    @property
    def _window_length(self) -> int:
        return round(self.window_s * self.rate_hz)

    def feed(self, samples: Array) -> WeightStep | None:
        """Process more samples, (N,), NaN for a sensor out of range; return the settled landing, None before it."""
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
                # Back near the zero: too small a step for a weight. The zero is measured again.
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
