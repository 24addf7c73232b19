"""Possible causes of a misfit: held parameters and nonidealities, the scale of one run, one point."""

from dataclasses import dataclass, replace
from typing import Any, Literal

from model import Mask, Membrane, Tactor, parameter_specs
from model.identification import parameters as known
from model.identification.fit_options import FitOptions
from model.identification.fit_result import JointFit
from model.identification.nonidealities import NONIDEALITIES
from model.identification.observations import (
    MassResonanceObservation,
    MembraneSagObservation,
    Observation,
    ObservationSet,
    SharedError,
)

Kind = Literal["parameter", "scale", "point"]

WIDE_GAIN_ERROR = 3.0
"""Prior standard error of the scale of one run that may be wrong by any factor."""
SAME_EFFECT = {"b_Al": "h_Al", "E_Al": "h_Al", "b_m": "contact_length"}
"""Parameters that enter the model only together with another one, which stands for them."""
NO_CAUSES = ("mu", "mass_put_in")
"""Parameters that are no cause: a wrong moment per volt is found with any drive."""

PLAUSIBLE_ERRORS = {
    "L": 0.05,
    "L1": 0.1,
    "L2": 0.05,
    "h_Al": 0.1,
    "rho1": 0.1,
    "rho2": 0.1,
    "L_m": 0.05,
    "h_m": 0.1,
}
"""Relative standard deviation of what a ruler, caliper or balance may be misread by; a cause beyond that is less likely."""


@dataclass(frozen=True)
class Cause:
    """One possible cause, as an extension of a fit."""

    kind: Kind
    name: str
    """Of a parameter, or of a run."""
    point: int = -1
    """Index of the point in its run."""

    @property
    def title(self) -> str:
        """What it is called in a table."""
        match self.kind:
            case "scale":
                return f"scale of {self.name}"
            case "point":
                return f"point {self.point + 1} of {self.name}"
        return self.name

    def extend(self, fit: JointFit) -> tuple[ObservationSet, FitOptions]:
        """Return the observations and options of a fit with this cause, which begins where `fit` ended."""
        options = free_as_well(fit, (self.name,) if self.kind == "parameter" else ())
        match self.kind:
            case "parameter":
                return fit.observations, replace(options, priors=self._priors(fit))
            case "scale":
                error = SharedError(self.title, "displacement", WIDE_GAIN_ERROR)
                run = self.run(fit)
                return _with_run(fit, run, {"shared_errors": (*run.shared_errors, error)}), options
        run = self.run(fit)
        return _with_run(fit, run, {"good": _without(run, self.point)}), options

    def _priors(self, fit: JointFit) -> dict[str, tuple[float, float]]:
        share = PLAUSIBLE_ERRORS.get(self.name)
        if share is None:
            return dict(fit.options.priors)
        held = known.start_value(self.name, fit.options.base_values())
        return {**fit.options.priors, self.name: (held, share * abs(held))}

    def run(self, fit: JointFit) -> Observation:
        """Return the run of a wrong scale or point."""
        return next(run for run in fit.observations.runs if run.label == self.name)


def free_as_well(fit: JointFit, names: tuple[str, ...]) -> FitOptions:
    """Return the options of a fit with these parameters free in addition, which begins where `fit` ended."""
    base = fit.options.base_values()
    start = {name: known.start_value(name, base) for name in names}
    start |= dict(zip(fit.names, fit.theta.tolist(), strict=True))
    fixed = {name: value for name, value in fit.options.fixed.items() if name not in names}
    return replace(fit.options, free=fit.free_parameters, also=names, fixed=fixed, start=start)


def possible_causes(fit: JointFit) -> tuple[Cause, ...]:
    """Return every parameter that is held and every run whose scale may be wrong; points are found by their residuals."""
    base = fit.options.base_values()
    names = [q.name for q in (*parameter_specs(Tactor), *parameter_specs(Membrane))]
    names += ["contact_length", "asymmetry", *NONIDEALITIES]
    held = [
        name
        for name in names
        if name not in fit.names
        and name not in fit.options.tied
        and name not in NO_CAUSES
        and SAME_EFFECT.get(name) is None
        and not (name == "m_add" and (base.get("mass_put_in") or "mass_put_in" in fit.names))
    ]
    runs = [r for r in fit.observations.runs if not isinstance(r, MassResonanceObservation | MembraneSagObservation)]
    scales = [Cause("scale", run.label) for run in runs] if len(fit.observations.runs) > 1 else []
    return (*(Cause("parameter", name) for name in held), *scales)


def _with_run(fit: JointFit, changed: Observation, changes: dict[str, Any]) -> ObservationSet:
    return ObservationSet(tuple(replace(run, **changes) if run is changed else run for run in fit.observations.runs))


def _without(run: Observation, point: int) -> Mask:
    good = run.usable.copy()
    good[point] = False
    return good
