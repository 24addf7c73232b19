"""One resonant mode in a frequency response: its natural frequency and damping by a complex least-squares fit."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

LEAST_LINES = 5


@dataclass(frozen=True, slots=True)
class Mode:
    """A mode a / (1 - r^2 + 2 i zeta r) plus a constant (what higher modes add far below their resonance), r = f / f0.

    Attributes:
        natural_hz, natural_error_hz: undamped natural frequency f0 and its standard error, Hz.
        damping_ratio, damping_error: zeta and its standard error.
        amplitude, constant: complex, in the unit of the response.
        degrees_of_freedom: of the standard errors.
    """

    natural_hz: float
    natural_error_hz: float
    damping_ratio: float
    damping_error: float
    amplitude: complex
    constant: complex
    degrees_of_freedom: int

    @property
    def peak_hz(self) -> float:
        """Where the modulus of the mode alone is largest: f0 sqrt(1 - 2 zeta^2); 0 where it is overdamped."""
        return self.natural_hz * float(np.sqrt(max(1 - 2 * self.damping_ratio**2, 0.0)))


def fit_mode(
    frequency_hz: ArrayLike, response: ArrayLike, standard_error: ArrayLike | None = None, correlation: float = 0.0
) -> Mode:
    """Fit one mode and a constant to a complex response.

    The standard errors are scaled by the misfit: the model error of one mode usually dominates the noise.

    Args:
        frequency_hz: (F,), of the lines; they must enclose the resonance.
        response: (F,), complex.
        standard_error: (F,), of real and imaginary part; equal where None.
        correlation: of neighbouring lines, see `FrequencyResponse`.

    Raises:
        ValueError: fewer than 5 lines, or no resonance within them.
    """
    from scipy.optimize import least_squares

    f, H = np.asarray(frequency_hz, float), np.asarray(response, complex)
    if f.size < LEAST_LINES:
        raise ValueError(f"{f.size} lines are given, a mode needs at least {LEAST_LINES}: measure more frequencies")
    if not np.isfinite(H).all():
        raise ValueError(
            f"{np.count_nonzero(~np.isfinite(H))} of {f.size} lines of the response are not finite numbers"
        )
    scale, peak = float(np.abs(H).max()), float(f[np.abs(H).argmax()])
    weight = np.ones(f.size) if standard_error is None else 1 / np.asarray(standard_error, float)
    weight = weight / weight.max()

    def model(parameters: Array) -> NDArray[np.complex128]:
        f0, zeta, a, b, re, im = parameters
        r = f / (f0 * peak)
        return np.asarray((a + 1j * b) / (1 - r**2 + 2j * zeta * r) + re + 1j * im)

    def misfit(parameters: Array) -> Array:
        gap = weight * (model(parameters) - H / scale)
        return np.concatenate([gap.real, gap.imag], dtype=float)

    start = H[np.abs(H).argmax()] / scale * 0.4j  # a mode of damping 0.2 at its resonance is a / 0.4i
    fit = least_squares(misfit, [1.0, 0.2, start.real, start.imag, 0.0, 0.0], max_nfev=500)
    freedom = 2 * f.size - fit.x.size
    natural = float(fit.x[0]) * peak
    if not fit.success or freedom < 1 or not f.min() < natural < f.max():
        raise ValueError(f"no resonance between {f.min():g} and {f.max():g} Hz: measure a band that encloses it")
    jacobian = np.asarray(fit.jac)
    # Neighbouring lines share noise: a smooth function of them feels (1 + 2 rho) of its variance.
    variance = 2 * fit.cost / freedom * (1 + 2 * correlation)
    errors = np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian)) * variance)
    return Mode(
        natural_hz=natural,
        natural_error_hz=float(errors[0]) * peak,
        damping_ratio=float(abs(fit.x[1])),
        damping_error=float(errors[1]),
        amplitude=scale * complex(fit.x[2], fit.x[3]),
        constant=scale * complex(fit.x[4], fit.x[5]),
        degrees_of_freedom=freedom,
    )
