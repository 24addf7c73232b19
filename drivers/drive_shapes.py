"""Drives: sine, sweep, square wave, ramp, steps and hold as parametric waveforms at the amplifier's input; level pulses.

A generator plays a drive natively, an analogue output renders `volts(t)`, the model evaluates it exactly, and the drive
limits check its extremes, its steepest slope and its end levels before anything moves. All volts are at the amplifier's
*input*.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Any, ClassVar, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

FADE_CYCLES = 4
"""Cycles of the highest frequency within which a periodic sweep begins and ends."""


ANY_SIGN = ("level_v", "levels_v", "start_v", "stop_v", "offset_v")
"""Fields that may be zero or negative: levels."""
MAY_BE_ZERO = (*ANY_SIGN, "fade_s")
"""Fields that may be zero: levels, and the duration of a fade."""


class _CheckedDrive:
    """Checks the fields of a drive: all finite, all except levels above 0."""

    __slots__ = ()
    kind: ClassVar[str]
    """Name of the class in files, JSON and messages; a released name never changes."""

    def __init_subclass__(cls) -> None:
        cls.kind = cls.__name__

    def __post_init__(self) -> None:
        values = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
        for name, value in values.items():
            for number in value if isinstance(value, tuple) else (value,):
                if not math.isfinite(number):
                    raise ValueError(f"{self.kind}: {name} must be a finite number, not {number}")
        for name, value in values.items():
            if name not in ANY_SIGN and not value > 0 and not (name in MAY_BE_ZERO and value == 0):
                raise ValueError(f"{self.kind}: {name} must be positive, not {value}")


class _Levels(_CheckedDrive):
    """Consecutive levels: extremes and end levels."""

    __slots__ = ()
    levels_v: tuple[float, ...]

    @property
    def low_v(self) -> float:
        """Lowest level."""
        return min(self.levels_v)

    @property
    def high_v(self) -> float:
        """Highest level."""
        return max(self.levels_v)

    @property
    def end_levels_v(self) -> tuple[float, float]:
        """Levels at the start and at the end."""
        return self.levels_v[0], self.levels_v[-1]


class _Oscillation(_CheckedDrive):
    """Oscillation by its amplitude about its offset: extremes."""

    __slots__ = ()
    amplitude_v: float
    offset_v: float

    @property
    def _turning_points(self) -> tuple[float, float]:
        """Lowest and highest value from the offset, as a share of the amplitude."""
        return -1.0, 1.0

    @property
    def low_v(self) -> float:
        """Lowest level."""
        return self.offset_v + self.amplitude_v * self._turning_points[0]

    @property
    def high_v(self) -> float:
        """Highest level."""
        return self.offset_v + self.amplitude_v * self._turning_points[1]


class _WholeCycles(_Oscillation, ABC):
    """Oscillation of one frequency for a number of cycles; it starts and ends at the offset, by itself."""

    __slots__ = ()
    frequency_hz: float
    cycles: int

    @property
    def period_s(self) -> float:
        """Duration of one period, s."""
        return 1 / self.frequency_hz

    @property
    def duration_s(self) -> float:
        """Duration, s."""
        return self.cycles / self.frequency_hz

    @property
    def end_levels_v(self) -> tuple[float, float]:
        """Levels at the start and at the end."""
        return self.offset_v, self.offset_v

    def volts(self, t: ArrayLike) -> Array:
        """Return the volts at the times `t` after the start, an array of the shape of `t`; 0 to `duration_s`."""
        time = np.asarray(t, float)
        live = (time >= 0) & (time <= self.duration_s)
        return np.asarray(self.offset_v + np.where(live, self.amplitude_v * self._shape(time), 0.0))

    @abstractmethod
    def _shape(self, time: Array) -> Array:
        """Return the oscillation as a share of the amplitude."""


@dataclass(frozen=True, slots=True)
class Hold(_Levels):
    """A constant level for `duration_s`."""

    level_v: float
    duration_s: float

    @property
    def levels_v(self) -> tuple[float, ...]:  # type: ignore[override]
        """Levels in order."""
        return (self.level_v,)

    @property
    def slew_v_per_s(self) -> float:
        """Largest slope, V/s."""
        return 0.0

    def volts(self, t: ArrayLike) -> Array:
        """Return the volts at the times `t` after the start, an array of the shape of `t`; 0 to `duration_s`."""
        return np.full(np.shape(t), self.level_v)


@dataclass(frozen=True, slots=True)
class Ramp(_Levels):
    """A straight line from one level to another, held at its end."""

    start_v: float
    stop_v: float
    duration_s: float

    @property
    def levels_v(self) -> tuple[float, ...]:  # type: ignore[override]
        """Levels in order."""
        return self.start_v, self.stop_v

    @property
    def slew_v_per_s(self) -> float:
        """Largest slope, V/s."""
        return abs(self.stop_v - self.start_v) / self.duration_s

    def volts(self, t: ArrayLike) -> Array:
        """Return the volts at the times `t` after the start, an array of the shape of `t`; 0 to `duration_s`."""
        return np.asarray(np.interp(np.asarray(t, float), [0.0, self.duration_s], [self.start_v, self.stop_v]))


@dataclass(frozen=True, slots=True)
class Sine(_WholeCycles):
    """`cycles` whole cycles of `offset_v + amplitude_v sin(2 pi f t)`; it starts and ends at the offset, by itself.

    `amplitude_v` is the peak, half of the peak to peak. The number of cycles is finite on purpose: a generator whose computer
    died comes to rest by itself.
    """

    frequency_hz: float
    amplitude_v: float
    offset_v: float
    cycles: int

    @property
    def slew_v_per_s(self) -> float:
        """Largest slope, V/s."""
        return 2 * math.pi * self.frequency_hz * self.amplitude_v

    def _shape(self, time: Array) -> Array:
        return np.asarray(np.sin(2 * np.pi * self.frequency_hz * time))


def _envelope(time: Array, duration_s: float, fade_s: float) -> Array:
    """Return the share of the full amplitude, with the square of a sine as the fade at both ends."""
    if not fade_s:
        return np.ones_like(time)
    share = np.clip(np.minimum(time, duration_s - time) / fade_s, 0.0, 1.0)
    return np.asarray(np.sin(0.5 * np.pi * share) ** 2)


@dataclass(frozen=True, slots=True)
class LinearSweep(_Oscillation):
    """A sine whose frequency moves linearly from `start_hz` to `stop_hz`; it starts at the offset, going up.

    It ends at the offset only if its mean frequency times its duration is a whole number of cycles, which the
    drive limits require. Within `fade_s` its amplitude rises at its begin and falls at its end: the ends of a sweep that starts
    at full amplitude, and the mean that an amplifier with two slopes adds to it, are as broad as its band.
    """

    start_hz: float
    stop_hz: float
    duration_s: float
    amplitude_v: float
    offset_v: float
    fade_s: float = 0.0

    @property
    def slew_v_per_s(self) -> float:
        """Largest slope, V/s."""
        of_fade = 0.5 * math.pi / self.fade_s if self.fade_s else 0.0
        return (2 * math.pi * max(self.start_hz, self.stop_hz) + of_fade) * self.amplitude_v

    @property
    def cycles(self) -> float:
        """Cycles from start to end."""
        return 0.5 * (self.start_hz + self.stop_hz) * self.duration_s

    @property
    def end_levels_v(self) -> tuple[float, float]:
        """Levels at the start and at the end."""
        fraction = 0.0 if self.fade_s else self.cycles - round(self.cycles)
        return self.offset_v, self.offset_v + self.amplitude_v * math.sin(2 * math.pi * fraction)

    def volts(self, t: ArrayLike) -> Array:
        """Return the volts at the times `t` after the start, an array of the shape of `t`; 0 to `duration_s`."""
        time = np.clip(np.asarray(t, float), 0.0, self.duration_s)
        rate = (self.stop_hz - self.start_hz) / self.duration_s
        phase = 2 * np.pi * (self.start_hz * time + 0.5 * rate * time**2)
        return np.asarray(self.offset_v + self.amplitude_v * self.envelope(time) * np.sin(phase))

    def envelope(self, t: ArrayLike) -> Array:
        """Return the present amplitude at the times `t` after the start, as a share of `amplitude_v`."""
        return _envelope(np.asarray(t, float), self.duration_s, self.fade_s)


@dataclass(frozen=True, slots=True)
class PeriodicSweep(_Oscillation):
    """A linear sweep of `sweep_s` and the same inverted, `periods` times without a pause.

    Its sign alternates, so that even-order effects - an amplifier with different slopes for both signs, an offset - fall on other
    lines of the spectrum than the response: the sweep excites the odd lines, these effects the even lines. It is continuous only
    if the sweep's mean frequency times its duration is a whole number of cycles, which the drive limits require. Each sweep is
    faded in and out within `fade_s`: a corner between two sweeps would have a spectrum far beyond the band, which a card without
    a filter would alias onto the lines.
    """

    start_hz: float
    stop_hz: float
    sweep_s: float
    periods: int
    amplitude_v: float
    offset_v: float

    @property
    def sweep(self) -> LinearSweep:
        """The sweep without inversion."""
        return LinearSweep(self.start_hz, self.stop_hz, self.sweep_s, self.amplitude_v, self.offset_v)

    @property
    def period_s(self) -> float:
        """Duration of one period, s."""
        return 2 * self.sweep_s

    @property
    def fade_s(self) -> float:
        """Duration of the fade to and from full amplitude."""
        return min(FADE_CYCLES / max(self.start_hz, self.stop_hz), self.sweep_s / 8)

    @property
    def duration_s(self) -> float:
        """Duration, s."""
        return self.periods * self.period_s

    @property
    def slew_v_per_s(self) -> float:
        """Largest slope, V/s."""
        return self.sweep.slew_v_per_s

    @property
    def end_levels_v(self) -> tuple[float, float]:
        """Levels at the start and at the end."""
        return self.sweep.end_levels_v

    def volts(self, t: ArrayLike) -> Array:
        """Return the volts at the times `t` after the start, an array of the shape of `t`; 0 to `duration_s`."""
        time = np.clip(np.asarray(t, float), 0.0, self.duration_s)
        turn = np.floor(time / self.sweep_s)
        within = time - turn * self.sweep_s
        away = _envelope(within, self.sweep_s, self.fade_s) * (self.sweep.volts(within) - self.offset_v)
        return np.asarray(self.offset_v + np.where(turn % 2 == 0, away, -away))


@dataclass(frozen=True, slots=True)
class SquareWave(_WholeCycles):
    """`cycles` periods of a square wave with the edges of an RC circuit, as of an astable multivibrator.

    It relaxes with the time constant `edge_s` towards `offset_v + amplitude_v` for the fraction `duty` of a period, and towards
    `offset_v - amplitude_v` for the rest. It begins and ends at a rise through the offset, in the periodic state from the first
    period.
    """

    frequency_hz: float
    amplitude_v: float
    offset_v: float
    duty: float
    edge_s: float
    cycles: int

    def __post_init__(self) -> None:
        _CheckedDrive.__post_init__(self)
        if not self.duty < 1:
            raise ValueError(f"{self.kind}: duty must lie between 0 and 1, not {self.duty}")
        low, high = self._turning_points
        if not low < 0 < high:
            raise ValueError(
                f"{self.kind}: with edges of {self.edge_s:g} s and a duty of {self.duty:g} it does not cross its offset at "
                f"{self.frequency_hz:g} Hz; lower the frequency, shorten the edges or move the duty towards 0.5"
            )

    @property
    def _turning_points(self) -> tuple[float, float]:
        """Lowest and highest value from the offset, as a share of the amplitude: the ends of fall and rise."""
        rise = math.exp(-self.duty * self.period_s / self.edge_s)
        fall = math.exp(-(1 - self.duty) * self.period_s / self.edge_s)
        return -(1 - 2 * fall + rise * fall) / (1 - rise * fall), (1 - 2 * rise + rise * fall) / (1 - rise * fall)

    @property
    def slew_v_per_s(self) -> float:
        """Largest slope, V/s: at the begin of an edge."""
        low, high = self._turning_points
        return self.amplitude_v * max(1 - low, 1 + high) / self.edge_s

    def _shape(self, time: Array) -> Array:
        low, high = self._turning_points
        since_rise = np.mod(time + self.edge_s * math.log(1 - low), self.period_s)
        since_fall = since_rise - self.duty * self.period_s
        rising = 1 - (1 - low) * np.exp(-since_rise / self.edge_s)
        falling = -1 + (1 + high) * np.exp(-np.maximum(since_fall, 0.0) / self.edge_s)
        return np.where(since_fall < 0, rising, falling)


@dataclass(frozen=True, slots=True)
class Steps(_Levels):
    """Levels held one after the other for `dwell_s`, each reached by a straight line of `rise_s`.

    It starts at the first level; each later level is reached in `rise_s` and then held.
    """

    levels_v: tuple[float, ...]
    dwell_s: float
    rise_s: float

    def __post_init__(self) -> None:
        _CheckedDrive.__post_init__(self)
        if not self.levels_v:
            raise ValueError("Steps: levels_v must name at least one level")

    @property
    def duration_s(self) -> float:
        """Duration, s."""
        return len(self.levels_v) * self.dwell_s + (len(self.levels_v) - 1) * self.rise_s

    @property
    def slew_v_per_s(self) -> float:
        """Largest slope, V/s."""
        jumps = [abs(b - a) for a, b in zip(self.levels_v, self.levels_v[1:], strict=False)]
        return max(jumps, default=0.0) / self.rise_s

    def volts(self, t: ArrayLike) -> Array:
        """Return the volts at the times `t` after the start, an array of the shape of `t`; 0 to `duration_s`."""
        knots, levels = [], []
        for i, level in enumerate(self.levels_v):
            begin = i * (self.dwell_s + self.rise_s)
            knots += [begin, begin + self.dwell_s]
            levels += [level, level]
        return np.asarray(np.interp(np.asarray(t, float), knots, levels))


Drive = Hold | Ramp | Sine | LinearSweep | PeriodicSweep | Steps | SquareWave

DRIVES: dict[str, type[Drive]] = {drive.kind: drive for drive in get_args(Drive)}
"""Drive types by their `kind`."""


def swings(drive: Drive, duration_s: float) -> bool:
    """Whether a drive passes a whole cycle within any such time, in seconds."""
    match drive:
        case Sine(frequency_hz) | SquareWave(frequency_hz):
            return frequency_hz * duration_s >= 1
        case LinearSweep() | PeriodicSweep():
            return min(drive.start_hz, drive.stop_hz) * duration_s >= 1
    return False


def as_record(drive: Drive) -> dict[str, Any]:
    """Return the drive as plain values, for events and files."""
    return {"kind": drive.kind, **{f.name: getattr(drive, f.name) for f in fields(drive)}}


def from_record(record: dict[str, Any]) -> Drive:
    """Return the drive of a record made by `as_record`.

    Raises:
        ValueError: the record is no drive, or a drive of a newer version of this program.
    """
    kind = record.get("kind")
    if kind not in DRIVES:
        raise ValueError(f"unknown drive {kind!r}: this version has {', '.join(DRIVES)}; install a newer one")
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in record.items() if k != "kind"}
    try:
        return DRIVES[kind](**values)
    except TypeError as error:
        raise ValueError(f"not a drive: {record}") from error


@dataclass(frozen=True, slots=True)
class LevelPulse:
    """A level reached from rest by a straight line in `rise_s`, held for `hold_s`, and left for rest in `rise_s`.

    The form of a `Hold` that must end at rest without a further command.
    """

    kind: ClassVar[str] = "Hold"
    rest_v: float
    level_v: float
    hold_s: float
    rise_s: float

    @property
    def duration_s(self) -> float:
        """Duration, s."""
        return self.hold_s + 2 * self.rise_s

    @property
    def low_v(self) -> float:
        """Lowest level."""
        return min(self.rest_v, self.level_v)

    @property
    def high_v(self) -> float:
        """Highest level."""
        return max(self.rest_v, self.level_v)

    @property
    def end_levels_v(self) -> tuple[float, float]:
        """Levels at the start and at the end."""
        return self.rest_v, self.rest_v

    @property
    def slew_v_per_s(self) -> float:
        """Largest slope, V/s."""
        return abs(self.level_v - self.rest_v) / self.rise_s

    def volts(self, t: ArrayLike) -> NDArray[np.float64]:
        """Return the volts at the times `t` after the start, an array of the shape of `t`; 0 to `duration_s`."""
        knots = [0.0, self.rise_s, self.rise_s + self.hold_s, self.duration_s]
        return np.asarray(
            np.interp(np.asarray(t, float), knots, [self.rest_v, self.level_v, self.level_v, self.rest_v])
        )
