"""Diagnosis of a misfit: the likeliest causes by the linearized fit, each fitted, ranked by their evidence."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from model import Array, ParameterError
from model.identification.attribution.cause_text import with_text
from model.identification.attribution.causes import Cause
from model.identification.attribution.evidence import CauseEvidence, Evidence
from model.identification.attribution.explanation import Diagnosis, Explanation, ParameterShift
from model.identification.fit_options import IdentificationError
from model.identification.fit_result import MIN_P_VALUE, JointFit
from model.identification.joint_least_squares import joint_fit

REFITTED_CAUSES = 6
"""Causes with the best linearized fit that are fitted."""
REFITTED_OF_A_KIND = 2
"""Largest number of candidates of one kind: neighbouring resonances, or points, are much alike."""
WORTH_FITTING = 0.2
"""Share of the largest improvement in the linearized fit from which on a cause is fitted."""
CLEARLY_LESS = 8.0
"""Logarithm of odds by which a cause is less likely in the linearized fit than one that explains all, so that it is not fitted."""
REFIT_EVALUATIONS = 60
"""Largest number of evaluations of such a fit; it begins where the linearized fit has its minimum."""
FAR_FROM_RUNS = 30.0
"""Largest reduced chi-square of a fit that is linearized: a wrong run bends what the others determine beyond all reason; a robust fit follows the others."""
MIN_LOG_ODDS = 1.0
"""Logarithm of the odds against chance from which on a cause is named."""
MAX_EXPLANATIONS = 5
"""Largest number of explanations."""
LARGE_SCALE = 4.0
"""Standard deviations of its prior beyond which an error of a scale is a wrong unit or sign, of any size: the prior counts no more than at this distance."""
MAX_SHIFTS = 4
"""Largest number of parameters whose change with a cause is stated."""
REFIT_TOLERANCE = 1e-5
"""Relative tolerance of chi-square: causes are compared by differences of some units."""


def diagnose(evidence: Evidence, cancelled: Callable[[], bool] | None = None) -> Diagnosis:
    """Compare the possible causes of the misfit of a fit that is not adequate.

    A single point, or an exchange, is a cause only if the rest is adequate then. Where the rest is too large with every cause, the
    improvements are divided by the least reduced chi-square: what is left may be as large for any of them.

    Raises:
        FitCancelled: `cancelled` returned true.
    """
    fit = evidence.fit
    found: list[tuple[CauseEvidence, Explanation]] = []
    for place in _linearizations(evidence, cancelled):
        if any(e.p_value > MIN_P_VALUE for _, e in found):
            break
        for linear in _candidates(place.linear):
            enough = any(
                e.p_value > MIN_P_VALUE and linear.log_odds < known.log_odds - CLEARLY_LESS for known, e in found
            )
            explained = None if enough else _explain(fit, place, linear, cancelled)
            if explained is not None:
                found.append((linear, explained))
    rest = [e.chi_square / max(e.degrees_of_freedom, 1) for _, e in found if e.p_value < MIN_P_VALUE]
    enlarged = max(1.0, min(rest)) if len(rest) == len(found) and rest else 1.0
    ranked = [_ranked(fit, linear, e, enlarged) for linear, e in found]
    ranked = sorted((e for e in ranked if e.log_odds > MIN_LOG_ODDS), key=lambda e: e.log_odds)
    # Of several forms of one cause the last stays, the likeliest.
    likeliest = {(e.cause.kind, e.cause.title): e for e in ranked}
    ranked = sorted(likeliest.values(), key=lambda e: -e.log_odds)
    return Diagnosis(tuple(with_text(fit, e) for e in ranked[:MAX_EXPLANATIONS]), len(evidence.linear))


def _linearizations(evidence: Evidence, cancelled: Callable[[], bool] | None) -> Iterator[Evidence]:
    """Yield the evidence, before it that at a robust fit if the fit is far from its runs."""
    fit = evidence.fit
    if fit.chi_square > FAR_FROM_RUNS * fit.degrees_of_freedom:
        robust = replace(fit.options, loss="cauchy")
        near = joint_fit(fit.observations, robust, cancelled=cancelled, max_starts=1, tolerance=REFIT_TOLERANCE)
        residuals, slopes = near.problem.evaluate(near.theta)
        yield Evidence(replace(near, options=fit.options, weighted_residuals=residuals, jacobian=slopes))
    yield evidence


def _candidates(linear: Sequence[CauseEvidence]) -> list[CauseEvidence]:
    best = max((e.gain for e in linear), default=0.0)
    chosen: list[CauseEvidence] = []
    for e in linear:
        alike = sum(c.cause.kind == e.cause.kind for c in chosen) if e.cause.kind not in ("parameter", "beyond") else 0
        if e.gain > WORTH_FITTING * best and alike < REFITTED_OF_A_KIND and len(chosen) < REFITTED_CAUSES:
            chosen.append(e)
    return chosen


def _ranked(fit: JointFit, linear: CauseEvidence, found: Explanation, enlarged: float) -> Explanation:
    gain = (fit.cost - found.fit.cost + found.excess_penalty) / enlarged
    odds = gain / 2 - linear.price + linear.cause.log_prior
    if found.cause.points and found.p_value < MIN_P_VALUE:
        odds = min(odds, MIN_LOG_ODDS + 1e-3 * odds)  # after every cause of all points
    return replace(found, log_odds=odds)


def _explain(
    fit: JointFit, evidence: Evidence, linear: CauseEvidence, cancelled: Callable[[], bool] | None
) -> Explanation | None:
    """Fit with the cause; None where that is not possible."""
    cause = linear.cause
    observations, options = cause.extend(evidence.fit)
    options = replace(options, start=_linear_start(evidence, cause, options.start))
    try:
        found = joint_fit(
            observations,
            options,
            None,
            cancelled,
            max_evaluations=REFIT_EVALUATIONS,
            max_starts=1,
            tolerance=REFIT_TOLERANCE,
        )
    except (ParameterError, IdentificationError):
        return None
    errors = np.sqrt(np.diag(found.covariance))
    at = [found.names.index(name) for name in cause.sizes]
    sizes = tuple((float(found.theta[i]), float(errors[i])) for i in at)
    freedom = max(found.degrees_of_freedom - len(sizes), 0)
    scale = cause.errors[0].error.standard_error if cause.kind in ("scale", "scale from") else np.inf
    excess = max((sizes[0][0] / scale) ** 2 - LARGE_SCALE**2, 0.0) if sizes else 0.0
    shifts = _shifts(fit, found, errors)
    return Explanation(cause, sizes, found.chi_square - excess, freedom, linear.log_odds, shifts, found, excess)


def _linear_start(evidence: Evidence, cause: Cause, start: Mapping[str, float]) -> dict[str, float]:
    """Return where the linearized fit with the cause has its minimum, a step of at most half of each positive parameter."""
    fit, none = evidence.fit, np.zeros((evidence.residuals.size, 0))
    effects = evidence.effect(cause) if cause.sizes else none
    columns = np.column_stack((fit.jacobian * fit.parameter_scale, effects))
    data = np.vstack((columns * fit.used_rows[:, None], np.eye(effects.shape[1], columns.shape[1], fit.theta.size)))
    r = np.append(fit.weighted_residuals * fit.used_rows, np.zeros(effects.shape[1]))
    step = np.linalg.lstsq(data, r, rcond=1e-10)[0]
    out = dict(start)
    for name, change in zip(fit.names, (step[: fit.theta.size] * fit.parameter_scale).tolist(), strict=True):
        value = out.get(name, 0.0)
        out[name] = value + (max(change, -0.5 * value) if value > 0 else change)
    plausible = [deviation for _, deviation in cause.parameters.values()] + [
        e.error.standard_error for e in cause.errors
    ]
    for name, size, change in zip(cause.sizes, plausible, step[fit.theta.size :].tolist(), strict=True):
        if name not in fit.names:
            value = out.get(name, 0.0)
            out[name] = value + (max(change * size, -0.5 * value) if value > 0 else change * size)
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
