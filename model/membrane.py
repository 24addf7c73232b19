"""Sag of the membrane under its own weight: bending, with the tension of its own deflection (von Karman).

Clamped at both ends, E I w'''' - T w'' = q with T = E A (delta + integral of w'^2 / (2 L)). Linear theory predicts a sag of
thirteen thicknesses, far outside its own validity; stretching carries most of the weight.
"""

from dataclasses import dataclass, replace

import numpy as np
from annotated_types import Interval

from model.arrays import Array, gauss_legendre
from model.parameter_spec import ParameterError, ParameterSpec
from model.parameters import GRAVITY, Membrane
from model.skin_model import PRE_STRETCH, point_stiffness

RUBBER_KG_M3 = 1000.0
LOAD_SPEC = ParameterSpec("load", "N/m", Interval(ge=0), "weight of the membrane per length", None)


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
    from scipy.optimize import brentq

    q = float(LOAD_SPEC.check(weight_per_length(membrane) if load_n_per_m is None else load_n_per_m))
    delta = float(PRE_STRETCH.check(delta))

    def excess(total: float) -> float:
        return total - delta - _stretch(membrane, q, total)

    most = delta + _stretch(membrane, q, delta)
    # A taut or hardly loaded membrane stretches by less than rounding: both ends of the bracket are then the answer.
    total = most if excess(most) <= 0 else float(brentq(excess, delta, most, xtol=1e-15, rtol=1e-13))
    tension = membrane.E_m * membrane.b_m * membrane.h_m * total
    return SagSolution(_centre_deflection(membrane, q, total), _centre_deflection(membrane, q, delta), tension, total)


def young_modulus_from_sag(
    membrane: Membrane, sag_m: float, load_n_per_m: float | None = None, delta: float = 0.0
) -> float:
    """Young modulus, Pa, with which a membrane of this geometry sags by `sag_m`; its own E_m is not used.

    Raises:
        ParameterError: no modulus between 1 kPa and 1 TPa does; or as `sag`.
    """
    from scipy.optimize import brentq

    q = weight_per_length(membrane) if load_n_per_m is None else load_n_per_m

    def off(log_e: float) -> float:
        return float(np.log(sag(replace(membrane, E_m=float(np.exp(log_e))), q, delta).centre_m / sag_m))

    softest, stiffest = np.log(1e3), np.log(1e12)
    if not (sag_m > 0 and q > 0) or off(softest) <= 0 or off(stiffest) >= 0:
        raise ParameterError(
            f"no modulus gives this membrane a sag of {sag_m:g} m under {q:g} N/m; check its dimensions and the sag"
        )
    return float(np.exp(brentq(off, softest, stiffest, xtol=1e-13)))


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
    nodes, weights = gauss_legendre(64)
    a2 = 3 * m.L_m**2 * total / m.h_m**2
    slope = q * m.L_m**3 / (8 * m.E_m * m.b_m * m.h_m**3 / 12) * _slope(a2, nodes)
    return float(weights @ slope**2 / 4)


def _slope(a2: float, s: Array) -> Array:
    if a2 < 1e-3:
        # to a^4 in numerator and denominator; at a = 0 it is the cubic (s - s^3) / 6
        return np.asarray(s * ((1 - s**2) / 6 + a2 * (1 - s**4) / 120) / (1 + a2 / 6 + a2**2 / 120))
    a = np.sqrt(a2)
    ratio = (np.exp(a * (s - 1)) - np.exp(-a * (s + 1))) / (1 - np.exp(-2 * a))
    return np.asarray((s - ratio) / a2)
