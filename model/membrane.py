"""Membrane as skin: its stiffness at a pre-stretch (Sec. III-A), and its sag under its own weight, with the tension of its own deflection (von Karman).

Clamped at both ends, E I w'''' - T w'' = q with T = E A (delta + integral of w'^2 / (2 L)). Linear theory predicts a sag of
thirteen thicknesses, far outside its own validity; stretching carries most of the weight.
"""

from dataclasses import dataclass, replace

import numpy as np
from annotated_types import Interval
from numpy.typing import ArrayLike

from model.arrays import Array
from model.parameter_spec import ParameterError, ParameterSpec
from model.parameters import CONTACT_LENGTH, GRAVITY, PRE_STRETCH, Membrane, Skin, Tactor

RUBBER_KG_M3 = 1000.0
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
LOAD_SPEC = ParameterSpec("load", "N/m", Interval(ge=0), "weight of the membrane per length", None)


def skin(membrane: Membrane, delta: float, contact_length: float | None = None, tactor: Tactor | None = None) -> Skin:
    """Skin of `membrane` at pre-stretch `delta`.

    `contact_length` (m) divides the point stiffness. Default: L - L2 of `tactor` (Table I if None), which reproduces the paper's
    8.5e4 N/m^2; the symmetric reading, both halves of the beam carrying the membrane, is `2 * (tactor.L - tactor.L2)`.

    Raises:
        ParameterError: delta < 0, contact_length <= 0, or a c_s that would be negative.
    """
    tactor = tactor or Tactor()
    length = tactor.L - tactor.L2 if contact_length is None else contact_length
    k_point = point_stiffness(membrane.L_m, membrane.b_m, membrane.h_m, membrane.E_m, delta)
    c_s = membrane.c_s_delta * delta + membrane.c_s_0
    return Skin(float(k_point / CONTACT_LENGTH.check(length)), float(c_s))


def point_stiffness(L_m: ArrayLike, b_m: ArrayLike, h_m: ArrayLike, E_m: ArrayLike, delta: ArrayLike) -> Array:
    """Centre stiffness (N/m) of a fixed-fixed beam under axial tension T = E_m A delta; arrays broadcast.

    k = (4 T / L_m) / (1 - tanh(u) / u) with u = (L_m / 4) sqrt(T / (E_m I_m)); 192 E_m I_m / L_m^3 at delta = 0.
    Written with g(u) = 3 (1 - tanh(u) / u) / u^2, which is 1 at u = 0 and smooth, it has no branch that jumps.

    Raises:
        ParameterError: delta < 0 or not finite.
    """
    L_m, b_m, h_m, E_m = (np.asarray(a, float) for a in (L_m, b_m, h_m, E_m))
    u2 = L_m**2 / 16 * 12 * PRE_STRETCH.check(delta) / h_m**2  # u^2, with A / I_m = 12 / h_m^2
    return np.asarray(192 * E_m * b_m * h_m**3 / 12 / L_m**3 / _g(u2))


def _g(u2: Array) -> Array:
    """3 (1 - tanh(u) / u) / u^2 as a function of u^2; series below u = 0.1, where the difference loses digits."""
    u = np.sqrt(np.maximum(u2, 1e-2))
    series = 1 - u2 * (2 / 5 - u2 * (17 / 105 - u2 * (62 / 945 - u2 * (1382 / 51975))))
    return np.where(u2 < 1e-2, series, 3 * (1 - np.tanh(u) / u) / u**2)


@dataclass(frozen=True, slots=True)
class SagSolution:
    """Deflection of the membrane's centre."""

    centre_m: float
    linear_theory_m: float
    """Sag by linear theory, without the tension of the deflection itself."""
    tension_n: float
    stretch: float
    """Pre-stretch and the stretch of the deflection together."""


def weight_per_length(membrane: Membrane, density_kg_m3: float = RUBBER_KG_M3) -> float:
    """Weight per length, N/m."""
    return density_kg_m3 * GRAVITY * membrane.b_m * membrane.h_m


def sag(membrane: Membrane, load_n_per_m: float | None = None, delta: float = 0.0) -> SagSolution:
    """Sag under `load_n_per_m` (default: its own weight) at pre-stretch `delta`.

    Raises:
        ParameterError: a load or pre-stretch < 0 or not finite.
    """
    q = float(LOAD_SPEC.check(weight_per_length(membrane) if load_n_per_m is None else load_n_per_m))
    delta = float(PRE_STRETCH.check(delta))
    # Newton's method by secants of a millionth, from the stretch without bending or without the deflection's own tension: neither is too small.
    string = (q * membrane.L_m / (membrane.E_m * membrane.b_m * membrane.h_m)) ** (2 / 3) / 24 ** (1 / 3)
    total = delta + min(_stretch(membrane, q, delta), string)
    for _ in range(100):
        more = _stretch(membrane, q, total)
        slope = (_stretch(membrane, q, total * (1 + 1e-6)) - more) / (total * 1e-6) if total else 0.0
        before, total = total, max(total + (delta + more - total) / (1 - slope), delta)
        if abs(total - before) <= 1e-14 * total:
            break
    tension = membrane.E_m * membrane.b_m * membrane.h_m * total
    return SagSolution(_centre_deflection(membrane, q, total), _centre_deflection(membrane, q, delta), tension, total)


def young_modulus_from_sag(
    membrane: Membrane, sag_m: float, load_n_per_m: float | None = None, delta: float = 0.0
) -> float:
    """Young modulus, Pa, with which a membrane of this geometry sags by `sag_m`; its own E_m is not used.

    Raises:
        ParameterError: no modulus between 1 kPa and 1 TPa does; or as `sag`.
    """
    q = weight_per_length(membrane) if load_n_per_m is None else load_n_per_m
    stretch = float(PRE_STRETCH.check(delta))
    unit, modulus = replace(membrane, E_m=1.0), np.inf
    if sag_m > 0 and q > 0:
        # The stretch of a given sag depends on its shape alone, between those of bending and of tension: 10 % in all.
        for _ in range(100):
            load = sag_m / _centre_deflection(unit, 1.0, stretch)
            before, stretch = stretch, delta + _stretch(unit, load, stretch)
            if abs(stretch - before) <= 1e-14 * stretch:
                break
        modulus = q / load
    if not 1e3 < modulus < 1e12:
        raise ParameterError(
            f"no modulus gives this membrane a sag of {sag_m:g} m under {q:g} N/m; check its dimensions and the sag"
        )
    return float(modulus)


def linear_young_modulus(membrane: Membrane, sag_m: float, load_n_per_m: float | None = None) -> float:
    """Young modulus by linear theory, q L^4 / (384 I w), for the same sag, Pa; for comparison only."""
    q = weight_per_length(membrane) if load_n_per_m is None else load_n_per_m
    return float(q * membrane.L_m**4 / (384 * membrane.b_m * membrane.h_m**3 / 12 * sag_m))


def _centre_deflection(m: Membrane, q: float, total: float) -> float:
    """A uniform load deflects the centre like half of it at the centre: w = q L / (2 k_point), for any tension."""
    return float(q * m.L_m / 2 / point_stiffness(m.L_m, m.b_m, m.h_m, m.E_m, total))


def _stretch(m: Membrane, q: float, total: float) -> float:
    """Mean of w'^2 / 2 of the beam whose total stretch is `total`.

    With a = (L / 2) sqrt(T / E I) and s from the centre (-1..1), w' = q L^3 / (8 E I) [s - sinh(a s) / sinh a] / a^2.
    """
    a2 = 3 * m.L_m**2 * total / m.h_m**2
    slope = q * m.L_m**3 / (8 * m.E_m * m.b_m * m.h_m**3 / 12) * _slope(a2, _NODES)
    return float(_WEIGHTS @ slope**2 / 4)


def _slope(a2: float, s: Array) -> Array:
    if a2 < 1e-3:
        # to a^4 in numerator and denominator; at a = 0 it is the cubic (s - s^3) / 6
        return np.asarray(s * ((1 - s**2) / 6 + a2 * (1 - s**4) / 120) / (1 + a2 / 6 + a2**2 / 120))
    a = np.sqrt(a2)
    ratio = (np.exp(a * (s - 1)) - np.exp(-a * (s + 1))) / (1 - np.exp(-2 * a))
    return np.asarray((s - ratio) / a2)
