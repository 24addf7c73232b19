"""Diagnosis of a misfit: possible causes ranked by the chi-square of the fit with each.

Every cause is one parameter more, or one point less. The linearized fit at the minimum screens all; the likeliest are fitted.
They are ranked by the probability of an equal improvement by chance, times the number of tried causes of the kind.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from model import Array, ParameterError
from model.identification.attribution.cause_text import with_text
from model.identification.attribution.causes import (
    RUN_ERRORS,
    Cause,
    free_as_well,
    possible_causes,
    with_errors_of_runs,
)
from model.identification.attribution.explanation import Diagnosis, Explanation, ParameterShift
from model.identification.attribution.significance import log_p_value, point_gains, point_rows, unit_effect
from model.identification.fit_options import IdentificationError
from model.identification.fit_result import MIN_P_VALUE, JointFit
from model.identification.joint_least_squares import joint_fit
from model.identification.observations import observed_values
from model.identification.residuals import LeastSquaresProblem

MAX_CHANCE = 0.1
"""Probability by chance, among all causes of a kind, above which a cause is left out."""
REFITTED_CAUSES = 5
"""Number of causes with the best linearized fit that are fitted."""
WORTH_FITTING = 0.25
"""Share of the largest improvement in the linearized fit above which a cause is fitted."""
MAX_EXPLANATIONS = 5
"""Largest number of explanations."""
MAX_SHIFTS = 4
"""Largest number of parameters whose change with a cause is stated."""
REFIT_TOLERANCE = 1e-5
"""Relative tolerance of chi-square: causes are compared by differences of some units."""


def diagnose(
    fit: JointFit, cause_effects: Mapping[Cause, Array] | None = None, cancelled: Callable[[], bool] | None = None
) -> Diagnosis:
    """Compare the possible causes of the misfit of a fit; causes whose improvement can be chance are left out.

    Args:
        fit: a fit that is not adequate.
        cause_effects: `effects` of the fit; computed if None.
        cancelled: called at every evaluation of the fits.

    Raises:
        FitCancelled: `cancelled` returned true.
    """
    r = np.where(fit.used_rows, fit.weighted_residuals, 0.0)
    Q = fit_subspace(fit)
    cause_effects = effects(fit) if cause_effects is None else cause_effects
    screened = [*_screened_effects(fit, r, Q, cause_effects), *_screened_points(fit, r, Q)]
    screened.sort(key=lambda s: s.log_probability + np.log(s.among))
    best = max((s.gain for s in screened), default=0.0)
    chosen = [s for s in screened if s.gain > WORTH_FITTING * best][:REFITTED_CAUSES]
    explanations = [e for s in chosen if (e := _explain(fit, s, cause_effects, cancelled)) is not None]
    explanations = [e for e in explanations if e.log_probability < np.log(MAX_CHANCE)]
    explanations.sort(key=lambda e: (e.log_probability, e.chi_square + e.penalty))
    return Diagnosis(tuple(with_text(fit, e) for e in explanations[:MAX_EXPLANATIONS]), len(screened))


def fit_subspace(fit: JointFit) -> Array:
    """Orthonormal basis (rows, k) of the fit's degrees of freedom."""
    J = fit.jacobian * fit.parameter_scale * fit.used_rows[:, None]
    U, s, _ = np.linalg.svd(J, full_matrices=False)
    return np.asarray(U[:, s > 1e-7 * s[0]])


class Screened(NamedTuple):
    """A cause in the linearized fit."""

    cause: Cause
    gain: float
    """Decrease of chi-square."""
    log_probability: float
    among: int
    """Number of causes of its kind."""


def effects(fit: JointFit) -> dict[Cause, Array]:
    """Return the addition of each possible cause, points excepted, to the weighted residuals, (rows,), per unit of its size."""
    causes = possible_causes(fit)
    names = tuple(c.name for c in causes if c.kind == "parameter")
    problem = LeastSquaresProblem(with_errors_of_runs(fit, causes), free_as_well(fit, names))
    _, J = problem.evaluate(problem.start)
    data = fit.run_slices[-1].stop
    J[data:] = 0.0
    rows = fit.weighted_residuals.size
    out = {c: J[:rows, problem.names.index(c.parameter)] for c in causes if c.kind != "prior"}
    first = data + len(fit.observations.shared_errors)  # rows of the shared errors, then of the priors
    for place, (name, (_, error)) in enumerate(fit.options.priors.items()):
        out[Cause("prior", name)] = np.eye(1, rows, first + place)[0] / error
    return out


def _screened_effects(fit: JointFit, r: Array, Q: Array, cause_effects: Mapping[Cause, Array]) -> Iterator[Screened]:
    visible = {}
    for cause, effect in cause_effects.items():
        unit = unit_effect(np.where(fit.used_rows, effect, 0.0), Q)
        if unit is not None:
            visible[cause] = float(unit @ r) ** 2
    for cause, gain in visible.items():
        count = sum((c.kind in RUN_ERRORS) == (cause.kind in RUN_ERRORS) for c in visible)
        yield Screened(cause, gain, float(log_p_value(np.array(gain), 1)), count)


def _screened_points(fit: JointFit, r: Array, Q: Array) -> Iterator[Screened]:
    points = point_rows(fit)
    gains = point_gains(r, Q, [rows for _, _, rows in points])
    for (label, point, rows), gain in zip(points, gains.tolist(), strict=True):
        yield Screened(Cause("point", label, point), gain, float(log_p_value(np.array(gain), rows.size)), len(points))


def _explain(
    fit: JointFit, screened: Screened, cause_effects: Mapping[Cause, Array], cancelled: Callable[[], bool] | None
) -> Explanation | None:
    """Fit with the cause; None if this is not possible."""
    cause, count = screened.cause, screened.among
    observations, options = cause.extend(fit)
    if cause in cause_effects and cause.kind != "prior":
        options = replace(options, start=_linear_start(fit, cause, cause_effects[cause], options.start))
    try:
        refit = joint_fit(observations, options, cancelled=cancelled, max_starts=1, tolerance=REFIT_TOLERANCE)
    except (ParameterError, IdentificationError):
        return None
    freedom, size, error = 1, float("nan"), float("nan")
    errors = np.sqrt(np.diag(refit.covariance))
    if cause.kind == "point":
        freedom = 2 if np.iscomplexobj(observed_values(cause.run(fit))[0]) else 1
    else:
        at = refit.names.index(cause.parameter)
        size, error = float(refit.theta[at]), float(errors[at])
    left, penalty = fit.degrees_of_freedom - freedom, 0.0
    if (plausible := cause.plausible(fit)) is not None:
        penalty = ((size - plausible[0]) / plausible[1]) ** 2
    chi_square = refit.cost - penalty
    # if the rest is still too large, the errors may be too small: the improvement must exceed enlarged errors
    enlarged = chi_square / left if left > 0 and chdtrc(left, chi_square) < MIN_P_VALUE else 1.0
    gain = (fit.cost - refit.cost) / max(1.0, enlarged)
    chance = min(0.0, float(log_p_value(np.array(gain), freedom)) + float(np.log(count)))
    return Explanation(cause, size, error, chi_square, penalty, left, chance, _shifts(fit, refit, errors), refit)


def _linear_start(fit: JointFit, cause: Cause, effect: Array, start: Mapping[str, float]) -> dict[str, float]:
    """Return the minimum of the linearized fit with the cause, a step of at most half of each positive parameter."""
    scale = np.append(fit.parameter_scale, 1.0)
    J = np.column_stack((fit.jacobian, effect)) * scale
    J[:, -1] *= 1 / max(float(np.linalg.norm(J[:, -1])), 1e-300)
    scale[-1] = 1 / max(float(np.linalg.norm(effect)), 1e-300)
    step = np.linalg.lstsq(J * fit.used_rows[:, None], fit.weighted_residuals * fit.used_rows, rcond=1e-10)[0] * scale
    out = dict(start)
    for name, change in zip((*fit.names, cause.parameter), step.tolist(), strict=True):
        value = out.get(name, 0.0)
        out[name] = value + (max(change, -0.5 * value) if value > 0 else change)
    return out


def _shifts(fit: JointFit, refit: JointFit, errors: Array) -> tuple[ParameterShift, ...]:
    out = []
    for name in fit.free_parameters:
        i = refit.names.index(name)
        out.append(
            ParameterShift(name, float(fit.theta[fit.names.index(name)]), float(refit.theta[i]), float(errors[i]))
        )
    moved = [s for s in out if abs(s.after - s.before) > 2 * s.standard_error > 0]
    return tuple(sorted(moved, key=lambda s: -abs(s.after - s.before) / s.standard_error)[:MAX_SHIFTS])
