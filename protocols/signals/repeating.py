"""What repeats with every period and is no response: seen where lines scatter more about their neighbours than noise would.

Odd orders of an amplifier or a specimen, a generator's steps and whatever a card without a filter folds back stand in every
period alike, so the spread over periods does not know them. They come in with the drive, and so err by a share of the response,
of another sign at every line. A response is smooth, and its inverse is so however narrow its resonance: of second degree in the
frequency for one mode. (After the local polynomial method of Pintelon & Schoukens, System Identification, 2nd ed., ch. 7.)
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

LINES, DEGREE = 15, 6
"""A piece of the response, and the degree of the polynomial that must fit its inverse."""

FREEDOM = 2 * (LINES - DEGREE - 1)
MEDIAN = (1 - 2 / (9 * FREEDOM)) ** 3
"""Of chi square over its degrees of freedom (Wilson and Hilferty)."""

AROUND = 61
"""Lines over whose median the share is found."""

CLEAR = 10.0
"""Lines that stand out of their noise by less tell nothing of a share."""

EVERY = 8
STEPS = 40


def repeating_share(frequency_hz: Array, response: Complex, noise: Array) -> Array:
    """(F,) standard deviation of what repeats, of real and of imaginary part, as a share of the response's modulus.

    Args:
        frequency_hz: (F,), rising.
        response: (F,), its errors independent from line to line.
        noise: (F,), standard errors of real and imaginary part that the spread over periods tells; none is 0.
    """
    clear = np.abs(response) > CLEAR * noise
    if np.count_nonzero(clear) < 2 * LINES:
        return np.zeros(frequency_hz.size)
    inverse, error = 1 / response[clear], noise[clear] / np.abs(response[clear]) ** 2
    f, G, s = (sliding_window_view(values, LINES) for values in (frequency_hz[clear], inverse, error))
    place = 2 * (f - f[:, :1]) / (f[:, -1:] - f[:, :1]) - 1
    q, _ = np.linalg.qr(legvander(place, DEGREE) / s[..., None])
    target = (G / s)[..., None]
    left = target - q @ (q.swapaxes(1, 2) @ target)
    excess = (np.abs(left[..., 0]) ** 2).sum(1) / FREEDOM  # 1 where there is noise alone
    strength = np.mean(np.abs(G / s) ** 2, axis=1)
    wide = min(AROUND, excess.size)
    at = np.arange(0, excess.size - wide + 1, EVERY)
    excess, strength = (sliding_window_view(values, wide)[at] for values in (excess, strength))
    # The share whose variance brings the median excess down to what noise alone would give; looked for by halving.
    low, high = np.zeros(at.size), (excess / strength).max(1)
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        more = np.median(excess / (1 + middle[:, None] * strength), axis=1) > MEDIAN
        low, high = np.where(more, middle, low), np.where(more, high, middle)
    centre = frequency_hz[clear][at + (wide + LINES) // 2 - 1]
    return np.sqrt(np.interp(frequency_hz, centre, low))
