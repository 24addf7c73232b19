"""Statistics of many specimens: mean, spread, outliers, capability against limits, trend.

Formulas: NIST/SEMATECH e-Handbook of Statistical Methods (doi.org/10.18434/M32189); each function names its section.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from model import COVERAGE_FACTOR_95, Array

MAX_MODIFIED_Z = 3.5
"""Modified z-score beyond which a value is a possible outlier."""
MAD_TO_SIGMA = 0.6745
"""Median absolute deviation of a normal distribution in its standard deviations."""
MEAN_DEVIATION_TO_SIGMA = 1.253314
MIN_FOR_OUTLIERS = 5
"""Fewest values for the detection of outliers."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean and spread of values.

    Attributes:
        sd: standard deviation, NaN for a single value.
        mean_uncertainty: root mean square of the values' total uncertainties: the scatter by measurement alone.
        median: of the values.
    """

    count: int
    mean: float
    sd: float
    median: float
    lowest: float
    highest: float
    mean_uncertainty: float

    @property
    def true_sd(self) -> float:
        """Spread of the specimens without the measurement's part; 0 if measurement explains all of it."""
        return math.sqrt(max(self.sd**2 - self.mean_uncertainty**2, 0.0)) if self.count > 1 else math.nan


def spread_of(values: Array, uncertainties: Array) -> Spread:
    """Return mean and spread of one or more values (e-Handbook 1.3.5.1 and 1.3.5.6)."""
    sd = float(values.std(ddof=1)) if values.size > 1 else math.nan
    return Spread(
        int(values.size),
        float(values.mean()),
        sd,
        float(np.median(values)),
        float(values.min()),
        float(values.max()),
        float(np.sqrt(np.mean(np.square(uncertainties)))),
    )


def outlier_mask(values: Array) -> Array:
    """Return a mask of possible outliers: modified z-score above 3.5 (e-Handbook 1.3.5.17, after Iglewicz and Hoaglin).

    Where more than half of the values agree, the mean absolute deviation takes the place of the median's.
    """
    if values.size < MIN_FOR_OUTLIERS:
        return np.zeros(values.shape, bool)
    deviation = np.abs(values - np.median(values))
    sigma = float(np.median(deviation)) / MAD_TO_SIGMA or MEAN_DEVIATION_TO_SIGMA * float(deviation.mean())
    return np.asarray(deviation > MAX_MODIFIED_Z * sigma) if sigma else np.zeros(values.shape, bool)


@dataclass(frozen=True, slots=True)
class Capability:
    """Capability against limits, with a 95 % interval.

    Attributes:
        ppk: by the overall spread.
        cpk: by the spread within batches; NaN where no batch has two specimens.
        ppk_error, cpk_error: half of their 95 % intervals.
        outside: number of values beyond the limits.
    """

    ppk: float
    ppk_error: float
    cpk: float
    cpk_error: float
    outside: int


def capability(values: Array, batches: Sequence[str], low: float | None, high: float | None) -> Capability:
    """Return Cpk = min(high - mean, mean - low) / (3 sigma) with its interval (e-Handbook 6.1.6).

    Sigma of Cpk is the pooled standard deviation within batches, of Ppk the standard deviation of all values.
    """
    mean = float(values.mean())
    lowest, highest = -math.inf if low is None else low, math.inf if high is None else high
    room = min(highest - mean, mean - lowest)
    beyond = (values < lowest) | (values > highest)
    overall = float(values.std(ddof=1)) if values.size > 1 else math.nan
    within, freedom = _pooled_sd(values, batches)
    ppk, ppk_error = _index(room, overall, values.size, values.size - 1)
    cpk, cpk_error = _index(room, within, values.size, freedom)
    return Capability(ppk, ppk_error, cpk, cpk_error, int(beyond.sum()))


def _index(room: float, sigma: float, count: int, freedom: int) -> tuple[float, float]:
    """Return room / (3 sigma) and half of its 95 % interval, z * sqrt(1 / (9 n) + C^2 / (2 nu)) (e-Handbook 6.1.6)."""
    if not (sigma > 0 and freedom > 0 and math.isfinite(room)):
        return math.nan, math.nan
    index = room / (3 * sigma)
    return index, COVERAGE_FACTOR_95 * math.sqrt(1 / (9 * count) + index**2 / (2 * freedom))


def _pooled_sd(values: Array, batches: Sequence[str]) -> tuple[float, int]:
    """Return the standard deviation within batches and its degrees of freedom."""
    groups: dict[str, list[float]] = {}
    for value, batch in zip(values.tolist(), batches, strict=True):
        groups.setdefault(batch, []).append(value)
    parts = [(np.var(group, ddof=1), len(group) - 1) for group in groups.values() if len(group) > 1]
    freedom = sum(n for _, n in parts)
    return (math.sqrt(sum(v * n for v, n in parts) / freedom), freedom) if freedom else (math.nan, 0)


@dataclass(frozen=True, slots=True)
class Trend:
    """Straight line through values over time: slope per 30 days with its standard error."""

    per_month: float
    error: float

    @property
    def is_significant(self) -> bool:
        """Whether the slope exceeds two of its standard errors."""
        return abs(self.per_month) > COVERAGE_FACTOR_95 * self.error


MONTH_S = 30 * 86400.0


def trend_of(times_s: Array, values: Array) -> Trend | None:
    """Return the least-squares slope over time (e-Handbook 4.1.4.1); None of fewer than three times."""
    if np.unique(times_s).size < 3:
        return None
    t = (times_s - times_s.mean()) / MONTH_S
    total = float(np.sum(t * t))
    slope = float(np.sum(t * (values - values.mean())) / total)
    rest = values - values.mean() - slope * t
    return Trend(slope, math.sqrt(float(np.sum(rest * rest)) / (values.size - 2) / total))


def by_group(values: Array, uncertainties: Array, groups: Sequence[str]) -> Mapping[str, Spread]:
    """Return mean and spread of each group, sorted by name."""
    names = np.asarray(groups, object)
    return {name: spread_of(values[names == name], uncertainties[names == name]) for name in sorted(set(groups))}
