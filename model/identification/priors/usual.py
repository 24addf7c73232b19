"""Usual nonidealities of a tactor and its set-up, as parameters of every fit with their expected size.

Each is free with a normal prior around zero, like a length around the reading of a ruler; an effect of one sign, such as creep, has half
of a normal distribution. Parameters of the specimen that neither sheet nor runs determine are free around Table I. A specimen sheet,
`--prior` or `--fix` replaces the prior; `--sheet none` holds all of them, `--plain` the nonidealities.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import sqrt

from model.identification.fit_options import FitOptions
from model.identification.observations import (
    DecayPoleObservation,
    FrequencyResponseObservation,
    MassResonanceObservation,
    MembraneSagObservation,
    Observation,
    ObservationSet,
    StaticLoadingObservation,
    VoltageStepsObservation,
)
from model.identification.parameters import parameter_spec


@dataclass(frozen=True, slots=True)
class UsualEffect:
    """A nonideality or parameter with its standard deviation among tactors, SI, and the source of that."""

    standard_deviation: float
    source: str


USUAL_EFFECTS: Mapping[str, UsualEffect] = {
    "creep": UsualEffect(0.02, "soft piezoceramics creep by 1 to 3 % a decade"),
    "hysteresis": UsualEffect(0.15, "loops of MFCs are up to 15 % of the stroke wide, half of this parameter"),
    "asymmetry": UsualEffect(0.05, "a different modulus in compression and extension (paper, Sec. IV-1)"),
    "mass_fraction": UsualEffect(0.2, "11 g put in moved as 7.73 g (paper, Sec. IV-3)"),
    "clamp_flexibility": UsualEffect(
        0.02, "a plate bends on inside its clamp, over about its thickness: 0.16 mm of 8 mm"
    ),
    "elongation_slip": UsualEffect(0.02, "a millimetre of a stretched membrane of 170 mm in its clamps"),
}
"""Without the amplifier's slope below rest: its uncertainty is in the uncertainty of the slopes in the bench file."""

ASSUMED_PARAMETERS: Mapping[str, UsualEffect] = {
    "k2": UsualEffect(0.15, "MFC, glue and plate of one batch; unproven"),
    "c0": UsualEffect(0.25, "damping differs more between tactors than stiffness; unproven"),
    "E_m": UsualEffect(0.15, "rubber of one hardness, 6 to 8.5 MPa; unproven"),
}
"""Relative standard deviations around Table I of parameters that some kinds of runs do not determine."""


TEMPERATURE_COEFFICIENTS: Mapping[str, UsualEffect] = {
    "k2_per_kelvin": UsualEffect(
        1e-3, "aluminium -0.05 %/K, glue and Kapton some times that; unproven for the laminate"
    ),
    "mu_per_kelvin": UsualEffect(
        2e-3, "free strain of piezoelectric fibre composites, largest near 30 °C (doi:10.3390/s19081809)"
    ),
    "c0_per_kelvin": UsualEffect(5e-3, "damping of glue and Kapton; unproven"),
}
"""Relative change per kelvin, standard deviation around none."""
ASSUMED_KELVINS = 1.0
"""Standard uncertainty of a temperature that no run states: of a laboratory with air conditioning."""
MIN_WARMER_K = 0.1
"""Differences of temperature below change nothing that a fit would see."""


def usual_effects(observations: ObservationSet) -> dict[str, tuple[float, float]]:
    """Return value and standard deviation of each usual nonideality that these runs depend on, by name."""
    found = {
        name: (float(parameter_spec(name).default or 0.0), effect.standard_deviation)
        for name, effect in USUAL_EFFECTS.items()
        if name in set(_affecting(observations))
    }
    driven = (VoltageStepsObservation, FrequencyResponseObservation)
    slopes = [e.standard_error for e in observations.shared_errors.values() if e.acts_on == "volts"]
    if slopes and any(isinstance(run, driven) for run in observations.runs):
        found["gain_below_rest"] = 0.0, sqrt(2) * max(slopes)  # difference of two slopes with an error each
    return found | _temperature_effects(observations)


def _temperature_effects(observations: ObservationSet) -> dict[str, tuple[float, float]]:
    """Return the coefficients that runs at different temperatures depend on."""
    runs = [
        run
        for run in observations.runs
        if not isinstance(run, MembraneSagObservation) and run.temperature_c is not None
    ]
    if (
        not runs
        or max(abs(float(run.temperature_c or 0.0) - float(observations.reference_c or 0.0)) for run in runs)
        < MIN_WARMER_K
    ):
        return {}
    used = {name for run in runs for name in _temperature_dependent(run)}
    return {name: (0.0, each.standard_deviation) for name, each in TEMPERATURE_COEFFICIENTS.items() if name[:2] in used}


def assumed_temperature(observations: ObservationSet) -> dict[str, float]:
    """Return the relative standard uncertainty of each parameter because the temperature of a run that shows it is not stated."""
    runs = [
        run for run in observations.runs if run.temperature_c is None and not isinstance(run, MembraneSagObservation)
    ]
    used = {name for run in runs for name in _temperature_dependent(run)}
    return {
        name[:2]: ASSUMED_KELVINS * each.standard_deviation
        for name, each in TEMPERATURE_COEFFICIENTS.items()
        if name[:2] in used
    }


def _temperature_dependent(run: Observation) -> Iterator[str]:
    yield "k2"
    if isinstance(run, VoltageStepsObservation | FrequencyResponseObservation):
        yield "mu"
    if isinstance(run, FrequencyResponseObservation | DecayPoleObservation | MassResonanceObservation):
        yield "c0"


def assumed_parameters(observations: ObservationSet) -> dict[str, tuple[float, float]]:
    """Return Table I with its spread for each parameter that these runs depend on and a fit would hold, by name."""
    free = FitOptions().free_parameters(observations)
    needed = set(_used_parameters(observations)) - set(free)
    table = {name: float(parameter_spec(name).default or 0.0) for name in ASSUMED_PARAMETERS if name in needed}
    return {name: (value, ASSUMED_PARAMETERS[name].standard_deviation * value) for name, value in table.items()}


def _used_parameters(observations: ObservationSet) -> Iterator[str]:
    for run in observations.runs:
        if not isinstance(run, MembraneSagObservation):
            yield "k2"
        if isinstance(run, MassResonanceObservation) and run.meaning == "peak":
            yield "c0"
        if isinstance(run, FrequencyResponseObservation) and run.elongation_m is not None:
            yield "E_m"


def _affecting(observations: ObservationSet) -> Iterator[str]:
    for run in observations.runs:
        if not isinstance(run, MembraneSagObservation):
            yield "clamp_flexibility"
        match run:
            case StaticLoadingObservation():
                yield from ("creep", "asymmetry") if run.side != "both" else ("creep",)
            case VoltageStepsObservation():
                yield from ("creep", "hysteresis")
            case MassResonanceObservation():
                yield from ("creep", "mass_fraction")
            case FrequencyResponseObservation():
                yield from ("creep", "hysteresis")
                if run.added_mass_kg is not None:
                    yield "mass_fraction"
                if run.elongation_m:
                    yield "elongation_slip"
