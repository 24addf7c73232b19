"""Damped Gauss-Newton descent (Levenberg-Marquardt) whose steps are corrected by residuals alone.

Precise runs determine some combinations of parameters a million times better than others, so that the least squares are in a narrow,
bent valley. A step along its tangent leaves it, and a method that judges the step there shortens it until nothing moves. Here the
end of a step is brought back to the bottom by further residuals with the slopes of its begin, which costs a fraction of new
slopes, before the step is judged (the second-order correction of sequential quadratic programming, Nocedal and Wright, Numerical
Optimization, 2006, section 18.3).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from model import Array

SETTLED = 1e-13
"""Possible decrease of the cost at a minimum: a third of a millionth of a standard error, squared."""
NEARLY_SETTLED = 1e-11
"""The same where a further step does not make it smaller, because slopes are rounded, too."""
ROUNDING = 1e-12
"""Relative decrease of the cost that may be rounding error: if less is possible, the step is judged by the decrease possible at its end."""
START_DAMPING, MIN_DAMPING, MAX_DAMPING = 1e-2, 1e-12, 1e12
"""Addition to the squares of the singular values; of a prior alone they are 1."""
LESS_DAMPING, MORE_DAMPING = 100.0, 4.0
"""Factors after a step that succeeds at once and after one that fails."""
MAX_CORRECTIONS = 5
"""Largest number of points of one step."""
WORTH_CORRECTING = 0.1
"""Share of the decrease of a step that a further correction has to add."""
RANK_TOLERANCE = 1e-12
"""Smallest singular value over the largest one of a direction that counts for the end of a descent."""
ON_LIMIT = 1e-9
"""Distance from a limit, in usual steps, of a parameter that is held there."""


class Linearization(NamedTuple):
    """Cost, weighted residuals (rows,) and their slopes (rows, P) at a point."""

    cost: float
    residuals: Array
    slopes: Array


class Box(NamedTuple):
    """Limits and usual steps of the coordinates, (P,) each."""

    low: Array
    high: Array
    steps: Array


def descend(
    start: Array,
    box: Box,
    linearize: Callable[[Array], Linearization],
    cost_and_residuals: Callable[[Array], tuple[float, Array]],
    limits: tuple[int, float],
) -> tuple[Array, bool]:
    """Return the point with the least cost from a start (P,), and whether it is a minimum.

    Args:
        start: the first point.
        box: limits and usual steps.
        linearize: cost, residuals and slopes at a point.
        cost_and_residuals: the same without slopes; a cost that is not finite is a point that cannot be evaluated.
        limits: largest number of linearizations, and the share of the cost that may be left to gain at a minimum.
    """
    x, damping, rounding = start, START_DAMPING, ROUNDING
    at = linearize(x)
    before = np.inf, x, at
    for _ in range(limits[0] - 1):
        slopes = at.slopes * box.steps
        uphill = slopes.T @ at.residuals
        near = ON_LIMIT * box.steps
        held = ((x <= box.low + near) & (uphill > 0)) | ((x >= box.high - near) & (uphill < 0))
        parts = np.linalg.svd(np.where(held, 0.0, slopes), full_matrices=False)
        possible = float(np.sum((parts[0].T @ at.residuals)[parts[1] > RANK_TOLERANCE * parts[1][0]] ** 2))
        if possible < limits[1] * at.cost + SETTLED:
            return x, True
        if possible >= before[0]:
            if before[0] < NEARLY_SETTLED:
                return before[1], True
            # A large misfit bends the cost more than the slopes say: the cost judges the steps after all.
            (_, x, at), before, rounding = before, (np.inf, x, at), 0.0
            continue
        if possible < rounding * at.cost:
            before, x = (possible, x, at), _moved(x, box, _damped(parts, at.residuals, np.zeros(x.size), damping))
            at = linearize(x)
            continue
        found, tried = None, 0
        while found is None and damping < MAX_DAMPING:
            found, tried = _step(x, box, at, parts, damping, cost_and_residuals), tried + 1
            if found is None:
                damping *= MORE_DAMPING
            elif tried == 1:
                damping = max(damping / LESS_DAMPING, MIN_DAMPING)
        if found is None:  # what is left to gain is below the rounding of the cost
            return x, True
        x, at = found, linearize(found)
    return x, False


def _damped(parts: tuple[Array, Array, Array], residuals: Array, step: Array, damping: float) -> Array:
    """Return a step (P,), in usual steps, corrected by the residuals at its end."""
    U, s, V = parts
    return np.asarray(step - V.T @ ((s * (U.T @ residuals) + damping * (V @ step)) / (s**2 + damping)))


def _moved(x: Array, box: Box, step: Array) -> Array:
    return np.clip(x + step * box.steps, box.low, box.high)


def _step(
    x: Array,
    box: Box,
    at: Linearization,
    parts: tuple[Array, Array, Array],
    damping: float,
    cost_and_residuals: Callable[[Array], tuple[float, Array]],
) -> Array | None:
    """Return the best point of one corrected step; None if none has a smaller cost."""
    step, residuals = np.zeros(x.size), at.residuals
    best: tuple[float, Array] | None = None
    for _ in range(MAX_CORRECTIONS):
        point = _moved(x, box, _damped(parts, residuals, step, damping))
        step = (point - x) / box.steps
        cost, residuals = cost_and_residuals(point)
        if not np.isfinite(cost) or (best is not None and not cost < best[0]):
            break
        worth = best is None or best[0] - cost > WORTH_CORRECTING * abs(at.cost - cost)
        best = cost, point
        if not worth:
            break
    return best[1] if best is not None and best[0] < at.cost else None
