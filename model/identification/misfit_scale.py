"""Scale of the misfit of each run, and variance of least squares and of robust losses.

An M-estimator with residuals s z, z normal, has the covariance A^-1 B A^-1 with A = a J'J and B = b J'J, a = E[psi'(s z)] and
b = E[psi(s z)^2] (Huber, Robust Statistics, 1981). For squares a = 1 and b = s^2.
"""

from functools import lru_cache

import numpy as np

from model import Array
from model.identification.fit_options import Loss

LOSS_SCALES: dict[Loss, float] = {"linear": 1.0, "soft_l1": 1.345, "cauchy": 2.385}
"""Tuning constant of each loss, in standard errors (95 % efficiency for normal data)."""
NORMAL_MAD = 1.4826
"""Standard deviation of a normal variable over its median absolute deviation."""
MAD_EFFICIENCY = 1.17
"""Standard error of the estimate by the median, times the root of the number of values, over the standard deviation."""
MAD_SIGMAS = 3.3
"""Number of its standard errors by which a significant robust scale exceeds 1."""
OUTLIER_SIGMAS = 4.0
"""Residual of an outlier of a robust fit, in scales of its run."""


def loss_weights(rows: Array, loss: Loss) -> Array:
    """Return the derivative of the loss to the squared residual, (rows,): the weight of each row in a robust fit."""
    squares = 1 + (rows / LOSS_SCALES[loss]) ** 2
    match loss:
        case "soft_l1":
            return np.asarray(1 / np.sqrt(squares))
        case "cauchy":
            return np.asarray(1 / squares)
    return np.ones_like(rows)


def loss_costs(rows: Array, loss: Loss) -> Array:
    """Return the loss of each residual, (rows,): at most its square."""
    c2 = LOSS_SCALES[loss] ** 2
    match loss:
        case "soft_l1":
            return np.asarray(2 * c2 * (np.sqrt(1 + rows**2 / c2) - 1))
        case "cauchy":
            return np.asarray(c2 * np.log1p(rows**2 / c2))
    return np.asarray(rows**2)


@lru_cache(maxsize=256)
def influence_moments(loss: Loss, scale: float) -> tuple[float, float]:
    """Return E[psi'] and E[psi^2] of a loss for normal residuals of this standard deviation."""
    if loss == "linear":
        return 1.0, scale**2
    z = np.linspace(-8, 8, 4001)
    weight = np.exp(-(z**2) / 2)
    weight /= weight.sum()
    r = scale * z
    psi = r * loss_weights(r, loss)
    return float(weight @ np.gradient(psi, r)), float(weight @ psi**2)


def robust_scale(rows: Array, freedom: float) -> float:
    """Return the standard deviation of residuals by their median size, which is robust against outliers; 1 if it can be chance."""
    if rows.size < 2 or freedom <= 0:
        return 1.0
    scale = NORMAL_MAD * float(np.median(np.abs(rows))) * np.sqrt(rows.size / freedom)
    return scale if scale > 1 + MAD_SIGMAS * MAD_EFFICIENCY / np.sqrt(rows.size) else 1.0
