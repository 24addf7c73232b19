"""Mountings in a fit: differences between gluing a mass, clamping the plate, putting a membrane on or moving the laser again.

The parameters of a fit are those of the last mounting of each part. The difference of every earlier mounting from it is a shared
error of the runs of that mounting, with a normal prior by the repeatability of mountings. A part with one mounting has none.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from scipy.special import chdtrc

from model.identification.fit_result import MIN_P_VALUE, JointFit
from model.identification.observations import (
    SHARED_ERROR_UNITS,
    DecayPoleObservation,
    ErrorTarget,
    FrequencyResponseObservation,
    MassResonanceObservation,
    MembraneSagObservation,
    Observation,
    ObservationSet,
    SharedError,
)


@dataclass(frozen=True, slots=True)
class MountingEffect:
    """Effect of mounting a part anew, and its usual repeatability as a standard deviation, SI."""

    acts_on: ErrorTarget
    standard_deviation: float
    source: str

    @property
    def unit(self) -> str:
        """SI unit of the difference between two mountings."""
        return SHARED_ERROR_UNITS[self.acts_on]


MOUNTING_EFFECTS: Mapping[str, MountingEffect] = {
    "mass": MountingEffect("mass", 1e-4, "a drop of glue, and a millimetre along the cylinder; unproven"),
    "plate": MountingEffect("clamp", 0.01, "half of the spread among tactors, of the bare plate's length; unproven"),
    "membrane": MountingEffect("elongation", 2e-4, "slack of a membrane by eye; unproven"),
    "laser": MountingEffect("displacement", 2e-3, "an angle of 3 degrees: 1 - cos; unproven"),
}
"""Parts that can be mounted anew. The standard deviations are assumed where nothing is stated."""


@dataclass(frozen=True, slots=True)
class MountingDifference:
    """One mounting of a part: its time, its runs, and its difference from the last mounting of the part.

    `value` and `standard_error` are zero for the last mounting itself.
    """

    part: str
    time: str
    """ISO 8601; empty if unknown."""
    runs: tuple[str, ...]
    value: float
    standard_error: float


@dataclass(frozen=True, slots=True)
class MountingRepeatability:
    """Standard deviation between the mountings of a part, as found and as expected.

    Attributes:
        part: the part.
        count: number of mountings.
        found: standard deviation between mountings without the part by the uncertainty of the differences, 0 if that explains all.
        found_error: standard uncertainty of `found` by the number of mountings.
        expected: standard deviation of the prior.
        probability: of differences at least as large with the expected standard deviation.
    """

    part: str
    count: int
    found: float
    found_error: float
    expected: float
    probability: float

    @property
    def is_contradicted(self) -> bool:
        """Whether mountings differ by more than the expected standard deviation explains."""
        return self.probability < MIN_P_VALUE


def mountings_of(observations: ObservationSet, part: str) -> dict[str, tuple[Observation, ...]]:
    """Return the runs that a part acts on by the time of its mounting, the oldest first; the empty time is an unknown one."""
    runs: dict[str, tuple[Observation, ...]] = {}
    for run in observations.runs:
        if _acts_on(part, run):
            time = run.mountings.get(part, "")
            runs[time] = (*runs.get(time, ()), run)
    return dict(sorted(runs.items()))


def with_mountings(observations: ObservationSet, stated: Mapping[str, float]) -> ObservationSet:
    """Return the observations with an error for each mounting but the last of every part with several.

    Args:
        observations: the runs, with the times of their mountings.
        stated: standard deviation between mountings by part, SI; for others the usual one.
    """
    added: dict[str, tuple[SharedError, ...]] = {}
    for part, effect in MOUNTING_EFFECTS.items():
        deviation = sqrt(2) * stated.get(part, effect.standard_deviation)  # of a difference
        for number, runs in enumerate([*mountings_of(observations, part).values()][:-1], 1):
            error = SharedError(_name(part, number), effect.acts_on, deviation, source=f"mountings of the {part}")
            added |= {run.label: (*added.get(run.label, ()), error) for run in runs}
    if not added:
        return observations
    return ObservationSet(
        tuple(replace(run, shared_errors=(*run.shared_errors, *added.get(run.label, ()))) for run in observations.runs)
    )


def mounting_differences(fit: JointFit) -> tuple[MountingDifference, ...]:
    """Return every mounting of the parts with several, by part and time."""
    errors = np.sqrt(np.diag(fit.enlarged_covariance))
    found = []
    for part, runs in _fitted(fit):
        for number, (time, of) in enumerate(runs.items(), 1):
            at = fit.names.index(_name(part, number)) if number < len(runs) else None
            size = (0.0, 0.0) if at is None else (float(fit.theta[at]), float(errors[at]))
            found.append(MountingDifference(part, time, tuple(run.label for run in of), *size))
    return tuple(found)


def mounting_repeatabilities(fit: JointFit) -> tuple[MountingRepeatability, ...]:
    """Return how repeatable the mountings of each part with several are: the sample variance, less its part by the fit's uncertainty."""
    found = []
    for part, runs in _fitted(fit):
        at, count = [fit.names.index(_name(part, i)) for i in range(1, len(runs))], len(runs)
        values, covariance = np.append(fit.theta[at], 0.0), np.zeros((count, count))
        covariance[:-1, :-1] = fit.enlarged_covariance[np.ix_(at, at)]
        centred = np.eye(count) - 1 / count
        squares, freedom = float(values @ centred @ values), count - 1
        variance = max(squares - float(np.trace(centred @ covariance)), 0.0) / freedom
        expected = fit.observations.shared_errors[_name(part, 1)].standard_error / sqrt(2)
        size = sqrt(variance)
        chance = float(chdtrc(freedom, squares / expected**2))
        found.append(MountingRepeatability(part, count, size, size / sqrt(2 * freedom), expected, chance))
    return tuple(found)


def _fitted(fit: JointFit) -> Iterator[tuple[str, dict[str, tuple[Observation, ...]]]]:
    """Yield every part with differences in a fit, with its mountings."""
    for part in MOUNTING_EFFECTS:
        if _name(part, 1) in fit.observations.shared_errors:
            yield part, mountings_of(fit.observations, part)


def _name(part: str, number: int) -> str:
    return f"mounting {number} of the {part}"


def _acts_on(part: str, run: Observation) -> bool:
    response = isinstance(run, FrequencyResponseObservation)
    match part:
        case "mass":
            return isinstance(run, DecayPoleObservation) or (response and getattr(run, "added_mass_kg", None) is None)
        case "membrane":
            return response and getattr(run, "elongation_m", None) is not None
        case "laser":
            return not isinstance(run, MassResonanceObservation | DecayPoleObservation | MembraneSagObservation)
    return not isinstance(run, MembraneSagObservation)


def unrecorded_parts(observations: ObservationSet) -> Iterable[str]:
    """Return the parts that affect these runs and whose mounting no run records."""
    return [part for part in MOUNTING_EFFECTS if list(mountings_of(observations, part)) == [""]]
