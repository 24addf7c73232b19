"""Multisine: periodic excitation with a small crest factor.

Schroeder's phases (IEEE Trans. Inf. Theory 16, 1970).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from protocols.signals.checks import check_positive

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Multisine:
    """sum_k amplitude cos(2 pi lines_k t / period + phases_k): equal lines, `peak` its largest excursion.

    Attributes:
        lines: (K,), whole multiples of 1 / period.
        phases: (K,), rad.
        amplitude: of each line, unit of the peak.
        period_s: s.
    """

    lines: NDArray[np.int64]
    phases: Array
    amplitude: float
    period_s: float

    @classmethod
    def between(cls, low_hz: float, high_hz: float, period_s: float, peak: float, line_step: int = 1) -> Self:
        """Equal lines from low to high; `every` 2 with an odd first line leaves the even ones free, to see distortion there.

        Raises:
            ValueError: no line lies between.
        """
        check_positive(low_hz=low_hz, high_hz=high_hz, period_s=period_s, peak=peak, every=line_step)
        lines = np.arange(
            int(np.ceil(low_hz * period_s - 1e-9)), int(np.floor(high_hz * period_s + 1e-9)) + 1, line_step
        )
        if not lines.size:
            raise ValueError(
                f"no line of a period of {period_s:g} s lies between {low_hz:g} and {high_hz:g} Hz: take a longer period"
            )
        k = np.arange(1, lines.size + 1)
        phases = -np.pi * k * (k - 1) / lines.size
        unit = cls(lines, phases, 1.0, period_s)
        # Sixteen samples in the fastest cycle find the crest to 2 %; what is missing there is allowed for.
        crest = float(np.abs(unit.samples(16 * int(lines[-1]) / period_s)).max()) / np.cos(np.pi / 16)
        return cls(lines, phases, peak / crest, period_s)

    @property
    def frequency_hz(self) -> Array:
        """(K,), the lines' frequencies."""
        return self.lines / self.period_s

    def samples(self, rate_hz: float) -> Array:
        """One period, (N,), N = period times rate.

        Raises:
            ValueError: a period is no whole number of samples, or too few for the highest line.
        """
        n = round(self.period_s * rate_hz)
        if abs(self.period_s * rate_hz - n) > 1e-6 * max(n, 1) or n <= 2 * int(self.lines[-1]):
            raise ValueError(
                f"{self.period_s:g} s at {rate_hz:g} Hz are {self.period_s * rate_hz:g} samples: "
                f"a whole number above {2 * int(self.lines[-1])} is needed"
            )
        bins = np.zeros(n // 2 + 1, complex)
        bins[self.lines] = 0.5 * n * self.amplitude * np.exp(1j * self.phases)
        return np.asarray(np.fft.irfft(bins, n))
