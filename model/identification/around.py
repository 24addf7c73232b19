"""A point of the parameters and a step up and down of each: what the model says there, all in one array operation."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.identification.equation import Values
from model.identification.observations import Acts, Observation
from model.identification.receptance import Factors

Array = NDArray[np.float64]
Ends = tuple[tuple[float, float], tuple[float, float]]
"""A geometry, L1 / L and L2 / L, to either side of one."""

STEP = 1e-6
"""Of a parameter's scale, or of a ratio of lengths; a central difference takes it up and down."""


class Around:
    """S = 2 P + 1 sets of all parameters: the point of the P free ones, then every step up, then every step down.

    Args:
        theta: the point, (P,).
        scale: of each free parameter, (P,); a step is a share of it, or of the parameter where that is larger.
        join: every parameter by name from the free ones, (P, S).
    """

    def __init__(self, theta: Array, scale: Array, join: Callable[[Array], Values]) -> None:
        P = theta.size
        self.sets = 2 * P + 1
        self._h = STEP * np.maximum(np.abs(theta), scale)
        table = np.tile(theta, (self.sets, 1))
        table[1 : P + 1] += np.diag(self._h)
        table[P + 1 :] -= np.diag(self._h)
        self.values = join(table.T)
        """Every parameter by name: plain where it is fixed, else (S,)."""

    def slopes(self, y: Any) -> Any:
        """Slopes to the free parameters of what was computed for every set: (S, ...) -> (P, ...)."""
        P = self._h.size
        y = np.broadcast_to(y, (self.sets, *np.shape(y)[1:])) if np.ndim(y) else np.full(self.sets, y)
        return (y[1 : P + 1] - y[P + 1 :]) / (2 * self._h).reshape(-1, *(1,) * (y.ndim - 1))

    def shared(self, run: Observation, acts_on: Acts) -> Array:
        """Sum of a run's common errors of one kind, (S,)."""
        errors = (self.values[e.name] for e in run.common if e.acts_on == acts_on)
        return np.asarray(sum(errors, start=np.zeros(self.sets)))

    def stack(self, factors: Sequence[Factors]) -> tuple[Factors, Factors]:
        """Values (R, 6) and slopes (P, R, 6) of entries of (S, 6) each, one a row."""
        tables = [np.stack([f[i] for f in factors], axis=1) for i in range(3)]
        return Factors(*(t[0] for t in tables)), Factors(*(self.slopes(t) for t in tables))

    @property
    def geometry(self) -> tuple[float, float]:
        """L1 / L and L2 / L at the point."""
        l1, l2 = self._ratios()
        return float(l1[0]), float(l2[0])

    def moves(self) -> list[tuple[Ends, Any]]:
        """Geometries to look at either side where L1 / L or L2 / L hangs on a free parameter, with its slopes (P,)."""
        l1, l2 = self._ratios()
        a, b = self.geometry
        ends: tuple[Ends, Ends] = (((a + STEP, b), (a - STEP, b)), ((a, b + STEP), (a, b - STEP)))
        return [(each, self.slopes(ratio)) for ratio, each in zip((l1, l2), ends, strict=True) if np.ptp(ratio)]

    def _ratios(self) -> tuple[Array, Array]:
        v = self.values
        return np.broadcast_to(v["L1"] / v["L"], self.sets), np.broadcast_to(v["L2"] / v["L"], self.sets)
