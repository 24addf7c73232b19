"""The joint fit: all runs of a specimen at once, weighted by their errors, with the errors that instruments share.

Weighted least squares by `scipy.optimize.least_squares` (docs/decisions/0027-joint-fit.md). Shared errors are parameters with
a prior; unidentified combinations are found by the singular values of the scaled Jacobian and reported instead of numbers.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from time import monotonic
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.identification import names as known
from model.identification.estimates import Estimate
from model.identification.forward import Forward, observed
from model.identification.observations import Campaign
from model.identification.setting import FitCancelled, IdentificationError, Setting
from model.quantity import ParameterError

Array = NDArray[np.float64]
Progress = Callable[[int, float], None]
"""Called with the number of evaluations and the present chi-square."""
Cancelled = Callable[[], bool]
"""Asked at every evaluation, e.g. `threading.Event().is_set`."""

UNIDENTIFIED = 1.0
"""A combination whose standard error is above 100 % of the parameters' own sizes is not identified."""
NOTHING = 1e-7
"""Singular values below this share of the largest are rounding."""
PART = 0.05
"""A parameter belongs to an unidentified combination if its share is at least this."""
DOUBTFUL = 1e-3
"""Probability of a chi-square below which the errors do not explain the misfit."""


@dataclass(frozen=True)
class Combination:
    """A combination of parameters that the runs do not tell: moving along it changes nothing that was measured."""

    shares: dict[str, float]
    """Relative change of each parameter along it; the squares sum to about 1."""
    standard_error: float
    """Relative; infinite where nothing at all is known."""

    @property
    def words(self) -> str:
        """E.g. "k2 and mu (+0.71 k2, +0.71 mu)"."""
        parts = ", ".join(f"{share:+.2f} {name}" for name, share in self.shares.items())
        return f"{' and '.join(self.shares)} ({parts})" if len(self.shares) > 1 else next(iter(self.shares))


@dataclass(frozen=True)
class Residuals:
    """One run's residuals, (observed - predicted) / error, real parts before imaginary ones; and their chi-square."""

    label: str
    values: Array
    chi_square: float
    probability: float
    """Of a chi-square at least as large if the model and the errors are right (points taken as independent)."""
    outliers: tuple[int, ...]
    """Indices among the usable points with a residual beyond 4."""


@dataclass(frozen=True)
class JointFit:
    """The result. `theta`, `jacobian` and `covariance` are in the order of `names`, shared errors last."""

    campaign: Campaign
    setting: Setting
    names: tuple[str, ...]
    theta: Array
    rows: Array
    """Residuals of all runs, then of what is known beforehand."""
    jacobian: Array
    """Slopes of the predictions over their errors, (rows, P)."""
    converged: bool
    message: str
    evaluations: int
    seconds: float

    @property
    def parameters(self) -> tuple[str, ...]:
        """Free parameters of the specimen, without the instruments' shared errors."""
        return tuple(n for n in self.names if n not in self.campaign.common)

    @cached_property
    def scale(self) -> Array:
        """What one hundred percent means, (P,): the value; ten standard errors of the prior for a shared error.

        A shared error is bounded by its prior, so it is never what the runs cannot tell.
        """
        base = self.setting.base()
        out = []
        for name, value in zip(self.names, self.theta, strict=True):
            error = self.campaign.common.get(name)
            if error is None:
                out.append(max(abs(value), 1e-3 * known.scale(name, known.start_value(name, base))))
            else:
                out.append(10 * error.standard_error)
        return np.array(out)

    @cached_property
    def _svd(self) -> tuple[Array, Array]:
        """Singular values (P,) and right vectors of the scaled Jacobian."""
        J = self.jacobian * self.scale
        if J.shape[0] < J.shape[1]:
            J = np.vstack((J, np.zeros((J.shape[1] - J.shape[0], J.shape[1]))))
        _, s, Vt = np.linalg.svd(J, full_matrices=False)
        return s, Vt

    @cached_property
    def unidentified(self) -> tuple[Combination, ...]:
        """What these runs cannot tell."""
        s, Vt = self._svd
        out = []
        for size, row in zip(s, Vt, strict=True):
            if self._lost(size):
                error = float(1 / size) if size > NOTHING * s[0] else float("inf")
                relative = row * np.where(self.theta < 0, -1, 1)
                shares = {n: float(c) for n, c in zip(self.names, relative, strict=True) if abs(c) >= PART}
                out.append(Combination(shares, error))
        return tuple(out)

    def _lost(self, size: float) -> bool:
        return size <= NOTHING * self._svd[0][0] or 1 / size > UNIDENTIFIED

    @cached_property
    def covariance(self) -> Array:
        """(P, P) as the given errors imply; along unidentified combinations it is infinite and left out here."""
        s, Vt = self._svd
        keep = np.array([not self._lost(x) for x in s])
        inverse = (Vt[keep].T / s[keep] ** 2) @ Vt[keep]
        return np.asarray(inverse * np.outer(self.scale, self.scale))

    @property
    def correlation(self) -> Array:
        """(P, P)."""
        d = np.sqrt(np.diag(self.covariance))
        d = np.where(d > 0, d, 1)
        return np.asarray(self.covariance / np.outer(d, d))

    @property
    def chi_square(self) -> float:
        """Of all residuals, what is known beforehand included."""
        return float(self.rows @ self.rows)

    @property
    def cost(self) -> float:
        """What the fit made least: chi-square, or the robust loss."""
        z = self.rows**2
        match self.setting.loss:
            case "soft_l1":
                return float(2 * (np.sqrt(1 + z) - 1).sum())
            case "cauchy":
                return float(np.log1p(z).sum())
        return float(z.sum())

    @property
    def freedom(self) -> int:
        """Residuals less identified parameters."""
        return self.rows.size - (len(self.names) - len(self.unidentified))

    @property
    def probability(self) -> float:
        """Of a chi-square at least this large if model and errors are right; 1 where nothing is left to test."""
        from scipy.stats import chi2

        return float(chi2.sf(self.chi_square, self.freedom)) if self.freedom > 0 else 1.0

    @property
    def stretch(self) -> float:
        """Factor on all standard errors: 1, or the square root of the reduced chi-square where errors explain too little."""
        if self.freedom > 0 and self.probability < DOUBTFUL:
            return float(np.sqrt(self.chi_square / self.freedom))
        return 1.0

    @property
    def verdict(self) -> str:
        """Chi-square in words."""
        from scipy.stats import chi2

        if self.freedom <= 0:
            return "no residual is left over to test the model with: measure more points"
        said = f"chi-square {self.chi_square:.1f} for {self.freedom} degrees of freedom"
        if self.stretch > 1:
            return (
                f"{said} (p = {self.probability:.1g}): the misfit is {self.stretch:.2g} times what the errors explain; "
                "standard errors are enlarged by that, which helps only if the misfit is noise: see adequacy"
            )
        if chi2.cdf(self.chi_square, self.freedom) < DOUBTFUL:
            return f"{said}: the misfit is smaller than the errors given, which are too large"
        return f"{said} (p = {self.probability:.2f}): the errors explain the misfit"

    def estimates(self) -> tuple[Estimate, ...]:
        """The identified parameters; none for a parameter that is part of an unidentified combination."""
        lost = {name for c in self.unidentified for name in c.shares}
        sources = self._sources()
        errors = np.sqrt(np.diag(self.covariance)) * self.stretch
        return tuple(
            Estimate(n, float(v), float(e), known.quantity(n, self.campaign).unit, sources[n])
            for n, v, e in zip(self.names, self.theta, errors, strict=True)
            if n not in lost and n in self.parameters
        )

    def covariance_of(self, estimates: tuple[Estimate, ...]) -> Array:
        """Covariance of these estimates, in their order, enlarged as their standard errors are."""
        at = [self.names.index(e.name) for e in estimates]
        return np.asarray(self.covariance[np.ix_(at, at)] * self.stretch**2)

    def _sources(self) -> dict[str, tuple[str, ...]]:
        """Per parameter the runs that tell it: those with at least 1 % of its information."""
        told: dict[str, tuple[str, ...]] = {}
        for i, name in enumerate(self.names):
            share = [float(self.jacobian[part, i] @ self.jacobian[part, i]) for part in self.slices]
            total = sum(share) or 1.0
            told[name] = tuple(r.label for r, x in zip(self.campaign.runs, share, strict=True) if x > 0.01 * total)
        return told

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Where each run's residuals are among `rows`."""
        out, start = [], 0
        for run in self.campaign.runs:
            y, _ = observed(run)
            size = y.size * (2 if np.iscomplexobj(y) else 1)
            out.append(slice(start, start + size))
            start += size
        return tuple(out)

    @cached_property
    def residuals(self) -> tuple[Residuals, ...]:
        """Run by run, in the campaign's order."""
        from scipy.stats import chi2

        out = []
        for run, part in zip(self.campaign.runs, self.slices, strict=True):
            r = self.rows[part]
            points = observed(run)[0].size
            far = np.unique(np.flatnonzero(np.abs(r) > 4) % points)
            out.append(Residuals(run.label, r, float(r @ r), float(chi2.sf(r @ r, r.size)), tuple(far.tolist())))
        return tuple(out)

    @property
    def values(self) -> dict[str, float | None]:
        """Every parameter by name, fixed ones too; what is not identified stands where the fit left it."""
        return self.problem.forward.values(self.theta)

    @cached_property
    def problem(self) -> "Problem":
        """To evaluate the model again."""
        return Problem(self.campaign, self.setting)


class Problem:
    """Residuals and Jacobian of one campaign under one setting.

    Raises:
        ParameterError: the setting does not fit the campaign.
        IdentificationError: nothing is free.
    """

    def __init__(self, campaign: Campaign, setting: Setting) -> None:
        self.campaign, self.setting = campaign, setting
        own = setting.names(campaign)
        if not own:
            raise IdentificationError("no parameter is free: name at least one that these runs can tell")
        self.names = (*own, *campaign.common)
        self.forward = Forward(campaign, self.names, setting.base(), setting.tied, setting.amplifier, setting.n)
        base = setting.base()
        self.start = np.array([setting.start.get(n, known.start_value(n, base)) for n in self.names])
        prior = {n: (0.0, e.standard_error) for n, e in campaign.common.items()} | dict(setting.known)
        self._prior = [(self.names.index(n), v, s) for n, (v, s) in prior.items()]
        self._data = [observed(run) for run in campaign.runs]
        limits = [known.quantity(n, campaign).interval for n in self.names]
        self.log = np.array([i.gt == 0 for i in limits]) & (self.start > 0)
        self.low = np.array([next((float(x) for x in (i.ge, i.gt) if x is not None), -np.inf) for i in limits])  # type: ignore[arg-type]
        self.high = np.array([next((float(x) for x in (i.le, i.lt) if x is not None), np.inf) for i in limits])  # type: ignore[arg-type]

    def evaluate(self, theta: Array) -> tuple[Array, Array]:
        """Residuals (rows,) and slopes of the predictions over their errors (rows, P)."""
        rows: list[Array] = []
        J: list[Any] = []
        for (y, error), got in zip(self._data, self.forward.predict(theta), strict=True):
            r, s = (y - got.values) / error, got.slopes / error
            parts = (r.real, r.imag) if np.iscomplexobj(r) else (r,)
            rows += parts
            J += [s.real.T, s.imag.T] if len(parts) == 2 else [s.T]
        for i, value, sigma in self._prior:
            rows.append(np.array([(value - theta[i]) / sigma]))
            one = np.zeros((1, theta.size))
            one[0, i] = 1 / sigma
            J.append(one)
        return np.concatenate(rows), np.concatenate(J)


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
        if monotonic() > self.deadline:
            raise _Stop


def _weights(r: Array, loss: str) -> Array:
    """Derivative of the loss to the squared residual."""
    return 1 / np.sqrt(1 + r * r) if loss == "soft_l1" else 1 / (1 + r * r)
