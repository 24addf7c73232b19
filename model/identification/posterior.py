"""Posterior of a joint fit by Monte Carlo, which its linear uncertainties are checked with.

The likelihood and the priors are those of the fit, truncated ones as they are. Readings and prior values are drawn within their errors
and fitted again (GUM supplement 1), and each draw has the weight that makes a sample of the posterior of them: randomize-then-optimize
(Bardsley et al. 2014, doi:10.1137/140964023). A narrow, bent valley, in which Markov chains stay for thousands of steps, is no obstacle.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from model import Array, ParameterError
from model.identification import parameters as fit_parameters
from model.identification.fit_options import FitCancelled
from model.identification.fit_result import JointFit
from model.identification.priors import near_limit, prior_moments
from model.identification.residuals import LeastSquaresProblem

DRAWS = 1500
"""Draws; a standard deviation is then known to 2 or 3 %."""
MAX_STEPS = 8
SOLVED = 0.02
"""Distance from the drawn readings, in standard errors, at which a fit of them has settled."""
WIDER = 1.25
"""Normal distributions that stand for truncated ones in the draws are so much wider, so that no draw has a large weight."""
LARGEST_WEIGHT = 0.05
"""Share of the sum that a weight is cut to: a few draws would decide all."""


@dataclass(frozen=True)
class Posterior:
    """Weighted draws from the posterior of a fit, beside its linear result.

    Attributes:
        names: parameters of the fit, shared errors last, (P,).
        draws: (N, P), SI.
        weights: of the draws, (N,); their sum is 1.
        estimates, errors: of the fit, without further shifts, (P,).
        linear_correlation: (P, P).
        failed: draws that could not be fitted.
    """

    names: tuple[str, ...]
    draws: Array
    weights: Array
    estimates: Array
    errors: Array
    linear_correlation: Array
    failed: int

    @property
    def independent(self) -> float:
        """Number of draws of equal weight that they are worth."""
        return float(1 / (self.weights**2).sum())

    @property
    def means(self) -> Array:
        """(P,)."""
        return np.asarray(self.weights @ self.draws)

    @property
    def covariance(self) -> Array:
        """(P, P)."""
        away = self.draws - self.means
        return np.asarray((self.weights[:, None] * away).T @ away)

    @property
    def deviations(self) -> Array:
        """(P,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def ratios(self) -> Array:
        """Ratios of the standard uncertainties of linear fit and posterior, (P,)."""
        return np.asarray(self.errors / self.deviations)

    @property
    def shifts(self) -> Array:
        """(P,): mean of the posterior less the estimate, in its standard deviations."""
        return np.asarray((self.means - self.estimates) / self.deviations)

    @property
    def correlation(self) -> Array:
        """(P, P)."""
        return np.asarray(self.covariance / np.outer(self.deviations, self.deviations))

    def interval(self, name: str, coverage: float = 0.95) -> tuple[float, float]:
        """Return the limits between which this share of the posterior lies, as much beyond either."""
        column = self.draws[:, self.names.index(name)]
        order = np.argsort(column)
        below = np.cumsum(self.weights[order]) - 0.5 * self.weights[order]
        low, high = np.interp([(1 - coverage) / 2, (1 + coverage) / 2], below, column[order])
        return float(low), float(high)


def sample_posterior(
    fit: JointFit,
    draws: int = DRAWS,
    progress: Callable[[float], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    seed: int = 1,
) -> Posterior:
    """Sample the posterior of a fit; `progress` receives the completed share.

    Raises:
        ParameterError: the fit is a robust one, or a parameter is not identified.
        FitCancelled: `cancelled` returned true.
    """
    if fit.options.loss != "linear" or fit.unidentified_combinations:
        raise ParameterError(
            "a posterior needs least squares and runs that identify every parameter: free fewer, or add runs"
        )
    proposal, rng, failed = _Proposal(fit), np.random.default_rng(seed), 0
    found: list[tuple[Array, float]] = []
    for i in range(draws):
        if cancelled is not None and cancelled():
            raise FitCancelled("the posterior was stopped on request")
        drawn = proposal.draw(rng.standard_normal(fit.theta.size))
        failed += drawn is None
        if drawn is not None and np.isfinite(drawn[1]):
            found.append(drawn)
        if progress is not None:
            progress((i + 1) / draws)
    if len(found) < 2:
        raise ParameterError("no draw could be fitted: the posterior of these runs cannot be sampled")
    logarithms = np.array([weight for _, weight in found])
    weights = np.exp(logarithms - logarithms.max())
    weights = np.minimum(weights / weights.sum(), LARGEST_WEIGHT)
    covariance = replace(fit, further_shifts=()).enlarged_covariance
    errors = np.sqrt(np.diag(covariance))
    places = np.array([theta for theta, _ in found])
    return Posterior(
        fit.names, places, weights / weights.sum(), fit.theta, errors, covariance / np.outer(errors, errors), failed
    )


class _Proposal:
    """Draws of readings and prior values with the parameters that fit them, and their weights.

    With Q' the projection on what the fit follows, a draw solves Q' r(theta) = xi. Its density is |det Q' J| exp(-|Q' r|^2 / 2), that
    of the posterior exp(-|r|^2 / 2).
    """

    def __init__(self, fit: JointFit) -> None:
        priors = fit.options.priors
        self._limits = {
            fit.names.index(name): (near, priors[name]) for name in priors if (near := near_limit(name, priors[name]))
        }
        stand_in = {fit.names[i]: prior_moments(fit.names[i], prior) for i, (_, prior) in self._limits.items()}
        self._stand_in = {name: (mean, WIDER * deviation) for name, (mean, deviation) in stand_in.items()}
        self._problem = LeastSquaresProblem(fit.observations, replace(fit.options, normal_priors=self._stand_in))
        self._names, self._scale, self._middle = fit.names, fit.parameter_scale, fit.theta
        self._weights = np.ones(fit.weighted_residuals.size)
        for part, scale in zip(fit.run_slices, fit.run_error_scales, strict=True):
            self._weights[part] = 1 / scale
        r, J = self._evaluate(fit.theta)
        Q, self._R = np.linalg.qr(J)
        self._projection, self._start = Q.T, Q.T @ r
        intervals = [fit_parameters.parameter_spec(name, fit.observations).interval for name in fit.names]
        lowest = [next((float(x) for x in (i.ge, i.gt) if x is not None), -np.inf) for i in intervals]  # type: ignore[arg-type]
        highest = [next((float(x) for x in (i.le, i.lt) if x is not None), np.inf) for i in intervals]  # type: ignore[arg-type]
        self._lowest, self._highest = np.array(lowest), np.array(highest)

    def draw(self, xi: Array) -> tuple[Array, float] | None:
        """Return the parameters of one draw and the logarithm of its weight; None where no parameters fit it."""
        theta = self._middle + self._scale * np.linalg.solve(self._R, self._start - xi)
        try:
            with np.errstate(all="ignore"):
                for _ in range(MAX_STEPS):
                    r, J = self._evaluate(theta)
                    followed = self._projection @ r
                    if not np.isfinite(followed).all():
                        return None
                    if np.abs(followed - xi).max() < SOLVED:
                        return theta, self._log_weight(theta, r, followed, self._projection @ J)
                    theta = theta + self._scale * np.linalg.solve(self._projection @ J, followed - xi)
        except (np.linalg.LinAlgError, ParameterError):
            return None
        return None

    def _evaluate(self, theta: Array) -> tuple[Array, Array]:
        r, J = self._problem.evaluate(theta)
        return r * self._weights, J * self._weights[:, None] * self._scale

    def _log_weight(self, theta: Array, r: Array, followed: Array, slopes: Array) -> float:
        if np.any(theta < self._lowest) or np.any(theta > self._highest):
            return -np.inf
        weight = 0.5 * float(followed @ followed - r @ r) - float(np.linalg.slogdet(slopes)[1])
        for i, (_, (value, deviation)) in self._limits.items():
            mean, wider = self._stand_in[self._names[i]]
            weight += 0.5 * (((theta[i] - mean) / wider) ** 2 - ((theta[i] - value) / deviation) ** 2)
        return weight
