"""Resonance frequency and damping ratio from the points of a sine dwell."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.values import Estimate

Array = NDArray[Any]

SOURCE = "complex fit of one mode and a constant to the fundamentals of this run"


def fit_resonance(points: Sequence[Any]) -> tuple[Estimate, ...]:
    """One resonant mode plus a constant (what higher modes add far below their resonance), by least squares.

    The standard errors are scaled by the misfit, which the model error of one mode dominates.

    Args:
        points: with `frequency`, `fundamental`, `phase`, `drive_amplitude` (see SinePoint); all usable.

    Returns:
        Resonance frequency in hertz and damping ratio; empty where the points do not span a resonance.
    """
    if len(points) < 5:
        return ()
    from scipy.optimize import least_squares

    f = np.array([p.frequency for p in points])
    response = np.array([p.fundamental / p.drive_amplitude * np.exp(1j * p.phase) for p in points])
    scale = np.abs(response).max()
    peak = f[np.abs(response).argmax()]

    def model(parameters: Array) -> Array:
        f0, zeta, a, b, re, im = parameters
        r = f / (f0 * peak)
        return np.asarray((a + 1j * b) / (1 - r**2 + 2j * zeta * r) + re + 1j * im)

    def misfit(parameters: Array) -> Array:
        gap = model(parameters) - response / scale
        return np.concatenate([gap.real, gap.imag], dtype=float)

    fit = least_squares(misfit, [1.0, 0.2, 0.4, 0.0, 0.0, 0.0], max_nfev=500)
    freedom = 2 * len(f) - len(fit.x)
    if not fit.success or freedom < 1 or not f.min() < fit.x[0] * peak < f.max():
        return ()
    jacobian = np.asarray(fit.jac)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * 2 * fit.cost / freedom
    errors = np.sqrt(np.diag(covariance))
    return (
        Estimate("resonance frequency", float(fit.x[0] * peak), float(errors[0] * peak), "Hz", SOURCE),
        Estimate("damping ratio", float(abs(fit.x[1])), float(errors[1]), "1", SOURCE),
    )
