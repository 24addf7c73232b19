"""A tactor, free or on a membrane, and its variables, which studies, estimates and command lines may change."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from annotated_types import Interval
from numpy.typing import ArrayLike

from model.arrays import Array
from model.membrane import point_stiffness
from model.parameter_spec import ParameterError, ParameterSpec, parameter_specs
from model.parameters import CONTACT_LENGTH, PRE_STRETCH, Beam, Membrane, Skin, Tactor, beams

K_S = parameter_specs(Skin)[0]
C_S = parameter_specs(Skin)[1]
SKIN_VARIABLES = (PRE_STRETCH, CONTACT_LENGTH, K_S, C_S)
HYSTERESIS = ParameterSpec.listed("hysteresis", Interval(ge=0), 0.0)
CREEP = ParameterSpec.listed("creep", Interval(ge=0), 0.0)
CLAMP_FLEXIBILITY = ParameterSpec.listed("clamp_flexibility", Interval(ge=0), 0.0)
LAG_NAMES = (HYSTERESIS.name, CREEP.name)
NONIDEAL_VARIABLES = (HYSTERESIS, CREEP, CLAMP_FLEXIBILITY)
"""Effects outside the paper's beam model. The first two act on the response to a voltage (`model.response.lag`), not on the beam."""
NONIDEAL_NAMES = tuple(each.name for each in NONIDEAL_VARIABLES)


class BeamCoefficients(NamedTuple):
    """The letters of Eqs. (1)-(6) with the skin's, floats or arrays that broadcast to one shape."""

    beam: Beam
    k_s: Array
    c_s: Array


def variable_specs() -> dict[str, ParameterSpec]:
    """All variables by name: fields of Tactor and Membrane, delta, contact_length, k_s, c_s, hysteresis, creep and clamp_flexibility."""
    return {
        q.name: q for q in (*parameter_specs(Tactor), *parameter_specs(Membrane), *SKIN_VARIABLES, *NONIDEAL_VARIABLES)
    }


def flexible_clamp_lengths(lengths: Mapping[str, Any], clamp_flexibility: Any) -> dict[str, Any]:
    """Return L, L1 and L2, m, of the beam with its bare plate lengthened by the equivalent of the clamp's rotation.

    Numbers or arrays that broadcast. Deflection and mass of the added piece are of second order: less than 0.05 % of the response
    for a clamp of 5 %.
    """
    longer = clamp_flexibility * lengths["L1"]
    return {name: lengths[name] + longer for name in ("L", "L1", "L2")}


@dataclass(frozen=True, slots=True)
class Specimen:
    """A tactor on `membrane` at pre-stretch `delta`, or free if `membrane` is None.

    `k_s` and `c_s`, where given, replace the membrane's; None: values of `model.skin`. `hysteresis` and `creep` belong to
    its MFC, `clamp_flexibility` to its clamp.

    Raises:
        ParameterError: a value is not physical.
    """

    tactor: Tactor = field(default_factory=Tactor)
    membrane: Membrane | None = None
    delta: float = 0.0
    contact_length: float | None = None
    k_s: float | None = None
    c_s: float | None = None
    hysteresis: float = 0.0
    creep: float = 0.0
    clamp_flexibility: float = 0.0

    def __post_init__(self) -> None:
        self.coefficients({each.name: getattr(self, each.name) for each in NONIDEAL_VARIABLES})

    @property
    def acting_tactor(self) -> Tactor:
        """The tactor with its bare plate lengthened by the equivalent of the clamp's rotation."""
        if not self.clamp_flexibility:
            return self.tactor
        return replace(self.tactor, **flexible_clamp_lengths(asdict(self.tactor), self.clamp_flexibility))

    @property
    def skin(self) -> Skin:
        """The skin under the cylinder."""
        _, k_s, c_s = self.coefficients({})
        return Skin(float(k_s), float(c_s))

    def value(self, name: str) -> float:
        """The present value of a variable; raises ParameterError for a variable that this specimen lacks."""
        if name in {q.name for q in parameter_specs(Tactor)}:
            return float(getattr(self.tactor, name))
        if self.membrane is not None and name in {q.name for q in parameter_specs(Membrane)}:
            return float(getattr(self.membrane, name))
        match name:
            case "delta" | "hysteresis" | "creep" | "clamp_flexibility":
                return float(getattr(self, name))
            case "k_s" | "c_s":
                return float(getattr(self.skin, name))
            case "contact_length":
                return self.contact_length or self.tactor.L - self.tactor.L2
        raise ParameterError(f"{name} is not a variable of this specimen: choose from {', '.join(variable_specs())}")

    def coefficients(self, values: Mapping[str, ArrayLike]) -> BeamCoefficients:
        """The letters with the named variables replaced by floats or arrays that broadcast together.

        Raises:
            ParameterError: an unknown name, a value that is not physical, or a membrane's variable without a membrane.
        """
        specs = variable_specs()
        for name in values:
            if name not in specs:
                raise ParameterError(f"{name} is not a variable of the model: choose from {', '.join(specs)}")
        v = {name: specs[name].check(value) for name, value in values.items()}
        of_tactor = {q.name for q in parameter_specs(Tactor)}
        flexibility = v.get("clamp_flexibility", np.asarray(self.clamp_flexibility))
        if np.any(flexibility):
            longer = flexibility * v.get("L1", np.asarray(self.tactor.L1))
            v |= {name: v.get(name, np.asarray(getattr(self.tactor, name))) + longer for name in ("L", "L1", "L2")}
        beam = beams(self.tactor, {name: a for name, a in v.items() if name in of_tactor})
        k_s, c_s = self._membrane_skin(v, beam)
        for quantity, given in ((K_S, self.k_s), (C_S, self.c_s)):
            if given is not None:
                quantity.check(given)
        k_s = v.get("k_s", k_s if self.k_s is None else np.asarray(self.k_s))
        c_s = v.get("c_s", c_s if self.c_s is None else np.asarray(self.c_s))
        return BeamCoefficients(beam, K_S.check(k_s), C_S.check(c_s))

    def _membrane_skin(self, v: Mapping[str, Array], beam: Beam) -> tuple[Array, Array]:
        names = [q.name for q in parameter_specs(Membrane)]
        if self.membrane is None:
            lost = next((name for name in (*names, "delta", "contact_length") if name in v), None)
            if lost is not None:
                raise ParameterError(f"{lost} has no effect on a free tactor: give the specimen a membrane")
            return np.zeros(()), np.zeros(())
        m = {name: v.get(name, np.asarray(getattr(self.membrane, name))) for name in names}
        delta = v.get("delta", PRE_STRETCH.check(self.delta))
        length = v.get("contact_length", beam.L - beam.L2 if self.contact_length is None else self.contact_length)
        k_point = point_stiffness(m["L_m"], m["b_m"], m["h_m"], m["E_m"], delta)
        return k_point / CONTACT_LENGTH.check(length), m["c_s_delta"] * delta + m["c_s_0"]


def replace_variables(base: Specimen, values: Mapping[str, float]) -> Specimen:
    """Return `base` with the named variables replaced; a variable of the membrane puts the tactor on it."""
    of_tactor, of_membrane = ({q.name for q in parameter_specs(kind)} for kind in (Tactor, Membrane))
    membrane = base.membrane
    if membrane is None and values.keys() & (of_membrane | {"delta", "contact_length"}):
        membrane = Membrane()
    if membrane is not None:
        membrane = replace(membrane, **_select_values(values, of_membrane))
    rest: Any = _select_values(values, {each.name for each in (*SKIN_VARIABLES, *NONIDEAL_VARIABLES)})
    return replace(base, tactor=replace(base.tactor, **_select_values(values, of_tactor)), membrane=membrane, **rest)


def specimen_record(specimen: Specimen) -> dict[str, float]:
    """Return every variable that the specimen has, SI, by name."""
    free = {q.name for q in parameter_specs(Tactor)} | {"k_s", "c_s", *NONIDEAL_NAMES}
    return {name: specimen.value(name) for name in variable_specs() if specimen.membrane is not None or name in free}


def _select_values(values: Mapping[str, float], names: set[str]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name in names}
