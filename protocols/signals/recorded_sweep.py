"""What a recorded drive tells of the sweep in it: from when to when it runs, which way, and whether it is one at all."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SEARCHED = 1 << 14
"""Samples looked at in one go."""


def driven(drive: Array) -> slice:
    """From where to where the drive, (N,), is away from the middle of its range.

    Raises:
        ValueError: it does not move at all.
    """
    low, high = float(drive.min()), float(drive.max())
    if not high > low:
        raise ValueError(f"the drive stands at {low:g}: check the drive channel's cable")
    middle, least = 0.5 * (low + high), 0.05 * (high - low)

    def first(samples: Array) -> int:
        """The first sample that is away; looked for piece by piece, since it is mostly near the end."""
        for start in range(0, samples.size, SEARCHED):
            away = np.abs(samples[start : start + SEARCHED] - middle) > least
            if away.any():
                return start + int(away.argmax())
        return samples.size

    return slice(first(drive), drive.size - first(drive[::-1]))


def rises(X: NDArray[np.complex64]) -> bool:
    """Whether the sweep goes up: whether its upper half of bins arrives later than its lower half (group delay)."""
    few = slice(None, None, 16)
    delay = np.mod(-np.angle(X[1:][few] * X[:-1][few].conj()), 2 * np.pi)
    half = delay.size // 2
    return bool(np.median(delay[half:]) >= np.median(delay[:half]))


def stands_out(drive: Array, power: float, width: float, n: int, band_hz: tuple[float, float]) -> None:
    """Refuse a drive that is no stronger in the band than noise would be.

    Args:
        drive: (N,), as it was transformed.
        power: sum of its squared bins within the band.
        width: of the band, as a share of half the sample rate; noise has that share of its power there.
        n: length of the transform.
        band_hz: for the sentence.

    Raises:
        ValueError: less than twice that share of the drive's power lies in the band.
    """
    centred = drive - drive.mean()
    share = 2 * power / (n * float(centred @ centred))
    if width < 0.4 and share < 2 * width:
        raise ValueError(
            f"only {100 * share:.2g} % of the recorded drive's power lies between {band_hz[0]:g} and {band_hz[1]:g} Hz, "
            "as with noise: check the drive channel's cable, and that the sweep went through this band"
        )
