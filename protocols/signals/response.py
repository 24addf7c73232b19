"""Frequency response of displacement over drive, with coherence and a standard error per line.

Standard errors depend on the excitation: repeated periods show noise by their differences (`estimate_periodic_response`); a long
sweep does not repeat, but its drive is known (`swept_response`). Both use H1 = S_yx / S_xx, because the noise is the laser's; the
noise of the recorded drive is a thousandth of it. H2 would count the harmonics as response.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from model import Array, Series, SeriesAxis

FREQUENCY_RESPONSE = "frequency response"
"""Name of the series."""

FREQUENCY = SeriesAxis("frequency", "Hz", "frequency")
RESPONSE = SeriesAxis("response", "m/V", "displacement per volt at the amplifier's input, modulus")
LINE_COLUMNS = ("x", "y", "errors", "coherence")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrequencyResponse(Series):
    """Displacement per drive at rising frequencies, complex, in the unit of displacement over the unit of drive; delay removed.

    Attributes:
        degrees_of_freedom: of the errors.
        resolution_hz: full width of the average of a line (Hann for a sweep, its bias removed).
        correlation: correlation of the errors of neighbouring lines.
    """

    errors: Array
    coherence: Array
    x_axis: SeriesAxis = FREQUENCY
    y_axis: SeriesAxis = RESPONSE
    fit_description: str = "one mode fitted around the peak, modulus"
    name: str = FREQUENCY_RESPONSE
    degrees_of_freedom: float
    resolution_hz: float
    correlation: float = 0.0


def concatenate_responses(parts: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """Return responses of one resolution over consecutive bands as one."""
    rows: Any = {name: np.concatenate([getattr(part, name) for part in parts]) for name in LINE_COLUMNS}
    return replace(parts[0], resolution_hz=max(part.resolution_hz for part in parts), **rows)
