"""Periodic response over frequency: harmonics and max - min."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from model.arrays import Array, Complex


@dataclass(frozen=True, slots=True, eq=False)
class PeriodicResponse:
    """Periodic response at each frequency, m. w(t) = harmonics_0 + sum_k |harmonics_k| sin(k w t + arg harmonics_k)."""

    frequency_hz: Array
    harmonics: Complex
    """(F, orders + 1), the computed harmonics; order 0 is the real mean deflection, NaN if not computed."""
    peak_to_peak: Array
    """(F,): max - min of the response with all harmonics superposed, the paper's measured amplitude."""

    @property
    def fundamental(self) -> Complex:
        """(F,): peak amplitude and phase relative to the input sine, as from a sine fit of the data."""
        return self.harmonics[:, 1]

    @property
    def phase(self) -> Array:
        """(F,): phase of the fundamental, rad, unwrapped over the frequencies."""
        return np.unwrap(np.angle(self.fundamental))

    @classmethod
    def of_fundamental(cls, frequency_hz: Array, fundamental: Complex, peak_to_peak: Array) -> Self:
        """Return a response without other computed harmonics."""
        return cls(frequency_hz, np.stack([np.full(frequency_hz.size, np.nan), fundamental], axis=1), peak_to_peak)
