"""Possible causes of a misfit: hypotheses with parameters of plausible sizes, each of which acts on all residuals of a kind.

A cause frees parameters of the specimen, widens what is known of one, or adds errors to runs: of scale, time base, delay, elongation,
added mass or clamp, or of a shape over the points. Only an exchange of two labels has no parameter.
"""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from model import Array, Complex, Membrane, Tactor, parameter_specs
from model.identification import observations as observed
from model.identification import parameters as fit_parameters
from model.identification.attribution.shapes import shaped_errors
from model.identification.fit_options import FitOptions
from model.identification.fit_result import JointFit
from model.identification.nonidealities import NONIDEALITIES
from model.identification.priors import TEMPERATURE_COEFFICIENTS, USUAL_EFFECTS

SAME_EFFECT = {"b_Al": "h_Al", "E_Al": "h_Al", "b_m": "contact_length"}
"""Parameters that enter the model only together with another one, which represents them."""
NO_CAUSES = ("mu", "mass_put_in", "gain_above_rest")
"""Parameters that are no cause: any drive determines the moment per volt, which takes up the slope above rest."""
TABLE = tomllib.loads(files("model.identification.attribution").joinpath("causes.toml").read_text("utf-8"))
"""Text, decisive check and plausible size of each cause: of `parameters` by their name, of errors of `runs` by their kind."""
PLAUSIBLE_SIZES = {name: each["plausible"] for name, each in TABLE["parameters"].items() if "plausible" in each}
"""Standard deviation of the plausible values of a held parameter, SI; for others `PLAUSIBLE_SHARE` of their value."""
PLAUSIBLE_SHARE = 0.1
WIDENED = 5.0
"""Times as far as its standard uncertainty a stated value may be off by a mistake."""
POINT_ERRORS = 20.0
"""Standard errors by which a point may be off by a mistake."""
SCALE_ERROR, CLOCK_ERROR, DELAY_ERROR_S = 0.1, 0.01, 5e-5
ELONGATION_ERROR_M, MASS_ERROR_KG, CLAMP_ERROR, DAMPING_ERROR = 5e-4, 3e-4, 0.05, 0.2
"""Plausible sizes of the errors of one run, or of one mounting."""
LOG_PRIORS = {"clamp of": -2.0, "creep of the dwells": -1.0}
"""Kinds that are less likely beforehand: a clamp that gives in one run must be as before after it."""
MOST_SUCCESSIVE = 4
"""Largest number of successive runs in which something is mounted and then taken off; more begin at the first or end at the last."""
SEVERAL_RUNS = -0.7
"""Logarithm of odds of a mistake in all runs of a kind against one in a single run."""


class RunError(NamedTuple):
    """An error of some runs: with its shape over the usable points where it has one, by run."""

    error: observed.SharedError
    runs: Mapping[str, Array | Complex | None]


@dataclass(frozen=True, eq=False)
class Cause:
    """One possible cause, as an extension of a fit.

    Attributes:
        kind: kind of the cause; decides text and check.
        name: of the parameter, or of the run; `all dwells` and the like for several.
        title: in a table.
        parameters: value and standard deviation of each parameter of the specimen that is free, or less known.
        errors: of runs.
        points: that are left out, or whose labels are exchanged, of the run `name`.
        among: causes of the kind, which share its odds.
    """

    kind: str
    name: str
    title: str
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    errors: tuple[RunError, ...] = ()
    points: tuple[int, ...] = ()
    among: int = 1

    @property
    def sizes(self) -> tuple[str, ...]:
        """The parameters of the extended fit that have its size."""
        return (*self.parameters, *(e.error.name for e in self.errors))

    @property
    def log_prior(self) -> float:
        """Logarithm of its odds beforehand, on which all causes of its kind share."""
        return LOG_PRIORS.get(self.kind, 0.0) + SEVERAL_RUNS * self.name.startswith("all ") - float(np.log(self.among))

    @property
    def proposable(self) -> bool:
        """Whether a fit may go on with it: an effect of the specimen or of the set-up, no mistake of one run and no wrong length."""
        return self.kind in ("parameter", "beyond") and not {*self.parameters} & {"load_gain", "sensor_gain", *_LENGTHS}

    def extend(self, fit: JointFit) -> tuple[observed.ObservationSet, FitOptions]:
        """Return the observations and options of a fit with this cause, which begins where `fit` ended."""
        options = free_as_well(fit, tuple(self.parameters))
        normal = {n: v for n, v in options.normal_priors.items() if n not in self.parameters}
        options = replace(options, priors={**options.priors, **self.parameters}, normal_priors=normal)
        return with_errors(
            fit.observations, self.errors, {self.name: self.points} if self.points else {}, self.kind
        ), options


_LENGTHS = {q.name for q in (*parameter_specs(Tactor), *parameter_specs(Membrane))}


def free_as_well(fit: JointFit, names: Sequence[str]) -> FitOptions:
    """Return the options of a fit with these parameters free in addition, which begins where `fit` ended."""
    base = fit.options.base_values()
    new = tuple(n for n in names if n not in fit.names)
    start = {name: fit_parameters.start_value(name, base) for name in new}
    start |= dict(zip(fit.names, fit.theta.tolist(), strict=True))
    fixed = {name: value for name, value in fit.options.fixed.items() if name not in new}
    return replace(fit.options, free=fit.free_parameters, also=new, fixed=fixed, start=start)


def with_errors(
    observations: observed.ObservationSet,
    errors: Sequence[RunError],
    points: Mapping[str, tuple[int, ...]] | None = None,
    kind: str = "",
) -> observed.ObservationSet:
    """Return the observations with further errors, and without points of a run, or with their labels exchanged."""
    runs: list[observed.Observation] = []
    for run in observations.runs:
        own = [e for e in errors if run.label in e.runs]
        shapes = {e.error.name: _over_all(run, e.runs[run.label]) for e in own if e.runs[run.label] is not None}
        changes: dict[str, Any] = {"shared_errors": (*run.shared_errors, *(e.error for e in own))}
        changes["shapes"] = {**run.shapes, **shapes}
        if (at := (points or {}).get(run.label)) and kind == "exchange":
            inputs = labels_of(run).copy()
            inputs[list(at)] = inputs[list(at)[::-1]]
            changes["load_n" if isinstance(run, observed.StaticLoadingObservation) else "mass_kg"] = inputs
        elif at:
            good = run.usable.copy()
            good[list(at)] = False
            changes["good"] = good
        runs.append(replace(run, **changes))
    return observed.ObservationSet(tuple(runs))


def _over_all(run: observed.Observation, shape: Any) -> Any:
    out = np.zeros(run.usable.size, dtype=np.asarray(shape).dtype)
    out[run.usable] = shape
    return out


def labels_of(run: observed.Observation) -> Array:
    """Return the loads or added masses of a run, which somebody wrote down, (F,)."""
    return run.load_n if isinstance(run, observed.StaticLoadingObservation) else getattr(run, "mass_kg", np.zeros(0))


def possible_causes(fit: JointFit, predictions: Mapping[str, Any], softening: Mapping[str, Any]) -> tuple[Cause, ...]:
    """Return every cause but `exchanges` that the runs of a fit may have.

    `predictions` of the usable points, by run, and `softening`, their relative changes for a relative change of k2, (F,).

    A point has an odd of one over the number of points, as have all causes of a kind.
    """
    found = [*_held(fit), *_known(fit), *_run_errors(fit), *shaped_causes(fit, predictions, softening), *_points(fit)]
    count: dict[str, int] = {}
    for cause in found:
        count[cause.kind] = count.get(cause.kind, 0) + 1
    return tuple(c if c.kind in ("parameter", "beyond") else replace(c, among=count[c.kind]) for c in found)


def _held(fit: JointFit) -> Iterator[Cause]:
    """Yield every parameter that is held, around its value."""
    base, usual = fit.options.base_values(), {**USUAL_EFFECTS, **TEMPERATURE_COEFFICIENTS}
    names = [q.name for q in (*parameter_specs(Tactor), *parameter_specs(Membrane))]
    for name in (*names, "contact_length", "asymmetry", *NONIDEALITIES):
        taken = name in fit.names or name in fit.options.tied or name in NO_CAUSES or name in SAME_EFFECT
        if taken or (name == "m_add" and (base.get("mass_put_in") or "mass_put_in" in fit.names)):
            continue
        value = fit_parameters.start_value(name, base)
        size = usual[name].standard_deviation if name in usual else PLAUSIBLE_SHARE * abs(value)
        yield Cause("parameter", name, name, {name: (value, PLAUSIBLE_SIZES.get(name, size))})


def _known(fit: JointFit) -> Iterator[Cause]:
    """Yield every value known beforehand, and every usual effect, as less known."""
    for name, (value, deviation) in fit.options.priors.items():
        kind = "stated" if name in _LENGTHS else "beyond"
        yield Cause(kind, name, f"stated {name}", {name: (value, WIDENED * deviation)})


def _run_errors(fit: JointFit) -> Iterator[Cause]:
    """Yield errors of one run, of all runs of a kind, and of successive runs."""
    runs = fit.observations.runs
    if len(runs) < 2:
        return
    groups = dict(_groups(runs))
    for label, members in groups.items():
        if not isinstance(
            members[0],
            observed.MassResonanceObservation | observed.MembraneSagObservation | observed.DecayPoleObservation,
        ):
            yield _error("scale", label, members, "displacement", SCALE_ERROR)
        responses = [r for r in members if isinstance(r, observed.FrequencyResponseObservation)]
        if responses or isinstance(members[0], observed.MassResonanceObservation | observed.DecayPoleObservation):
            yield _error("time base", label, members, "clock", CLOCK_ERROR)
        if responses and len(members) == 1:
            if np.iscomplexobj(observed.observed_values(responses[0])[0]):
                yield _error("delay", label, members, "delay", DELAY_ERROR_S)
            if responses[0].elongation_m is not None:
                yield _error("elongation", label, members, "elongation", ELONGATION_ERROR_M)
    beams = [r for r in runs if not isinstance(r, observed.MembraneSagObservation)]
    still = observed.StaticLoadingObservation | observed.VoltageStepsObservation
    changes: tuple[tuple[observed.ErrorTarget, float, Sequence[observed.Observation]], ...] = (
        ("mass", MASS_ERROR_KG, [r for r in runs if _carries_own_mass(r)]),
        ("clamp", CLAMP_ERROR, beams),
        ("damping", DAMPING_ERROR, [r for r in beams if not isinstance(r, still)]),
    )
    for on, size, concerned in changes:
        for i in range(len(concerned) - 1 if len(concerned) > 2 else 0):
            yield _error(f"{on} of", concerned[i].label, concerned[i : i + 1], on, size)
        yield from _successive(f"{on} of", f"{on} from", on, size, concerned)
    responses = [r for r in runs if isinstance(r, observed.FrequencyResponseObservation)]
    yield from _successive("scale", "scale from", "displacement", SCALE_ERROR, responses)


def _successive(
    of: str, onward: str, on: observed.ErrorTarget, size: float, runs: Sequence[observed.Observation]
) -> Iterator[Cause]:
    """Yield errors of all runs from one on, and of several successive ones, which end before the last of these runs."""
    last = len(runs) - 1
    for i in range(1, len(runs)):
        yield _error(onward, runs[i].label, runs[i:], on, size)
    membrane = [r for r in runs if getattr(r, "elongation_m", None) is not None]
    if 0 < len(membrane) < len(runs):
        yield _error(of, "all dwells on the membrane", membrane, on, size)
    for first in range(1, last):
        for after in range(first + 2, min(first + MOST_SUCCESSIVE, last) + 1):
            if runs[first:after] != membrane:
                label = f"{runs[first].label} to {runs[after - 1].label}"
                yield _error(of, label, runs[first:after], on, size)


def _error(kind: str, label: str, runs: Sequence[observed.Observation], on: Any, size: float) -> Cause:
    title = (
        f"{kind} {label}{' on' if kind.endswith('from') else ''}" if kind[-2:] in ("of", "om") else f"{kind} of {label}"
    )
    error = observed.SharedError(title, on, size)
    return Cause(kind, label, title, errors=(RunError(error, dict.fromkeys([r.label for r in runs])),))


def _groups(runs: Sequence[observed.Observation]) -> Iterator[tuple[str, list[observed.Observation]]]:
    """Yield every run by itself, and all loadings, steps or dwells where there are several and others."""
    for run in runs:
        yield run.label, [run]
    for kind, name in (
        (observed.StaticLoadingObservation, "loadings"),
        (observed.VoltageStepsObservation, "steps"),
        (observed.FrequencyResponseObservation, "dwells"),
    ):
        same: list[observed.Observation] = [r for r in runs if isinstance(r, kind)]
        if 1 < len(same) < len(runs):
            yield f"all {name}", same


def _carries_own_mass(run: observed.Observation) -> bool:
    if isinstance(run, observed.FrequencyResponseObservation):
        return run.added_mass_kg is None
    return isinstance(run, observed.DecayPoleObservation)


def shaped_causes(fit: JointFit, predictions: Mapping[str, Any], softening: Mapping[str, Any]) -> Iterator[Cause]:
    """Yield errors of readings that have a shape over the points."""
    for kind, name, title, errors in shaped_errors(
        fit.observations.runs, predictions, softening, fit.options.amplifier.rest_v
    ):
        made = tuple(
            RunError(observed.SharedError(f"{title}{'' if len(errors) == 1 else f' ({i + 1})'}", "reading", size), runs)
            for i, (size, runs) in enumerate(errors)
        )
        yield Cause(kind, name, title, errors=made)


def _points(fit: JointFit) -> Iterator[Cause]:
    """Yield every point of runs of two or more by itself."""
    for run, usable in comparable_points(fit):
        yield from (Cause("point", run.label, f"point {i + 1} of {run.label}", points=(i,)) for i in usable)


def exchanged_points(fit: JointFit) -> dict[str, list[tuple[int, int]]]:
    """Return by run every two points whose labels may have been exchanged."""
    found = ((run.label, labels_of(run), usable) for run, usable in comparable_points(fit))
    return {name: [(i, j) for i, j in combinations(usable, 2) if x[i] != x[j]] for name, x, usable in found if x.size}


def exchanges(pairs: Mapping[str, list[tuple[int, int]]]) -> list[Cause]:
    """Return the exchanges of `exchanged_points` as causes, which share their odds."""
    every = [(name, pair) for name, own in pairs.items() for pair in own]
    return [Cause("exchange", name, f"exchange in {name}", points=pair, among=len(every)) for name, pair in every]


def several_points(run: str, points: Sequence[int], among: int) -> Cause:
    """Return the cause that these points of a run are wrong, each by an error of its own; `among`: number of sets of as many points in all runs."""
    title = f"points {listed([str(i + 1) for i in sorted(points)])} of {run}"
    return Cause("points", run, title, points=tuple(sorted(points)), among=among)


def listed(words: Sequence[str]) -> str:
    """Return two words or more as a list in a sentence: `3, 7 and 12`."""
    return f"{', '.join(words[:-1])} and {words[-1]}"


def comparable_points(fit: JointFit) -> Iterator[tuple[observed.Observation, list[int]]]:
    """Yield the runs without outliers of two usable points or more, with these points."""
    for run, part in zip(fit.observations.runs, fit.run_slices, strict=True):
        usable = np.flatnonzero(run.usable).tolist()
        if len(usable) >= 2 and fit.used_rows[part].all():
            yield run, usable
