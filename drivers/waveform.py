"""Drives as one period of an arbitrary waveform, for generators that cannot play them otherwise."""

import math

import numpy as np
from numpy.typing import NDArray

from drivers.drive import LinearSweep, Steps
from drivers.errors import InstrumentError

Points = NDArray[np.float64]
"""Values between -1 and 1; 0 is the level where the source idles, and the first value."""

FEWEST = 256
PLENTY = 16_384
"""As fine as that a waveform is made without need, where there is room."""

SINE: Points = np.sin(2 * np.pi * np.arange(4096) / 4096)
"""One cycle; from point to point it moves by less than a thousandth of its span."""


def rendered(drive: LinearSweep | Steps, most: int, jump_v: float, instrument: str) -> tuple[Points, float]:
    """The drive as points, and the volts of a full point.

    Args:
        drive: what shall be played.
        most: how many points the instrument holds.
        jump_v: largest change from one point to the next that may reach the amplifier.
        instrument: who plays it, for the sentence.

    Raises:
        InstrumentError: that drive would need more points.
    """
    needed = max(math.ceil(drive.duration_s * drive.slew_v_per_s / jump_v) + 1, FEWEST)
    if needed > most:
        name = type(drive).__name__
        raise InstrumentError(
            f"{instrument}: this {name} needs {needed} points to move by no more than {jump_v:g} V at a time, and the "
            f"instrument holds {most}; shorten it, lower its amplitude or its top frequency, lengthen its rise, or raise "
            "amplifier.step_v in the bench file. Nothing was sent"
        )
    size = min(most, max(needed, min(4 * needed, PLENTY)))
    idle_v = drive.ends_v[0]
    away = drive.volts(np.arange(size) * (drive.duration_s / size)) - idle_v
    full_v = float(np.abs(away).max()) or 1.0
    return away / full_v, full_v


def block(data: bytes) -> str:
    """Bytes as a binary block of a message: IEEE 488.2 definite length, Latin-1 standing for bytes."""
    length = str(len(data))
    return f"#{len(length)}{length}{data.decode('latin-1')}"
