"""Usual nonidealities of a tactor and its set-up, as parameters of every fit with their expected size.

Each is free with a normal prior around zero, like a length around the reading of a ruler. A specimen sheet, `--prior` or `--fix`
replaces the prior; `--sheet none` and `--plain` hold all of them at none.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import sqrt

from model.identification import (
    FrequencyResponseObservation,
    MassResonanceObservation,
    MembraneSagObservation,
    ObservationSet,
    StaticLoadingObservation,
    VoltageStepsObservation,
    parameter_spec,
)


@dataclass(frozen=True, slots=True)
class UsualEffect:
    """A nonideality with its standard deviation among tactors, SI, and the source of that."""

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


def usual_effects(observations: ObservationSet) -> dict[str, tuple[float, float]]:
    """Return value and standard deviation of each usual nonideality that these runs depend on, by name."""
    effects = {
        name: (float(parameter_spec(name).default or 0.0), effect.standard_deviation)
        for name, effect in USUAL_EFFECTS.items()
        if name in set(_affecting(observations))
    }
    driven = (VoltageStepsObservation, FrequencyResponseObservation)
    slopes = [e.standard_error for e in observations.shared_errors.values() if e.acts_on == "volts"]
    if slopes and any(isinstance(run, driven) for run in observations.runs):
        effects["gain_below_rest"] = 0.0, sqrt(2) * max(slopes)  # difference of two slopes with an error each
    return effects


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
