"""Drive history of a run in time: creep and hysteresis of earlier levels or loads in each reading.

Creep is linear and has no end, so that every reading contains the creep of all earlier levels; hysteresis remembers the turning
points of the voltage (Madelung's rules), between which the response is a parabola (Rayleigh's law).
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from model.arrays import Array
from model.parameter_spec import ParameterError

MIN_READ_S = 1e-3
"""Shortest time from reaching a drive to its reading, s."""

FAR_APART_S = 1e5
"""Assumed time between levels of unknown times, each reached from rest, s: the creep of earlier levels has decayed."""


@dataclass(frozen=True, eq=False)
class DriveHistory:
    """Straight lines between vertices, (K,), and the times of reading of each point, (F,), and of its zeros, (F, Z).

    The drive is constant before the first vertex and during every reading.
    """

    time_s: Array
    drive: Array
    """Volts at the amplifier's input, or newtons."""
    start_s: Array
    """Time at which the drive of each point was reached, (F,)."""
    read_s: Array
    zero_s: Array

    def __post_init__(self) -> None:
        for each in fields(self):
            value = np.array(getattr(self, each.name), float)
            if not np.isfinite(value).all():
                raise ParameterError(f"the {each.name} of a drive's history is not finite")
            value.setflags(write=False)
            object.__setattr__(self, each.name, value)
        points = self.read_s.shape
        if self.time_s.shape != self.drive.shape or self.start_s.shape != points or self.zero_s.shape[:1] != points:
            raise ParameterError("a drive's history has vertices or readings without a time")
        if np.any(np.diff(self.time_s) < 0) or np.any(self.read_s <= self.start_s):
            raise ParameterError("a drive's history goes back in time")

    @classmethod
    def of_points(
        cls, time_s: Array, drive: Array, start_s: Array, read_s: Array, zero_s: Array
    ) -> "DriveHistory | None":
        """Return a history from the vertices of each point, (F, V); None where the times are not in order."""
        t = time_s.ravel()
        if np.any(np.diff(t) < 0) or np.any(read_s < start_s + MIN_READ_S):
            return None
        return cls(t, drive.ravel(), start_s, read_s, zero_s)

    @classmethod
    def of_levels(cls, levels: Array, rest: float, held_s: Array, staircase: bool) -> "DriveHistory":
        """Return the history of levels in the order of their points, of which only the time `held_s` until the reading is given.

        In a staircase each level follows its predecessor and the only zero precedes the first level; otherwise each is reached
        from rest, with its own zero, long after its predecessor.
        """
        levels = np.where(np.isfinite(levels), levels, rest)
        held_s = np.asarray(np.maximum(held_s, MIN_READ_S), float)
        if staircase:
            start_s: Array = np.cumsum(held_s + MIN_READ_S) - held_s  # the next level comes after the reading
            before = np.concatenate(([rest], levels[:-1]))
            zero_s = np.full((levels.size, 1), -1.0)
            stairs = np.stack((before, levels), axis=1).ravel()
            return cls(np.repeat(start_s, 2), stairs, start_s, start_s + held_s, zero_s)
        start_s = FAR_APART_S * np.arange(levels.size, dtype=float)
        end_s = start_s + 2 * held_s
        away = np.full(levels.size, rest)
        time_s = np.stack((start_s, start_s, end_s, end_s), axis=1)
        drive = np.stack((away, levels, levels, away), axis=1)
        return cls(time_s.ravel(), drive.ravel(), start_s, start_s + held_s, start_s[:, None] - 1.0)

    def take(self, rows: Any) -> "DriveHistory":
        """Return the history with the selected readings."""
        return DriveHistory(self.time_s, self.drive, self.start_s[rows], self.read_s[rows], self.zero_s[rows])

    def steps(self, drive: Array) -> Array:
        """Return the reading of each point against the mean of its zeros, (F,), for a drive (K,) at the vertices without creep."""
        return np.asarray(self._at(drive, self.read_s) - self._at(drive, self.zero_s).mean(axis=1))

    def decades(self, reference_s: float) -> Array:
        """Return the decades of time from `reference_s` to each reading, (F,)."""
        return np.asarray(np.log10((self.read_s - self.start_s) / reference_s))

    def crept(self, drive: Array, reference_s: float) -> Array:
        """Return the creep per decade in the reading of each point, (F,), for a drive (K,) at the vertices."""
        return np.asarray(
            self._crept_at(drive, self.read_s, reference_s)
            - self._crept_at(drive, self.zero_s, reference_s).mean(axis=1)
        )

    def easing_drift(self, age_s: float) -> Array:
        """Return the reading of each point, (F,), under a decaying drift at rest that is 1 from the first to the last zero.

        It follows the logarithm of the time since `age_s` before the begin of the run, like the creep of an earlier drive.
        """

        def since(t: Array) -> Array:
            return np.asarray(np.log((t - self._began_s + age_s) / age_s))

        zeros = since(self.zero_s)
        span = float(np.ptp(zeros))
        return np.asarray((since(self.read_s) - zeros.mean(axis=1)) / (span or 1.0))

    @property
    def _began_s(self) -> float:
        return float(min(self.zero_s.min(), self.time_s.min()))

    def _at(self, drive: Array, t: Array) -> Array:
        return np.asarray(np.interp(t, self.time_s, drive))

    def _crept_at(self, drive: Array, t: Array, reference_s: float) -> Array:
        """Return the sum over the lines between vertices of their rise times the mean decades since."""
        since = t[..., None] - self.time_s
        begin, end = since[..., :-1], since[..., 1:]
        over = end > 0  # the drive is constant where something is read: a line is over or has not begun
        begin, end = np.where(over, begin, 2.0), np.where(over, end, 1.0)
        lasted = begin - end
        long = lasted > 1e-9 * begin
        mean = np.log(end)
        mean = np.where(
            long, (begin * np.log(begin) - end * np.log(end)) / np.where(long, lasted, 1.0) - 1, mean
        ) - np.log(reference_s)
        return np.asarray((np.where(over, mean, 0.0) * np.diff(drive)).sum(axis=-1) / np.log(10))


def rayleigh_response(volts: Array, low_v: float, high_v: float) -> Array:
    """Return half the squares of the changes of voltage since the turning points, summed with their signs, (K,), at turning points.

    `volts` begin at rest, reached from the lower end of the whole range, `low_v` to `high_v`, like the end of a sine.
    """
    turned = [(high_v, 0.0), (low_v, -0.5 * (high_v - low_v) ** 2)]
    """Remembered turning points with their response; the last is the begin of the present branch."""
    at, out = float(volts[0]), []
    rises = at >= low_v

    def response(v: float) -> float:
        start, there = turned[-1]
        return there + 0.5 * (v - start) * abs(v - start)

    for v in volts.tolist():
        if v != at and (v > at) != rises:
            turned.append((at, response(at)))
            rises = not rises
        while len(turned) > 2 and (v >= turned[-2][0] if rises else v <= turned[-2][0]):
            del turned[-2:]  # the loop is closed and forgotten
        at = v
        out.append(response(v))
    return np.array(out)


def rayleigh_loop(volts: Array) -> Array:
    """Return the hysteretic response along one period of periodic voltages, (..., N), that rise once and fall once."""
    low, high = volts.min(axis=-1, keepdims=True), volts.max(axis=-1, keepdims=True)
    rises = np.roll(volts, -1, axis=-1) > np.roll(volts, 1, axis=-1)
    return np.asarray(np.where(rises, 0.5 * (volts - low) ** 2, 0.5 * (high - low) ** 2 - 0.5 * (high - volts) ** 2))
