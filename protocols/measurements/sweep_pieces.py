"""Pieces of a sweep: octaves of its band, for a generator with a waveform memory too small for the whole band.

A memory of N points holds the same number of cycles, and hence of lines, below any frequency. A piece spans an octave; the tops of
the pieces lie at equal ratios and closer together than octaves, so that each frequency is covered by several pieces of different
periods, whose lines interleave. Every piece is a periodic sweep of its own that begins and ends at rest.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from model import Array, Complex
from protocols.signals import FrequencyResponse, concatenate_responses

PIECES_PER_OCTAVE = 3
"""Number of adapted pieces that cover a frequency in mid-band."""

SETTLED_S = 0.3
"""Duration of a piece before its periods are used, until the free vibration from rest has decayed."""

MIN_PERIODS = 3
"""Fewest used periods of a piece."""

OUTLIER_SIGMAS = 3.0
"""Significant departure of a line from the smooth curve through its neighbours, in standard errors."""


def fewest_pieces(start_hz: float, stop_hz: float) -> int:
    """Return the number of octaves of a band."""
    return max(math.ceil(math.log2(stop_hz / start_hz) - 1e-9), 1)


def adapted_pieces(start_hz: float, stop_hz: float) -> int:
    """Return the number of pieces that interleave over a band."""
    return 1 + max(math.ceil(PIECES_PER_OCTAVE * math.log2(stop_hz / (2 * start_hz))), 0)


def piece_bands(start_hz: float, stop_hz: float, pieces: int) -> tuple[tuple[float, float], ...]:
    """Return the octaves of the pieces, from the lowest: their tops at equal ratios, the highest at the top of the band."""
    return tuple((0.5 * top, top) for top in np.geomspace(2 * start_hz, stop_hz, pieces).tolist())


def merge_pieces(parts: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """Return the responses of pieces as one, their lines in order.

    The scatter of one piece's few lines does not show repeating errors; all pieces together have enough lines. Aliases of the
    steps between a generator's points, for a card without a filter, fall on some lines of one piece only: such a line departs
    from the lines of the other pieces around it, and has its departure as error.
    """
    from protocols.signals import repeating_error_share

    joined = concatenate_responses(parts)
    joined = joined.at(np.argsort(joined.x, kind="stable"))
    share = repeating_error_share(joined.x, joined.y, joined.errors)
    return replace(
        joined,
        errors=_with_departures(joined.x, joined.y, np.hypot(joined.errors, share * joined.plotted)),
        degrees_of_freedom=min(part.degrees_of_freedom for part in parts),
    )


def _with_departures(frequency_hz: Array, response: Complex, standard_error: Array) -> Array:
    """Return the standard errors, larger at lines that depart from the smooth curve through their neighbours.

    The worst line is treated first, the others without its weight.
    """
    from numpy.polynomial.legendre import legvander

    from protocols.signals import POLYNOMIAL_DEGREE, WINDOW_LINES

    errors, size = standard_error.copy(), frequency_hz.size
    if size < WINDOW_LINES:
        return errors
    first = np.clip(np.arange(size) - WINDOW_LINES // 2, 0, size - WINDOW_LINES)
    at = first[:, None] + np.arange(WINDOW_LINES)
    own = np.arange(size) - first
    f = frequency_hz[at]
    place = 2 * (f - f[:, :1]) / (f[:, -1:] - f[:, :1]) - 1
    inverse = 1 / response
    for _ in range(size):
        s = errors / np.abs(response) ** 2
        q, _ = np.linalg.qr(legvander(place, POLYNOMIAL_DEGREE) / s[at][..., None])
        target = (inverse / s)[at][..., None]
        left = (target - q @ (q.swapaxes(1, 2) @ target))[np.arange(size), own, 0]
        free = 1 - (q[np.arange(size), own] ** 2).sum(1)  # share of a line's departure that remains beside the curve
        departure = np.abs(left) / np.sqrt(free)
        worst = int(departure.argmax())
        if not departure[worst] > OUTLIER_SIGMAS:
            break
        errors[worst] *= departure[worst] / np.sqrt(2 * free[worst])
    return errors
