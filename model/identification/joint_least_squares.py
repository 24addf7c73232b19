"""Joint fit: weighted least squares over all runs of a specimen, with errors shared by instruments.

Solved by a descent along narrow valleys (`valley_descent`, docs/decisions/0027-joint-fit.md). Shared errors are parameters with a prior.
Unidentified combinations are found from the singular values of the scaled Jacobian and reported instead of numbers. The
solver works on logarithms of positive parameters and on the others in units of their scale.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from time import perf_counter

import numpy as np

from model import Array, ParameterError
from model.identification import parameters as fit_parameters
from model.identification.fit_options import FitCancelled, FitOptions, IdentificationError
from model.identification.fit_result import JointFit
from model.identification.misfit_scale import loss_costs, loss_weights
from model.identification.observations import ObservationSet
from model.identification.paper_chain import PaperChainError, PaperChainOptions, identify_by_paper_chain
from model.identification.priors import normal_equivalents
from model.identification.residuals import LeastSquaresProblem
from model.identification.valley_descent import Box, Linearization, descend

LOG_RANGE = 12.0
"""Range of a logarithm to both sides: five powers of ten."""

BOUND_MARGIN = 1e-9
"""Distance by which a start on a limit is moved inside."""

DESCENT_EVALUATIONS = 200
"""Largest number of evaluations of one descent."""

MAX_EVALUATIONS = 400
"""Largest number of evaluations of all descents of a fit. Usual fits need 4 to 50; with 34 parameters and 500 residuals an
evaluation takes 20 ms."""

RESIDUALS_PER_EVALUATION = 15
"""Largest number of evaluations of residuals alone, which take a fifth of the time, for each one with slopes; usual fits need 2 to 9."""

FAR_START, NEAR_MISFIT = 30.0, 10.0
"""Misfit of a start, as the root mean square over the errors, above which a first descent takes larger errors, and its misfit with them.
Precise runs make narrow valleys: from far away a campaign takes 32 instead of 129 evaluations then."""
FIRST_EVALUATIONS, FIRST_TOLERANCE = 30, 0.1
"""Largest number of evaluations of that descent, and the share of its cost that may be left to gain."""

SAME_MINIMUM = 1e-3
"""Relative difference of cost up to which two fits ended in one minimum."""

LARGE_MISFIT = 4.0
"""Cost over the degrees of freedom from which on a minimum may be a wrong one."""

SPREAD_PARAMETERS = ("k2", "mu", "m_add", "c0", "E_m", "c_s_0", "c_s_delta")
SPREAD = 2.0
"""Parameters of further starts, and the factor by which they differ from the default values at most."""

MAX_SPREAD_STARTS = 6

MAX_LIMIT_FITS = 4
"""Fits for the normal distributions in the place of priors next to a limit, which depend on the fit."""

LIMIT_TOLERANCE = 1e-3
"""Change of such a distribution, in standard deviations of the prior, that needs no further fit."""


class FitCoordinates:
    """x, (P,), in place of the parameters theta, (P,), for a descent that begins at `start`.

    Attributes:
        start, lower_bounds, upper_bounds: start and limits of the descent, (P,) each.
        steps: usual steps, (P,): the standard uncertainty of a prior; 1, the parameter itself, without prior.
    """

    def __init__(self, problem: LeastSquaresProblem, start: Array) -> None:
        self._logarithmic = problem.logarithmic & (start > 0)
        scale = np.array([fit_parameters.typical_size(n, x) for n, x in zip(problem.names, start, strict=True)])
        self._scale = np.where(self._logarithmic, 1.0, scale)
        for i, name in enumerate(problem.names):
            if name in problem.observations.shared_errors:
                self._scale[i] = problem.observations.shared_errors[name].standard_error
        middle = np.log(np.where(self._logarithmic, start, 1.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            low, high = (np.log(np.maximum(b, 0.0)) for b in (problem.lower_bounds, problem.upper_bounds))
        self.lower_bounds = np.where(
            self._logarithmic, np.maximum(middle - LOG_RANGE, low), problem.lower_bounds / self._scale
        )
        self.upper_bounds = np.where(
            self._logarithmic, np.minimum(middle + LOG_RANGE, high), problem.upper_bounds / self._scale
        )
        self.start = np.clip(
            self.to_coordinates(start),
            np.where(np.isfinite(self.lower_bounds), self.lower_bounds + BOUND_MARGIN, self.lower_bounds),
            np.where(np.isfinite(self.upper_bounds), self.upper_bounds - BOUND_MARGIN, self.upper_bounds),
        )

        self.steps = np.ones(start.size)
        slopes = self.parameter_derivatives(start)
        for at, _, uncertainty in problem.priors:
            self.steps[at] = uncertainty / slopes[at]

    def to_coordinates(self, theta: Array) -> Array:
        """Return x of theta."""
        return np.where(self._logarithmic, np.log(np.where(self._logarithmic, theta, 1.0)), theta / self._scale)

    def to_parameters(self, x: Array) -> Array:
        """Return theta of x."""
        return np.where(self._logarithmic, np.exp(np.where(self._logarithmic, x, 0.0)), x * self._scale)

    def parameter_derivatives(self, theta: Array) -> Array:
        """Return d theta / d x, (P,)."""
        return np.where(self._logarithmic, theta, self._scale)


FitProgress = Callable[[int, float], None]
"""Callback with the number of evaluations and the present chi-square."""
CancelCheck = Callable[[], bool]
"""Callback at every evaluation, e.g. `threading.Event().is_set`."""


class _EvaluationLimitReached(Exception):
    pass


def joint_fit(
    observations: ObservationSet,
    options: FitOptions | None = None,
    progress: FitProgress | None = None,
    cancelled: CancelCheck | None = None,
    max_evaluations: int = MAX_EVALUATIONS,
    max_starts: int = 6,
    tolerance: float = 0.0,
) -> JointFit:
    """Fit the free parameters to all runs together.

    A fit with a large unexplained misfit is repeated from other starts, `max_starts` in all, until two agree. After
    `max_evaluations` the best fit is returned, with a note in `message`; the result does not depend on the computer's load.
    `tolerance` is the share of the cost that may be left to gain; 0: a millionth of a standard error.

    Raises:
        ParameterError, IdentificationError: these runs cannot be fitted.
        FitCancelled: `cancelled` returned true.
    """
    problem = LeastSquaresProblem(observations, options or FitOptions())
    began = perf_counter()
    watch = _FitMonitor(problem, progress, cancelled, max_evaluations, tolerance)
    best, agreed = _best_of_starts(problem, watch, max_starts)
    if best is None:
        raise IdentificationError(
            "the model cannot be evaluated where the fit begins: "
            + ", ".join(f"{n} = {v:.3g}" for n, v in zip(problem.names, problem.start, strict=True))
            + "; choose other initial values"
        )
    if not agreed and best.converged and max_starts > 1:
        best = replace(
            best, converged=False, message=f"no two starts of {max_starts} lead to the least chi-square that was found"
        )
    best = _with_limits(best, watch)
    return replace(best, evaluations=watch.evaluations, duration_s=perf_counter() - began)


def _with_limits(fit: JointFit, watch: "_FitMonitor") -> JointFit:
    """Return the fit with normal distributions in place of its priors next to a limit; the same fit without any."""
    present = fit.problem.normal_priors
    for _ in range(MAX_LIMIT_FITS if present else 0):
        sites = normal_equivalents(
            fit.names, fit.options.priors, present, (fit.theta, fit.jacobian, fit.weighted_residuals)
        )
        moved = [abs(sites[n][k] - present[n][k]) / fit.options.priors[n][1] for n in present for k in (0, 1)]
        if max(moved) < LIMIT_TOLERANCE:
            break
        present = sites
        watch.problem = LeastSquaresProblem(fit.observations, replace(fit.options, normal_priors=sites))
        if (again := watch.fit(fit.theta)) is None:
            break
        fit = again
    return fit


def _best_of_starts(
    problem: LeastSquaresProblem, watch: "_FitMonitor", max_starts: int
) -> tuple[JointFit | None, bool]:
    """Return the best fit of several starts, and whether a second one agrees; a small misfit needs one start only."""
    best: JointFit | None = None
    for start in islice(_starting_points(problem), max_starts):
        if best is not None and watch.evaluations >= watch.max_evaluations:
            break
        fit = watch.fit(start)
        if fit is None:
            continue
        same = best is not None and abs(fit.cost - best.cost) < SAME_MINIMUM * best.cost
        best = fit if best is None or fit.cost < best.cost else best
        if same or (best.converged and best.cost < LARGE_MISFIT * max(best.degrees_of_freedom, 1)):
            return best, True
    return best, False


def _starting_points(problem: LeastSquaresProblem) -> Iterator[Array]:
    """Yield the start of the options, the end of the paper's chain, the default values, and points spread about them."""
    yield problem.start
    base = problem.options.base_values()
    table = np.array([fit_parameters.start_value(n, base) for n in problem.names])
    options = problem.options
    chosen = PaperChainOptions(
        options.tactor, options.membrane, options.contact_length, amplifier=options.amplifier, n=options.n
    )
    with suppress(PaperChainError, ParameterError, np.linalg.LinAlgError):
        values = identify_by_paper_chain(problem.observations, chosen, validated=False).values
        yield np.array([values.get(n, x) for n, x in zip(problem.names, table, strict=True)])
    if not np.array_equal(table, problem.start):
        yield table
    spread = [n in SPREAD_PARAMETERS for n in problem.names]
    for k in range(1, MAX_SPREAD_STARTS + 1):
        places = np.mod(0.5 + k * (1.0 + np.arange(len(problem.names))) * 0.618034, 1.0)
        yield np.where(spread, table * SPREAD ** (2 * places - 1), table)


class _FitMonitor:
    """Runs descents with a limited number of evaluations and cancellation, and keeps the best point."""

    def __init__(
        self,
        problem: LeastSquaresProblem,
        progress: FitProgress | None,
        cancelled: CancelCheck | None,
        max_evaluations: int,
        tolerance: float = 0.0,
    ) -> None:
        self.problem, self._progress, self._cancelled = problem, progress, cancelled
        self.evaluations, self.max_evaluations, self._tolerance = 0, max_evaluations, tolerance
        self._residuals_left = 1 + RESIDUALS_PER_EVALUATION * max_evaluations

    def fit(self, start: Array) -> JointFit | None:
        """Return one descent; None if the model cannot be evaluated at the start."""
        p = self.problem
        place = FitCoordinates(p, start)
        box = Box(place.lower_bounds + BOUND_MARGIN, place.upper_bounds - BOUND_MARGIN, place.steps)
        descent = _ResidualFunction(p.condensed, place, self, 1.0)
        end, settled = place.start, False
        try:
            with np.errstate(all="ignore"):
                cost, rows = descent.cost_and_residuals(end)
                misfit = np.sqrt(cost / max(rows.size, 1))
                stages = [(1.0, DESCENT_EVALUATIONS, self._tolerance)]
                if FAR_START < misfit < np.inf:
                    stages.insert(0, (NEAR_MISFIT / misfit, FIRST_EVALUATIONS, FIRST_TOLERANCE))
                for descent.weight, evaluations, share in stages:
                    descent.least_cost = np.inf
                    end, settled = descend(
                        end, box, descent.linearize, descent.cost_and_residuals, (evaluations, share)
                    )
        except _EvaluationLimitReached:
            if descent.best is None:
                return None
            theta = descent.best
            r, J = p.evaluate(theta)
            converged, message = False, f"stopped after {self.evaluations} evaluations; the best so far"
        else:
            theta, converged = place.to_parameters(end), settled
            r, J = p.evaluate(theta)
            message = "converged" if converged else f"stopped after {DESCENT_EVALUATIONS} evaluations without settling"
        if p.options.loss != "linear":
            weights = np.ones(r.size)
            weights[: r.size - p.prior_count] = loss_weights(r[: r.size - p.prior_count], p.options.loss)
            J = J * np.sqrt(weights)[:, None]
        return JointFit(p.observations, p.options, p.names, theta, r, J, converged, message, self.evaluations, 0.0)

    def count_residuals(self) -> None:
        """Count an evaluation of residuals alone; raises as `count_evaluation`."""
        self._raise_if_cancelled()
        if self._residuals_left <= 0:
            raise _EvaluationLimitReached
        self._residuals_left -= 1

    def _raise_if_cancelled(self) -> None:
        if self._cancelled is not None and self._cancelled():
            raise FitCancelled("the fit was stopped on request")

    def count_evaluation(self) -> None:
        """Count an evaluation before it begins.

        Raises:
            FitCancelled: on request.
            _EvaluationLimitReached: the allowed number is exhausted.
        """
        self._raise_if_cancelled()
        # The first evaluation is never refused, so that there is a result.
        if self.evaluations >= max(self.max_evaluations, 1):
            raise _EvaluationLimitReached
        self.evaluations += 1

    def report(self, cost: float) -> None:
        """The smallest sum of squares so far."""
        if self._progress is not None:
            self._progress(self.evaluations, cost)


class _ResidualFunction:
    """Cost, residuals and slopes for the descent, in its coordinates; the best point is kept.

    Args:
        problem: the problem.
        coordinates: the coordinates of the descent.
        monitor: counts the evaluations.
        weight: factor on the residuals of the runs; prior values keep their errors.
    """

    def __init__(
        self, problem: LeastSquaresProblem, coordinates: FitCoordinates, monitor: _FitMonitor, weight: float
    ) -> None:
        self._problem, self._coordinates, self._monitor, self.weight = problem, coordinates, monitor, weight
        self.least_cost = np.inf
        self.best: Array | None = None
        """theta at the least cost with this weight, or with the weight before it."""

    def linearize(self, x: Array) -> Linearization:
        """Return cost, residuals and slopes at x, (P,), each row by the root of the weight that its loss gives it.

        Raises:
            FitCancelled: on request.
            _EvaluationLimitReached: the allowed number is exhausted, or the model cannot be evaluated at x.
        """
        self._monitor.count_evaluation()
        theta = self._coordinates.to_parameters(x)
        try:
            r, J = self._problem.evaluate(theta)
        except (np.linalg.LinAlgError, ParameterError, FloatingPointError):
            r, J = np.full(1, np.nan), np.zeros((1, x.size))
        if not (np.isfinite(r).all() and np.isfinite(J).all()):
            raise _EvaluationLimitReached
        cost, r, weights = self._weighted(r)
        if cost < self.least_cost:
            self.least_cost, self.best = cost, theta
        self._monitor.report(self.least_cost)
        roots = np.sqrt(weights)
        slopes = -J * self._coordinates.parameter_derivatives(theta)
        slopes[: r.size - self._problem.prior_count] *= self.weight
        return Linearization(cost, r * roots, slopes * roots[:, None])

    def cost_and_residuals(self, x: Array) -> tuple[float, Array]:
        """Return cost and residuals at x; an infinite cost where the model cannot be evaluated. Raises as `linearize`."""
        self._monitor.count_residuals()
        try:
            r = self._problem.residuals(self._coordinates.to_parameters(x))
        except (np.linalg.LinAlgError, ParameterError, FloatingPointError):
            return np.inf, np.empty(0)
        cost, r, weights = self._weighted(r)
        return (cost if np.isfinite(cost) else np.inf), r * np.sqrt(weights)

    def _weighted(self, r: Array) -> tuple[float, Array, Array]:
        """Return cost, residuals with the errors of the descent, and the weight of each by its loss."""
        data = r.size - self._problem.prior_count
        r = np.concatenate((r[:data] * self.weight, r[data:]))
        if (loss := self._problem.options.loss) == "linear":
            return float(r @ r), r, np.ones(r.size)
        weights = np.ones(r.size)
        weights[:data] = loss_weights(r[:data], loss)
        return float(loss_costs(r[:data], loss).sum() + r[data:] @ r[data:]), r, weights
