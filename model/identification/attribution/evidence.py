"""Evidence for each possible cause in the linearized fit, and its distribution under noise alone.

With a cause of the parameters phi, normal with their plausible sizes S, the residuals r that the fit leaves gain the logarithm of a
Bayes factor: half of r' d (1 + d'd)^-1 d' r less half of the logarithm of |1 + d'd|, d being S times what the fit cannot follow of the
effects. The second term is the price of its parameters.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import chdtrc, ndtr

from model import Array
from model.identification import observations as observed
from model.identification.attribution.causes import POINT_ERRORS, Cause, free_as_well, possible_causes, with_errors
from model.identification.fit_result import JointFit
from model.identification.residuals import LeastSquaresProblem

DRAWS = 1500
"""Simulated sets of residuals."""
INSIDE_FIT = 1e-6
"""Share of an effect outside the space of the fit, squared, below which the runs cannot show it."""
MIN_PATTERN_ROWS = 6
"""Residuals of a run from which on its neighbours are compared."""


@dataclass(frozen=True)
class CauseEvidence:
    """One cause in the linearized fit."""

    cause: Cause
    gain: float
    """By which chi-square would be smaller."""
    price: float
    """Logarithm of the Bayes factor that its parameters cost."""

    @property
    def log_odds(self) -> float:
        """Logarithm of the odds against chance, all causes of its kind counted."""
        return self.gain / 2 - self.price + self.cause.log_prior


class Evidence:
    """Evidence for every possible cause of the misfit of a fit."""

    def __init__(self, fit: JointFit) -> None:
        self.fit = fit
        self.residuals: Array = np.where(fit.used_rows, fit.weighted_residuals, 0.0)
        self.predictions = {
            run.label: p.values
            for run, p in zip(fit.observations.runs, fit.problem.forward_model.predict(fit.theta), strict=True)
        }
        every = possible_causes(fit, self.predictions)
        self.causes = tuple(c for c in every if c.kind != "exchange")
        self._exchanges = tuple(c for c in every if c.kind == "exchange")
        columns = self._columns()
        self.effects: Mapping[Cause, Array] = {
            c: columns[:, at] for c, at in zip(self.causes, self._places, strict=True)
        }
        """What each cause adds to the weighted residuals for plausible sizes, (rows, its parameters)."""
        self._directions, self._weights, self._prices = self._decompose(columns)

    @cached_property
    def subspace(self) -> Array:
        """Orthonormal basis (rows, k) of the fit's degrees of freedom."""
        J = self.fit.jacobian * self.fit.parameter_scale * self.fit.used_rows[:, None]
        U, s, _ = np.linalg.svd(J, full_matrices=False)
        return np.asarray(U[:, s > 1e-7 * s[0]])

    @cached_property
    def linear(self) -> tuple[CauseEvidence, ...]:
        """Every cause, the likeliest first."""
        gains = self._gains(self.residuals[None])[0]
        found = [CauseEvidence(c, float(g), float(p)) for c, g, p in zip(self.causes, gains, self._prices, strict=True)]
        found += [CauseEvidence(c, g, 0.0) for c, g in zip(self._exchanges, self._exchange_gains(), strict=True)]
        return tuple(sorted(found, key=lambda e: -e.log_odds))

    def outside_fit(self, effect: Array) -> Array:
        """Return the part of effects (rows, ...) that the fit cannot follow."""
        return np.asarray(effect - self.subspace @ (self.subspace.T @ effect))

    def chance(self, probabilities: Sequence[float]) -> float:
        """Return the probability that noise alone gives so significant a test: causes, chi-square, patterns, or other tests.

        Args:
            probabilities: of further tests, independent of the residuals.
        """
        fit, used = self.fit, self.fit.used_rows
        noise = np.random.default_rng(0).standard_normal((DRAWS, used.size)) * used
        noise -= (noise @ self.subspace) @ self.subspace.T
        every = np.vstack((self.residuals, noise))
        odds = np.array([c.log_prior for c in self.causes])
        tests = [(self._gains(every) / 2 - self._prices + odds).max(axis=1, initial=-np.inf), (every**2).sum(axis=1)]
        for rows, form, mean, deviation in map(self.pattern, self._patterned):
            part = every[:, rows]
            tests.append(((part @ form * part).sum(axis=1) - mean) / deviation)
        ranks = np.array([np.searchsorted(np.sort(-t[1:]), -t, side="right") + 1.0 for t in tests]) / (DRAWS + 1)
        ranks[1, 0] = min(ranks[1, 0], chdtrc(max(fit.degrees_of_freedom, 1), tests[1][0]))
        least = ranks.min(axis=0)
        own = (
            (1 + np.sum(least[1:] <= least[0])) / (DRAWS + 1) if least[0] > 1 / DRAWS else float(least[0]) * len(tests)
        )
        others = [min(1.0, p) for p in probabilities]
        return float(-np.expm1((1 + bool(others)) * np.log1p(-min(own, *others, 1 - 1e-12))))

    def patterns(self) -> Iterator[tuple[str, int, float, float]]:
        """Yield run, residuals, correlation of neighbours and its probability by chance of each run."""
        for at in self._patterned:
            rows, form, mean, deviation = self.pattern(at)
            part = self.residuals[rows]
            products = float(part @ form @ part)
            # skewed like a chi-square, so the tail of the normal is taken with twice its probability
            p = min(1.0, float(4 * ndtr(-max((products - mean) / deviation, 0.0))))
            yield self.fit.observations.runs[at].label, part.size, products / max(float(part @ part), 1e-300), p

    def pattern(self, at: int) -> tuple[slice, Array, float, float]:
        """Return the sum of products of neighbours of a run as a form, with its exact mean and deviation under noise alone."""
        part, run = self.fit.run_slices[at], self.fit.observations.runs[at]
        n = part.stop - part.start
        q = self.subspace[part]
        S = np.eye(n) - q @ q.T
        L = 0.5 * (np.eye(n, k=1) + np.eye(n, k=-1))
        if np.iscomplexobj(observed.observed_values(run)[0]):
            L[n // 2 - 1, n // 2] = L[n // 2, n // 2 - 1] = 0.0
        A = L @ S
        return part, L, float(np.trace(A)), float(np.sqrt(2 * np.sum(A * A.T)))

    @property
    def _patterned(self) -> list[int]:
        return [i for i, part in enumerate(self.fit.run_slices) if part.stop - part.start >= MIN_PATTERN_ROWS]

    @cached_property
    def _places(self) -> list[slice]:
        """Columns of each cause."""
        ends = np.cumsum([self._column_count(c) for c in self.causes], dtype=int).tolist()
        return [slice(a, b) for a, b in zip([0, *ends[:-1]], ends, strict=True)]

    def _column_count(self, cause: Cause) -> int:
        if cause.kind == "point":
            return 2 if np.iscomplexobj(self.predictions[cause.name]) else 1
        return len(cause.sizes)

    def _columns(self) -> Array:
        """Return the effects of all causes but exchanges for plausible sizes, (rows, columns)."""
        fit, rows = self.fit, self.fit.weighted_residuals.size
        plain = [e for c in self.causes for e in c.errors if e.error.acts_on != "reading"]
        names = tuple(n for c in self.causes if c.kind == "parameter" for n in c.parameters)
        problem = LeastSquaresProblem(with_errors(fit.observations, plain), free_as_well(fit, names))
        _, J = problem.evaluate(problem.start)
        data = fit.run_slices[-1].stop
        place = {name: i for i, name in enumerate(problem.names)}
        out = np.zeros((rows, self._places[-1].stop if self.causes else 0))
        for cause, at in zip(self.causes, self._places, strict=True):
            if cause.kind == "point":
                out[self._rows_of_point(cause), np.arange(at.start, at.stop)] = POINT_ERRORS
            for k, (name, (_, size)) in enumerate(cause.parameters.items()):
                if name in fit.options.priors:
                    row, own = fit.prior_rows[name], fit.problem.priors_by_name[name][1]
                    out[row, at.start + k] = np.sqrt(max(size**2 - own**2, 0.0)) / own
                else:
                    out[:data, at.start + k] = J[:data, place[name]] * size
            for k, e in enumerate(cause.errors):
                if e.error.acts_on == "reading":
                    out[:, at.start + k] = self._reading_effect(e.runs) * e.error.standard_error
                else:
                    out[:data, at.start + k] = J[:data, place[e.error.name]] * e.error.standard_error
        return np.asarray(out * fit.used_rows[:, None])

    def _reading_effect(self, shapes: Mapping[str, Any]) -> Array:
        out = np.zeros(self.residuals.size)
        for run, part in zip(self.fit.observations.runs, self.fit.run_slices, strict=True):
            if run.label in shapes:
                change = self.predictions[run.label] * shapes[run.label]
                real = not np.iscomplexobj(self.predictions[run.label])
                out[part] = observed.over_errors(run, np.real(change) if real else change + 0j)
        return out

    def _rows_of_point(self, cause: Cause) -> Any:
        at = next(i for i, run in enumerate(self.fit.observations.runs) if run.label == cause.name)
        run, part = self.fit.observations.runs[at], self.fit.run_slices[at]
        usable = np.flatnonzero(run.usable)
        rows = np.arange(part.start, part.stop).reshape(-1, usable.size)
        return rows[:, int(np.flatnonzero(usable == cause.points[0])[0])]

    def _decompose(self, columns: Array) -> tuple[Array, Array, Array]:
        """Return unit directions (rows, K) outside the fit, their weights (K,), and the price of each cause."""
        rest, length = self.outside_fit(columns), (columns**2).sum(axis=0)
        directions, weights, prices = np.zeros_like(rest), np.zeros(rest.shape[1]), []
        for at in self._places:
            d = rest[:, at]
            d = d * ((d * d).sum(axis=0) > INSIDE_FIT * length[at])
            values, vectors = np.linalg.eigh(d.T @ d)
            seen = values > 1e-9
            directions[:, at] = (d @ vectors) * np.where(seen, 1 / np.sqrt(np.where(seen, values, 1.0)), 0.0)
            weights[at] = np.where(seen, values / (1 + values), 0.0)
            prices.append(0.5 * float(np.log1p(np.where(seen, values, 0.0)).sum()))
        return directions, weights, np.array(prices)

    def _gains(self, residuals: Array) -> Array:
        """Return by how much chi-square is smaller with each cause, (..., causes), of residuals (..., rows)."""
        if not self.causes:
            return np.zeros((len(residuals), 0))
        squares = (residuals @ self._directions) ** 2 * self._weights
        return np.add.reduceat(squares, [at.start for at in self._places], axis=-1)

    def _exchange_gains(self) -> list[float]:
        """Return by how much chi-square is smaller with two labels exchanged."""
        gains, left = [], self.outside_fit(self.residuals)
        places = {run.label: i for i, run in enumerate(self.fit.observations.runs)}
        for cause in self._exchanges:
            run, part = self.fit.observations.runs[places[cause.name]], self.fit.run_slices[places[cause.name]]
            usable = np.flatnonzero(run.usable).tolist()
            i, j = (usable.index(point) for point in cause.points)
            moved = self.predictions[cause.name][i] - self.predictions[cause.name][j]
            change = np.array([moved, -moved]) / observed.observed_values(run)[1][[i, j]]
            rows = [part.start + i, part.start + j]
            q = self.subspace[rows]
            gains.append(-float(2 * left[rows] @ change + change @ (change - q @ (q.T @ change))))
        return gains
