"""Logarithmic creep: growth of a deflection per decade of time after a step, by least squares."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from protocols.signals.checks import check_positive, check_samples

BINS_PER_DECADE = 20
"""Bins of the logarithm of time for averages: the late decades have nearly all samples without more information."""

MIN_BINS = 8


@dataclass(frozen=True, slots=True)
class CreepFit:
    """x(t) = value + per_decade log10(t / reference) (+ drift t), in the unit of the samples.

    Attributes:
        value, value_error: value at the reference time, and its standard error.
        per_decade, per_decade_error: growth from t to 10 t.
        drift_per_s, drift_error: slope of an additional straight line; 0 without one.
        reference_s: the reference time.
        degrees_of_freedom: of the standard errors; see `coverage_factor`.
        decades: fitted decades of time.
    """

    value: float
    value_error: float
    per_decade: float
    per_decade_error: float
    drift_per_s: float
    drift_error: float
    reference_s: float
    degrees_of_freedom: int
    decades: float


def fit_creep(
    time_s: ArrayLike, samples: ArrayLike, zero: float = 0.0, reference_s: float = 1.0, with_drift: bool = False
) -> CreepFit:
    """Fit creep after a step.

    The errors are from the scatter of the bins about the line, each weighted with its number of samples; slow noise increases the
    scatter and is included.

    Args:
        time_s: (N,), time since the step, rising; all > 0.
        samples: (N,), sensor signal.
        zero: the level before the step.
        reference_s: time to which `value` refers.
        with_drift: whether to fit a straight line in time in addition to the logarithm.

    Raises:
        ValueError: not finite, a time <= 0, or less than half a decade.
    """
    check_positive(reference_s=reference_s)
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
    log = np.log10(t / reference_s)
    edges = np.linspace(log[0], log[-1], int(np.ceil(decades * BINS_PER_DECADE)) + 1)[:-1]
    starts = np.unique(np.searchsorted(log, edges))
    counts = np.diff(np.append(starts, t.size))
    columns = [np.ones(t.size), log, *([t] if with_drift else [])]
    # Means of the regressors, not their values at the bins' middles: the fit is then exact for a bin of any width.
    basis = np.stack([np.add.reduceat(c, starts) / counts for c in columns], axis=1)
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
    drift, drift_error = (float(solution[2]), float(errors[2])) if with_drift else (0.0, 0.0)
    return CreepFit(
        value=float(solution[0]) + drift * reference_s,
        value_error=float(
            np.linalg.norm(inverse.T @ np.array([1.0, 0.0, *([reference_s] if with_drift else [])]))
            * np.sqrt(left @ left / freedom)
        ),
        per_decade=float(solution[1]),
        per_decade_error=float(errors[1]),
        drift_per_s=drift,
        drift_error=drift_error,
        reference_s=reference_s,
        degrees_of_freedom=freedom,
        decades=decades,
    )
