"""A drive as samples for an analogue output: fine enough to be smooth, and how it dies down when it is stopped."""

import math

import numpy as np
from numpy.typing import NDArray

from drivers.drive import Drive, LinearSweep, PeriodicSweep, Sine

RATES_HZ = (10e3, 20e3, 50e3, 100e3, 200e3, 500e3)
"""Integer parts of an NI card's 100 MHz timebase; the slowest that is fine enough is taken."""

STEP_V = 0.02
"""Largest step between two samples: 12 V on the specimen."""

SAMPLES_PER_CYCLE = 100
FADE_S = 0.05
STILL_S = 1.0
"""Rest after a fade: longer than it takes anybody to let go of the card."""

Array = NDArray[np.float64]


def rate_for(drive: Drive) -> float:
    """Samples per second."""
    fine = drive.slew_v_per_s / STEP_V
    if isinstance(drive, Sine):
        fine = max(fine, SAMPLES_PER_CYCLE * drive.frequency_hz)
    if isinstance(drive, LinearSweep | PeriodicSweep):
        fine = max(fine, SAMPLES_PER_CYCLE * max(drive.start_hz, drive.stop_hz))
    return next((rate for rate in RATES_HZ if rate >= fine), RATES_HZ[-1])


def count_of(drive: Drive, rate_hz: float) -> int:
    """Samples of the whole drive; the last one is where it ends."""
    return math.ceil(drive.duration_s * rate_hz) + 1


def rendered(drive: Drive, rate_hz: float, first: int, count: int) -> Array:
    """Samples `first` to `first + count`, shape (count,); beyond its end the drive stays where it ended."""
    t = np.arange(first, first + count) / rate_hz
    return np.ascontiguousarray(drive.volts(np.minimum(t, drive.duration_s)))


def resting_v(drive: Drive, rate_hz: float, first: int) -> float:
    """Where a drive idles that is stopped at sample `first`: at its offset, or at the level it has reached."""
    last = count_of(drive, rate_hz) - 1
    if isinstance(drive, Sine | LinearSweep | PeriodicSweep) and first <= last:
        return drive.offset_v
    return float(rendered(drive, rate_hz, min(first, last), 1)[0])


def dying(drive: Drive, rate_hz: float, first: int) -> tuple[Array, int]:
    """What to play from sample `first` on instead of the drive, and how much of it is not rest yet."""
    left = count_of(drive, rate_hz) - first
    fade = min(math.ceil(FADE_S * rate_hz), left)
    level_v = resting_v(drive, rate_hz, first)
    wave = np.full(fade, level_v)
    if isinstance(drive, Sine | LinearSweep | PeriodicSweep):
        wave += np.linspace(1.0, 0.0, fade) * (rendered(drive, rate_hz, first, fade) - level_v)
    return np.concatenate((wave, np.full(min(math.ceil(STILL_S * rate_hz), left - fade), level_v))), fade
