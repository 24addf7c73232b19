"""Curves of one tactor as the paper's steps compare them: amplitudes, resonances, and the vertex of a measured peak."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from model.amplifier import AmplifierMap
from model.drive import series
from model.identification.equation import factors_of
from model.identification.observations import FrequencyResponse, StaticLoading
from model.identification.receptance import Dense, Factors
from model.parameters import Beam, Tactor

Array = NDArray[np.float64]


def amplitudes(t: Tactor, f: Array, volts: Array, k_s: float = 0.0, c_s: float = 0.0, n: int = 7) -> Array:
    """Peak amplitude (m) of the fundamental at f (Hz) under `volts` on the specimen, all (F,)."""
    one = np.ones_like(f)
    H = Dense(t.L1 / t.L, t.L2 / t.L, n).response(factors(t, t.m_add * one, k_s * one, c_s * one), 2 * np.pi * f)[0]
    return np.asarray(np.abs(t.mu / t.L * H) * volts)


def resonances(t: Tactor, mass: Array, damped: NDArray[np.bool_], n: int) -> tuple[Array, Array]:
    """Resonance frequencies (Hz) for each added mass, of the peak where `damped`, and their slopes to k2."""
    if not mass.size:
        return np.zeros(0), np.zeros(0)
    a = factors(t, mass, np.zeros_like(mass), np.zeros_like(mass))
    dense = Dense(t.L1 / t.L, t.L2 / t.L, n)
    omega, square = dense.undamped(a)
    slope = square[:, 4:].sum(-1) / (2 * omega)
    if damped.any():
        peak, s = dense.peak(a)
        omega, slope = np.where(damped, peak, omega), np.where(damped, s.K[:, 4:].sum(-1), slope)
    return omega / (2 * np.pi), slope / t.L**3 / (2 * np.pi)


def factors(t: Tactor, mass: Array, k_s: Array, c_s: Array) -> Factors:
    """Factors of Eq. (14), one row for each added mass (kg) and skin (N/m^2, kg/(m s)), all (R,)."""
    eta = mass / (2 * (t.L - t.L2))
    beam = Beam(t.L, t.L1, t.L2, t.rho1, t.rho2, eta, t.c0, t.k1, t.k2, t.mu)
    return factors_of(beam, (k_s, c_s), mass.size)


def measured(run: FrequencyResponse, whole: bool) -> tuple[Array, Array]:
    """Frequencies (Hz), rising, and amplitudes (m) of the usable points, (F,); `whole` prefers half of max - min."""
    whole = run.fundamental_m is None or (whole and run.peak_to_peak_m is not None)
    A = np.asarray(run.peak_to_peak_m) / 2 if whole else np.abs(np.asarray(run.fundamental_m))
    order = np.argsort(run.frequency_hz[run.use])
    return run.frequency_hz[run.use][order], A[run.use][order]


def volts_of(run: FrequencyResponse, amplifier: AmplifierMap) -> Array:
    """Peak volts of the fundamental on the specimen, (F,), in the order of `measured`."""
    pairs = np.stack((run.drive_amplitude_v, run.drive_offset_v), axis=-1)[run.use]
    different, where = np.unique(pairs[np.argsort(run.frequency_hz[run.use])], axis=0, return_inverse=True)
    return np.array([abs(series("sine", a, o, amplifier, 1)[1]) for a, o in different])[where.ravel()]


def averaged(runs: Sequence[StaticLoading]) -> tuple[Array, Array]:
    """Loads (N) and deflections (m), (N,) each: repeats averaged per side and then over the sides (Sec. IV-1)."""
    means: dict[float, dict[str, list[float]]] = {}
    for run in runs:
        for F, w in zip(run.load_n[run.use], run.deflection_m[run.use], strict=True):
            means.setdefault(round(float(F), 9), {}).setdefault(run.side, []).append(float(w))
    loads = np.array(list(means))
    return loads, np.array([np.mean([np.mean(v) for v in sides.values()]) for sides in means.values()])


def vertex(x: Array, y: Array) -> tuple[float, float]:
    """Abscissa and height of the parabola through three points, (3,) each; the middle one where it has no top."""
    u = x - x[1]
    a, b, c = np.linalg.solve(np.stack((u * u, u, np.ones(3)), axis=-1), y)
    if not a < 0:
        return float(x[1]), float(y[1])
    shift = float(-b / (2 * a))
    return float(x[1] + shift), float(c + b * shift + a * shift * shift)
