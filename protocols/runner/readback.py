"""Drive read-back check: compares the recorded drive with the commanded one, block by block."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from drivers import Drive, Hold, LinearSweep, PeriodicSweep, Sine, SquareWave, swings
from model import Array

SINE_SAMPLES_PER_CYCLE = 16
"""Largest number of samples per cycle in a fit."""

MIN_TOLERANCE_V = 0.05
"""Smallest tolerance: noise and gain error of the card, offset error of the generator."""

MIN_CHECKED_S = 0.01
"""Shortest piece of a block for a comparison."""

FLAT_V = 0.05
"""Largest swing of a constant level."""

COARSE_SAMPLES_LOSS = 0.06
"""Largest share of a sweep's amplitude lost by sampling, at ten samples per cycle."""


CABLE = (
    "check the cable from the generator to the card and to the amplifier, the generator's output, and that no other program or "
    "person controls the generator"
)
NOT_STARTED = (
    "it did not start, and the cable is whole: look at the generator's trigger source and delay, burst, gate and sequencer settings, "
    "and that no other program or person controls it"
)
CLIPPED = "it is clipped: look at the generator's output limits, protection and load (high impedance), and at the card's range"


@dataclass(frozen=True, slots=True)
class Deviation:
    """A deviation from the commanded drive: recorded drive as text, largest deviation and its limit, in volts, and a remedy."""

    seen: str
    value_v: float
    limit_v: float
    remedy: str = CABLE


@dataclass
class DriveReadback:
    """Compares blocks with the last started drive.

    Until `fresh_scan` the previous drive, its way to rest and the start of the new one may still arrive; there only values
    outside all of them count.

    Args:
        drive: the commanded drive.
        start_scan: scan at its start.
        fresh_scan: first scan with the new drive alone.
        rate_hz: scans per second.
        rest_v: rest at the amplifier's input.
        relative_tolerance: tolerance as a share of the drive's amplitude, or of a level's distance from rest.
        previous: previous drive, if any.
        early_s: largest lead of the drive's start before `start_scan`, because of late replies.
        held_s: duration of a held level from `start_scan`; then it may return to rest by itself.
    """

    drive: Drive
    start_scan: int
    fresh_scan: int
    rate_hz: float
    rest_v: float
    relative_tolerance: float
    previous: Drive | None = None
    early_s: float = 0.0
    held_s: float = math.inf
    compared: bool = field(default=False, init=False)
    """Whether the last block was compared with the drive; false before `fresh_scan` or for too small a part of a cycle."""
    _sine_scans: list[Array] = field(default_factory=list)
    _sine_volts: list[Array] = field(default_factory=list)

    def __post_init__(self) -> None:
        span = max(abs(self.drive.high_v - self.rest_v), abs(self.drive.low_v - self.rest_v))
        if isinstance(self.drive, Sine | LinearSweep | PeriodicSweep):
            span = self.drive.amplitude_v
        self.swing_limit_v = max(self.relative_tolerance * span, min(MIN_TOLERANCE_V, 0.5 * span))
        self.level_limit_v = max(self.relative_tolerance * span, MIN_TOLERANCE_V)
        self._late_s = (self.fresh_scan - self.start_scan) / self.rate_hz + self.early_s

    def check(
        self, start: int, raw: NDArray[np.int16], to_volts: Callable[[NDArray[np.int16]], Array]
    ) -> Deviation | None:
        """Return the deviation of the counts `raw` from scan `start` from the drive; None if they agree or cannot be compared."""
        self.compared = False
        split = min(max(self.fresh_scan - start, 0), raw.size)
        shortest = MIN_CHECKED_S * self.rate_hz
        if split > shortest and (deviation := self._check_transition(raw[:split], to_volts)):
            return deviation
        played_s = self.held_s if isinstance(self.drive, Hold) else self.drive.duration_s
        left = (self.start_scan - start) + (played_s - self._late_s) * self.rate_hz
        stop = raw.size if left >= raw.size else math.floor(left)
        if stop - split <= shortest:
            return None
        self.compared = True
        found = self._check_drive(start + split, raw[split:stop], to_volts)
        return None if found is None else replace(found, remedy=self._remedy(*_extremes(raw[split:stop], to_volts)))

    def _remedy(self, low: float, high: float) -> str:
        """Return a remedy by the extremes of a block that deviates from the drive."""
        if max(high - self.rest_v, self.rest_v - low) < FLAT_V:
            return NOT_STARTED
        short_v = (low - self.drive.low_v, self.drive.high_v - high)
        if high - low > FLAT_V and min(short_v) < self.level_limit_v < max(short_v) and max(short_v) < high - low:
            return CLIPPED
        return CABLE

    def _deviation(self, low: float, high: float, beyond_v: float) -> Deviation | None:
        return (
            Deviation(_range_text(low, high), beyond_v, self.level_limit_v) if beyond_v > self.level_limit_v else None
        )

    def _check_transition(
        self, raw: NDArray[np.int16], to_volts: Callable[[NDArray[np.int16]], Array]
    ) -> Deviation | None:
        low, high = _extremes(raw, to_volts)
        drives = [self.drive, *([] if self.previous is None else [self.previous])]
        least = min(self.rest_v, *(drive.low_v for drive in drives))
        most = max(self.rest_v, *(drive.high_v for drive in drives))
        beyond = max(least - low, high - most)
        if high - low < FLAT_V and all(swings(drive, raw.size / self.rate_hz) for drive in drives):
            beyond = max(beyond, abs(0.5 * (low + high) - self.rest_v))
        return self._deviation(low, high, beyond)

    def _check_drive(
        self, start: int, raw: NDArray[np.int16], to_volts: Callable[[NDArray[np.int16]], Array]
    ) -> Deviation | None:
        low, high = _extremes(raw, to_volts)
        beyond = max(self.drive.low_v - low, high - self.drive.high_v)
        if beyond > self.level_limit_v:
            return self._deviation(low, high, beyond)
        match self.drive:
            case Sine():
                return self._check_sine(self.drive, start, raw, to_volts)
            case LinearSweep() | PeriodicSweep():
                return self._check_sweep(self.drive, start, raw.size, low, high)
            case SquareWave(frequency_hz):
                self.compared = raw.size / self.rate_hz * frequency_hz >= 1
                missing = 0.5 * (self.drive.high_v - self.drive.low_v - (high - low))
                if self.compared and missing > self.swing_limit_v + COARSE_SAMPLES_LOSS * self.drive.amplitude_v:
                    return Deviation(_range_text(low, high), missing, self.swing_limit_v)
        return None

    def _check_sine(
        self, drive: Sine, start: int, raw: NDArray[np.int16], to_volts: Callable[[NDArray[np.int16]], Array]
    ) -> Deviation | None:
        """Compare offset, amplitude and residual of a fitted sine; over several blocks if one has no whole cycle."""
        stride = max(math.floor(self.rate_hz / drive.frequency_hz / SINE_SAMPLES_PER_CYCLE), 1)
        self._sine_scans.append(np.arange(start, start + raw.size, stride, dtype=float))
        self._sine_volts.append(to_volts(raw[::stride]))
        scans = np.concatenate(self._sine_scans)
        if (scans[-1] - scans[0] + stride) * drive.frequency_hz < self.rate_hz:
            return self._check_slow_sine(drive, scans, self._sine_volts[-1])
        volts = np.concatenate(self._sine_volts)
        self._sine_scans, self._sine_volts = [], []
        phase = 2 * math.pi * drive.frequency_hz / self.rate_hz * (scans - scans[0])
        columns = np.column_stack([np.ones_like(phase), np.cos(phase), np.sin(phase)])
        (offset, *parts), *_ = np.linalg.lstsq(columns, volts, rcond=None)
        amplitude = math.hypot(*parts)
        left = float(np.std(volts - columns @ np.array([offset, *parts])))
        wrong = [(abs(offset - drive.offset_v), self.level_limit_v)]
        wrong += [(abs(amplitude - drive.amplitude_v), self.swing_limit_v), (left, self.swing_limit_v)]
        value_v, limit_v = max(wrong, key=lambda pair: pair[0] / pair[1])
        if value_v <= limit_v:
            return None
        seen = f"{offset:z.3f} V with a sine of {amplitude:.3f} V at {drive.frequency_hz:g} Hz and {left:.3f} V rms of other signals"
        return Deviation(seen, value_v, limit_v)

    def _check_slow_sine(self, drive: Sine, scans: Array, latest: Array) -> Deviation | None:
        """Compare the latest piece of a cycle with the range that the sine crosses within the uncertainty of its start."""
        t = (scans[-latest.size :] - self.start_scan) / self.rate_hz
        if drive.frequency_hz * self._late_s > 0.1:
            self.compared = False
            return None
        near = drive.volts(np.clip(t + np.linspace(-self._late_s, self._late_s, 5)[:, None], 0.0, drive.duration_s))
        beyond = float(np.max(np.maximum(near.min(axis=0) - latest, latest - near.max(axis=0))))
        return self._deviation(float(latest.min()), float(latest.max()), beyond)

    def _check_sweep(
        self, drive: LinearSweep | PeriodicSweep, start: int, count: int, low: float, high: float
    ) -> Deviation | None:
        """Compare the swing with the sweep's, if a whole cycle passes outside the faded ends."""
        t = (start - self.start_scan + np.array([0.0, count])) / self.rate_hz + [-self._late_s, self._late_s]
        if isinstance(drive, PeriodicSweep):
            fade_s, least, slowest = 2 * drive.fade_s, 1.0, min(drive.start_hz, drive.stop_hz)
        else:
            share = np.clip(t / drive.duration_s, 0.0, 1.0)
            fade_s, least = 0.0, float(drive.envelope(t).min())
            slowest = float((drive.start_hz + (drive.stop_hz - drive.start_hz) * share).min())
        cycles = (count / self.rate_hz - fade_s) * slowest
        missing = least * drive.amplitude_v - 0.5 * (high - low)
        limit_v = (
            self.swing_limit_v + COARSE_SAMPLES_LOSS * drive.amplitude_v if cycles >= 1.1 else 0.75 * drive.amplitude_v
        )
        if cycles < 0.6:  # 0.6 of a cycle swings by more than a quarter of the amplitude
            self.compared = False
            return None
        if missing <= limit_v:
            return None
        return Deviation(_range_text(low, high), missing, limit_v)


def _extremes(raw: NDArray[np.int16], to_volts: Callable[[NDArray[np.int16]], Array]) -> tuple[float, float]:
    low, high = to_volts(np.array([raw.min(), raw.max()], np.int16))
    return float(low), float(high)


def _range_text(low: float, high: float) -> str:
    return f"{0.5 * (low + high):z.3f} V" if high - low < FLAT_V else f"{low:z.2f} to {high:z.2f} V"


def drive_text(drive: Drive) -> str:
    """Describe a commanded drive in volts at the amplifier's input."""
    match drive:
        case Sine(frequency_hz, amplitude_v, offset_v):
            return f"a sine of {amplitude_v:g} V around {offset_v:g} V at {frequency_hz:g} Hz is driven"
        case SquareWave(frequency_hz):
            return f"a square wave of {drive.low_v:.3g} to {drive.high_v:.3g} V at {frequency_hz:g} Hz is driven"
        case Hold(level_v):
            return f"{level_v:g} V are driven"
    return f"{drive.low_v:g} to {drive.high_v:g} V are driven"
