"""The coordinates a fit moves in: logarithms of what is positive, the rest in units of its scale."""

import numpy as np
from numpy.typing import NDArray

from model.identification import names as known
from model.identification.problem import Problem

Array = NDArray[np.float64]

REACH = 12.0
"""How far a logarithm may go to either side: five powers of ten."""

INSIDE = 1e-9
"""A start on a limit is moved so far inside."""


class Coordinates:
    """x, (P,), in place of the parameters theta, (P,), for a descent that begins at `start`.

    Attributes:
        begin, low, high: where it begins, and between which limits it stays, (P,) each.
    """

    def __init__(self, problem: Problem, start: Array) -> None:
        self._log = problem.log & (start > 0)
        scale = np.array([known.scale(n, x) for n, x in zip(problem.names, start, strict=True)])
        self._scale = np.where(self._log, 1.0, scale)
        for i, name in enumerate(problem.names):
            if name in problem.campaign.common:
                self._scale[i] = problem.campaign.common[name].standard_error
        middle = np.log(np.where(self._log, start, 1.0))
        self.low = np.where(self._log, middle - REACH, problem.low / self._scale)
        self.high = np.where(self._log, middle + REACH, problem.high / self._scale)
        self.begin = np.clip(
            self.inward(start),
            np.where(np.isfinite(self.low), self.low + INSIDE, self.low),
            np.where(np.isfinite(self.high), self.high - INSIDE, self.high),
        )

    def inward(self, theta: Array) -> Array:
        """Theta -> x."""
        return np.where(self._log, np.log(np.where(self._log, theta, 1.0)), theta / self._scale)

    def outward(self, x: Array) -> Array:
        """X -> theta."""
        return np.where(self._log, np.exp(np.where(self._log, x, 0.0)), x * self._scale)

    def steepness(self, theta: Array) -> Array:
        """D theta / d x, (P,)."""
        return np.where(self._log, theta, self._scale)
