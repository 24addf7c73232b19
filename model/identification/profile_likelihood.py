"""Profile intervals: confidence interval of one parameter with all others fitted again at each value."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from model import Array, ParameterError
from model.identification import parameters as known
from model.identification.fit_result import JointFit, fit_cost
from model.identification.joint_least_squares import CancelCheck, joint_fit


@dataclass(frozen=True)
class ProfileInterval:
    """Interval of one parameter; an end is None where chi-square never rises enough: open on that side."""

    name: str
    coverage: float
    low: float | None
    high: float | None
    values: Array
    """Evaluated values, ascending."""
    chi_square_rise: Array
    """Chi-square above its least, each with all other parameters fitted again."""


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
    value = float(fit.theta[at])
    error = float(np.sqrt(fit.enlarged_covariance[at, at]))
    step = error if 0 < error < abs(fit.parameter_scale[at]) else 0.1 * float(fit.parameter_scale[at])
    enlarged = error**2 / float(fit.covariance[at, at]) if fit.covariance[at, at] > 0 else 1.0
    limit_rise = float(chdtri(1, 1 - coverage)) * enlarged
    others = tuple(n for n in fit.free_parameters if n != name)
    prior = fit.options.priors.get(name)
    limit = known.parameter_spec(name, fit.observations)
    evaluated = {value: 0.0}
    start = dict(zip(fit.names, fit.theta.tolist(), strict=True))

    def rise(v: float) -> float:
        if v not in evaluated:
            setting = replace(
                fit.options,
                free=others,
                fixed={**fit.options.fixed, name: v},
                priors={n: k for n, k in fit.options.priors.items() if n != name},
                start={n: start[n] for n in others},
            )
            if others:
                repeat = joint_fit(fit.observations, setting, cancelled=cancelled, max_starts=1)
                start.update(zip(repeat.names, repeat.theta.tolist(), strict=True))
                cost = repeat.cost + (0.0 if prior is None else ((v - prior[0]) / prior[1]) ** 2)
            else:
                cost = _single_parameter_cost(fit, v)
            evaluated[v] = cost - fit.cost
        return evaluated[v]

    def edge(sign: int) -> float | None:
        from scipy.optimize import brentq

        inside, reach = value, step
        for _ in range(12):
            v = value + sign * reach
            if not bool(limit.is_valid(v)):
                return None
            if rise(v) > limit_rise:
                return float(brentq(lambda x: rise(x) - limit_rise, inside, v, xtol=1e-3 * abs(v - inside)))
            inside, reach = v, 1.7 * reach
        return None

    low = edge(-1)
    start.update(zip(fit.names, fit.theta.tolist(), strict=True))
    high = edge(1)
    values = np.array(sorted(evaluated))
    return ProfileInterval(name, coverage, low, high, values, np.array([evaluated[v] for v in values]))


def _single_parameter_cost(fit: JointFit, value: float) -> float:
    """Least cost with the only free parameter held at `value`: the shared errors, all but linear, take one step."""
    theta = fit.theta.copy()
    theta[0] = value
    rows, J = fit.problem.evaluate(theta)
    if J.shape[1] > 1:
        theta[1:] += np.linalg.lstsq(J[:, 1:], rows, rcond=None)[0]
        rows, _ = fit.problem.evaluate(theta)
    return fit_cost(rows, fit.options.loss, fit.problem.prior_count)
