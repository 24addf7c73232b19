"""The joint fit: all runs of a specimen at once, weighted by their errors, with the errors that instruments share.

Weighted least squares by `scipy.optimize.least_squares` (docs/decisions/0027-joint-fit.md). Shared errors are parameters with
a prior; unidentified combinations are found by the singular values of the scaled Jacobian and reported instead of numbers.
"""

from collections.abc import Callable
from dataclasses import replace
from time import monotonic
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.identification import names as known
from model.identification.fitted import JointFit
from model.identification.observations import Campaign
from model.identification.problem import Problem
from model.identification.setting import FitCancelled, IdentificationError, Setting
from model.quantity import ParameterError

Array = NDArray[np.float64]
Progress = Callable[[int, float], None]
"""Called with the number of evaluations and the present chi-square."""
Cancelled = Callable[[], bool]
"""Asked at every evaluation, e.g. `threading.Event().is_set`."""


class _Stop(Exception):
    pass


def joint_fit(
    campaign: Campaign,
    setting: Setting | None = None,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
    seconds: float = 20.0,
    tries: int = 4,
) -> JointFit:
    """Fit the free parameters to all runs at once.

    A fit that leaves the misfit far from explained is begun again from other starts, `tries` in all, and the best is kept. After
    `seconds` the best so far is given, and `message` says so.

    Raises:
        ParameterError, IdentificationError: a sentence why this cannot be fitted.
        FitCancelled: `cancelled` said so.
    """
    problem = Problem(campaign, setting or Setting())
    began = monotonic()
    watch = _Watch(problem, progress, cancelled, began + seconds)
    best: JointFit | None = None
    for start in _starts(problem)[:tries]:
        if best is not None and monotonic() > watch.deadline:
            break
        fit = watch.fit(start)
        if fit is not None and (best is None or fit.cost < 0.999 * best.cost):
            best = fit
        if best is not None and (best.converged and best.cost < 4 * max(best.freedom, 1)):
            break
    if best is None:
        raise IdentificationError(
            "the model cannot be evaluated where the fit begins: "
            + ", ".join(f"{n} = {v:.3g}" for n, v in zip(problem.names, problem.start, strict=True))
            + "; begin somewhere else"
        )
    return replace(best, evaluations=watch.evaluations, seconds=monotonic() - began)


def _starts(problem: Problem) -> list[Array]:
    """The start asked for; the table's values; and those of the table moved both ways."""
    base = problem.setting.base()
    table = np.array([known.start_value(n, base) for n in problem.names])
    own = np.array([n not in problem.campaign.common for n in problem.names])
    moves = ({"k2": 0.5, "m_add": 1.5, "c0": 0.5, "mu": 0.5}, {"k2": 2.0, "m_add": 0.7, "c0": 0.5, "mu": 2.0})
    moved = [np.where(own, table * [move.get(n, 1.0) for n in problem.names], table) for move in moves]
    return [problem.start, table, *moved]


class _Watch:
    """Runs fits and stops them: in time, on request, and with the best point it saw."""

    def __init__(
        self, problem: Problem, progress: Progress | None, cancelled: Cancelled | None, deadline: float
    ) -> None:
        self._problem, self._progress, self._cancelled = problem, progress, cancelled
        self.deadline, self.evaluations = deadline, 0

    def fit(self, start: Array) -> JointFit | None:
        """One descent; None where the model cannot be evaluated at the start."""
        from scipy.optimize import least_squares

        p = self._problem
        log = p.log & (start > 0)
        scale = np.array([known.scale(n, x) for n, x in zip(p.names, start, strict=True)])
        scale = np.where(log, 1.0, scale)
        for i, name in enumerate(p.names):
            if name in p.campaign.common:
                scale[i] = p.campaign.common[name].standard_error

        def inward(theta: Array) -> Array:
            return np.where(log, np.log(np.where(log, theta, 1.0)), theta / scale)

        def outward(x: Array) -> Array:
            return np.where(log, np.exp(np.where(log, x, 0.0)), x * scale)

        low = np.where(log, np.log(np.where(log, start, 1.0)) - 12, p.low / scale)
        high = np.where(log, np.log(np.where(log, start, 1.0)) + 12, p.high / scale)
        seen: dict[bytes, tuple[Array, Array]] = {}
        best: list[Any] = [np.inf, None]

        def at(x: Array) -> tuple[Array, Array]:
            key = x.tobytes()
            if key not in seen:
                self._check()
                seen.clear()
                theta = outward(x)
                try:
                    r, J = p.evaluate(theta)
                except (np.linalg.LinAlgError, ParameterError, FloatingPointError):
                    r, J = np.full(1, np.nan), np.zeros((1, x.size))
                if not (np.isfinite(r).all() and np.isfinite(J).all()):
                    if best[1] is None:
                        raise _Stop
                    r, J = np.full(best[1][0].size, 1e8), np.zeros_like(best[1][1])
                if r @ r < best[0]:
                    best[:] = [float(r @ r), (r, J, theta)]
                if self._progress is not None:
                    self._progress(self.evaluations, best[0])
                seen[key] = r, -J * np.where(log, theta, scale)
            return seen[key]

        # a start on a limit is moved a little inside
        x0 = np.clip(
            inward(start), np.where(np.isfinite(low), low + 1e-9, low), np.where(np.isfinite(high), high - 1e-9, high)
        )
        message, converged = "", False

        def rows(x: Array) -> Array:
            return at(x)[0]

        def slopes(x: Array) -> Array:
            return at(x)[1]

        try:
            with np.errstate(all="ignore"):
                got = least_squares(
                    rows, x0, slopes, (low, high), "trf", loss=p.setting.loss,
                    xtol=1e-10, ftol=1e-10, gtol=1e-10, max_nfev=200,
                )  # fmt: skip
            converged = bool(got.success)
            message = "converged" if converged else "stopped after 200 evaluations without settling"
            r, J = p.evaluate(outward(got.x))
            theta = outward(got.x)
        except _Stop:
            if best[1] is None:
                return None
            r, J, theta = best[1]
            message = "stopped because its time was over; the best so far"
        if p.setting.loss != "linear":
            weight = np.sqrt(_weights(r, p.setting.loss))
            J = J * weight[:, None]
        at_limit = [
            n for n, v, lo in zip(p.names, theta, p.low, strict=True) if lo == 0 and v < 1e-6 * known.scale(n, v)
        ]
        if at_limit:
            message += f"; {', '.join(at_limit)} ended at the limit 0, where its standard error says little"
        return JointFit(p.campaign, p.setting, p.names, theta, r, J, converged, message, self.evaluations, 0.0)

    def _check(self) -> None:
        self.evaluations += 1
        if self._cancelled is not None and self._cancelled():
            raise FitCancelled("the fit was stopped on request")
        if self.evaluations > 1 and monotonic() > self.deadline:  # the first is always done: an answer, if a poor one
            raise _Stop


def _weights(r: Array, loss: str) -> Array:
    """Derivative of the loss to the squared residual."""
    return 1 / np.sqrt(1 + r * r) if loss == "soft_l1" else 1 / (1 + r * r)
