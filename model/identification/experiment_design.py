"""Experiment design: ranking of possible runs by their reduction of a parameter's error per minute."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from model import GRAVITY, Array, ParameterError, format_uncertainty
from model.identification import observations as observed
from model.identification import parameters as fit_parameters
from model.identification.fit_result import UNKNOWN_RELATIVE_ERROR, JointFit
from model.identification.forward_model import with_predictions
from model.identification.residuals import LeastSquaresProblem

AGAIN_BETTER, AGAIN_MINUTES = 5.0, 5.0
"""A length or mass measured again: a caliper instead of a ruler, a micrometer instead of a caliper; and its duration."""


@dataclass(frozen=True)
class BetterKnowledge:
    """A parameter with a prior value, such as a length, measured again with a better instrument."""

    label: str
    parameter: str
    standard_error: float


@dataclass(frozen=True)
class Candidate:
    """A possible run, or better measurement of a length or mass, and its duration.

    Settings and expected errors of the run count; its values are ignored.
    """

    run: observed.Observation | BetterKnowledge
    minutes: float


@dataclass(frozen=True)
class Proposal:
    """Effect of a candidate on one parameter; errors are relative to its value."""

    candidate: Candidate
    parameter: str
    error_before: float
    error_after: float

    @property
    def improvement_per_minute(self) -> float:
        """Decrease of the logarithm of the standard error per minute, so that proposals add up."""
        return float(np.log(self.error_before / self.error_after) / self.candidate.minutes)

    @property
    def summary(self) -> str:
        """The numbers in one line."""
        was = "not identified" if self.error_before > 1 else format_uncertainty(100 * self.error_before, "%")
        will = "still not identified" if self.error_after > 1 else format_uncertainty(100 * self.error_after, "%")
        return (
            f"{self.candidate.run.label} ({self.candidate.minutes:.3g} min): {self.parameter} from {was} to {will}, "
            f"{100 * (1 - np.exp(-self.improvement_per_minute)):.2g} % less a minute"
        )


def rank_candidates(
    fit: JointFit, candidates: Sequence[Candidate], parameter: str | None = None
) -> tuple[Proposal, ...]:
    """All candidates, the best first, ranked by their effect on `parameter`, by default the least certain one.

    The information of a run is computed at the fit's parameters; errors shared with earlier runs stay shared.

    Raises:
        ParameterError: `parameter` was not free, there is no candidate, or one has no duration.
    """
    if not candidates:
        raise ParameterError("there is no candidate to choose from: name at least one run that could be done")
    for c in candidates:
        if not c.minutes > 0:
            raise ParameterError(f"{c.run.label} takes {c.minutes:g} minutes: give the time it really takes")
    own = fit.free_parameters
    J = fit.jacobian * fit.parameter_scale
    now = _standard_errors(J.T @ J)[: len(own)]
    if parameter is None:
        sought = [i for i, name in enumerate(own) if name not in fit.options.priors] or range(len(own))
        parameter = own[max(sought, key=lambda i: float(now[i]))]
    if parameter not in own:
        raise ParameterError(f"{parameter} was not free in this fit: choose from {', '.join(own)}")
    at = own.index(parameter)
    proposals = [
        Proposal(c, parameter, float(now[at]), float(_standard_errors(_information_with(fit, c))[at]))
        for c in candidates
    ]
    return tuple(sorted(proposals, key=lambda p: -p.improvement_per_minute))


def _information_with(fit: JointFit, candidate: Candidate) -> Array:
    """Scaled information of the fit and the candidate together; new shared errors come last."""
    P, run = len(fit.names), candidate.run
    if isinstance(run, BetterKnowledge):
        F = (fit.jacobian * fit.parameter_scale).T @ (fit.jacobian * fit.parameter_scale)
        at = fit.names.index(run.parameter)
        F[at, at] += (fit.parameter_scale[at] / run.standard_error) ** 2
        return np.asarray(F)
    values = dict(zip(fit.names, fit.theta.tolist(), strict=True))
    skin = _unknown_skin(fit, run)
    setting = replace(
        fit.options, free=(*fit.free_parameters, *skin), priors={}, start={n: values[n] for n in fit.free_parameters}
    )
    problem = LeastSquaresProblem(observed.ObservationSet((run,)), setting)
    begin = dict(zip(problem.names, problem.start.tolist(), strict=True))
    theta = np.array([values.get(n, begin[n]) for n in problem.names])
    _, J = problem.evaluate(theta)
    J = J[: J.shape[0] - len(problem.observations.shared_errors)]  # the priors of shared errors are the last rows
    new = [n for n in problem.names if n not in fit.names]
    names = (*fit.names, *new)
    shared = problem.observations.shared_errors
    scale = np.array(
        [
            *fit.parameter_scale,
            *(10 * shared[n].standard_error if n in shared else fit_parameters.typical_size(n, begin[n]) for n in new),
        ]
    )
    F = np.zeros((len(names), len(names)))
    F[:P, :P] = (fit.jacobian * fit.parameter_scale).T @ (fit.jacobian * fit.parameter_scale)
    for i in range(P, len(names)):
        F[i, i] = 100.0 if names[i] in shared else 0.0  # ten standard errors are one hundred percent
    place = [names.index(n) for n in problem.names]
    J = J * scale[place]
    F[np.ix_(place, place)] += J.T @ J
    return F


def _unknown_skin(fit: JointFit, run: observed.Observation) -> tuple[str, ...]:
    """Return stiffness and damping of the skin under a candidate, if earlier runs do not determine them."""
    elongation = getattr(run, "elongation_m", None)
    if elongation is None:
        return ()
    names = {"k_s": ("E_m",), "c_s": ("c_s_0", "c_s_delta")}
    return tuple(
        fit_parameters.elongation_parameter(symbol, elongation)
        for symbol, own in names.items()
        if not {*own, fit_parameters.elongation_parameter(symbol, elongation)} & set(fit.free_parameters)
    )


def _standard_errors(F: Array) -> Array:
    return np.sqrt(np.diag(np.linalg.inv(F + np.eye(F.shape[0]) / UNKNOWN_RELATIVE_ERROR**2)))


@dataclass(frozen=True)
class ExpectedPrecision:
    """Expected precision of a bench: standard errors of one value, and minutes.

    Attributes:
        relative_error, floor_m: error of a deflection, as a share of its value, and in metres.
        resonance_hz: error of one resonance frequency.
        decay_hz: error of the frequency of one free decay; the error of its damping ratio follows in proportion.
        minutes_per_load, minutes_per_mass, minutes_per_level, minutes_per_frequency: duration of one value of each kind.
        sweep_minutes, decay_minutes: duration of a whole run, with its preparation.
        mounting_minutes: duration of mounting a membrane at one elongation, or a cylinder with another mass.
        shared_errors: shared errors of the instruments; each kind of run uses the errors that act on it.
    """

    relative_error: float = 0.003
    floor_m: float = 2e-7
    resonance_hz: float = 0.3
    decay_hz: float = 0.3
    sweep_minutes: float = 1.0
    decay_minutes: float = 1.0
    minutes_per_load: float = 0.5
    minutes_per_mass: float = 7.0
    minutes_per_level: float = 0.25
    minutes_per_frequency: float = 0.05
    mounting_minutes: float = 5.0
    shared_errors: tuple[observed.SharedError, ...] = ()


def default_candidates(
    fit: JointFit, expected: ExpectedPrecision, elongations_m: Sequence[float] = (0.0, 1.27e-3, 6.35e-3)
) -> tuple[Candidate, ...]:
    """The paper's runs with their default settings, and short ones of the same kind, as candidates.

    Their errors follow from the fit's predictions and the `expected` precision.
    """
    plan = _planned_runs(expected, elongations_m)
    values = {n: v for n, v in fit.values.items() if v is not None}
    fixed = {
        n: v for n, v in values.items() if n not in fit.free_parameters and n not in fit.observations.shared_errors
    }
    own = {
        n: v
        for n, v in fixed.items()
        if n in fit_parameters.SPECIMEN_PARAMETERS or fit_parameters.parse_elongation(n) is not None
    }
    setting = replace(
        fit.options, free=fit.free_parameters, priors={}, fixed={**own, **fit.options.fixed}, tied=fit.options.tied
    )
    campaign = observed.ObservationSet(tuple(run for run, _ in plan))
    problem = LeastSquaresProblem(campaign, setting)
    theta = np.array([values.get(n, 0.0) for n in problem.names])
    predicted = with_predictions(campaign, problem.forward_model, theta)
    again = tuple(
        Candidate(
            BetterKnowledge(f"{name} measured {AGAIN_BETTER:g} times as well", name, error / AGAIN_BETTER),
            AGAIN_MINUTES,
        )
        for name, (_, error) in fit.options.priors.items()
        if name in fit.free_parameters
    )
    runs = tuple(
        Candidate(_with_errors(run, expected), minutes) for run, (_, minutes) in zip(predicted.runs, plan, strict=True)
    )
    return (*runs, *again)


def _planned_runs(
    expected: ExpectedPrecision, elongations_m: Sequence[float]
) -> list[tuple[observed.Observation, float]]:
    """Return the runs without their values, each with its minutes."""
    e = expected
    loads, masses = GRAVITY * np.array([0.02, 0.05, 0.1, 0.2, 0.5]), 1e-3 * np.arange(1.75, 10)
    lines = np.arange(26.0, 526, 2)
    levels, f = np.arange(0.5, 5.01, 0.5), np.array([25, 50, 75, 100, 125, *range(150, 201, 5), 225, 250], float)
    peak = np.array([100.0, 140, 150, 160, 180])

    def shared(*acts: str) -> tuple[observed.SharedError, ...]:
        return tuple(c for c in e.shared_errors if c.acts_on in acts)

    def dwell(label: str, f: Array, elongation: float | None = None) -> observed.FrequencyResponseObservation:
        on = shared("displacement", "volts", "delay")
        return observed.FrequencyResponseObservation(
            label, f, np.ones(f.size, complex), np.ones(f.size), elongation_m=elongation, shared_errors=on
        )

    # The lines of a sweep share its repeatability error.
    unrepeated = observed.SharedError("repeatability of the next sweep", "displacement", e.relative_error)
    swept = dwell(f"sweep, free, {lines.size} lines", lines)
    swept = replace(swept, swept=True, shared_errors=(*swept.shared_errors, unrepeated))

    def rows(x: Array) -> tuple[Array, Array]:
        return np.ones(x.size), np.ones(x.size)

    on, heavy = shared("displacement", "load"), shared("mass")
    plan: list[tuple[observed.Observation, float]] = [
        (observed.StaticLoadingObservation("static loading", loads, *rows(loads), shared_errors=on), e.minutes_per_load * 5),
        (observed.StaticLoadingObservation("static loading, 500 g five times", loads[[4] * 5], *rows(loads), shared_errors=on), e.minutes_per_load * 5),
        (observed.MassResonanceObservation("mass resonance, nine masses", masses, *rows(masses), shared_errors=heavy), e.minutes_per_mass * 9),
        (observed.MassResonanceObservation("mass resonance, lightest and heaviest", masses[[0, 8]], *rows(masses[:2]), shared_errors=heavy), e.minutes_per_mass * 2),
        (observed.VoltageStepsObservation("voltage steps", levels, *rows(levels), shared_errors=shared("displacement", "volts")), e.minutes_per_level * 10),
        (dwell("sine dwell, free, 18 frequencies", f), e.minutes_per_frequency * f.size),
        (dwell("sine dwell, free, 5 frequencies about the peak", peak), e.minutes_per_frequency * peak.size),
        (swept, e.sweep_minutes),
        (observed.DecayPoleObservation("free decay, ten edges", *rows(np.ones(10)), np.full(10, 0.2), np.ones(10)), e.decay_minutes),
    ]  # fmt: skip
    for x in elongations_m:
        run = dwell(f"sine dwell, membrane at {1e3 * x:.3g} mm", f, x)
        plan.append((run, e.minutes_per_frequency * f.size + e.mounting_minutes))
    plan.append((observed.MembraneSagObservation("membrane sag", *rows(np.ones(5))), e.mounting_minutes))
    return plan


def _with_errors(run: observed.Observation, expected: ExpectedPrecision) -> observed.Observation:
    match run:
        case observed.MassResonanceObservation():
            return replace(run, errors_hz=np.full(run.mass_kg.size, expected.resonance_hz))
        case observed.DecayPoleObservation():
            errors = np.full(run.frequency_hz.size, expected.decay_hz)
            return replace(run, errors_hz=errors, damping_errors=errors / run.frequency_hz)
        case observed.FrequencyResponseObservation(swept=True):
            return replace(run, errors_m=np.full(run.frequency_hz.size, expected.floor_m))
        case observed.FrequencyResponseObservation():
            return replace(
                run, errors_m=expected.relative_error * np.abs(np.asarray(run.fundamental_m)) + expected.floor_m
            )
    return replace(run, errors_m=expected.relative_error * np.abs(run.deflection_m) + expected.floor_m)
