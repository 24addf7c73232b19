"""Output segments: the exact volts of a generator's output between two changes.

Times are absolute bench seconds. A segment carries its own origin, so that a burst keeps its phase when only its
amplitude changes, and a finite burst returns to its idle level by itself.
"""

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from model import Array

_EDGE_S = 5e-6
"""Duration of a generator's transition between held points: less than the plant's grid."""


class Segment(Protocol):
    """The output during one interval; immutable, and identified by its hash."""

    @property
    def constant_from_s(self) -> float:
        """Time after which the output is constant; infinity if it never is."""

    @property
    def breakpoints_s(self) -> tuple[float, ...]:
        """Return the times at which the output may jump or change its formula."""

    def volts(self, t: Array) -> Array:
        """Volts at bench times `t`, shape (n,)."""


@dataclass(frozen=True, slots=True)
class ConstantSegment:
    """A constant voltage: a held level, or the volts of the amplifier's input with an open output."""

    level_v: float

    @property
    def constant_from_s(self) -> float:
        return -math.inf

    @property
    def breakpoints_s(self) -> tuple[float, ...]:
        return ()

    def volts(self, t: Array) -> Array:
        return np.full(np.shape(t), self.level_v)


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class ArbitraryWaveform:
    """One period of an arbitrary waveform, 1 being the amplitude: smoothed from point to point, or held at each."""

    points: Array
    interpolated: bool = False
    _rises: Array = field(init=False, repr=False)
    """From each point to the next."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "_rises", np.roll(self.points, -1) - self.points)

    @property
    def low(self) -> float:
        return float(self.points.min())

    @property
    def high(self) -> float:
        return float(self.points.max())

    def values_at(self, periods: Array, period_s: float) -> Array:
        """Return the values after a number of periods, same shape."""
        size = self.points.size
        place = np.floor(periods)  # in place, because a slow sweep spends most of its simulated time here
        np.subtract(periods, place, out=place)
        place *= size
        first = place.astype(np.intp)
        np.minimum(first, size - 1, out=first)
        place -= first
        if not self.interpolated:
            place /= min(1.0, _EDGE_S * size / period_s)
            np.minimum(place, 1.0, out=place)
            first -= 1
        place *= self._rises.take(first, mode="wrap")
        place += self.points.take(first, mode="wrap")
        return place


@dataclass(frozen=True, slots=True)
class PeriodicSegment:
    """A sine from `origin_s`, where its phase is `phase_rad`; before it, and after `cycles`, it rests at `idle_v`.

    `period_s` repeats the burst from its origin (an internally triggered burst), infinity plays it once. With `wave` the waveform
    replaces the sine.
    """

    origin_s: float
    frequency_hz: float
    amplitude_v: float
    offset_v: float
    phase_rad: float
    idle_v: float
    cycles: float = math.inf
    period_s: float = math.inf
    waveform: ArbitraryWaveform | None = None

    @property
    def end_s(self) -> float:
        """End of the (first) burst."""
        return self.origin_s + self.cycles / self.frequency_hz

    @property
    def constant_from_s(self) -> float:
        return self.end_s if math.isinf(self.period_s) else math.inf

    @property
    def breakpoints_s(self) -> tuple[float, ...]:
        return (self.origin_s, self.end_s) if math.isfinite(self.cycles) and math.isinf(self.period_s) else ()

    def phase_at(self, t: float) -> float:
        """Phase in radians at time `t` of the running sine."""
        return math.remainder(self.phase_rad + 2 * math.pi * self.frequency_hz * (t - self.origin_s), 2 * math.pi)

    def cycles_until(self, t: float) -> float:
        """Return the number of periods of a single burst until time `t`; 0 of a repeated one."""
        if math.isfinite(self.period_s):
            return 0.0
        return min(max((t - self.origin_s) * self.frequency_hz, 0.0), self.cycles)

    def volts(self, t: Array) -> Array:
        since = np.asarray(t, float) - self.origin_s
        if math.isfinite(self.period_s):
            since = np.mod(since, self.period_s)
        turns = self.frequency_hz * since
        turns += self.phase_rad / (2 * np.pi)
        if self.waveform:
            wave = self.waveform.values_at(turns, 1 / self.frequency_hz)
        else:
            turns *= 2 * np.pi
            wave = np.sin(turns, out=turns)
        wave *= self.amplitude_v
        wave += self.offset_v
        if math.isfinite(self.cycles):
            wave[(since < 0) | (since >= self.cycles / self.frequency_hz)] = self.idle_v
        return wave


@dataclass(frozen=True, slots=True)
class ChirpSegment:
    """A sine swept linearly from `start_hz` to `stop_hz` in `duration_s`; then it stays at the start frequency.

    For instruments that sweep once per trigger: the sweep ends, the sine does not.
    """

    origin_s: float
    start_hz: float
    stop_hz: float
    duration_s: float
    amplitude_v: float
    offset_v: float
    phase_rad: float

    @property
    def constant_from_s(self) -> float:
        return math.inf

    @property
    def breakpoints_s(self) -> tuple[float, ...]:
        return (self.origin_s + self.duration_s,)

    def _cycles_after(self, elapsed_s: Array) -> Array:
        swept = np.clip(elapsed_s, 0.0, self.duration_s)
        rate = (self.stop_hz - self.start_hz) / self.duration_s
        return self.start_hz * swept + 0.5 * rate * swept**2 + self.start_hz * (elapsed_s - swept)

    def phase_at(self, t: float) -> float:
        """Phase in radians at time `t`."""
        turns = float(self._cycles_after(np.asarray(t - self.origin_s)))
        return math.remainder(self.phase_rad + 2 * math.pi * turns, 2 * math.pi)

    def volts(self, t: Array) -> Array:
        turns = self._cycles_after(np.asarray(t, float) - self.origin_s)
        return self.offset_v + self.amplitude_v * np.sin(2 * np.pi * turns + self.phase_rad)


@dataclass(frozen=True, slots=True)
class RelayGlitchSegment:
    """The output relay switches: `during_v` until `until_s`, and only then the new output."""

    until_s: float
    during_v: float
    following: Segment

    @property
    def constant_from_s(self) -> float:
        return max(self.until_s, self.following.constant_from_s)

    @property
    def breakpoints_s(self) -> tuple[float, ...]:
        return (self.until_s, *self.following.breakpoints_s)

    def volts(self, t: Array) -> Array:
        return np.where(np.asarray(t, float) < self.until_s, self.during_v, self.following.volts(t))


@dataclass(frozen=True, slots=True)
class SaggingSegment:
    """A burst that sags towards its offset like a coupling capacitor."""

    burst: PeriodicSegment
    level_v: float
    tau_s: float

    @property
    def constant_from_s(self) -> float:
        return self.burst.constant_from_s

    @property
    def breakpoints_s(self) -> tuple[float, ...]:
        return self.burst.breakpoints_s

    def volts(self, t: Array) -> Array:
        since = np.clip(np.asarray(t, float) - self.burst.origin_s, 0.0, None)
        left = np.where(np.asarray(t, float) < self.burst.end_s, np.exp(-since / self.tau_s), 1.0)
        return self.level_v + (self.burst.volts(t) - self.level_v) * left
