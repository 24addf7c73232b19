"""Profile intervals: confidence interval of one parameter with all others fitted again at each value."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from model import ParameterError
from model.identification import parameters as fit_parameters
from model.identification.fit_result import JointFit, fit_cost
from model.identification.joint_least_squares import CancelCheck, joint_fit


@dataclass(frozen=True)
class ProfileInterval:
    """Interval of one parameter; an end is None if chi-square never rises enough on that side."""

    name: str
    coverage: float
    low: float | None
    high: float | None


def profile_interval(
    fit: JointFit, name: str, coverage: float = 0.95, cancelled: CancelCheck | None = None
) -> ProfileInterval:
    """The interval in which chi-square rises by no more than the quantile of one degree of freedom, times the factor on the variance.

    Each side takes some ten fits.

    Raises:
        ParameterError: the parameter was not free, or coverage is outside 0..1.
        FitCancelled: `cancelled` returned true.
    """
    if name not in fit.free_parameters:
        raise ParameterError(f"{name} was not free in this fit: choose from {', '.join(fit.free_parameters)}")
    if not 0 < coverage < 1:
        raise ParameterError(f"coverage is {coverage:g}: it must lie between 0 and 1, e.g. 0.95")
    at = fit.names.index(name)
    error = float(np.sqrt(fit.enlarged_covariance[at, at]))
    step = error if 0 < error < abs(fit.parameter_scale[at]) else 0.1 * float(fit.parameter_scale[at])
    enlarged = error**2 / float(fit.covariance[at, at]) if fit.covariance[at, at] > 0 else 1.0
    profile = _Profile(fit, name, float(chdtri(1, 1 - coverage)) * enlarged, cancelled)
    low = profile.edge(-step)
    profile.restart()
    high = profile.edge(step)
    return ProfileInterval(name, coverage, low, high)


class _Profile:
    """Rise of chi-square over one parameter with the others refitted; every value is fitted once."""

    def __init__(self, fit: JointFit, name: str, limit_rise: float, cancelled: CancelCheck | None) -> None:
        self._fit, self._name, self._limit_rise, self._cancelled = fit, name, limit_rise, cancelled
        self._value = float(fit.theta[fit.names.index(name)])
        self._others = tuple(n for n in fit.free_parameters if n != name)
        self.evaluated = {self._value: 0.0}
        """Rise of chi-square by value of the parameter."""
        self.restart()

    def restart(self) -> None:
        """Let the next fit start at the parameters of the fit."""
        self._start = dict(zip(self._fit.names, self._fit.theta.tolist(), strict=True))

    def rise(self, v: float) -> float:
        """Return the rise of chi-square with the parameter held at a value."""
        if v not in self.evaluated:
            self.evaluated[v] = self._cost(v) - self._fit.cost
        return self.evaluated[v]

    def _cost(self, v: float) -> float:
        if not self._others:
            return _single_parameter_cost(self._fit, v)
        options = self._fit.options
        setting = replace(
            options,
            free=self._others,
            fixed={**options.fixed, self._name: v},
            priors={n: k for n, k in options.priors.items() if n != self._name},
            start={n: self._start[n] for n in self._others},
        )
        repeat = joint_fit(self._fit.observations, setting, cancelled=self._cancelled, max_starts=1)
        self._start.update(zip(repeat.names, repeat.theta.tolist(), strict=True))
        prior = options.priors.get(self._name)
        return repeat.cost + (0.0 if prior is None else ((v - prior[0]) / prior[1]) ** 2)

    def edge(self, reach: float) -> float | None:
        """Return the value with chi-square at the limit, searched in steps from `reach`, with its sign; None if there is none."""
        from scipy.optimize import brentq

        inside, limit = self._value, fit_parameters.parameter_spec(self._name, self._fit.observations)
        for _ in range(12):
            v = self._value + reach
            if not bool(limit.is_valid(v)):
                return None
            if self.rise(v) > self._limit_rise:
                return float(brentq(lambda x: self.rise(x) - self._limit_rise, inside, v, xtol=1e-3 * abs(v - inside)))
            inside, reach = v, 1.7 * reach
        return None


def _single_parameter_cost(fit: JointFit, value: float) -> float:
    """Minimum of the cost with the only free parameter held at `value`: the nearly linear shared errors take one step."""
    theta = fit.theta.copy()
    theta[0] = value
    rows, J = fit.problem.evaluate(theta)
    if J.shape[1] > 1:
        theta[1:] += np.linalg.lstsq(J[:, 1:], rows, rcond=None)[0]
        rows, _ = fit.problem.evaluate(theta)
    return fit_cost(rows, fit.options.loss, fit.problem.prior_count)
