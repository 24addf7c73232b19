"""What a joint fit found: estimates with their covariance, what is not identified, residuals, chi-square and its verdict."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from model.identification import parameters as known
from model.identification.calibration import Estimate
from model.identification.fit_options import Loss, Setting
from model.identification.observations import Campaign, observed
from model.identification.residuals import Problem

Array = NDArray[np.float64]

UNIDENTIFIED = 1.0
"""A combination whose standard error is above 100 % of the parameters' own sizes is not identified."""
NOTHING = 1e-7
"""Singular values below this share of the largest are rounding."""
PART = 0.05
"""A parameter belongs to an unidentified combination if its share is at least this, or undoes what is known of it."""
UNKNOWN = 10.0
"""How far, relative, something that nothing tells may be off: 1000 %."""
DOUBTFUL = 1e-3
"""Probability of a chi-square below which the errors do not explain the misfit."""


def cost_of(rows: Array, loss: Loss) -> float:
    """What a fit makes least: the sum of squares, or of the robust loss, of residuals over their errors, (rows,)."""
    z = rows**2
    match loss:
        case "soft_l1":
            return float(2 * (np.sqrt(1 + z) - 1).sum())
        case "cauchy":
            return float(np.log1p(z).sum())
    return float(z.sum())


def chance(probability: float, digits: int = 1) -> str:
    """`p = 0.003`; what a computer cannot tell from nothing is not called nothing."""
    return f"p = {probability:.{digits}g}" if probability > 0 else "p < 1e-300"


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
        """What one hundred percent means, (P,): the value, at least its usual size; ten standard errors of the prior for a shared error.

        A shared error is bounded by its prior, so it is never what the runs cannot tell.
        """
        base = self.setting.base()
        out = []
        for name, value in zip(self.names, self.theta, strict=True):
            error = self.campaign.common.get(name)
            if error is None:
                out.append(max(abs(value), known.scale(name, known.start_value(name, base))))
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
        own = np.sqrt(np.diag(self.covariance)) / self.scale
        sign = np.where(self.theta < 0, -1, 1)
        out = []
        for size, row in zip(s, Vt, strict=True):
            if self._lost(size):
                error = float(1 / size) if size > NOTHING * s[0] else float("inf")
                # even a small share of something unknown can be more than what is otherwise known of a parameter
                part = (np.abs(row) >= PART) | (np.abs(row) * min(error, UNKNOWN) > np.maximum(own, 1e-6))
                shares = {n: float(c) for n, c, p in zip(self.names, row * sign, part, strict=True) if p}
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
        return cost_of(self.rows, self.setting.loss)

    @property
    def freedom(self) -> int:
        """Residuals less identified parameters."""
        return self.rows.size - (len(self.names) - len(self.unidentified))

    @property
    def probability(self) -> float:
        """Of a chi-square at least this large if model and errors are right; 1 where nothing is left to test."""
        return float(chdtrc(self.freedom, self.chi_square)) if self.freedom > 0 else 1.0

    @property
    def stretch(self) -> float:
        """Factor on all standard errors: 1, or the square root of the reduced chi-square where errors explain too little."""
        if self.freedom > 0 and self.probability < DOUBTFUL:
            return float(np.sqrt(self.chi_square / self.freedom))
        return 1.0

    @property
    def verdict(self) -> str:
        """Chi-square in words."""
        if self.freedom <= 0:
            return "no residual is left over to test the model with: measure more points"
        said = f"chi-square {self.chi_square:.1f} for {self.freedom} degrees of freedom"
        if self.stretch > 1:
            return (
                f"{said} ({chance(self.probability)}): the misfit is {self.stretch:.2g} times what the errors explain; "
                "standard errors are enlarged by that, which helps only if the misfit is noise: see adequacy"
            )
        if 1 - self.probability < DOUBTFUL:
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
        out = []
        for run, part in zip(self.campaign.runs, self.slices, strict=True):
            r = self.rows[part]
            points = observed(run)[0].size
            far = np.unique(np.flatnonzero(np.abs(r) > 4) % points)
            out.append(Residuals(run.label, r, float(r @ r), float(chdtrc(r.size, r @ r)), tuple(far.tolist())))
        return tuple(out)

    @property
    def values(self) -> dict[str, float | None]:
        """Every parameter by name, fixed ones too; what is not identified stands where the fit left it."""
        return self.problem.forward.values(self.theta)

    @cached_property
    def problem(self) -> Problem:
        """To evaluate the model again."""
        return Problem(self.campaign, self.setting)
