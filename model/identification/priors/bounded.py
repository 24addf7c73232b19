"""Prior values next to a physical limit, such as creep, as normal distributions of the same posterior mean and variance.

A prior whose limit lies within `NEAR_SIGMAS` is a truncated normal distribution: half of one where the usual size is none. The posterior
of a linear fit with it is not normal; its mean and variance are those of a fit with a normal prior, which expectation propagation finds
(Minka, Expectation propagation for approximate Bayesian inference, UAI 2001).
"""

from collections.abc import Mapping

import numpy as np
from scipy.special import log_ndtr

from model import Array
from model.identification import parameters as fit_parameters

NEAR_SIGMAS = 4.0
"""Standard deviations from a prior value to a limit up to which the limit counts: beyond, it cuts off less than 4e-5."""
FARTHEST_SIGMAS = 1e3
"""A mean so far beyond the limit is as good as any farther."""
ROUNDS = 30
SETTLED = 1e-4
"""Change of a mean, in standard deviations, at which a search has settled."""

Prior = tuple[float, float]


def truncated_moments(mean: float, deviation: float, limit: float, side: int) -> Prior:
    """Return mean and standard deviation of a truncated normal distribution; `side` 1 keeps values above the limit, -1 below."""
    a = min(side * (limit - mean) / deviation, FARTHEST_SIGMAS)
    hazard = float(np.exp(-0.5 * a * a - 0.5 * np.log(2 * np.pi) - log_ndtr(-a)))
    if a < 30:
        return mean + side * deviation * hazard, deviation * float(np.sqrt(1 - hazard * (hazard - a)))
    return limit + side * deviation / a, deviation / a  # exponential


def near_limit(name: str, prior: Prior) -> tuple[float, int] | None:
    """Return the limit next to a prior value of a parameter, and on which side of it the parameter is; None where none is near."""
    interval, (value, deviation) = fit_parameters.SPECIMEN_PARAMETERS.get(name), prior
    if interval is None:
        return None
    for limits, side in (
        ((interval.interval.ge, interval.interval.gt), 1),
        ((interval.interval.le, interval.interval.lt), -1),
    ):
        for limit in limits:
            if limit is not None and abs(value - float(limit)) < NEAR_SIGMAS * deviation:  # type: ignore[arg-type]
                return float(limit), side  # type: ignore[arg-type]
    return None


def prior_moments(name: str, prior: Prior) -> Prior:
    """Return mean and standard deviation of a prior with its limit: a half of a normal distribution around none is 0.8 ± 0.6 of it."""
    limit = near_limit(name, prior)
    return prior if limit is None else truncated_moments(*prior, *limit)


def normal_equivalents(
    names: tuple[str, ...],
    priors: Mapping[str, Prior],
    present: Mapping[str, Prior],
    linear_fit: tuple[Array, Array, Array],
) -> dict[str, Prior]:
    """Return the normal priors with which a linear fit has the posterior means and variances of the truncated ones, by name.

    Args:
        names: parameters of the fit, (P,).
        priors: every prior value of a specimen's parameter.
        present: normal priors that took the place of truncated ones in the fit.
        linear_fit: parameters (P,), slopes (rows, P) and residuals (rows,) with the rows of the priors.
    """
    theta, jacobian, residuals = linear_fit
    limits = {name: found for name in present if (found := near_limit(name, priors[name])) is not None}
    scale = 1 / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    J = jacobian * scale
    covariance = np.linalg.inv(J.T @ J + 1e-12 * np.eye(len(names)))
    mean = theta / scale + covariance @ (J.T @ residuals)
    sites = dict(present)
    for _ in range(ROUNDS):
        moved = 0.0
        for name, (limit, side) in limits.items():
            i = names.index(name)
            own, (m, s) = scale[i], sites[name]
            value, variance = float(mean[i] * own), float(covariance[i, i] * own**2)
            precision = max(1 / variance - 1 / s**2, 1e-9 / variance)  # of all but this prior
            others = value / variance - m / s**2
            m0, s0 = priors[name]
            both = precision + 1 / s0**2
            new, deviation = truncated_moments((others + m0 / s0**2) / both, both**-0.5, limit, side)
            moved = max(moved, abs(new - value) / deviation)
            site = max(1 / deviation**2 - precision, 1 / s0**2)  # a limit only adds; less is rounding
            sites[name] = (new / deviation**2 - others) / site, site**-0.5
            column = covariance[:, i] / covariance[i, i]
            mean = mean + column * (new - value) / own
            covariance = covariance + np.outer(column, column) * (deviation**2 - variance) / own**2
        if moved < SETTLED:
            break
    return sites
