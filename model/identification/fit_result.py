"""Fit result: estimates with covariance, unidentified combinations, residuals, chi-square and verdict."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import chdtrc

from model import Array, EstimatedQuantity, Mask, misfit_factor
from model.identification import parameters as fit_parameters
from model.identification.fit_options import FitOptions, Loss
from model.identification.misfit_scale import OUTLIER_SIGMAS, influence_moments, loss_costs, loss_weights, robust_scale
from model.identification.observations import ObservationSet, observed_values
from model.identification.residuals import LeastSquaresProblem

MAX_RELATIVE_ERROR = 1.0
"""Standard error, as a share of the parameters' sizes, above which a combination is not identified."""
SINGULAR_VALUE_CUTOFF = 1e-7
"""Singular values below this share of the largest are rounding."""
MIN_SHARE = 0.05
"""Share from which on a parameter belongs to an unidentified combination; also a smaller share can make it unidentified."""
UNKNOWN_RELATIVE_ERROR = 10.0
"""Assumed relative error of an unidentified combination: 1000 %."""
MIN_RUN_FREEDOM = 0.5
"""Fewest degrees of freedom of a run for an estimate of the size of its errors."""
MIN_P_VALUE = 1e-3
"""Probability of a chi-square below which the errors do not explain the misfit."""


def fit_cost(rows: Array, loss: Loss, priors: int = 0) -> float:
    """Return the cost of residuals over their errors (rows,); the last `priors` rows always count by their squares."""
    data = rows.size - priors
    return float(loss_costs(rows[:data], loss).sum() + rows[data:] @ rows[data:])


def format_p_value(probability: float, digits: int = 1) -> str:
    """`p = 0.003`; a probability that underflows is given as a bound."""
    return f"p = {probability:.{digits}g}" if probability > 0 else "p < 1e-300"


@dataclass(frozen=True)
class UnidentifiedCombination:
    """A combination of parameters that the runs do not determine."""

    shares: dict[str, float]
    """Relative change of each parameter along it; the squares sum to about 1."""
    standard_error: float
    """Relative standard error; infinite if nothing is known."""

    @property
    def description(self) -> str:
        """The combination as text, e.g. "k2 and mu (+0.71 k2, +0.71 mu)"."""
        parts = ", ".join(f"{share:+.2f} {name}" for name, share in self.shares.items())
        return f"{' and '.join(self.shares)} ({parts})" if len(self.shares) > 1 else next(iter(self.shares))


@dataclass(frozen=True)
class RunResiduals:
    """One run's residuals, (observed - predicted) / error, real parts before imaginary ones; and their chi-square."""

    label: str
    values: Array
    chi_square: float
    p_value: float
    """Probability of a chi-square at least as large with a correct model and correct errors (independent points)."""
    outliers: tuple[int, ...]
    """Indices among the usable points with a residual beyond 4."""
    error_scale: float = 1.0
    """Factor on this run's errors in the standard errors of the result; 1 if the errors explain its misfit."""


@dataclass(frozen=True)
class JointFit:
    """The result. `theta`, `jacobian` and `covariance` are in the order of `names`, shared errors last."""

    observations: ObservationSet
    options: FitOptions
    names: tuple[str, ...]
    theta: Array
    weighted_residuals: Array
    """Residuals of all runs, then of the priors."""
    jacobian: Array
    """Slopes of the predictions over their errors, (rows, P), times the root of the weights of a robust loss."""
    converged: bool
    message: str
    evaluations: int
    duration_s: float
    further_shifts: tuple[tuple[str, tuple[float, ...]], ...] = ()
    """Source and changes of the parameters, in the order of `names`, of each uncertainty outside the residuals: by a possible cause of
    an inadequate model, or by an unstated temperature."""

    @property
    def free_parameters(self) -> tuple[str, ...]:
        """Free parameters of the specimen, without the instruments' shared errors."""
        return tuple(n for n in self.names if n not in self.observations.shared_errors)

    @cached_property
    def parameter_scale(self) -> Array:
        """Reference of relative errors, (P,): the value, at least its usual size; ten standard errors of the prior for a shared error.

        A shared error is bounded by its prior, so it is always identified.
        """
        base, shared = self.options.base_values(), self.observations.shared_errors
        return np.array(
            [
                10 * shared[name].standard_error
                if name in shared
                else max(abs(value), fit_parameters.typical_size(name, fit_parameters.start_value(name, base)))
                for name, value in zip(self.names, self.theta, strict=True)
            ]
        )

    @cached_property
    def _svd(self) -> tuple[Array, Array]:
        """Singular values (P,) and right vectors of the scaled Jacobian."""
        J = self.jacobian * self.parameter_scale
        if J.shape[0] < J.shape[1]:
            J = np.vstack((J, np.zeros((J.shape[1] - J.shape[0], J.shape[1]))))
        _, s, Vt = np.linalg.svd(J, full_matrices=False)
        return s, Vt

    @cached_property
    def unidentified_combinations(self) -> tuple[UnidentifiedCombination, ...]:
        """Combinations of parameters that these runs do not determine."""
        s, Vt = self._svd
        own = np.sqrt(np.diag(self.covariance)) / self.parameter_scale
        sign = np.where(self.theta < 0, -1, 1)
        out = []
        for size, row in zip(s, Vt, strict=True):
            if self._is_unidentified(size):
                error = float(1 / size) if size > SINGULAR_VALUE_CUTOFF * s[0] else float("inf")
                # even a small share of an unidentified combination can exceed the error of a parameter
                part = (np.abs(row) >= MIN_SHARE) | (
                    np.abs(row) * min(error, UNKNOWN_RELATIVE_ERROR) > np.maximum(own, 1e-6)
                )
                shares = {n: float(c) for n, c, p in zip(self.names, row * sign, part, strict=True) if p}
                out.append(UnidentifiedCombination(shares, error))
        return tuple(out)

    def _is_unidentified(self, size: float) -> bool:
        return size <= SINGULAR_VALUE_CUTOFF * self._svd[0][0] or 1 / size > MAX_RELATIVE_ERROR

    @cached_property
    def covariance(self) -> Array:
        """(P, P) by the given errors; without unidentified combinations, along which it is infinite."""
        s, Vt = self._svd
        keep = np.array([not self._is_unidentified(x) for x in s])
        inverse = (Vt[keep].T / s[keep] ** 2) @ Vt[keep]
        return np.asarray(inverse * np.outer(self.parameter_scale, self.parameter_scale))

    @property
    def correlation(self) -> Array:
        """(P, P)."""
        d = np.sqrt(np.diag(self.covariance))
        d = np.where(d > 0, d, 1)
        return np.asarray(self.covariance / np.outer(d, d))

    @cached_property
    def used_rows(self) -> Mask:
        """(rows,): all rows, or the rows without outliers in a robust fit."""
        used = np.ones(self.weighted_residuals.size, bool)
        if self.options.loss == "linear":
            return used
        for part, scale in zip(self.run_slices, self.run_error_scales, strict=True):
            used[part] = np.abs(self.weighted_residuals[part]) < OUTLIER_SIGMAS * scale
        for run, part in zip(self.observations.runs, self.run_slices, strict=True):
            if np.iscomplexobj(observed_values(run)[0]):  # both rows of a point
                used[part] = np.tile(used[part].reshape(2, -1).all(axis=0), 2)
        return used

    @property
    def chi_square(self) -> float:
        """Chi-square of all residuals and prior values; without the outliers of a robust fit."""
        r = self.weighted_residuals[self.used_rows]
        return float(r @ r)

    @property
    def cost(self) -> float:
        """The minimized cost: chi-square, or the robust loss."""
        priors = self.weighted_residuals.size - (self.run_slices[-1].stop if self.run_slices else 0)
        return fit_cost(self.weighted_residuals, self.options.loss, priors)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of residuals less number of identified parameters."""
        return int(self.used_rows.sum()) - (len(self.names) - len(self.unidentified_combinations))

    @property
    def p_value(self) -> float:
        """Probability of a chi-square at least this large with correct model and errors; 1 without degrees of freedom."""
        return float(chdtrc(self.degrees_of_freedom, self.chi_square)) if self.degrees_of_freedom > 0 else 1.0

    @cached_property
    def run_error_scales(self) -> tuple[float, ...]:
        """Factor on the errors of each run: 1, or the ratio of its misfit to its errors.

        The root of the run's reduced chi-square, or its robust counterpart. If the misfit is too large in total but in no single
        run, all runs have the same factor.
        """
        J, r = self.jacobian, self.weighted_residuals
        leverage = np.einsum("ij,jk,ik->i", J, self.covariance, J)
        parts = [(r[part], float(r[part].size - leverage[part].sum())) for part in self.run_slices]
        scales = [self._misfit_scale(rows, freedom, len(parts)) for rows, freedom in parts]
        if max(scales, default=1.0) == 1.0 and parts:
            common = self._misfit_scale(np.concatenate([rows for rows, _ in parts]), sum(f for _, f in parts), 1)
            scales = [common] * len(parts)
        return tuple(scales)

    def _misfit_scale(self, rows: Array, freedom: float, tests: int) -> float:
        if self.options.loss != "linear":
            return robust_scale(rows, freedom)
        return misfit_factor(float(rows @ rows), freedom, tests) if freedom >= MIN_RUN_FREEDOM else 1.0

    @property
    def error_scale(self) -> float:
        """Largest factor on the errors of a run."""
        return max(self.run_error_scales, default=1.0)

    @cached_property
    def row_influences(self) -> Array:
        """(P, rows): change of each parameter for one standard error of each residual, enlarged by the factor of its run.

        Its product with its own transpose is the covariance of the result.
        """
        J = self.jacobian * self.parameter_scale
        slope, spread = np.ones(len(J)), np.ones(len(J))
        for part, scale in zip(self.run_slices, self.run_error_scales, strict=True):
            J[part] /= np.sqrt(loss_weights(self.weighted_residuals[part], self.options.loss))[:, None]
            slope[part], spread[part] = influence_moments(self.options.loss, scale)
        s, Vt = self._svd
        V = Vt[[not self._is_unidentified(x) for x in s]].T
        J = J @ V
        inverse = V @ np.linalg.inv((J.T * slope) @ J)
        return np.asarray(inverse @ (J.T * np.sqrt(spread)) * self.parameter_scale[:, None])

    @cached_property
    def enlarged_covariance(self) -> Array:
        """(P, P) with the errors of each run enlarged by its own factor, and further shifts; the parameters are unchanged."""
        if self.options.loss == "linear" and self.error_scale == 1:
            covariance = self.covariance
        else:
            covariance = np.asarray(self.row_influences @ self.row_influences.T)
        if not self.further_shifts:
            return covariance
        shifts = np.array([shift for _, shift in self.further_shifts], float)
        return np.asarray(covariance + shifts.T @ shifts)

    @property
    def prior_rows(self) -> dict[str, int]:
        """Row of each shared error and of each parameter with a prior value, after the rows of the runs."""
        first = self.run_slices[-1].stop if self.run_slices else 0
        return {name: first + i for i, name in enumerate((*self.observations.shared_errors, *self.options.priors))}

    @property
    def verdict(self) -> str:
        """Chi-square and its interpretation as text."""
        if self.degrees_of_freedom <= 0:
            unknown = [n for n in self.free_parameters if n not in self.options.priors]
            values = self.run_slices[-1].stop
            more = max(len(unknown) - values + 1, 1)
            return (
                f"{values} value{'s' * (values != 1)} for {len(unknown)} unknown parameter{'s' * (len(unknown) != 1)} "
                f"({', '.join(unknown)}) cannot test the model: measure at least {more} more point{'s' * (more > 1)}"
            )
        text = f"chi-square {self.chi_square:.1f} for {self.degrees_of_freedom} degrees of freedom"
        if out := int((~self.used_rows).sum()):
            where = ", ".join(
                r.label
                for r, part in zip(self.residuals, self.run_slices, strict=True)
                if not self.used_rows[part].all()
            )
            text = f"{text} without {out} outlying residuals ({where})"
        if self.error_scale > 1:
            return (
                f"{text} ({format_p_value(self.p_value)}): the misfit is {self._describe_scales()} times what the errors explain; "
                "standard errors are enlarged by that, run by run, which helps only if the misfit is noise: see adequacy"
            )
        if self.p_value < MIN_P_VALUE:
            return f"{text} ({format_p_value(self.p_value)}): the misfit is against what was known beforehand"
        if 1 - self.p_value < MIN_P_VALUE:
            return f"{text}: the misfit is smaller than the errors given, which are too large"
        return f"{text} (p = {self.p_value:.2f}): the errors explain the misfit"

    def _describe_scales(self) -> str:
        """Return the factors by run as text: `3.2 (dwell) and 1.4 (steps)`, or one number for all."""
        scales = self.run_error_scales
        if len(scales) > 1 and len(set(scales)) == 1:
            return f"{scales[0]:.2g} (all runs)"
        return " and ".join(
            f"{scale:.2g} ({run.label})" for run, scale in zip(self.observations.runs, scales, strict=True) if scale > 1
        )

    def estimates(self) -> tuple[EstimatedQuantity, ...]:
        """The identified parameters; none for a parameter that is part of an unidentified combination."""
        missing = {name for c in self.unidentified_combinations for name in c.shares}
        sources = self._sources()
        errors = np.sqrt(np.diag(self.enlarged_covariance))
        return tuple(
            EstimatedQuantity(
                n, float(v), float(e), fit_parameters.parameter_spec(n, self.observations).unit, sources[n]
            )
            for n, v, e in zip(self.names, self.theta, errors, strict=True)
            if n not in missing and n in self.free_parameters
        )

    def covariance_of(self, estimates: tuple[EstimatedQuantity, ...]) -> Array:
        """Covariance of these estimates, in their order, enlarged like their standard errors."""
        at = [self.names.index(e.name) for e in estimates]
        return np.asarray(self.enlarged_covariance[np.ix_(at, at)])

    def _sources(self) -> dict[str, tuple[str, ...]]:
        """Return for each parameter the runs with at least 1 % of its information."""
        sources: dict[str, tuple[str, ...]] = {}
        for i, name in enumerate(self.names):
            share = [float(self.jacobian[part, i] @ self.jacobian[part, i]) for part in self.run_slices]
            total = sum(share) or 1.0
            sources[name] = tuple(
                r.label for r, x in zip(self.observations.runs, share, strict=True) if x > 0.01 * total
            )
        return sources

    @cached_property
    def run_slices(self) -> tuple[slice, ...]:
        """Slices of the runs' residuals in `rows`."""
        out, start = [], 0
        for run in self.observations.runs:
            y, _ = observed_values(run)
            size = y.size * (2 if np.iscomplexobj(y) else 1)
            out.append(slice(start, start + size))
            start += size
        return tuple(out)

    @cached_property
    def residuals(self) -> tuple[RunResiduals, ...]:
        """Run by run, in the campaign's order."""
        out = []
        parts = zip(self.observations.runs, self.run_slices, self.run_error_scales, strict=True)
        for run, part, scale in parts:
            r = self.weighted_residuals[part]
            points = observed_values(run)[0].size
            far = np.unique(np.flatnonzero(np.abs(r) > 4) % points)
            out.append(
                RunResiduals(run.label, r, float(r @ r), float(chdtrc(r.size, r @ r)), tuple(far.tolist()), scale)
            )
        return tuple(out)

    @property
    def values(self) -> dict[str, float | None]:
        """Every parameter by name, including fixed ones; an unidentified one has its last value in the fit."""
        return self.problem.forward_model.values(self.theta)

    @cached_property
    def problem(self) -> LeastSquaresProblem:
        """The model for further evaluations."""
        return LeastSquaresProblem(self.observations, self.options)
