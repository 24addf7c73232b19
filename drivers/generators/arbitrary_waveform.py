"""Drives as one period of an arbitrary waveform, for generators that cannot play them otherwise."""

import math

import numpy as np
from numpy.typing import NDArray

from drivers.drive import LinearSweep, PeriodicSweep, Steps

Points = NDArray[np.float64]
"""Values between -1 and 1; 0 is the level where the source idles, and the first value."""

ArbitraryDrive = LinearSweep | PeriodicSweep | Steps
"""Drives that no generator has built in."""

MIN_POINTS = 256
OVERSAMPLED_POINTS = 16_384
"""As fine as that a waveform is made without need, where there is room."""

QUANTIZATION_MARGIN = 0.98
"""Share of a jump that points may take: the box's converter, 12 bits at least, rounds either of two points."""

SINE_CYCLE: Points = np.sin(2 * np.pi * np.arange(4096) / 4096)
"""One cycle; from point to point it moves by less than a thousandth of its span."""


def reason_memory_too_small(drive: ArbitraryDrive, max_points: int, max_step_v: float) -> str:
    """Why a waveform memory of `most` points is too small for a drive, in half a sentence; empty where it is not."""
    needed = required_points(drive, max_step_v)
    if needed <= max_points:
        return ""
    return (
        f"this {drive.kind} needs {needed} points to move by no more than {max_step_v:g} V at a time, and the "
        f"instrument holds {max_points}; shorten it, lower its amplitude or its top frequency, lengthen its rise, or raise "
        "amplifier.step_v in the bench file. Nothing was sent"
    )


def required_points(drive: ArbitraryDrive, max_step_v: float) -> int:
    """Points without which one is further than `max_step_v` from the next."""
    return max(math.ceil(_period_s(drive) * drive.slew_v_per_s / (QUANTIZATION_MARGIN * max_step_v)) + 1, MIN_POINTS)


def render_waveform(drive: ArbitraryDrive, max_points: int, max_step_v: float) -> tuple[Points, float]:
    """The drive as points (of a periodic one, one period), and the volts of a full point.

    Args:
        drive: what shall be played; one that the instrument can hold.
        max_points: how many points the instrument holds.
        max_step_v: largest change from one point to the next that may reach the amplifier.
    """
    needed = required_points(drive, max_step_v)
    size = min(max_points, max(needed, min(4 * needed, OVERSAMPLED_POINTS)))
    idle_v = drive.end_levels_v[0]
    away = drive.volts(np.arange(size) * (_period_s(drive) / size)) - idle_v
    full_v = float(np.abs(away).max()) or 1.0
    return away / full_v, full_v


def _period_s(drive: ArbitraryDrive) -> float:
    return drive.period_s if isinstance(drive, PeriodicSweep) else drive.duration_s


def definite_length_block(data: bytes) -> str:
    """Bytes as a binary block of a message: IEEE 488.2 definite length, Latin-1 standing for bytes."""
    length = str(len(data))
    return f"#{len(length)}{length}{data.decode('latin-1')}"
