"""Possible causes of a misfit: held parameters and nonidealities, the scale of one run, one point."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from model import Mask, Membrane, Tactor, parameter_specs
from model.identification import observations as observed
from model.identification import parameters as fit_parameters
from model.identification.fit_options import FitOptions
from model.identification.fit_result import JointFit
from model.identification.nonidealities import NONIDEALITIES

Kind = Literal["parameter", "prior", "scale", "frequency", "elongation", "point"]

RUN_ERRORS: dict[Kind, tuple[observed.ErrorTarget, float]] = {
    "scale": ("displacement", 3.0),
    "frequency": ("frequency", 10.0),
    "elongation": ("elongation", 2e-3),
}
"""Errors of a single run: affected quantity, and a standard error large enough for the run to determine them."""
SAME_EFFECT = {"b_Al": "h_Al", "E_Al": "h_Al", "b_m": "contact_length"}
"""Parameters that enter the model only together with another one, which represents them."""
NO_CAUSES = ("mu", "mass_put_in", "gain_above_rest")
"""Parameters that are no cause: any drive determines the moment per volt, which takes up the slope above rest."""

PLAUSIBLE_ERRORS = {
    "L": 0.05,
    "L1": 0.1,
    "L2": 0.05,
    "h_Al": 0.1,
    "rho1": 0.1,
    "rho2": 0.1,
    "L_m": 0.05,
    "h_m": 0.1,
    "load_gain": 0.03,
    "sensor_gain": 0.03,
}
"""Relative standard deviation of plausible errors of ruler, caliper, balance or sensor; a larger cause is less likely."""


@dataclass(frozen=True)
class Cause:
    """One possible cause, as an extension of a fit."""

    kind: Kind
    name: str
    """Name of a parameter or run."""
    point: int = -1
    """Index of the point in its run."""

    @property
    def title(self) -> str:
        """Name in a table."""
        match self.kind:
            case "scale" | "frequency" | "elongation":
                return f"{self.kind} of {self.name}"
            case "point":
                return f"point {self.point + 1} of {self.name}"
            case "prior":
                return f"stated {self.name}"
        return self.name

    @property
    def parameter(self) -> str:
        """The parameter of the extended fit with the size of the cause; empty for a point."""
        return "" if self.kind == "point" else self.title if self.kind in RUN_ERRORS else self.name

    def extend(self, fit: JointFit) -> tuple[observed.ObservationSet, FitOptions]:
        """Return the observations and options of a fit with this cause, which begins where `fit` ended."""
        options = free_as_well(fit, (self.name,) if self.kind == "parameter" else ())
        match self.kind:
            case "parameter":
                return fit.observations, replace(options, priors=self._priors(fit))
            case "prior":
                priors = {name: prior for name, prior in options.priors.items() if name != self.name}
                return fit.observations, replace(options, priors=priors)
            case "scale" | "frequency" | "elongation":
                error, run = self.shared_error, self.run(fit)
                return _with_run(fit, run, {"shared_errors": (*run.shared_errors, error)}), options
        run = self.run(fit)
        return _with_run(fit, run, {"good": _without(run, self.point)}), options

    @property
    def shared_error(self) -> observed.SharedError:
        """Return the error of one run, as a shared error."""
        return observed.SharedError(self.title, *RUN_ERRORS[self.kind])

    def plausible(self, fit: JointFit) -> tuple[float, float] | None:
        """Return the held value and the plausible standard deviation; None if any size is plausible."""
        share = PLAUSIBLE_ERRORS.get(self.name) if self.kind == "parameter" else None
        if share is None:
            return None
        held = fit_parameters.start_value(self.name, fit.options.base_values())
        return held, share * (abs(held) or 1.0)

    def _priors(self, fit: JointFit) -> dict[str, tuple[float, float]]:
        plausible = self.plausible(fit)
        return {**fit.options.priors, **({} if plausible is None else {self.name: plausible})}

    def run(self, fit: JointFit) -> observed.Observation:
        """Return the run of a wrong scale or point."""
        return next(run for run in fit.observations.runs if run.label == self.name)


def free_as_well(fit: JointFit, names: tuple[str, ...]) -> FitOptions:
    """Return the options of a fit with these parameters free in addition, which begins where `fit` ended."""
    base = fit.options.base_values()
    start = {name: fit_parameters.start_value(name, base) for name in names}
    start |= dict(zip(fit.names, fit.theta.tolist(), strict=True))
    fixed = {name: value for name, value in fit.options.fixed.items() if name not in names}
    return replace(fit.options, free=fit.free_parameters, also=names, fixed=fixed, start=start)


def possible_causes(fit: JointFit) -> tuple[Cause, ...]:
    """Return every held parameter and the possible errors of whole runs; wrong points are found by their residuals."""
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
    out = [Cause("parameter", name) for name in held]
    out += [Cause("prior", name) for name in fit.options.priors]
    if len(fit.observations.runs) > 1:
        out += [Cause(kind, run.label) for run in fit.observations.runs for kind in _run_kinds(run)]
    return tuple(out)


def _run_kinds(run: observed.Observation) -> Iterator[Kind]:
    """Yield the possible errors of a whole run."""
    if not isinstance(
        run, observed.MassResonanceObservation | observed.MembraneSagObservation | observed.DecayPoleObservation
    ):
        yield "scale"
    if isinstance(run, observed.FrequencyResponseObservation):
        yield "frequency"
        if run.elongation_m is not None:
            yield "elongation"


def with_errors_of_runs(fit: JointFit, causes: Sequence[Cause]) -> observed.ObservationSet:
    """Return the observations with the error of every cause that is an error of a run."""
    runs = []
    for run in fit.observations.runs:
        errors = tuple(c.shared_error for c in causes if c.kind in RUN_ERRORS and c.name == run.label)
        runs.append(replace(run, shared_errors=(*run.shared_errors, *errors)))
    return observed.ObservationSet(tuple(runs))


def _with_run(fit: JointFit, changed: observed.Observation, changes: dict[str, Any]) -> observed.ObservationSet:
    return observed.ObservationSet(
        tuple(replace(run, **changes) if run is changed else run for run in fit.observations.runs)
    )


def _without(run: observed.Observation, point: int) -> Mask:
    good = run.usable.copy()
    good[point] = False
    return good
