"""What the deflections under many weights say together: compliance of each side, their mean, and the departure from a line."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from protocols.values import Estimate

SOURCE = "static loading, weighted lines through zero"

SIDES = {1.0: "MFC up", -1.0: "aluminium up"}

Value = tuple[float, float]
"""A value and its standard error."""


def estimates(points: Sequence[Any]) -> tuple[Estimate, ...]:
    """Everything that good points of a static loading tell; what they do not suffice for is left out."""
    by_side = {side: [p for p in points if p.side == side] for side in SIDES}
    lines = {side: line for side, group in by_side.items() if (line := compliance(group)) is not None}
    found = [Estimate(f"compliance, {SIDES[side]}", *line, "m/N", SOURCE) for side, line in lines.items()]
    if len(lines) == len(SIDES):
        (one, one_error), (other, other_error) = lines.values()
        error = math.hypot(one_error, other_error)
        mean = (one + other) / 2
        found.append(Estimate("compliance, mean of both sides", mean, error / 2, "m/N", SOURCE))
        found.append(Estimate("difference of the sides", (one - other) / mean, error / abs(mean), "1", SOURCE))
    for side, group in by_side.items():
        if (bend := nonlinearity(group)) is not None:
            source = f"static loading, against a line, at {max(p.load for p in group):.3g} N"
            found.append(Estimate(f"nonlinearity, {SIDES[side]}", *bend, "1", source))
    return tuple(found)


def compliance(points: Sequence[Any]) -> Value | None:
    """Slope of the weighted line through zero, m/N; None for fewer than two points or no load.

    Each point is weighted with its own error, the load's included. What the points scatter more than that widens the
    standard error (Birge ratio).
    """
    if len(points) < 2:
        return None
    load, moved = (np.array([getattr(p, name) for p in points]) for name in ("load", "deflection"))
    slope = float(load @ moved / (load @ load))
    for _ in range(2):  # the load's error counts by the slope
        weight = 1 / _variance(points, slope)
        slope = float((weight * load) @ moved / ((weight * load) @ load))
    left = moved - slope * load
    birge = float(weight @ left**2) / (len(points) - 1)
    return slope, math.sqrt(max(birge, 1.0) / float((weight * load) @ load))


def nonlinearity(points: Sequence[Any]) -> Value | None:
    """By how much the compliance at the largest load differs from that at none, as a share: d = c F (1 + n F / F_max).

    None for fewer than three different loads.
    """
    if len({round(p.load, 9) for p in points}) < 3:
        return None
    first = compliance(points)
    if first is None or not first[0]:
        return None
    load, moved = (np.array([getattr(p, name) for p in points]) for name in ("load", "deflection"))
    most = float(load.max())
    root = 1 / np.sqrt(_variance(points, first[0]))
    basis = np.stack((load, load**2 / most), axis=1) * root[:, None]
    covariance = np.linalg.inv(basis.T @ basis)
    c, bent = covariance @ basis.T @ (moved * root)
    left = moved * root - basis @ np.array([c, bent])
    covariance *= max(float(left @ left) / (len(points) - 2), 1.0)
    turn = np.array([-bent / c**2, 1 / c])
    return float(bent / c), math.sqrt(float(turn @ covariance @ turn))


def _variance(points: Sequence[Any], slope: float) -> Any:
    return np.array([p.deflection_errors**2 + (slope * p.load_errors) ** 2 for p in points])
