"""The paper's Table I and the skin as validated values, and the derived letters of Eqs. (1)-(6).

`Tactor` and `Membrane` are one specimen, validated on construction. `Beam` carries the same letters as floats or
as arrays of one shape; the numerics underneath take a `Beam`, so that a study of ten thousand specimens is one call.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import sqrt
from typing import Annotated, Any, NamedTuple

import numpy as np
from annotated_types import Interval
from numpy.typing import ArrayLike

from model.parameter_spec import ParameterError, ParameterSpec, parameter_specs, validate_parameters
from model.quantities import QUANTITIES

GRAVITY = 9.80665
"""Standard gravity, m/s^2."""

PRE_STRETCH = ParameterSpec("delta", "", Interval(ge=0), QUANTITIES["delta"].definition, 0.0)
CONTACT_LENGTH = ParameterSpec.listed("contact_length", Interval(gt=0), None)

FloatOrArray = Any
"""A float or an array of floats; the formulas of this module take both."""


class Beam(NamedTuple):
    """The letters of Eqs. (1)-(6), SI: floats, or arrays that broadcast to one shape."""

    L: FloatOrArray
    L1: FloatOrArray
    L2: FloatOrArray
    rho1: FloatOrArray
    rho2: FloatOrArray
    eta: FloatOrArray
    c0: FloatOrArray
    k1: FloatOrArray
    k2: FloatOrArray
    mu: FloatOrArray


@dataclass(frozen=True, slots=True)
class Tactor:
    """One tactor, modelled as half a stepped beam from the clamp (x = 0) to the centre (x = L). Defaults: Table I.

    Raises:
        ParameterError: a value is not physical, or the order 0 < L1 < L2 < L is broken.
    """

    L: Annotated[float, Interval(gt=0)] = 2.2e-2
    L1: Annotated[float, Interval(gt=0)] = 0.8e-2
    L2: Annotated[float, Interval(gt=0)] = 1.5e-2
    b_Al: Annotated[float, Interval(gt=0)] = 2.0e-2
    h_Al: Annotated[float, Interval(gt=0)] = 2.0e-4
    rho1: Annotated[float, Interval(gt=0)] = 1.13e-2
    rho2: Annotated[float, Interval(gt=0)] = 2.50e-2
    E_Al: Annotated[float, Interval(gt=0)] = 69e9
    k2: Annotated[float, Interval(gt=0)] = 7.0e-3
    mu: Annotated[float, Interval()] = -1.33e-5
    c0: Annotated[float, Interval(ge=0)] = 159.0
    m_add: Annotated[float, Interval(ge=0)] = 7.73e-3

    def __post_init__(self) -> None:
        validate_parameters(self)
        check_segment_order(self.L, self.L1, self.L2)

    @property
    def I_Al(self) -> float:
        """Second moment of area of the plate's section, m^4."""
        return self.b_Al * self.h_Al**3 / 12

    @property
    def k1(self) -> float:
        """Bending stiffness of the bare plate, N m^2."""
        return self.E_Al * self.I_Al

    @property
    def eta(self) -> float:
        """Added mass per length of the third segment, kg/m; the cylinder sits on both halves of the beam."""
        return self.m_add / (2 * (self.L - self.L2))

    @property
    def tau(self) -> float:
        """Characteristic time sqrt(rho1 L^4 / k1), s; the paper prints it inverted (Sec. V-B)."""
        return self.L**2 * sqrt(self.rho1 / self.k1)

    @property
    def c_bar(self) -> float:
        """Characteristic damping k1 tau / L^4, kg/(m s) (Sec. V-B)."""
        return self.k1 * self.tau / self.L**4

    @property
    def beam(self) -> Beam:
        """The letters of Eqs. (1)-(6)."""
        return Beam(self.L, self.L1, self.L2, self.rho1, self.rho2, self.eta, self.c0, self.k1, self.k2, self.mu)


@dataclass(frozen=True, slots=True)
class Membrane:
    """The rubber membrane that simulates skin (Table I). Its pre-stretch is an argument where it is used.

    Raises:
        ParameterError: a value is not physical.
    """

    L_m: Annotated[float, Interval(gt=0)] = 1.7e-1
    b_m: Annotated[float, Interval(gt=0)] = 6.6e-2
    h_m: Annotated[float, Interval(gt=0)] = 1.4e-3
    E_m: Annotated[float, Interval(gt=0)] = 6.95e6
    c_s_delta: Annotated[float, Interval()] = 5.48e4
    c_s_0: Annotated[float, Interval(ge=0)] = 165.0

    def __post_init__(self) -> None:
        validate_parameters(self)


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


def check_segment_order(L: ArrayLike, L1: ArrayLike, L2: ArrayLike) -> None:
    """Reject segments that do not follow each other; floats or arrays of one shape, m.

    Raises:
        ParameterError: L1 < L2 < L does not hold everywhere.
    """
    for (small, a), (large, b) in ((("L1", L1), ("L2", L2)), (("L2", L2), ("L", L))):
        low, high = np.broadcast_arrays(np.asarray(a, float), np.asarray(b, float))
        wrong = ~(low < high)
        if wrong.any():
            raise ParameterError(
                f"{small} is {low[wrong].flat[0]:g} m but must be less than {large} = {high[wrong].flat[0]:g} m: "
                f"the segments need 0 < L1 < L2 < L, so correct {small} or {large}"
            )


def beams(tactor: Tactor, values: Mapping[str, ArrayLike]) -> Beam:
    """The letters for many tactors: `tactor` with the named fields, SI, replaced by arrays that broadcast together.

    Raises:
        ParameterError: a name is unknown, a value is not physical, or an order of lengths is broken.
    """
    specs = {q.name: q for q in parameter_specs(Tactor)}
    for name in values:
        if name not in specs:
            raise ParameterError(f"{name} is not a parameter of the tactor: choose from {', '.join(specs)}")
    v = asdict(tactor) | {name: specs[name].check(value) for name, value in values.items()}
    check_segment_order(v["L"], v["L1"], v["L2"])
    return beam_from_values(v)


def beam_from_values(v: Mapping[str, Any], added_mass_kg: Any = None) -> Beam:
    """The letters from a tactor's parameters by name, with its own added mass or another."""
    k1 = v["E_Al"] * v["b_Al"] * v["h_Al"] ** 3 / 12
    eta = (v["m_add"] if added_mass_kg is None else added_mass_kg) / (2 * (v["L"] - v["L2"]))
    return Beam(v["L"], v["L1"], v["L2"], v["rho1"], v["rho2"], eta, v["c0"], k1, v["k2"], v["mu"])
