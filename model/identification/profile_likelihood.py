"""Profile intervals: how far one parameter can move when all others give way, where a standard error is too simple."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from model.identification import parameters as known
from model.identification.fit_result import JointFit, cost_of
from model.identification.joint_fit import Cancelled, joint_fit
from model.parameter_spec import ParameterError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Profile:
    """Interval of one parameter; an end is None where chi-square never rises enough: open on that side."""

    name: str
    coverage: float
    low: float | None
    high: float | None
    values: Array
    """Where it was looked, ascending."""
    rise: Array
    """Chi-square above its least, each with all other parameters fitted again."""


def profile(fit: JointFit, name: str, coverage: float = 0.95, cancelled: Cancelled | None = None) -> Profile:
    """The interval in which chi-square rises by no more than the quantile of one degree of freedom, times `fit.stretch` squared.

    Each side takes some ten fits.

    Raises:
        ParameterError: the parameter was not free, or coverage is outside 0..1.
        FitCancelled: `cancelled` said so.
    """
    if name not in fit.parameters:
        raise ParameterError(f"{name} was not free in this fit: choose from {', '.join(fit.parameters)}")
    if not 0 < coverage < 1:
        raise ParameterError(f"coverage is {coverage:g}: it must lie between 0 and 1, e.g. 0.95")
    at = fit.names.index(name)
    value = float(fit.theta[at])
    error = float(np.sqrt(fit.covariance[at, at])) * fit.stretch
    step = error if 0 < error < abs(fit.scale[at]) else 0.1 * float(fit.scale[at])
    wanted = float(chdtri(1, 1 - coverage)) * fit.stretch**2
    others = tuple(n for n in fit.parameters if n != name)
    prior = fit.setting.known.get(name)
    limit = known.quantity(name, fit.campaign)
    looked = {value: 0.0}
    start = dict(zip(fit.names, fit.theta.tolist(), strict=True))

    def rise(v: float) -> float:
        if v not in looked:
            setting = replace(
                fit.setting,
                free=others,
                fixed={**fit.setting.fixed, name: v},
                known={n: k for n, k in fit.setting.known.items() if n != name},
                start={n: start[n] for n in others},
            )
            if others:
                again = joint_fit(fit.campaign, setting, cancelled=cancelled, tries=1)
                start.update(zip(again.names, again.theta.tolist(), strict=True))
                cost = again.cost + (0.0 if prior is None else ((v - prior[0]) / prior[1]) ** 2)
            else:
                cost = _alone(fit, v)
            looked[v] = cost - fit.cost
        return looked[v]

    def edge(sign: int) -> float | None:
        from scipy.optimize import brentq

        inside, reach = value, step
        for _ in range(12):
            v = value + sign * reach
            if not bool(limit.admits(v)):
                return None
            if rise(v) > wanted:
                return float(brentq(lambda x: rise(x) - wanted, inside, v, xtol=1e-3 * abs(v - inside)))
            inside, reach = v, 1.7 * reach
        return None

    low = edge(-1)
    start.update(zip(fit.names, fit.theta.tolist(), strict=True))
    high = edge(1)
    values = np.array(sorted(looked))
    return Profile(name, coverage, low, high, values, np.array([looked[v] for v in values]))


def _alone(fit: JointFit, value: float) -> float:
    """Least cost with the only free parameter held at `value`: the shared errors, all but linear, take one step."""
    theta = fit.theta.copy()
    theta[0] = value
    rows, J = fit.problem.evaluate(theta)
    if J.shape[1] > 1:
        theta[1:] += np.linalg.lstsq(J[:, 1:], rows, rcond=None)[0]
        rows, _ = fit.problem.evaluate(theta)
    return cost_of(rows, fit.setting.loss)
