"""Arbitrary waveforms: drives as points of one period, for generators that cannot play them natively."""

import math

import numpy as np
from numpy.typing import NDArray

from drivers.drive_shapes import LevelPulse, LinearSweep, PeriodicSweep, SquareWave, Steps

Points = NDArray[np.float64]
"""Values between -1 and 1; 0 is the idle level, and the first value."""

ArbitraryDrive = LinearSweep | PeriodicSweep | Steps | SquareWave | LevelPulse
"""Drives that generators do not have built in."""

MIN_POINTS = 256
OVERSAMPLED_POINTS = 131_072
"""Number of points up to which a waveform is oversampled if the memory allows."""

QUANTIZATION_MARGIN = 0.98
"""Usable share of the largest step: the converter, 12 bits at least, rounds both points."""

SINE_CYCLE: Points = np.sin(2 * np.pi * np.arange(4096) / 4096)
"""Number of points of one cycle, with steps below a thousandth of its span."""


def reason_memory_too_small(drive: ArbitraryDrive, max_points: int, max_step_v: float) -> str:
    """Return the reason why a memory of `max_points` is too small for a drive, as part of a message; empty if it is not."""
    needed = required_points(drive, max_step_v)
    if needed <= max_points:
        return ""
    if isinstance(drive, LevelPulse):
        return (
            f"a level of {drive.level_v:g} V held for {drive.hold_s:g} s is a waveform of {needed} points, which ends at rest by itself, "
            f"and the instrument holds {max_points}; shorten the hold, raise the bench's 'step' of the amplifier, or use the "
            "card's analogue output. Nothing was sent"
        )
    return (
        f"this {drive.kind} needs {needed} points to move by no more than {max_step_v:g} V at a time, and the "
        f"instrument holds {max_points}; shorten it, lower its amplitude or its top frequency, lengthen its rise, or raise "
        "the bench's 'step' of the amplifier. Nothing was sent"
    )


def required_points(drive: ArbitraryDrive, max_step_v: float) -> int:
    """Return the number of points at which no step exceeds `max_step_v`."""
    return max(math.ceil(_period_s(drive) * drive.slew_v_per_s / (QUANTIZATION_MARGIN * max_step_v)) + 1, MIN_POINTS)


def render_waveform(drive: ArbitraryDrive, max_points: int, max_step_v: float) -> tuple[Points, float]:
    """Return the points of a drive (of a periodic one, one period), (N,) from -1 to 1, and the volts of a full-scale point.

    Args:
        drive: a drive that fits into the instrument's memory.
        max_points: size of the instrument's memory.
        max_step_v: largest change from one point to the next that may reach the amplifier.
    """
    needed = required_points(drive, max_step_v)
    size = min(max_points, max(needed, min(4 * needed, OVERSAMPLED_POINTS)))
    idle_v = drive.end_levels_v[0]
    away = drive.volts(np.arange(size) * (_period_s(drive) / size)) - idle_v
    full_v = float(np.abs(away).max()) or 1.0
    return away / full_v, full_v


def repetition(drive: ArbitraryDrive) -> tuple[float, int]:
    """Return the repetition rate of a drive's waveform per second, and the number of repetitions."""
    match drive:
        case PeriodicSweep():
            return 1 / drive.period_s, drive.periods
        case SquareWave():
            return drive.frequency_hz, drive.cycles
    return 1 / drive.duration_s, 1


def _period_s(drive: ArbitraryDrive) -> float:
    return drive.period_s if isinstance(drive, PeriodicSweep | SquareWave) else drive.duration_s
