"""Significance of the smallest of many dependent p-values: its distribution for normal errors, by simulation.

Score tests of causes and discrepancies, points, patterns and chi-square look at the same residuals. Bonferroni's correction for some hundred
of them is too strict; the distribution of the smallest p-value under noise alone is exact up to the number of draws.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, log_ndtr

from model import Array
from model.identification.fit_result import JointFit

DRAWS = 2000
"""Number of simulated sets of residuals."""
INSIDE_FIT = 1e-6
"""Share of an effect outside the space of the fit, squared, below which the runs cannot show it."""


class Pattern(NamedTuple):
    """A test for correlated neighbours: the form r . L r of one run's residuals, with mean and standard deviation under noise."""

    rows: slice
    form: Array
    mean: float
    deviation: float


def unit_effect(effect: Array, Q: Array) -> Array | None:
    """Return the part of an effect outside the space of the fit, of length 1; None if these runs cannot show it."""
    rest = effect - Q @ (Q.T @ effect)
    weight = float(rest @ rest)
    return rest / np.sqrt(weight) if weight > INSIDE_FIT * float(effect @ effect) and weight > 0 else None


def point_rows(fit: JointFit) -> list[tuple[str, int, NDArray[np.intp]]]:
    """Return run, index and rows of each point in runs of two or more points that are all used."""
    out = []
    for run, part in zip(fit.observations.runs, fit.run_slices, strict=True):
        usable = np.flatnonzero(run.usable)
        rows = np.arange(part.start, part.stop).reshape(-1, usable.size)
        if usable.size > 1 and fit.used_rows[part].all():
            out += [(run.label, int(point), rows[:, i]) for i, point in enumerate(usable)]
    return out


def point_gains(residuals: Array, Q: Array, rows: Sequence[NDArray[np.intp]]) -> Array:
    """Return the decrease of chi-square without each point, (..., points), for residuals (..., rows)."""
    gains = []
    for i in rows:
        left = np.eye(i.size) - Q[i] @ Q[i].T
        if np.linalg.eigvalsh(left)[0] <= INSIDE_FIT:
            gains.append(np.zeros(residuals.shape[:-1]))
            continue
        r = residuals[..., i]
        gains.append(np.einsum("...i,ij,...j->...", r, np.linalg.inv(left), r))
    return np.stack(gains, axis=-1) if gains else np.zeros((*residuals.shape[:-1], 0))


def log_p_value(gain: Array, freedom: Array | int) -> Array:
    """Return the logarithm of the probability of a chi-square above `gain`, of one or two degrees of freedom."""
    one = log_ndtr(-np.sqrt(np.maximum(gain, 0.0))) + np.log(2)
    return np.where(np.asarray(freedom) == 2, -gain / 2, one)


def chance_of_smallest(fit: JointFit, Q: Array, directions: Sequence[Array], patterns: Sequence[Pattern]) -> float:
    """Return the probability under noise of a p-value as small as the smallest of all tests of this fit.

    Args:
        fit: the fit.
        Q: orthonormal basis of the fit's degrees of freedom, (rows, k).
        directions: tested effects, (rows,) each.
        patterns: tests for correlated neighbours.
    """
    used = fit.used_rows
    D = [u for d in directions if (u := unit_effect(np.where(used, d, 0.0), Q)) is not None]
    rows = [i for _, _, i in point_rows(fit)]
    freedom = np.array([i.size for i in rows], int)
    tests = np.array(D).T if D else np.zeros((used.size, 0))

    def smallest(r: Array) -> Array:
        """The logarithm of the smallest p-value of residuals (draws, rows)."""
        samples = [np.log(np.maximum(chdtrc(fit.degrees_of_freedom, np.sum(r * r, axis=1)), 1e-300))[:, None]]
        if D:
            samples.append(log_p_value((r @ tests) ** 2, 1))
        if rows:
            samples.append(log_p_value(point_gains(r, Q, rows), freedom))
        for p in patterns:
            part = r[:, p.rows]
            z = (np.einsum("di,ij,dj->d", part, p.form, part, optimize=True) - p.mean) / p.deviation
            samples.append(log_ndtr(-z)[:, None])
        return np.asarray(np.concatenate(samples, axis=1).min(axis=1))

    observed = float(smallest(np.where(used, fit.weighted_residuals, 0.0)[None])[0])
    if observed < -25:
        return float(np.exp(max(observed + np.log(tests.shape[1] + len(rows) + len(patterns) + 1), -690.0)))
    noise = np.random.default_rng(0).standard_normal((DRAWS, used.size)) * used
    noise -= (noise @ Q) @ Q.T
    return float((1 + np.sum(smallest(noise) <= observed)) / (1 + DRAWS))
