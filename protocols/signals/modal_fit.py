"""Modal fit: natural frequency and damping of one mode by a complex least-squares fit."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model import Array, Complex

MIN_LINES = 5

MIN_PATTERN_LINES = 30
"""Fewest lines from which the correlation of their misfits is estimated."""


@dataclass(frozen=True, slots=True)
class ModalFit:
    """A mode of a real system, (a + i b r) / (1 - r^2 + 2 i zeta r), r = f / f0, plus the residual of higher modes.

    Attributes:
        natural_hz, natural_error_hz: undamped natural frequency f0 and its standard error, Hz.
        damping_ratio, damping_error: zeta and its standard error.
        amplitude: a + i b, in the unit of the response.
        constant: compliance of the higher modes, in the unit of the response.
        degrees_of_freedom: of the standard errors.
        natural_noise_hz, damping_noise: standard errors by the noise of the lines alone, without the misfit of the mode, which is the
            same whenever the same specimen is measured alike; NaN without errors of the lines.
        fitted: (F,), the fit at the given lines.
    """

    natural_hz: float
    natural_error_hz: float
    damping_ratio: float
    damping_error: float
    amplitude: complex
    constant: float
    degrees_of_freedom: int
    natural_noise_hz: float = np.nan
    damping_noise: float = np.nan
    fitted: Complex = field(default_factory=lambda: np.zeros(0, complex), compare=False, repr=False)

    @property
    def peak_hz(self) -> float:
        """Frequency of the largest modulus of the mode alone: f0 sqrt(1 - 2 zeta^2); 0 for an overdamped mode."""
        return self.natural_hz * float(np.sqrt(max(1 - 2 * self.damping_ratio**2, 0.0)))


def fit_sdof(
    frequency_hz: ArrayLike, response: ArrayLike, standard_error: ArrayLike | None = None, correlation: float = 0.0
) -> ModalFit:
    """Fit one mode, and the residual of higher modes, to a complex response.

    A pair of poles of a real system has real a and b; far below their resonance, the residual of higher modes is c + i d f + e
    f^2: their compliance, their damping, and their approach. (With a complex constant in place of a + i b r and of the residual,
    the frequency is wrong by five standard errors at 158 Hz.) The standard errors are from the misfit: of many lines with its
    correlation, because distortions of a sweep repeat as a wave over the lines, which a fit averages out; the change of the
    result without the last term, the error of this model, is added in quadrature.

    Args:
        frequency_hz: (F,), frequencies of the lines, which must enclose the resonance.
        response: (F,), complex.
        standard_error: (F,), of real and imaginary part; None: equal errors.
        correlation: correlation of neighbouring lines, see `FrequencyResponseObservation`; counts for few lines.

    Raises:
        ValueError: fewer than 5 lines, or no resonance within them.
    """
    f, H = np.asarray(frequency_hz, float), np.asarray(response, complex)
    if f.size < MIN_LINES:
        raise ValueError(f"{f.size} lines are given, a mode needs at least {MIN_LINES}: measure more frequencies")
    if not np.isfinite(H).all():
        raise ValueError(
            f"{np.count_nonzero(~np.isfinite(H))} of {f.size} lines of the response are not finite numbers"
        )
    scale, peak = float(np.abs(H).max()), float(f[np.abs(H).argmax()])
    weight = np.ones(f.size) if standard_error is None else 1 / np.asarray(standard_error, float)
    noise = np.nan if standard_error is None else 1 / (weight.max() * scale)
    weight = weight / weight.max()

    none = f"no resonance between {f.min():g} and {f.max():g} Hz: measure a band that encloses it"
    fitted, simpler = (_fit_poles(f / peak, np.asarray(H / scale, complex), weight, unknowns) for unknowns in (7, 6))
    if fitted is None or simpler is None:
        raise ValueError(none)
    values, errors, per_noise, freedom, terms, line = fitted
    # Neighbouring lines share noise: a smooth function of them has (1 + 2 rho) times its variance.
    if f.size < MIN_PATTERN_LINES:
        errors = errors * np.sqrt(1 + 2 * correlation)
    noise_errors = noise * np.sqrt(1 + 2 * correlation) * per_noise
    errors = np.hypot(errors, values - simpler[0])
    natural = float(values[0]) * peak
    if not f.min() < natural < f.max():
        raise ValueError(none)
    return ModalFit(
        natural_hz=natural,
        natural_error_hz=float(errors[0]) * peak,
        damping_ratio=float(values[1]),
        damping_error=float(errors[1]),
        amplitude=scale * complex(terms[0], terms[1]),
        constant=scale * float(terms[2]),
        degrees_of_freedom=freedom,
        natural_noise_hz=float(noise_errors[0]) * peak,
        damping_noise=float(noise_errors[1]),
        fitted=scale * line,
    )


def _fit_poles(
    g: Array, H: Complex, weight: Array, unknowns: int
) -> tuple[Array, Array, Array, int, Array, Complex] | None:
    """Return f0 and zeta, their standard errors, and those per noise of 1, the degrees of freedom, the linear terms a, b, c ..., and the fit.

    The linear terms are eliminated (variable projection), so that only f0 and zeta are searched. None without a minimum, or with
    fewer values than unknowns.
    """
    from scipy.optimize import least_squares

    def columns(f0: float, zeta: float) -> Array:
        r = g / f0
        mode = 1 / (1 - r**2 + 2j * zeta * r)
        terms = (mode, 1j * r * mode, np.ones_like(mode), 1j * g, g**2 + 0j)[: unknowns - 2]
        both = np.stack(terms, axis=1) * weight[:, None]
        return np.concatenate((both.real, both.imag))

    target = np.concatenate((weight * H.real, weight * H.imag))

    def misfit(parameters: Array) -> Array:
        basis = columns(*parameters)
        return np.asarray(basis @ np.linalg.lstsq(basis, target, rcond=None)[0] - target)

    bounds = ([0.5 * g.min(), 1e-4], [2 * g.max(), 3.0])
    fits = [
        least_squares(misfit, (1.0, zeta), bounds=bounds, x_scale=(1.0, zeta), max_nfev=200) for zeta in (0.03, 0.2)
    ]
    fit = min(fits, key=lambda one: float(one.cost))
    freedom = target.size - unknowns
    if not fit.success or freedom < 1:
        return None
    jacobian = np.asarray(fit.jac)  # with the linear terms projected out: its Gram matrix is that of f0 and zeta alone
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    per_noise = np.sqrt(np.diag(inverse))
    errors = per_noise * np.sqrt(2 * fit.cost / freedom)
    if g.size >= MIN_PATTERN_LINES:
        scale = _pattern_scale(np.argsort(g), columns(*fit.x), jacobian, np.asarray(fit.fun))
        errors = per_noise * scale
    basis = columns(*fit.x)
    linear = np.linalg.lstsq(basis, target, rcond=None)[0]
    real, imaginary = np.split(basis @ linear, 2)
    return (
        np.asarray(fit.x),
        errors,
        per_noise,
        freedom,
        np.asarray(linear),
        np.asarray((real + 1j * imaginary) / weight),
    )


def _pattern_scale(order: NDArray[np.intp], basis: Array, jacobian: Array, misfit: Array) -> Array:
    """Return the standard deviation of a misfit as each parameter of `jacobian`, (2 F, 2), sees it: with its correlation over the lines.

    Bartlett's weights (Newey, West, Econometrica 55, 1987), unbiased for white noise. `order` sorts the lines, (F,).
    """
    q, _ = np.linalg.qr(np.hstack((basis, jacobian)))
    along = jacobian @ np.linalg.pinv(jacobian.T @ jacobian)

    def squares(columns: Array) -> Array:
        """Return the weighted sum of the products of lines, (..., 2 F) to (...)."""
        rows = columns.reshape(*columns.shape[:-1], 2, order.size).sum(axis=-2)[..., order]
        reach = int(np.sqrt(order.size))
        lags = (
            2 * (1 - lag / (reach + 1)) * (rows[..., lag:] * rows[..., :-lag]).sum(axis=-1)
            for lag in range(1, reach + 1)
        )
        return np.asarray((rows**2).sum(axis=-1) + sum(lags))

    of_white = (along**2).sum(axis=0) - squares(along.T[:, None, :] * q.T).sum(axis=-1)
    return np.asarray(np.sqrt(np.maximum(squares(along.T * misfit), 0.0) / of_white))
