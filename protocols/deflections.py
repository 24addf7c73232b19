"""What the deflections of many voltage steps say together: slope, creep, repeatability, and the width of the loop."""

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

UP, DOWN, RANDOM = "up", "down", "random"
DIRECTION = {UP: 1.0, DOWN: -1.0, RANDOM: 0.0}
"""The order of levels as a column of a file: rising, falling, shuffled."""

LEVEL_TOLERANCE_V = 0.02
"""How far the card may see a level from the one commanded: the supply's accuracy and its own."""


def slope(points: Sequence[Any]) -> tuple[float, float] | None:
    """Deflection per volt of the recorded drive, a line through the origin, and its error from the scatter."""
    if len(points) < 2:
        return None
    v, w = np.array([p.drive_step for p in points]), np.array([p.deflection for p in points])
    slope = float(v @ w / (v @ v))
    spread = float(np.sum((w - slope * v) ** 2)) / (len(points) - 1)
    noise = float(np.sum((v * np.array([p.deflection_errors for p in points])) ** 2)) / float(v @ v) ** 2
    return slope, math.sqrt(max(spread / float(v @ v), noise))


def creep_share(points: Sequence[Any]) -> tuple[float, float] | None:
    """Creep per decade over the deflection, weighted, and its error from the scatter over the levels."""
    told = [p for p in points if abs(p.drive_step) > LEVEL_TOLERANCE_V and p.creep_errors > 0]
    if len(told) < 3:
        return None
    share = np.array([p.creep / p.deflection for p in told])
    weight = np.array([(p.deflection / p.creep_errors) ** 2 for p in told])
    mean = float(weight @ share / weight.sum())
    scatter = float(weight @ (share - mean) ** 2 / weight.sum()) / (len(told) - 1)
    return mean, math.sqrt(max(scatter, 1 / float(weight.sum())))


def repeatability(points: Sequence[Any]) -> tuple[float, float] | None:
    """Standard deviation of a deflection from repeat to repeat, pooled over levels and directions, and its error."""
    squares, freedom = 0.0, 0
    for group in _by(points, lambda p: (p.level, p.direction)).values():
        values = np.array([p.deflection for p in group])
        squares += float(np.sum((values - values.mean()) ** 2))
        freedom += len(group) - 1
    if not freedom:
        return None
    deviation = math.sqrt(squares / freedom)
    return deviation, deviation / math.sqrt(2 * freedom)


def loop_width(points: Sequence[Any]) -> tuple[float, float] | None:
    """Deflection with levels falling minus with levels rising, averaged over the levels that have both, and its error."""
    gaps, variances = [], []
    for group in _by(points, lambda p: p.level).values():
        up, down = ([p for p in group if p.direction == d] for d in (DIRECTION[UP], DIRECTION[DOWN]))
        if up and down:
            gaps.append(np.mean([p.deflection for p in down]) - np.mean([p.deflection for p in up]))
            variances.append(sum(_mean_variance(row) for row in (up, down)))
    if not gaps:
        return None
    return float(np.mean(gaps)), math.sqrt(sum(variances)) / len(gaps)


def _mean_variance(row: Sequence[Any]) -> float:
    """Of the mean of repeats: from their scatter where there are some, at least what their own errors make."""
    own = sum(float(p.deflection_errors) ** 2 for p in row) / len(row) ** 2
    scatter = float(np.var([p.deflection for p in row], ddof=1)) / len(row) if len(row) > 1 else 0.0
    return max(own, scatter)


def _by(points: Sequence[Any], key: Callable[[Any], Any]) -> dict[Any, list[Any]]:
    groups: dict[Any, list[Any]] = defaultdict(list)
    for point in points:
        groups[key(point)].append(point)
    return groups
