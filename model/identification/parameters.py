"""Identifiable parameters: parameters of the model, skin damping and stiffness at one elongation, shared errors."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict

from annotated_types import Interval

from model import C_S, CONTACT_LENGTH, K_S, Membrane, ParameterError, ParameterSpec, Tactor, parameter_specs, skin
from model.identification import observations as observed
from model.identification.nonidealities import NONIDEALITIES, TYPICAL_SIZES

ASYMMETRY = ParameterSpec.listed("asymmetry", Interval(gt=-1, lt=1), 0.0)
SPECIMEN_PARAMETERS = {
    q.name: q
    for q in (*parameter_specs(Tactor), *parameter_specs(Membrane), CONTACT_LENGTH, ASYMMETRY, *NONIDEALITIES.values())
}


def elongation_parameter(symbol: str, elongation_m: float) -> str:
    """The name of c_s or k_s at one elongation, e.g. `c_s(1.27 mm)`."""
    return f"{symbol}({1e3 * elongation_m:.6g} mm)"


def parse_elongation(name: str) -> float | None:
    """Return the elongation (m) in a name made by `elongation_parameter`; None for any other name."""
    if name[:4] in ("c_s(", "k_s(") and name.endswith(" mm)"):
        try:
            return float(name[4:-4]) * 1e-3
        except ValueError:
            return None
    return None


def parameter_spec(name: str, observations: observed.ObservationSet | None = None) -> ParameterSpec:
    """Unit, limits and meaning of a parameter; raises ParameterError for an unknown name."""
    if name in SPECIMEN_PARAMETERS:
        return SPECIMEN_PARAMETERS[name]
    if parse_elongation(name) is not None:
        of = C_S if name.startswith("c_s") else K_S
        return ParameterSpec(name, of.unit, of.interval, f"{of.description} at this elongation", None)
    if observations is not None and name in observations.shared_errors:
        error = observations.shared_errors[name]
        return ParameterSpec(
            name, observed.SHARED_ERROR_UNITS[error.acts_on], Interval(), f"common error of {error.acts_on}", 0.0
        )
    raise ParameterError(
        f"{name} is not an identifiable parameter: choose from {', '.join(SPECIMEN_PARAMETERS)}, or c_s(ELONGATION mm)"
    )


def default_values(tactor: Tactor, membrane: Membrane, contact_length: float | None) -> dict[str, float | None]:
    """Every parameter of the specimen with its value before identification; a contact length of None is L - L2."""
    return {**asdict(tactor), **asdict(membrane), "contact_length": contact_length, "asymmetry": 0.0}


def identifiable_parameters(observations: observed.ObservationSet, per_elongation: bool = False) -> tuple[str, ...]:
    """Return the parameters of the paper that these kinds of runs can identify.

    `per_elongation` adds a c_s at every elongation instead of the line c_s_delta delta + c_s_0.
    """
    responses = observations.of_type(observed.FrequencyResponseObservation)
    on_skin = sorted({r.elongation_m for r in responses if r.elongation_m is not None})
    names: list[str] = []
    if any(
        isinstance(run, observed.StaticLoadingObservation | observed.MassResonanceObservation)
        for run in observations.runs
    ):
        names.append("k2")
    if observations.of_type(observed.VoltageStepsObservation) or responses:
        names.append("mu")
    decays = observations.of_type(observed.DecayPoleObservation)
    if decays or any(r.added_mass_kg is None for r in responses):
        names.append("m_add")
    if decays or responses:
        names.append("c0")
    if observations.of_type(observed.MembraneSagObservation):
        names.append("E_m")
    if per_elongation or (len(on_skin) == 1 and on_skin[0] > 0):
        names += [elongation_parameter("c_s", e) for e in on_skin]
    elif on_skin:
        names += ["c_s_0", "c_s_delta"][: len(on_skin)]
    return tuple(names)


def validate_names(names: Iterable[str], observations: observed.ObservationSet) -> tuple[str, ...]:
    """The names, each valid and only once; raises ParameterError with a sentence."""
    out = tuple(names)
    for name in out:
        parameter_spec(name, observations)
        if out.count(name) > 1:
            raise ParameterError(f"{name} is named twice among the free parameters: name it once")
    return out


def start_value(name: str, base: Mapping[str, float | None]) -> float:
    """Return the default start of a fit: the present value; c_s from the line, 0 for shared errors."""
    if name in base:
        value = base[name]  # None: the contact length follows from the geometry
        return float((base["L"] or 0) - (base["L2"] or 0) if value is None else value)
    if name in NONIDEALITIES:
        return float(NONIDEALITIES[name].default or 0.0)
    elongation = parse_elongation(name)
    if elongation is None:
        return 0.0
    membrane = Membrane(**{q.name: float(base[q.name] or 0) for q in parameter_specs(Membrane)})
    here = skin(membrane, elongation / membrane.L_m)
    return here.c_s if name.startswith("c_s") else here.k_s


def typical_size(name: str, start: float) -> float:
    """A typical size, positive: one hundred percent of this parameter."""
    if start:
        return abs(start)
    if name in NONIDEALITIES:
        return TYPICAL_SIZES[NONIDEALITIES[name].unit]
    own = SPECIMEN_PARAMETERS.get(name)
    if own is not None and own.default:
        return abs(own.default)
    return 165.0 if name.startswith("c_s") and parse_elongation(name) is not None else 1.0
