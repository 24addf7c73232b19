"""Least-squares problem: residuals and Jacobian of one set of observations with given fit options."""

from dataclasses import replace
from functools import cached_property

import numpy as np

from model import Array
from model.identification import parameters as fit_parameters
from model.identification.fit_options import FitOptions, IdentificationError
from model.identification.forward_model import ForwardModel
from model.identification.observations import ObservationSet, condensed
from model.identification.priors import near_limit, prior_moments

PRIOR_REACH = 12.0
"""Largest shift of a prior value in standard uncertainties: a ruler errs by no more, even if a wrong model needs it."""


class LeastSquaresProblem:
    """Residuals and Jacobian of one campaign under one setting.

    Raises:
        ParameterError: the setting does not fit the campaign.
        IdentificationError: nothing is free.
    """

    def __init__(self, observations: ObservationSet, options: FitOptions, constant: float | None = None) -> None:
        """`constant` is a residual that no parameter changes, after the residuals of the runs."""
        self.observations, self.options = observations, options
        self._evaluated: tuple[Array, tuple[Array, Array]] = (np.zeros(0), (np.zeros(0), np.zeros((0, 0))))
        """The last point, and its residuals and slopes."""
        self._constant = np.zeros(0) if constant is None else np.array([constant])
        own = options.free_parameters(observations)
        if not own:
            raise IdentificationError("no parameter is free: name at least one that these runs determine")
        self.names = (*own, *observations.shared_errors)
        self.forward_model = ForwardModel(
            observations, self.names, options.base_values(), options.tied, options.amplifier, options.n
        )
        base = options.base_values()
        self.start = np.array([options.start.get(n, fit_parameters.start_value(n, base)) for n in self.names])
        shared = {n: (0.0, e.standard_error) for n, e in observations.shared_errors.items()}
        own_priors = {n: options.normal_priors.get(n) or prior_moments(n, prior) for n, prior in options.priors.items()}
        self.normal_priors = {n: own_priors[n] for n, prior in options.priors.items() if near_limit(n, prior)}
        """Normal distributions in the place of priors next to a limit."""
        self.priors = [(self.names.index(n), v, s) for n, (v, s) in (shared | own_priors).items()]
        """Index, value and standard uncertainty of each parameter with a prior value, shared errors first."""
        self.priors_by_name = shared | own_priors
        """Value and standard uncertainty of each prior, by the name of the parameter."""
        self.prior_count = len(self.priors)
        """Number of rows at the end that are no residuals of runs."""
        limits = [fit_parameters.parameter_spec(n, observations).interval for n in self.names]
        self.logarithmic = np.array([i.gt == 0 for i in limits]) & (self.start > 0)
        self.lower_bounds = np.array([next((float(x) for x in (i.ge, i.gt) if x is not None), -np.inf) for i in limits])  # type: ignore[arg-type]
        self.upper_bounds = np.array([next((float(x) for x in (i.le, i.lt) if x is not None), np.inf) for i in limits])  # type: ignore[arg-type]
        for name, (value, sigma) in options.priors.items():
            at = self.names.index(name)
            low, high = value - PRIOR_REACH * sigma, value + PRIOR_REACH * sigma
            self.lower_bounds[at] = max(self.lower_bounds[at], low)
            self.upper_bounds[at] = min(self.upper_bounds[at], high)

    def residuals(self, theta: Array) -> Array:
        """Residuals (rows,) alone."""
        model = self.forward_model
        gap = model.rows.observed - model.predict_all(theta, slopes=False).values
        return np.concatenate((model.rows.of(gap), self._constant, self._prior_residuals(theta)))

    @cached_property
    def condensed(self) -> "LeastSquaresProblem":
        """A problem with the same minimum, steps and cost and as few rows as the conditions have points; or this problem."""
        if self.options.loss != "linear" or "stiffening" in self.forward_model.effects:
            return self
        few, constant = condensed(self.observations, self.forward_model.effects)
        if (
            sum(run.usable.sum() for run in few.runs) == self.forward_model.rows.observed.size
            or few.reference_c != self.observations.reference_c
        ):
            return self
        if tuple(few.shared_errors) != tuple(self.observations.shared_errors):
            return self
        own = tuple(n for n in self.names if n not in self.observations.shared_errors)
        return LeastSquaresProblem(few, replace(self.options, free=own, also=()), constant)

    def evaluate(self, theta: Array) -> tuple[Array, Array]:
        """Residuals (rows,) and slopes of the predictions over their errors (rows, P)."""
        if np.array_equal(theta, self._evaluated[0]):
            return self._evaluated[1]
        rows = self.forward_model.rows
        values, slopes = self.forward_model.predict_all(theta)
        J = np.zeros((rows.row_count + self._constant.size + self.prior_count, theta.size))
        J[: rows.row_count] = rows.of(slopes).T
        for row, (i, _, sigma) in enumerate(self.priors, len(J) - self.prior_count):
            J[row, i] = 1 / sigma
        r = np.concatenate((rows.of(rows.observed - values), self._constant, self._prior_residuals(theta)))
        self._evaluated = theta.copy(), (r, J)
        return r, J

    def _prior_residuals(self, theta: Array) -> Array:
        return np.array([(value - theta[i]) / sigma for i, value, sigma in self.priors])
