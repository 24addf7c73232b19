"""Number of shape functions that keeps a stated accuracy against the closed form."""

from dataclasses import dataclass

import numpy as np

from model import ParameterError, Skin, Tactor
from model.response.closed_form import exact_response
from model.response.harmonic_response import frequency_response

DEFAULT_ACCURACY = 1e-3
"""Largest deviation of the complex response from the closed form, over the response."""
HIGHEST_HZ = 500.0
"""The response is compared from 1 Hz up to here, or to the highest frequency that is asked for."""
COMPARED_FREQUENCIES = 250
SHAPE_STEPS = (7, 10, 14, 20, 28, 40, 60, 80, 120)
"""The paper's number first."""


@dataclass(frozen=True, slots=True)
class ShapeChoice:
    """A number of shape functions and how far their response is from the closed form."""

    n: int
    error: float
    accuracy: float
    highest_hz: float

    @property
    def accurate(self) -> bool:
        """Whether the response is as accurate as it was asked for."""
        return self.error <= self.accuracy

    def describe(self) -> str:
        """Return number, error and accuracy as text."""
        if not self.error < 1:
            return (
                f"CAUTION: {self.n} shape functions do not follow the closed form with these parameters: the response is wrong; "
                "correct the value that is far from the paper's"
            )
        error = f"within {100 * self.error:.2g} % of the closed form from 1 to {self.highest_hz:g} Hz"
        if self.accurate:
            return f"{self.n} shape functions: the response is {error}"
        return (
            f"CAUTION: with {self.n} shape functions the response is only {error}, and {100 * self.accuracy:.2g} % is asked for; "
            "choose more of them, or leave their number to the program"
        )


def choose_shapes(
    tactor: Tactor,
    skin: Skin | None = None,
    n: int | None = None,
    accuracy: float = DEFAULT_ACCURACY,
    highest_hz: float = HIGHEST_HZ,
) -> ShapeChoice:
    """Return the smallest number of `SHAPE_STEPS` that is accurate, or how accurate a given `n` is.

    The largest number is returned where none is accurate.

    Raises:
        ParameterError: the accuracy is not between 1e-9 and 1, or n is outside 3..300.
    """
    if not 1e-9 <= accuracy < 1:
        raise ParameterError(f"accuracy is {accuracy:g}: it must lie between 1e-9 and 1")
    top = max(highest_hz, HIGHEST_HZ)
    f = np.linspace(1.0, top, COMPARED_FREQUENCIES)
    exact = exact_response(tactor, f, skin)
    error = np.inf
    count = 0
    for count in SHAPE_STEPS if n is None else (n,):
        error = float(np.max(np.abs(frequency_response(tactor, f, skin, count) - exact) / np.abs(exact)))
        if error <= accuracy:
            break
    return ShapeChoice(count, error, accuracy, top)
