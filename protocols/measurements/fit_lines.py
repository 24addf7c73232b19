"""Fit lines of points: selection of the points, and the weighted mean as a line."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from protocols.base import Quality, Role, Series

CURVE_POINTS = 101
"""Number of abscissae of a curved line."""


def line_indices(points: Sequence[Any], x_name: str, y_name: str) -> tuple[int, ...]:
    """Return the usable points with finite coordinates."""
    return tuple(
        i
        for i, p in enumerate(points)
        if Quality(p.quality).usable and math.isfinite(getattr(p, x_name)) and math.isfinite(getattr(p, y_name))
    )


def mean_line(points: Sequence[Any], x_name: str, y_name: str, label: str) -> tuple[Series, ...]:
    """Return the mean of at least two points, weighted with their errors, as a level line."""
    used = line_indices(points, x_name, y_name)
    if len(used) < 2:
        return ()
    x, y, error = (np.array([getattr(points[i], n) for i in used], float) for n in (x_name, y_name, f"{y_name}_errors"))
    weight = 1 / error**2 if (error > 0).all() else np.ones(y.size)
    ends = np.array([x.min(), x.max()])
    mean = np.full(2, float(weight @ y / weight.sum()))
    return (Series(ends, mean, role=Role.FIT, label=label, fitted_rows=used),)
