"""Free decay: frequency and damping after a step or a release, by least squares."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from model import Array
from protocols.base import InterferenceLine
from protocols.signals.checks import check_positive, check_samples
from protocols.signals.interference import resolved_lines

MIN_SAMPLES = 16
MAX_DAMPING = 0.8
"""Largest damping ratio for which frequency and damping can be separated."""

GRID_DAMPING = (0.003, 0.01, 0.03, 0.08, 0.15, 0.25, 0.4)
GRID_SAMPLES = 2048


@dataclass(frozen=True, slots=True)
class DecayFit:
    """x(t) = offset + amplitude exp(-zeta w0 t) cos(w0 sqrt(1 - zeta^2) t + phase) + creep, t from the first fitted sample.

    Creep follows the logarithm of the time since the release and is zero at the last sample.

    Attributes:
        natural_hz, natural_error_hz: undamped natural frequency w0 / 2 pi and its standard error.
        damping_ratio, damping_error: zeta.
        amplitude, amplitude_error: at t = 0, unit of the samples.
        phase: rad.
        offset, offset_error: value at the end of the record, after the ringing.
        creep_per_decade: creep per decade of the time since the release.
        creep_times_s: times from the release to the first and to the last fitted sample, less the delay of the vibration.
        noise: standard deviation of the residuals.
        degrees_of_freedom: of the standard errors.
    """

    natural_hz: float
    natural_error_hz: float
    damping_ratio: float
    damping_error: float
    amplitude: float
    amplitude_error: float
    phase: float
    offset: float
    offset_error: float
    creep_per_decade: float
    creep_times_s: tuple[float, float]
    noise: float
    degrees_of_freedom: int

    def displacement(self, time_s: Array) -> Array:
        """Return x at times from the first fitted sample, (N,)."""
        w = 2 * np.pi * self.natural_hz
        ringing = np.exp((-self.damping_ratio + 1j * np.sqrt(1 - self.damping_ratio**2)) * w * time_s + 1j * self.phase)
        crept = self.creep_per_decade * _decades(time_s, *self.creep_times_s)
        return np.asarray(self.offset + self.amplitude * ringing.real + crept)


def fit_decay(
    samples: ArrayLike,
    rate_hz: float,
    band_hz: tuple[float, float],
    interference: Sequence[InterferenceLine] = (),
    released_s: float = 0.0,
) -> DecayFit:
    """Fit one decaying oscillation on a creeping specimen.

    A grid of frequencies and dampings, at each of which the other parameters are linear, gives the start of a Gauss-Newton
    search. Without creep the damping would be 4 % too small at a creep of 1.5 % per decade.

    Args:
        samples: (N,), from a time at which the drive is constant and higher modes have decayed.
        rate_hz: samples per second.
        band_hz: search band of the natural frequency.
        interference: lines measured at rest; lines that the record resolves are fitted with the decay.
        released_s: time from the release to the first sample.

    Raises:
        ValueError: too short, not finite, or no free vibration within the band.
    """
    check_positive(rate_hz=rate_hz, **{"lowest frequency": band_hz[0]})
    if not band_hz[0] < band_hz[1] <= 0.45 * rate_hz:
        raise ValueError(f"the band {band_hz[0]:g}..{band_hz[1]:g} Hz must rise and end below {0.45 * rate_hz:g} Hz")
    x = check_samples("the decay", samples, MIN_SAMPLES)
    t = np.arange(x.size) / rate_hz
    lines_hz, _ = resolved_lines(interference, x.size / rate_hz, rate_hz)
    angles = 2 * np.pi * np.outer(t, lines_hz[: x.size // MIN_SAMPLES])
    lines = np.column_stack((np.cos(angles), np.sin(angles)))
    q, _ = np.linalg.qr(lines)
    w, zeta = _coarse_search(x - q @ (q.T @ x), t, band_hz)
    for _ in range(2):  # creep acts later by the delay of the vibration, which follows from the first fit
        first_s = max(released_s - 2 * zeta / w, 1 / rate_hz)
        fit = _fit_from(w, zeta, x, t, band_hz, lines, (first_s, first_s + float(t[-1])))
        w, zeta = 2 * np.pi * fit.natural_hz, fit.damping_ratio
    return fit


@dataclass(frozen=True, slots=True)
class _DecayMisfit:
    """Misfit of a decay near the angular frequency `w` to a record, without the directions `others`, (N, K) orthonormal.

    Its parameters are the frequency over `w`, the damping, and the offset and the two amplitudes over `scale`.
    """

    w: float
    t: Array
    others: Array
    record: Array
    """Record without the others, over the scale, (N,)."""

    def __call__(self, p: Array) -> Array:
        return _without(self.others, _basis(self.t, self.w * p[0], p[1]) @ p[2:]) - self.record

    def slopes(self, p: Array) -> Array:
        """Return the derivatives, (N, 5)."""
        basis = _basis(self.t, self.w * p[0], p[1])
        # a Re E + b Im E = Re (a - i b) E, and dE/ds = t E for E = exp(s t).
        turned = (p[3] - 1j * p[4]) * (basis[:, 1] + 1j * basis[:, 2]) * self.w * self.t
        root = np.sqrt(max(1 - p[1] ** 2, 1e-6))
        of_frequency, of_damping = (turned * (-p[1] + 1j * root)).real, (turned * p[0] * (-1 - 1j * p[1] / root)).real
        return _without(self.others, np.column_stack((of_frequency, of_damping, basis)))


def _without(directions: Array, columns: Array) -> Array:
    """Return columns, (N,) or (N, M), less their projections on orthonormal directions, (N, K)."""
    return np.asarray(columns - directions @ (directions.T @ columns))


def _fit_from(
    w: float,
    zeta: float,
    recorded: Array,
    t: Array,
    band_hz: tuple[float, float],
    lines: Array,
    creep_times_s: tuple[float, float],
) -> DecayFit:
    """Fit from a start frequency and damping; `lines` are the columns of the interference, (N, 2 lines)."""
    from scipy.optimize import least_squares

    beside = np.column_stack((lines, _decades(t, *creep_times_s)))
    q, _ = np.linalg.qr(beside)

    x = _without(q, recorded)
    basis = _without(q, _basis(t, w, zeta))
    linear = np.linalg.lstsq(basis, x, rcond=None)[0]
    scale = float(np.hypot(linear[1], linear[2])) or 1.0

    misfit = _DecayMisfit(w, t, q, x / scale)
    start = np.array([1.0, zeta, *linear / scale])
    fit = least_squares(
        misfit, start, misfit.slopes, method="lm", x_scale=np.array([0.01, 0.01, 1, 1, 1]), max_nfev=200
    )
    freedom = x.size - 5 - q.shape[1]
    natural, damping = float(fit.x[0]) * w / (2 * np.pi), float(fit.x[1])
    if not fit.success or not band_hz[0] < natural < band_hz[1] or not 0 < damping < MAX_DAMPING:
        raise ValueError(
            f"no free vibration between {band_hz[0]:g} and {band_hz[1]:g} Hz: the fit went to {natural:.4g} Hz, damping {damping:.3g}"
        )
    noise = float(np.sqrt(2 * fit.cost / freedom))
    jacobian = np.asarray(fit.jac)
    covariance = np.linalg.inv(jacobian.T @ jacobian) * noise**2
    errors = np.sqrt(np.diag(covariance))
    a, b = float(fit.x[3]), float(fit.x[4])
    amplitude = float(np.hypot(a, b))
    along = np.array([a, b]) / amplitude
    left = recorded - scale * _basis(t, float(fit.x[0]) * w, damping) @ fit.x[2:]
    amplitude_error = float(np.sqrt(along @ covariance[3:, 3:] @ along))
    if amplitude < 5 * amplitude_error:
        raise ValueError(
            f"no free vibration between {band_hz[0]:g} and {band_hz[1]:g} Hz: the amplitude, {scale * amplitude:.3g}, "
            f"is within 5 standard errors of zero ({scale * amplitude_error:.2g} each)"
        )
    return DecayFit(
        natural_hz=natural,
        natural_error_hz=float(errors[0]) * w / (2 * np.pi),
        damping_ratio=damping,
        damping_error=float(errors[1]),
        amplitude=scale * amplitude,
        amplitude_error=scale * amplitude_error,
        phase=float(np.arctan2(-b, a)),
        offset=scale * float(fit.x[2]),
        offset_error=scale * float(errors[2]),
        creep_per_decade=float(np.linalg.lstsq(beside, left, rcond=None)[0][-1]),
        creep_times_s=creep_times_s,
        noise=scale * noise,
        degrees_of_freedom=freedom,
    )


def _decades(t: Array, first_s: float, last_s: float) -> Array:
    """Return the decades of time since the release relative to the last sample, negative before it, (N,)."""
    return np.asarray(np.log10((t + first_s) / last_s))


def _coarse_search(x: Array, t: Array, band_hz: tuple[float, float]) -> tuple[float, float]:
    """Return the angular frequency and damping of a coarse grid that explain most of the begin of the record."""
    x, t = x[:GRID_SAMPLES], t[:GRID_SAMPLES]
    span, resolvable = np.log(band_hz[1] / band_hz[0]), (band_hz[1] - band_hz[0]) * t[-1]
    # A mode is as wide as its damping; a record resolves frequencies 1 / duration apart.
    counts = [4 + int(2 * min(span / zeta, resolvable)) for zeta in GRID_DAMPING]
    zeta = np.repeat(GRID_DAMPING, counts)
    w = 2 * np.pi * np.concatenate([np.geomspace(*band_hz, count) for count in counts])
    pole = (-zeta + 1j * np.sqrt(1 - zeta**2)) * w
    # exp(s (a + b)) is a product: one exponential per sample and pole would dominate the time.
    coarse, fine = np.exp(np.outer(pole, t[::32])), np.exp(np.outer(pole, t[:32]))
    ringing = (coarse[:, :, None] * fine[:, None, :]).reshape(pole.size, -1)[:, : t.size]
    ringing -= ringing.mean(1, keepdims=True)  # the offset is also fitted
    a, b = ringing.real, ringing.imag
    aa, bb, ab = (np.einsum("gn,gn->g", *pair) for pair in ((a, a), (b, b), (a, b)))
    xa, xb = a @ x, b @ x
    explained = (bb * xa**2 - 2 * ab * xa * xb + aa * xb**2) / (aa * bb - ab**2)
    best = int(explained.argmax())
    return float(w[best]), float(zeta[best])


def _basis(t: Array, w: float, zeta: float) -> Array:
    """Return 1, and decaying cosine and sine; (N, 3)."""
    ringing = np.exp((-zeta + 1j * np.sqrt(max(1 - zeta**2, 1e-6))) * w * t)
    return np.stack((np.ones(t.size), ringing.real, ringing.imag), axis=1)
