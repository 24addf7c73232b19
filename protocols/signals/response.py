"""Frequency response of displacement over drive, with coherence and a standard error per line.

Two excitations, two ways to an error bar: periods that repeat show their noise by not repeating (`estimate_periodic_response`); a
long sweep does not repeat, but its drive is known (`swept_response`). Both are H1 = S_yx / S_xx, the right one of the two here: the
noise is the laser's; the recorded drive has a thousandth of it. H2 would take the harmonics for response.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from model import Array, Complex

LINE_FIELDS = ("frequency_hz", "response", "standard_error", "coherence")
"""Fields of a response with one value for each line."""


@dataclass(frozen=True, slots=True)
class FrequencyResponse:
    """Displacement per drive, at lines.

    Attributes:
        frequency_hz: (F,), Hz, rising.
        response: (F,), complex, unit of displacement over unit of drive; delay removed.
        standard_error: (F,), of its real and of its imaginary part, hence of its modulus and of modulus times phase.
        coherence: (F,), share of the displacement's power at the line that follows the drive, 0..1.
        degrees_of_freedom: of the standard errors; see `coverage_factor`.
        resolution_hz: full width over which a line averages (Hann for a sweep, what that blunts being taken out).
        correlation: of the errors of neighbouring lines.
    """

    frequency_hz: Array
    response: Complex
    standard_error: Array
    coherence: Array
    degrees_of_freedom: float
    resolution_hz: float
    correlation: float

    @property
    def modulus(self) -> Array:
        """(F,), response per drive."""
        return np.abs(self.response)

    @property
    def phase(self) -> Array:
        """Radians, -pi..pi."""
        return np.angle(self.response)

    def within(self, low_hz: float, high_hz: float) -> Self:
        """The lines of a band."""
        keep = (self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz)
        rows = {name: getattr(self, name)[keep] for name in LINE_FIELDS}
        return replace(self, **rows)


def concatenate_responses(parts: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """Responses of one resolution over bands that follow each other, as one."""
    if len(parts) == 1:
        return parts[0]

    rows: Any = {name: np.concatenate([getattr(part, name) for part in parts]) for name in LINE_FIELDS}
    return replace(parts[0], resolution_hz=max(part.resolution_hz for part in parts), **rows)
