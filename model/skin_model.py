"""The skin under the cylinder: distributed stiffness k_s and damping c_s from a membrane and its pre-stretch (Sec. III-A)."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Interval
from numpy.typing import ArrayLike

from model.arrays import Array
from model.parameter_spec import ParameterSpec, validate_parameters
from model.parameters import Membrane, Tactor
from model.quantities import QUANTITIES

THRESHOLD_M = 50e-6
"""Discrimination threshold of the skin on the abdomen below 250 Hz (paper, Sec. I)."""

UNCOMFORTABLE_HZ = 200.0, 250.0
"""Range of the frequency above which vibration tends to be uncomfortable (paper, Sec. I, ref. [22])."""

PRE_STRETCH = ParameterSpec("delta", "", Interval(ge=0), QUANTITIES["delta"].definition, 0.0)
CONTACT_LENGTH = ParameterSpec.listed("contact_length", Interval(gt=0), None)


@dataclass(frozen=True, slots=True)
class Skin:
    """A bed of springs and dampers under the third segment, Eq. (2).

    Raises:
        ParameterError: a value is negative or not finite.
    """

    k_s: Annotated[float, Interval(ge=0)] = 0.0
    c_s: Annotated[float, Interval(ge=0)] = 0.0

    def __post_init__(self) -> None:
        validate_parameters(self)


NO_SKIN = Skin()
"""No skin: the tactor vibrates freely."""


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
