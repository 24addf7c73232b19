"""Evidence for each possible cause in the linearized fit, and its distribution under noise alone.

With a cause of the parameters phi, normal with their plausible sizes S, the residuals r that the fit leaves gain the logarithm of a
Bayes factor: half of r' d (1 + d'd)^-1 d' r less half of the logarithm of |1 + d'd|, d being S times what the fit cannot follow of the
effects. The second term is the price of its parameters.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np
from scipy.special import chdtrc, ndtr

from model import Array
from model.identification import observations as observed
from model.identification.attribution.causes import (
    POINT_ERRORS,
    Cause,
    comparable_points,
    exchanged_points,
    exchanges,
    possible_causes,
    several_points,
)
from model.identification.attribution.effects import Effects, Indices
from model.identification.attribution.shapes import relative_to
from model.identification.fit_result import JointFit

DRAWS = 1500
"""Simulated sets of residuals."""
DRAWS_AT_ONCE = 50
"""Sets in memory at a time: with 500 runs, each has 18,000 rows."""
INSIDE_FIT = 1e-6
"""Share of an effect outside the space of the fit, squared, below which the runs cannot show it."""
MOST_POINTS, SHARE_OF_POINTS = 4, 1 / 3
"""Largest number of points of a run that are wrong, each by an error of its own, and their largest share of the run."""
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


def chance_of_first(tests: Array) -> float:
    """Return the Monte Carlo p-value of the first data set for the minimum rank over all tests.

    Args:
        tests: statistics of the data set and of draws of noise, (tests, 1 + draws). Every column is ranked among all of them, the
            first included, so that columns are exchangeable under noise alone.
    """
    ranks = np.array([np.searchsorted(np.sort(-each), -each, side="right") for each in tests])
    least = ranks.min(axis=0)
    return float(np.mean(least <= least[0]))


class Evidence:
    """Evidence for every possible cause of the misfit of a fit."""

    def __init__(self, fit: JointFit) -> None:
        self.fit = fit
        self.residuals: Array = np.where(fit.used_rows, fit.weighted_residuals, 0.0)
        predicted = dict(
            zip([run.label for run in fit.observations.runs], fit.problem.forward_model.predict(fit.theta), strict=True)
        )
        self.predictions = {label: p.values for label, p in predicted.items()}
        k2 = fit.names.index("k2") if "k2" in fit.names else None
        softer = {
            k: -relative_to(p.derivatives[k2] * fit.theta[k2], p.values) for k, p in predicted.items() if k2 is not None
        }
        self.causes = possible_causes(fit, self.predictions, softer)
        """Causes other than exchanges of labels."""
        self._exchanged = exchanged_points(fit)
        self.cause_count = len(self.causes) + sum(map(len, self._exchanged.values()))
        self._effects = Effects(fit, self.causes, self.predictions)
        self._weights, self._prices = self._decompose()

    @cached_property
    def subspace(self) -> Array:
        """Orthonormal basis (rows, k) of the fit's degrees of freedom."""
        J = self.fit.jacobian * self.fit.parameter_scale * self.fit.used_rows[:, None]
        U, s, _ = np.linalg.svd(J, full_matrices=False)
        return np.asarray(U[:, s > 1e-7 * s[0]])

    @cached_property
    def linear(self) -> tuple[CauseEvidence, ...]:
        """Every cause, the likeliest first."""
        gains = self._gains(self.outside_fit(self.residuals)[:, None])[:, 0]
        found = [CauseEvidence(c, float(g), float(p)) for c, g, p in zip(self.causes, gains, self._prices, strict=True)]
        gains = self._exchange_gains()
        found += [CauseEvidence(c, float(g), 0.0) for c, g in zip(exchanges(self._exchanged), gains, strict=True)]
        return tuple(sorted((*found, *self._several_points()), key=lambda e: -e.log_odds))

    def effect(self, cause: Cause) -> Array:
        """Return what a cause adds to the weighted residuals for plausible sizes, (rows, its parameters)."""
        return self._effects.of(cause)

    def outside_fit(self, effect: Array) -> Array:
        """Return the part of effects (rows, ...) that the fit cannot follow."""
        return np.asarray(effect - self.subspace @ (self.subspace.T @ effect))

    def chance(self, probabilities: Sequence[float]) -> float:
        """Return the probability that noise alone gives so significant a test: causes, chi-square, patterns, or other tests.

        Args:
            probabilities: of further tests, independent of the residuals.
        """
        fit, used = self.fit, self.fit.used_rows
        random = np.random.default_rng(0)
        parts = [self._tests(self.residuals[:, None])]
        for first in range(0, DRAWS, DRAWS_AT_ONCE):
            noise = random.standard_normal((min(DRAWS_AT_ONCE, DRAWS - first), used.size)) * used
            parts.append(self._tests(self.outside_fit(np.ascontiguousarray(noise.T))))
        tests = np.concatenate(parts, axis=1)
        own = chance_of_first(tests)
        if own <= len(tests) / (DRAWS + 1):  # as rare as the rarest draws: of chi-square alone the tail is known
            own = min(own, len(tests) * float(chdtrc(max(fit.degrees_of_freedom, 1), tests[1, 0])))
        others = [min(1.0, p) for p in probabilities]
        return float(-np.expm1((1 + bool(others)) * np.log1p(-min(own, *others, 1 - 1e-12))))

    def _tests(self, residuals: Array) -> Array:
        """Return the statistics of residuals (rows, B): the largest odds of a cause, chi-square, and each pattern, (tests, B)."""
        odds = (self._gains(residuals) / 2 - self._handicaps[:, None]).max(axis=0, initial=-np.inf)
        products = residuals[:-1] * residuals[1:] * self._neighbours[:, None]
        sums = np.add.reduceat(products, [part.start for part in self.fit.run_slices], axis=0)
        means, deviations = self._moments
        patterns = (sums[self._patterned] - means) / deviations
        return np.concatenate((odds[None], (residuals**2).sum(axis=0)[None], patterns))

    @cached_property
    def _handicaps(self) -> Array:
        """What the log odds of each cause, (causes,), are less than half its gain."""
        return np.asarray(self._prices - np.array([c.log_prior for c in self.causes]))

    @cached_property
    def _neighbours(self) -> Array:
        """1 for each pair of successive residuals of one run and one component, else 0, (rows - 1,)."""
        pairs = np.zeros(self.residuals.size)
        for part, run in zip(self.fit.run_slices, self.fit.observations.runs, strict=True):
            pairs[part] = 1.0
            pairs[part.stop - 1] = 0.0
            if np.iscomplexobj(self.predictions[run.label]):
                pairs[part.start + (part.stop - part.start) // 2 - 1] = 0.0
        return pairs[:-1]

    @cached_property
    def _moments(self) -> Array:
        """Means and standard deviations under noise alone of the sums of products of neighbours, (2, runs with a pattern, 1)."""
        return np.array([self.pattern(at)[2:] for at in self._patterned]).reshape(-1, 2).T[..., None]

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

    def _decompose(self) -> tuple[dict[int, Array], Array]:
        """Return the form (causes, k, k) of the gains of all causes with k columns, by k, and the price of each cause."""
        forms, prices = dict[int, Array](), np.zeros(len(self.causes))
        for k, (which, grams, inside) in self._effects.grams(self.subspace).items():
            rest = grams - inside
            seen = np.einsum("nii->ni", rest) > INSIDE_FIT * np.einsum("nii->ni", grams)
            values, vectors = np.linalg.eigh(rest * seen[:, :, None] * seen[:, None, :])
            values = np.where(values > 1e-9, values, 0.0)
            shares = np.where(values > 0, 1 / (1 + values), 0.0)
            forms[k] = (vectors * shares[:, None, :]) @ vectors.mT * seen[:, :, None] * seen[:, None, :]
            prices[which] = 0.5 * np.log1p(values).sum(axis=1)
        return forms, prices

    def _gains(self, residuals: Array) -> Array:
        """Return by how much chi-square is smaller with each cause, (causes, B), of residuals outside the fit, (rows, B)."""
        out = np.zeros((len(self.causes), residuals.shape[1]))
        products = self._effects.products(residuals)
        for k, form in self._weights.items():
            which, columns = self._effects.columns[k]
            own = [products[column] for column in columns.T]
            terms = (form[:, i, j, None] * own[i] * own[j] for i in range(k) for j in range(k))
            out[which] = sum(terms, np.zeros((which.size, residuals.shape[1])))
        return out

    def _exchange_gains(self) -> Array:
        """Return by how much chi-square is smaller with each two labels exchanged, (exchanges,)."""
        gains, left = [np.zeros(0)], self.outside_fit(self.residuals)
        for run, part in zip(self.fit.observations.runs, self.fit.run_slices, strict=True):
            if pairs := self._exchanged.get(run.label):
                at = np.searchsorted(np.flatnonzero(run.usable), pairs)
                moved = -np.diff(self.predictions[run.label][at]) * (1.0, -1.0)
                change = moved / observed.observed_values(run)[1][at]
                rows = part.start + at
                followed = np.einsum("nr,nrk->nk", change, self.subspace[rows])
                gains.append(-np.sum(change * (2 * left[rows] + change), axis=1) + np.sum(followed**2, axis=1))
        return np.concatenate(gains)

    def _several_points(self) -> Iterator[CauseEvidence]:
        """Yield for each run sets of two points and more, built up by the point that explains most beside those before it."""
        runs, left = list(comparable_points(self.fit)), self.outside_fit(self.residuals)
        parts = dict(zip((r.label for r in self.fit.observations.runs), self.fit.run_slices, strict=True))
        for run, usable in runs:
            part, count = parts[run.label], len(usable)
            rows = part.start + np.arange(count)[:, None] + np.arange(0, part.stop - part.start, count)
            chosen: list[int] = []
            for size in range(1, min(MOST_POINTS, int(SHARE_OF_POINTS * count)) + 1):
                others = [i for i in range(count) if i not in chosen]
                gains, prices = self._gains_of_rows(left, np.array([rows[[*chosen, i]].ravel() for i in others]))
                best = int(np.argmax(gains))
                chosen.append(others[best])
                if size > 1:
                    among = sum(comb(len(each), size) for _, each in runs)
                    cause = several_points(run.label, [usable[i] for i in chosen], among)
                    yield CauseEvidence(cause, float(gains[best]), float(prices[best]))

    def _gains_of_rows(self, left: Array, rows: Indices) -> tuple[Array, Array]:
        """Return gain and price of errors of their own in each set of rows, (sets, k), of residuals outside the fit, (rows,)."""
        q, r = self.subspace[rows], POINT_ERRORS * left[rows]
        form = np.eye(rows.shape[1]) + POINT_ERRORS**2 * (np.eye(rows.shape[1]) - q @ q.mT)
        gains = np.einsum("nk,nk->n", r, np.linalg.solve(form, r[..., None])[..., 0])
        return gains, 0.5 * np.linalg.slogdet(form)[1]
