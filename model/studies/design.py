"""Design questions to the model: the added mass for a resonance, and the drive for an amplitude, with standard errors."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from model import AmplifierMap, Array, ParameterError, Specimen, replace_variables
from model.response import natural_frequencies, response_curve
from model.studies.uncertainty import EstimateSet, linear_band

LIGHTEST_KG, HEAVIEST_KG, TRIED_MASSES = 1e-4, 0.2, 40
"""Range of the search for an added mass, and number of first trials."""

NEAR = 0.7, 1.4
"""Multiples of the result that bracket the first search for slightly different parameters."""

SLOPE_SHARE = 1e-3
"""Relative distance from the frequency for the slope of the response."""

FULL_AMPLITUDE_V = 2.5

MassFunction = Callable[[float], float]
"""Function of the added mass, kg: positive while the resonance lies above the requested frequency."""


@dataclass(frozen=True, slots=True)
class DesignAnswer:
    """A value and its standard error, SI; the error is None without estimates."""

    value: float
    standard_error: float | None


def required_mass(
    specimen: Specimen, frequency_hz: float, estimates: EstimateSet | None = None, undamped: bool = False, n: int = 7
) -> DesignAnswer:
    """Return the moving added mass for a resonance at a frequency.

    Args:
        specimen: specimen with any added mass.
        frequency_hz: frequency of the largest fundamental under a sine of constant amplitude.
        estimates: estimates of the specimen's parameters with covariance; an added mass among them is ignored.
        undamped: use the undamped natural frequency of the first mode instead; damping lowers the peak.
        n: number of shape functions.

    Raises:
        ParameterError: no added mass between `LIGHTEST_KG` and `HEAVIEST_KG` does.
    """
    expected: list[float] = []

    def answer(of: Specimen) -> float:
        above = _natural_frequency_above(of, frequency_hz, n) if undamped else _response_rises(of, frequency_hz, n)
        expected.append(_sought_mass(above, frequency_hz, *expected[:1]))
        return expected[-1]

    return _with_error(answer, specimen, None if estimates is None else estimates.without(("m_add",)))


def required_drive(
    specimen: Specimen,
    frequency_hz: float,
    peak_to_peak_m: float,
    estimates: EstimateSet | None = None,
    amplifier: AmplifierMap | None = None,
    n: int = 7,
) -> DesignAnswer:
    """Return the sine around rest, volts peak to peak at the amplifier's input, for a max - min of the displacement.

    The response is proportional to a sine around rest, because the amplifier has one slope on each side of it. The result may
    exceed the amplifier's input range.

    Raises:
        ParameterError: a frequency or an amplitude that is not positive.
    """
    if not peak_to_peak_m > 0:
        raise ParameterError(f"amplitude is {peak_to_peak_m:g} m: it must be greater than 0")

    def answer(of: Specimen) -> float:
        full = response_curve(of, np.array([frequency_hz]), FULL_AMPLITUDE_V, amplifier, n)
        return 2 * FULL_AMPLITUDE_V * peak_to_peak_m / float(full.peak_to_peak[0])

    return _with_error(answer, specimen, estimates)


def _response_rises(specimen: Specimen, frequency_hz: float, n: int) -> MassFunction:
    beside = frequency_hz * np.array([1 - SLOPE_SHARE, 1 + SLOPE_SHARE])

    def slope(mass_kg: float) -> float:
        response = response_curve(replace_variables(specimen, {"m_add": mass_kg}), beside, FULL_AMPLITUDE_V, n=n)
        low, high = np.abs(response.fundamental)
        return float((high - low) / (high + low))

    return slope


def _natural_frequency_above(specimen: Specimen, frequency_hz: float, n: int) -> MassFunction:
    def above(mass_kg: float) -> float:
        loaded = replace_variables(specimen, {"m_add": mass_kg})
        return float(natural_frequencies(loaded.acting_tactor, loaded.skin, n)[0]) - frequency_hz

    return above


def _sought_mass(above: MassFunction, frequency_hz: float, expected_kg: float | None = None) -> float:
    from scipy.optimize import brentq

    if expected_kg is not None:
        low, high = (share * expected_kg for share in NEAR)
        if above(low) > 0 > above(high):
            return float(brentq(above, low, high, xtol=1e-9))
    masses_kg = np.geomspace(LIGHTEST_KG, HEAVIEST_KG, TRIED_MASSES)
    rises = np.array([above(mass) > 0 for mass in masses_kg])
    # A light tactor can be so damped that its response falls from the start.
    last = np.flatnonzero(rises[:-1] & ~rises[1:])
    if not last.size:
        span = f"no added mass from {1e3 * LIGHTEST_KG:g} to {1e3 * HEAVIEST_KG:g} g gives a resonance at {frequency_hz:g} Hz"
        if rises[-1]:
            raise ParameterError(f"{span}: with the heaviest it lies higher; ask for a higher frequency")
        raise ParameterError(
            f"{span}: it lies lower, or there is none; ask for a lower frequency, or for a skin that damps less"
        )
    return float(brentq(above, masses_kg[last[-1]], masses_kg[last[-1] + 1], xtol=1e-9))


def _with_error(answer: Callable[[Specimen], float], specimen: Specimen, estimates: EstimateSet | None) -> DesignAnswer:
    if estimates is None:
        return DesignAnswer(answer(specimen), None)

    def curve(values: Mapping[str, Array]) -> Array:
        rows = zip(*values.values(), strict=True)
        return np.array([[answer(replace_variables(specimen, dict(zip(values, row, strict=True))))] for row in rows])

    band = linear_band(curve, estimates)
    return DesignAnswer(float(band.centre[0]), float(band.standard_error[0]))
