"""Brute-force counterparts of the model: sampled drives, Fourier series and uncertainty bands."""

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from model.amplifier_map import AmplifierMap
from model.beam.poles import ModalForm
from model.studies.parameter_study import Study
from model.studies.sensitivity import chunked_responses
from model.studies.uncertainty import EstimateSet, ParameterizedCurve, UncertaintyBand

Array = NDArray[np.float64]


def march(form: ModalForm, u: Array, rate_hz: float, hold: Literal["linear", "zero"] = "linear") -> Array:
    """Exact recursion z_k[m + 1] = exp(s h) z_k[m] + drive over one sample, summed over the poles; shape (N,)."""
    from scipy.signal import lfilter

    w = np.zeros(u.size)
    for s, r in zip(*form, strict=True):
        if s.imag < 0:
            continue  # the conjugate of one already counted twice
        weight = (2 if s.imag > 0 else 1) * r / rate_hz
        b0, b1 = _weights(s / rate_hz, hold)
        forced = weight * (b0 * u + b1 * np.concatenate(([0.0], u[:-1])))
        forced[0] = 0  # at rest at the first sample
        w += lfilter([1.0], [1.0, -np.exp(s / rate_hz)], forced).real
    return w


def _weights(sh: complex, hold: str) -> tuple[complex, complex]:
    """What the new and the old sample contribute over one sample, in units of its length."""
    p1 = complex(np.expm1(sh)) / sh
    if hold == "zero":
        return 0.0, p1
    p2 = (p1 - 1) / sh if abs(sh) > 1e-2 else 1 / 2 + sh * (1 / 6 + sh * (1 / 24 + sh * (1 / 120 + sh / 720)))
    return p2, p1 - p2


def sampled_series(input_v: Array, orders: int) -> NDArray[np.complex128]:
    """V_k of a periodic input given as equidistant samples of one period, shape (N,) with N > 2 orders."""
    V = np.fft.rfft(AmplifierMap().specimen_v(input_v))[: orders + 1] / input_v.size
    V[1:] *= 2
    return V


def model_curve(study: Study) -> ParameterizedCurve:
    """The study's measure as a curve over its frequencies; estimates take the place of its specimen's values."""
    bare = replace(study, vary={})
    return lambda values: chunked_responses(bare, values)


def sampled_band(curve: ParameterizedCurve, estimates: EstimateSet, draws: int) -> UncertaintyBand:
    """A 95 % band from the quantiles of curves drawn from the estimates."""
    v = np.asarray(estimates.values)
    x = np.random.default_rng(1).multivariate_normal(v, estimates.covariance, draws, check_valid="ignore")
    w = curve(dict(zip(estimates.names, np.vstack((v, x)).T, strict=True)))
    lower, upper = np.quantile(w[1:], (0.025, 0.975), axis=0)
    return UncertaintyBand(w[0], w[1:].std(axis=0, ddof=1), lower, upper)
