"""Logarithmic creep: growth of a deflection per decade of time after a step, by least squares."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from protocols.signals.checks import check_samples

BINS_PER_DECADE = 20
"""Bins of the logarithm of time for averages: the late decades have nearly all samples without more information."""

MIN_BINS = 8


@dataclass(frozen=True, slots=True)
class CreepFit:
    """x(t) = value + per_decade log10(t / 1 s), in the unit of the samples.

    Attributes:
        value, value_error: value after a second, and its standard error.
        per_decade, per_decade_error: growth from t to 10 t.
        degrees_of_freedom: of the standard errors.
    """

    value: float
    value_error: float
    per_decade: float
    per_decade_error: float
    degrees_of_freedom: int


def fit_creep(time_s: ArrayLike, samples: ArrayLike, zero: float = 0.0) -> CreepFit:
    """Fit creep after a step.

    The errors are from the scatter of the bins about the line, each weighted with its number of samples; slow noise increases the
    scatter and is included.

    Args:
        time_s: (N,), time since the step, rising; all > 0.
        samples: (N,), sensor signal.
        zero: the level before the step.

    Raises:
        ValueError: not finite, a time <= 0, or less than half a decade.
    """
    t, x = check_samples("time", time_s, MIN_BINS), check_samples("the creep", samples, MIN_BINS)
    if t.size != x.size:
        raise ValueError(f"{t.size} times and {x.size} samples are given: they must be as many")
    if not t[0] > 0 or np.any(np.diff(t) <= 0):
        raise ValueError(f"the times must rise from above 0 (the first is {t[0]:g} s): creep is counted from the step")
    decades = float(np.log10(t[-1] / t[0]))
    if decades < 0.5:
        raise ValueError(
            f"from {t[0]:g} to {t[-1]:g} s are {decades:.2f} decades, at least 0.5 are needed: record longer, or from earlier on"
        )
    log = np.log10(t)
    edges = np.linspace(log[0], log[-1], int(np.ceil(decades * BINS_PER_DECADE)) + 1)[:-1]
    starts = np.unique(np.searchsorted(log, edges))
    counts = np.diff(np.append(starts, t.size))
    # Means of the regressors, not their values at the bins' middles: the fit is then exact for a bin of any width.
    basis = np.stack([np.add.reduceat(c, starts) / counts for c in (np.ones(t.size), log)], axis=1)
    binned = np.add.reduceat(x - zero, starts) / counts
    freedom = counts.size - basis.shape[1]
    if counts.size < MIN_BINS:
        raise ValueError(
            f"{t.size} samples fill {counts.size} bins of time, at least {MIN_BINS} are needed: sample faster"
        )
    weight = np.sqrt(counts)
    q, r = np.linalg.qr(basis * weight[:, None])
    solution = np.linalg.solve(r, q.T @ (binned * weight))
    left = weight * (binned - basis @ solution)
    inverse = np.linalg.inv(r)
    errors = np.sqrt((inverse**2).sum(1) * float(left @ left) / freedom)
    return CreepFit(float(solution[0]), float(errors[0]), float(solution[1]), float(errors[1]), freedom)
