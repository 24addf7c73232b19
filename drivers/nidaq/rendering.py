"""Rendering of drives to samples of an analogue output: sample rate, fade-out, held level with its return to rest."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.drive_shapes import Drive, LinearSweep, PeriodicSweep, Sine, SquareWave

SAMPLE_RATES_HZ = (10e3, 20e3, 50e3, 100e3, 200e3, 250e3, 500e3)
"""Integer fractions of an NI card's 100 MHz timebase; the slowest fine enough one is used."""

HOLD_RATES_HZ = (2e3, 5e3, *SAMPLE_RATES_HZ)
"""Sample rates of a held level, whose ramps are slow."""

STEP_V = 0.02
"""Largest step between two samples: 12 V on the specimen."""

COARSE_STEP_V = 0.035
"""Largest step of a drive that would otherwise need more than MAX_SAMPLES: 21 V on the specimen."""

MAX_SAMPLES = 80_000_000
"""Number of samples of the longest drive: 160 MB in NI's driver, and the paper's sweep of 300 s at 5 V peak to peak."""

QUEUE_S = 0.5
"""Longest time for which samples are on their way to the converter, which limits the sample rate from below."""

LONG_DRIVE_RATE_HZ = 250e3
"""Sample rate of the steepest drive of MAX_SAMPLES."""

SAMPLES_PER_CYCLE = 100
FADE_S = 0.05
RETURN_V_PER_S = 5.0
"""Slope at which a held level that is not renewed returns to rest."""

Array = NDArray[np.float64]


def sample_rate_for(drive: Drive, slowest_hz: float = 0.0) -> float:
    """Return samples per second: fine enough for the drive, and at least `slowest_hz`."""
    rate_hz = SAMPLE_RATES_HZ[-1]
    for step_v in (STEP_V, COARSE_STEP_V):
        fine = max(drive.slew_v_per_s / step_v, slowest_hz)
        if isinstance(drive, Sine):
            fine = max(fine, SAMPLES_PER_CYCLE * drive.frequency_hz)
        if isinstance(drive, LinearSweep | PeriodicSweep):
            fine = max(fine, SAMPLES_PER_CYCLE * max(drive.start_hz, drive.stop_hz))
        rate_hz = next((rate for rate in SAMPLE_RATES_HZ if rate >= fine), SAMPLE_RATES_HZ[-1])
        if sample_count(drive, rate_hz) <= MAX_SAMPLES:
            break
    return rate_hz


def sample_count(drive: Drive, rate_hz: float) -> int:
    """Return the samples of the whole drive; the last one is its final level."""
    return math.ceil(drive.duration_s * rate_hz) + 1


def render_samples(drive: Drive, rate_hz: float, first: int, count: int) -> Array:
    """Return the samples `first` to `first + count`, shape (count,); beyond its end the drive keeps its final level."""
    t = np.arange(first, first + count) / rate_hz
    return np.ascontiguousarray(drive.volts(np.minimum(t, drive.duration_s)))


def idle_level_after_stop_v(drive: Drive, rate_hz: float, first: int) -> float:
    """Return the idle level of a drive stopped at sample `first`: its offset, or its present level."""
    last = sample_count(drive, rate_hz) - 1
    if isinstance(drive, Sine | LinearSweep | PeriodicSweep | SquareWave) and first <= last:
        return drive.offset_v
    return float(render_samples(drive, rate_hz, min(first, last), 1)[0])


def fade_out(drive: Drive, rate_hz: float, first: int) -> Array:
    """Return the samples from `first` of the fade to the idle level; fewer near the end of the drive."""
    fade = min(math.ceil(FADE_S * rate_hz), sample_count(drive, rate_hz) - first)
    level_v = idle_level_after_stop_v(drive, rate_hz, first)
    wave = np.full(fade, level_v)
    if isinstance(drive, Sine | LinearSweep | PeriodicSweep | SquareWave):
        wave += np.linspace(1.0, 0.0, fade) * (render_samples(drive, rate_hz, first, fade) - level_v)
    return wave


@dataclass(slots=True)
class HeldLevel:
    """A level reached by a straight line, held, and left for rest by another line unless it is renewed.

    Attributes:
        start_v, level_v, rest_v: first level, held level, final level.
        rise, fall: numbers of samples of both lines.
        return_sample: first sample of the line to rest; changed by a renewal.
        total: number of samples, the last one at rest.
    """

    start_v: float
    level_v: float
    rest_v: float
    rise: int
    fall: int
    return_sample: int
    total: int

    @property
    def latest_return_sample(self) -> int:
        return self.total - self.fall - 1

    def samples(self, first: int, count: int) -> Array:
        """Samples `first` to `first + count`, shape (count,)."""
        knots = [0, self.rise, self.return_sample, self.return_sample + self.fall]
        return np.interp(
            np.arange(first, first + count), knots, [self.start_v, self.level_v, self.level_v, self.rest_v]
        )
