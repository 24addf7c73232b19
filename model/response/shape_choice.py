"""Number of shape functions, or of Hermite elements' unknowns, that keeps a stated accuracy against the closed form."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from model import NO_SKIN, Array, Complex, ParameterError, Skin, Tactor
from model.beam import gram, hermite_gram, matrices, modal_form, receptance
from model.response.closed_form import exact_response

DEFAULT_ACCURACY = 1e-3
"""Largest deviation of the complex response from the closed form, over the response."""
HIGHEST_HZ = 500.0
"""Upper end of the comparison, which begins at 1 Hz; the highest requested frequency if that is higher."""
COMPARED_FREQUENCIES = 250
SHAPE_STEPS = (7, 10, 14, 20, 28, 40, 60, 80, 120)
"""Candidate numbers, the paper's first."""
HERMITE_STEPS = (11, 17, 23, 29, 35, 47, 59, 83, 119)
"""Numbers of unknowns of Hermite elements: at equal accuracy 0.3 to 0.65 of the time of more than 7 of the paper's shape
functions."""


@dataclass(frozen=True, slots=True)
class ShapeChoice:
    """A number of shape functions, and the deviation of their response from the closed form."""

    n: int
    error: float
    accuracy: float
    highest_hz: float
    hermite: bool = False

    @property
    def accurate(self) -> bool:
        """Whether the response has the requested accuracy."""
        return self.error <= self.accuracy

    def describe(self) -> str:
        """Return number, error and accuracy as text."""
        basis = f"Hermite elements with {self.n} unknowns" if self.hermite else f"{self.n} shape functions"
        if not self.error < 1:
            return (
                f"CAUTION: {basis} do not follow the closed form with these parameters: the response is wrong; "
                "correct the value that is far from the paper's"
            )
        error = f"within {100 * self.error:.2g} % of the closed form from 1 to {self.highest_hz:g} Hz"
        if self.accurate:
            return f"{basis}: the response is {error}"
        return (
            f"CAUTION: with {basis} the response is only {error}, and {100 * self.accuracy:.2g} % is requested; "
            "choose more of them, or leave their number to the program"
        )


def choose_shapes(
    tactor: Tactor,
    skin: Skin | None = None,
    n: int | None = None,
    accuracy: float = DEFAULT_ACCURACY,
    highest_hz: float = HIGHEST_HZ,
    hermite: bool = False,
) -> ShapeChoice:
    """Return the smallest accurate number of `SHAPE_STEPS`, or the accuracy of a given `n`.

    With `hermite` the candidates beyond the paper's number are `HERMITE_STEPS`. If none is accurate, the largest is returned.

    Raises:
        ParameterError: the accuracy is not between 1e-9 and 1, or n is outside 3..300.
    """
    if not 1e-9 <= accuracy < 1:
        raise ParameterError(f"accuracy is {accuracy:g}: it must lie between 1e-9 and 1")
    top = max(highest_hz, HIGHEST_HZ)
    f = np.linspace(1.0, top, COMPARED_FREQUENCIES)
    exact = exact_response(tactor, f, skin)
    tried: list[tuple[int, bool]] = [(count, False) for count in (SHAPE_STEPS if n is None else (n,))]
    if hermite and n is None:
        tried = [(SHAPE_STEPS[0], False), *((count, True) for count in HERMITE_STEPS)]
    error, count, elements = np.inf, 0, False
    for count, elements in tried:
        response = _response(tactor, f, skin, count, hermite_gram if elements else gram)
        error = float(np.max(np.abs(response - exact) / np.abs(exact)))
        if error <= accuracy:
            break
    return ShapeChoice(count, error, accuracy, top, elements)


def _response(tactor: Tactor, f: Array, skin: Skin | None, n: int, integrals: Callable[..., Any]) -> Complex:
    skin = skin or NO_SKIN
    m = matrices(tactor.beam, skin.k_s, skin.c_s, n, integrals)
    # One set of many: NumPy's eigenvalues, without loading SciPy for a single question.
    form = modal_form(m.M[None], m.C[None], m.K[None], m.B[None], 2 * m.B_F[None])
    return np.asarray(receptance(form, 2 * np.pi * f)[0])
