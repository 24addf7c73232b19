"""Diagnosis of a misfit: possible causes ranked by the chi-square of the fit with each.

Every cause is one parameter more, or one point less. The linearized fit at the minimum screens all; the likeliest are fitted. They are
ranked by the probability of so large an improvement by chance, times the number of causes of the kind that were tried.
"""

from collections.abc import Iterator

import numpy as np
from scipy.special import chdtrc, log_ndtr

from model import Array, ParameterError
from model.identification.attribution.causes import Cause, free_as_well, possible_causes
from model.identification.attribution.explanation import Diagnosis, Explanation, ParameterShift
from model.identification.attribution.words import with_words
from model.identification.fit_options import IdentificationError
from model.identification.fit_result import MIN_P_VALUE, JointFit
from model.identification.joint_least_squares import joint_fit
from model.identification.observations import observed_values, over_errors
from model.identification.residuals import LeastSquaresProblem

REFITTED_CAUSES = 7
"""Causes with the best linearized fit that are fitted."""
MAX_EXPLANATIONS = 5
"""Explanations that are kept."""
MAX_SHIFTS = 4
"""Parameters of the fit whose change with a cause is stated."""
REFIT_TIME_S = 3.0
INSIDE_FIT = 1e-6
"""Share of an effect outside the space of the fit, squared, below which the runs cannot show it."""


def diagnose(fit: JointFit, level: float = 0.01, refitted: int = REFITTED_CAUSES) -> Diagnosis:
    """Compare the possible causes of the misfit of a fit; causes whose improvement can be chance are left out.

    Args:
        fit: a fit that is not adequate.
        level: probability by chance, among all causes of a kind, above which a cause is left out.
        refitted: how many of the causes are fitted, after a comparison of all in the linearized fit.
    """
    r = np.where(fit.used_rows, fit.weighted_residuals, 0.0)
    Q = fit_subspace(fit)
    screened = [*_screened_parameters(fit, r, Q), *_screened_points(fit, r, Q)]
    screened.sort(key=lambda s: s[1])
    found = [e for cause, _, count in screened[:refitted] if (e := _explain(fit, cause, count)) is not None]
    found = [e for e in found if e.log_probability < np.log(level)]
    found.sort(key=lambda e: (e.log_probability, e.chi_square))
    return Diagnosis(tuple(with_words(fit, e) for e in found[:MAX_EXPLANATIONS]), len(screened))


def fit_subspace(fit: JointFit) -> Array:
    """Orthonormal basis (rows, k) of the fit's degrees of freedom."""
    J = fit.jacobian * fit.parameter_scale * fit.used_rows[:, None]
    U, s, _ = np.linalg.svd(J, full_matrices=False)
    return np.asarray(U[:, s > 1e-7 * s[0]])


Screened = tuple[Cause, float, int]
"""A cause, the logarithm of its probability in the linearized fit, and how many there are of its kind."""


def effects(fit: JointFit) -> dict[Cause, Array]:
    """Return what each possible cause but a point adds to the weighted residuals, (rows,), per unit of its size."""
    causes = possible_causes(fit)
    names = tuple(c.name for c in causes if c.kind == "parameter")
    problem = LeastSquaresProblem(fit.observations, free_as_well(fit, names))
    _, J = problem.evaluate(problem.start)
    out = {c: J[:, problem.names.index(c.name)] for c in causes if c.kind == "parameter"}
    predictions = problem.forward_model.predict(problem.start)
    for run, part, predicted in zip(fit.observations.runs, fit.run_slices, predictions, strict=True):
        d = np.zeros(fit.weighted_residuals.size)
        d[part] = over_errors(run, predicted.values)
        out |= {c: d for c in causes if c.kind == "scale" and c.name == run.label}
    return out


def _screened_parameters(fit: JointFit, r: Array, Q: Array) -> Iterator[Screened]:
    visible = {}
    for cause, effect in effects(fit).items():
        d = np.where(fit.used_rows, effect, 0.0)
        rest = d - Q @ (Q.T @ d)
        weight = float(rest @ rest)
        if weight > INSIDE_FIT * float(d @ d) and weight > 0:
            visible[cause] = float(rest @ r) ** 2 / weight
    for cause, gain in visible.items():
        count = sum(c.kind == cause.kind for c in visible)
        yield cause, _log_probability(gain, 1, count), count


def _screened_points(fit: JointFit, r: Array, Q: Array) -> Iterator[Screened]:
    points: list[tuple[Cause, float, int]] = []
    for run, part in zip(fit.observations.runs, fit.run_slices, strict=True):
        usable = np.flatnonzero(run.usable)
        rows = np.arange(part.start, part.stop).reshape(-1, usable.size)  # one row of them, or two for complex values
        if usable.size < 2 or not fit.used_rows[part].all():
            continue
        for place, point in enumerate(usable.tolist()):
            i = rows[:, place]
            left = np.eye(i.size) - Q[i] @ Q[i].T
            if np.linalg.eigvalsh(left)[0] > INSIDE_FIT:
                points.append((Cause("point", run.label, point), float(r[i] @ np.linalg.solve(left, r[i])), i.size))
    for cause, gain, freedom in points:
        yield cause, _log_probability(gain, freedom, len(points)), len(points)


def _log_probability(gain: float, freedom: int, count: int) -> float:
    """Return the logarithm of the probability of a chi-square above `gain` in any of `count` tests; freedom is 1 or 2."""
    one = -gain / 2 if freedom == 2 else float(log_ndtr(-np.sqrt(max(gain, 0.0)))) + float(np.log(2))
    return min(0.0, one + float(np.log(count)))


def _explain(fit: JointFit, cause: Cause, count: int) -> Explanation | None:
    """Fit with the cause; None where that is not possible."""
    observations, options = cause.extend(fit)
    try:
        found = joint_fit(observations, options, time_limit_s=REFIT_TIME_S, max_starts=1)
    except (ParameterError, IdentificationError):
        return None
    freedom, size, error = 1, float("nan"), float("nan")
    errors = np.sqrt(np.diag(found.covariance))
    if cause.kind == "point":
        freedom = 2 if np.iscomplexobj(observed_values(cause.run(fit))[0]) else 1
    else:
        at = found.names.index(cause.title)
        size, error = float(found.theta[at]), float(errors[at])
    left = fit.degrees_of_freedom - freedom
    # where the rest is still too large, the errors may be too small: the improvement must exceed larger ones
    enlarged = found.cost / left if left > 0 and chdtrc(left, found.cost) < MIN_P_VALUE else 1.0
    chance = _log_probability((fit.cost - found.cost) / max(1.0, enlarged), freedom, count)
    return Explanation(cause, size, error, found.cost, left, chance, _shifts(fit, found, errors), found)


def _shifts(fit: JointFit, found: JointFit, errors: Array) -> tuple[ParameterShift, ...]:
    out = []
    for name in fit.free_parameters:
        i = found.names.index(name)
        out.append(
            ParameterShift(name, float(fit.theta[fit.names.index(name)]), float(found.theta[i]), float(errors[i]))
        )
    moved = [s for s in out if abs(s.after - s.before) > 2 * s.standard_error > 0]
    return tuple(sorted(moved, key=lambda s: -abs(s.after - s.before) / s.standard_error)[:MAX_SHIFTS])
