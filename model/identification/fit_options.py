"""Fit options: free, fixed and tied parameters, priors, start values and loss of a joint fit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from model import AmplifierMap, Membrane, ParameterError, Tactor
from model.identification import parameters as fit_parameters
from model.identification.observations import ObservationSet

MIN_SHAPES, MAX_SHAPES = 3, 60

Loss = Literal["linear", "soft_l1", "cauchy"]


class IdentificationError(ValueError):
    """A fit that is not possible; the message names the missing data and the remedy."""


class FitCancelled(Exception):
    """The fit was cancelled."""


@dataclass(frozen=True)
class FitOptions:
    """Options of a joint fit.

    Attributes:
        tactor, membrane, contact_length: values of the held parameters.
        free: names of the free parameters (`model.identification.parameters`); None: the parameters that the runs determine, and
            those with a prior.
        also: names of additional free parameters.
        fixed: fixed values by name, which replace values of tactor and membrane; also c_s(1.27 mm) and similar.
        tied: name -> (other, factor): the parameter is always that many times the other.
        priors: name -> (value, standard error): prior of a free parameter, e.g. from a caliper.
        normal_priors: normal distributions in place of priors next to a limit (`priors.bounded`), from an earlier fit.
        start: start values by name; default: the present values.
        per_elongation: a c_s at every elongation instead of the line c_s_delta delta + c_s_0.
        loss: loss of one residual in units of its error: "linear" is least squares; the others are robust against outliers.
        amplifier, n: the amplifier's map, and the number of shape functions: with the paper's 7 a sensor's delay is 0.8 errors off.
    """

    tactor: Tactor = field(default_factory=Tactor)
    membrane: Membrane = field(default_factory=Membrane)
    contact_length: float | None = None
    free: tuple[str, ...] | None = None
    also: tuple[str, ...] = ()
    fixed: Mapping[str, float] = field(default_factory=dict)
    tied: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    normal_priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    per_elongation: bool = False
    loss: Loss = "linear"
    amplifier: AmplifierMap = field(default_factory=AmplifierMap)
    n: int = 20

    def __post_init__(self) -> None:
        if self.loss not in ("linear", "soft_l1", "cauchy"):
            raise ParameterError(f"loss is {self.loss!r}: choose linear, soft_l1 or cauchy")
        if not MIN_SHAPES <= self.n <= MAX_SHAPES:
            raise ParameterError(f"{self.n} shape functions: choose from {MIN_SHAPES} to {MAX_SHAPES}")
        for name, value in self.fixed.items():
            fit_parameters.parameter_spec(name).check(value)

    def base_values(self) -> dict[str, float | None]:
        """Values of all parameters before the fit, by name."""
        return fit_parameters.default_values(self.tactor, self.membrane, self.contact_length) | dict(self.fixed)

    def free_parameters(self, observations: ObservationSet) -> tuple[str, ...]:
        """The free parameters for this campaign, without the shared errors of instruments.

        Raises:
            ParameterError: a name is unknown, both free and fixed, or tied to nothing.
        """
        free = (
            fit_parameters.identifiable_parameters(observations, self.per_elongation)
            if self.free is None
            else self.free
        )
        if self.free is None:
            free = tuple(name for name in free if name not in self.fixed and name not in self.tied)
            free += tuple(name for name in self.priors if name not in free)
            if self._has_added_mass_prior:
                free = tuple(name for name in free if name != "m_add")
        free += tuple(name for name in self.also if name not in free)
        free = fit_parameters.validate_names(free, observations)
        self._check_free(free, observations)
        for name in self.start:
            if name in free and name not in self.priors:
                fit_parameters.parameter_spec(name).check(self.start[name])
        return free

    def _check_free(self, free: Sequence[str], observations: ObservationSet) -> None:
        """Raise ParameterError for a parameter that is both free and held, a wrong tie or a wrong prior."""
        for name in free:
            if name in self.fixed or name in self.tied:
                raise ParameterError(f"{name} is both free and {'fixed' if name in self.fixed else 'tied'}: choose one")
            if name == "m_add" and self._has_added_mass_prior:
                raise ParameterError("m_add follows from mass_put_in, which is given: free mass_fraction instead")
            if name in observations.shared_errors:
                raise ParameterError(f"{name} is a shared error; it is always free, within its standard error")
        for name, (other, factor) in self.tied.items():
            fit_parameters.parameter_spec(name, observations)
            fit_parameters.parameter_spec(other, observations)
            if other in self.tied or not np.isfinite(factor):
                raise ParameterError(f"{name} is tied to {factor:g} times {other}, which is tied itself or not finite")
        for name, (value, error) in self.priors.items():
            if name not in free:
                raise ParameterError(f"{name} has a prior value but is not free: free it, or fix it at {value:g}")
            fit_parameters.parameter_spec(name).check(value)
            if not (np.isfinite(error) and error > 0):
                raise ParameterError(f"{name} has a standard error of {error:g} beforehand: it must be positive")

    @property
    def _has_added_mass_prior(self) -> bool:
        """Whether the mass in the cylinder is stated, so that m_add is its acting part."""
        return self.fixed.get("mass_put_in", 0.0) > 0 or "mass_put_in" in self.priors
