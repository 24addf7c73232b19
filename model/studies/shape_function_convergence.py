"""Convergence study: error of the Galerkin solution against the exact one by number of shape functions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from model import Array, Skin, Tactor
from model.response import check_frequency, exact_response, frequency_response, natural_frequencies


@dataclass(frozen=True, slots=True)
class Convergence:
    """Errors of the centre's frequency response against the closed form."""

    n: tuple[int, ...]
    frequency_hz: Array
    error: Array
    """(len(n), F): |H_n - H| / |H|, complex, so a shifted resonance counts in full."""
    amplitude_error: Array
    """(len(n), F): | |H_n| - |H| | / |H|."""
    first_frequency_hz: Array
    """(len(n),): undamped first frequency; Rayleigh-Ritz approaches it from above."""

    @property
    def max_error(self) -> Array:
        """(len(n),): the largest `error` over the frequencies."""
        return np.asarray(self.error.max(axis=1))

    @property
    def max_amplitude_error(self) -> Array:
        """(len(n),): the largest `amplitude_error` over the frequencies."""
        return np.asarray(self.amplitude_error.max(axis=1))


def convergence(
    tactor: Tactor,
    skin: Skin | None = None,
    frequency_hz: ArrayLike | None = None,
    n: Sequence[int] = (3, 5, 7, 10, 14, 20, 28, 40),
) -> Convergence:
    """Errors for each number of shapes in `n`; frequencies default to 1..500 Hz in steps of 1 Hz.

    Raises:
        ParameterError: a frequency < 0, or an n outside 3..300.
    """
    f = check_frequency(np.arange(1.0, 501.0) if frequency_hz is None else frequency_hz)
    exact = exact_response(tactor, f, skin)
    H = np.array([frequency_response(tactor, f, skin, k) for k in n])
    first = np.array([natural_frequencies(tactor, skin, k)[0] for k in n])
    size = np.abs(exact)
    return Convergence(tuple(n), f, np.abs(H - exact) / size, np.abs(np.abs(H) - size) / size, first)
