"""Control charts of single values over time: Shewhart with Western Electric and Nelson rules, and EWMA.

Sources: NIST/SEMATECH e-Handbook of Statistical Methods, 6.3.2 (rules of Western Electric and trends), 6.3.2.2 (individuals, sigma from
the moving range) and 6.3.2.4 (EWMA); the rules are numbered as by L. S. Nelson, Journal of Quality Technology 16 (1984) 237.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model import Array

MOVING_RANGE_D2 = 1.128
"""Mean range of two normal values in standard deviations."""
BASELINE = 20
"""Values that set centre and sigma, where no other number is given."""
MIN_BASELINE = 8
LASTING = 4.0
"""Standard errors between the means before and after the most likely step beyond which a change is a lasting one."""
EWMA_WEIGHT, EWMA_WIDTH = 0.2, 3.0
"""Weight of the newest value, and width of the limits in standard deviations."""

RULES = {
    "beyond 3 sigma": "Western Electric 1, Nelson 1: one value beyond 3 sigma",
    "2 of 3 beyond 2 sigma": "Western Electric 2, Nelson 5: two of three values beyond 2 sigma on one side",
    "4 of 5 beyond 1 sigma": "Western Electric 3, Nelson 6: four of five values beyond 1 sigma on one side",
    "8 on one side": "Western Electric 4: eight values in a row on one side (Nelson 2 takes nine)",
    "6 in one direction": "Nelson 3: six values in a row rising, or falling",
    "EWMA": "moving average with exponential weights beyond its limits",
}
"""Rules of a signal, each with its source."""


VALUES_PER_FALSE_ALARM = 92
"""Values after which the four rules of Western Electric signal by chance, on average (e-Handbook 6.3.2)."""


class TooFewValuesError(ValueError):
    """A control chart has no baseline; the message states the number of values that it needs."""


@dataclass(frozen=True, slots=True)
class Signal:
    """A rule is broken at a value."""

    index: int
    rule: str


@dataclass(frozen=True)
class ControlChart:
    """Centre and sigma of the baseline, and signals.

    Attributes:
        values: values in order of time.
        baseline: number of first values that define centre and sigma; they are judged as well.
        sigma: sigma of a single value, from the moving range of the baseline.
        average: EWMA, a value for each.
        average_limit: distance of the EWMA's limits from the centre, a value for each.
        signals: every broken rule, by value.
    """

    values: Array
    baseline: int
    centre: float
    sigma: float
    average: Array
    average_limit: Array
    signals: tuple[Signal, ...]

    @cached_property
    def rules(self) -> Mapping[int, Sequence[str]]:
        """Names of the rules that are broken, by the index of the value."""
        broken: dict[int, list[str]] = {}
        for signal in self.signals:
            broken.setdefault(signal.index, []).append(signal.rule)
        return broken

    @property
    def in_control(self) -> bool:
        return not self.signals

    @property
    def first_signal(self) -> int:
        """Index of the first value that breaks a rule; the number of values if none does."""
        return min((signal.index for signal in self.signals), default=len(self.values))

    @cached_property
    def onset(self) -> int:
        """Index of the first value after the most likely step of the mean; 0 if the values have no lasting change.

        The maximum likelihood estimate for a step at an unknown time (D. V. Hinkley, Biometrika 57 (1970) 1).
        """
        if self.in_control:
            return 0
        n = self.values.size
        k = np.arange(1, n)
        sums = np.cumsum(self.values - self.centre)
        difference = (sums[-1] - sums[:-1]) / (n - k) - sums[:-1] / k
        score = np.abs(difference) / (self.sigma * np.sqrt(1 / k + 1 / (n - k)))
        top = int(score.argmax())
        return top + 1 if score[top] > LASTING else 0

    def change(self, since: int) -> tuple[float, float]:
        """Return the mean from a value on less that before, relative to the centre, with its standard error."""
        before, later = self.values[:since], self.values[since:]
        error = self.sigma * math.sqrt(1 / later.size + 1 / before.size)
        return float(later.mean() - before.mean()) / abs(self.centre), error / abs(self.centre)


def control_chart(values: Array, baseline: int = BASELINE) -> ControlChart:
    """Return the chart of values in their order of time.

    Args:
        values: one or more for each time; at least as many as the baseline's least number.
        baseline: first values that set centre and sigma; fewer if there are fewer.

    Raises:
        TooFewValuesError: there are too few values, or the baseline does not scatter.
    """
    values = np.asarray(values, float)
    baseline = min(baseline, values.size)
    if baseline < MIN_BASELINE:
        raise TooFewValuesError(
            f"a control chart needs {MIN_BASELINE} values for its baseline, and there are {baseline}"
        )
    first = values[:baseline]
    centre, sigma = float(first.mean()), float(np.abs(np.diff(first)).mean()) / MOVING_RANGE_D2
    if sigma <= 0:
        raise TooFewValuesError(f"the first {baseline} values are all the same, which gives no limits")
    z = (values - centre) / sigma
    average = moving_average(values, centre)
    steps = np.arange(1, values.size + 1)
    share = EWMA_WEIGHT / (2 - EWMA_WEIGHT) * (1 - (1 - EWMA_WEIGHT) ** (2 * steps))
    limit = EWMA_WIDTH * sigma * np.sqrt(share)
    broken = {
        "beyond 3 sigma": np.abs(z) > 3,
        "2 of 3 beyond 2 sigma": _count_of(z, 2, 3, 2.0),
        "4 of 5 beyond 1 sigma": _count_of(z, 4, 5, 1.0),
        "8 on one side": _count_of(z, 8, 8, 0.0),
        "6 in one direction": _monotonic(values, 6),
        "EWMA": np.abs(average - centre) > limit,
    }
    signals = sorted(
        (Signal(int(i), rule) for rule, mask in broken.items() for i in np.flatnonzero(mask)),
        key=lambda signal: (signal.index, list(RULES).index(signal.rule)),
    )
    return ControlChart(values, baseline, centre, sigma, average, limit, tuple(signals))


def moving_average(values: Array, start: float, weight: float = EWMA_WEIGHT) -> Array:
    """Return the average with exponential weights after each value, from a start value on."""
    average = np.empty_like(values)
    last = start
    for i, value in enumerate(values):
        average[i] = last = weight * value + (1 - weight) * last
    return average


def _count_of(z: Array, least: int, of: int, beyond: float) -> Array:
    """Return a mask of values that are the last of `of` values, `least` of them beyond on the value's own side."""
    matches = np.zeros(z.shape, bool)
    for side in (1.0, -1.0):
        out = side * z > beyond
        sums = np.convolve(out, np.ones(of, int))[: z.size]
        matches |= (sums >= least) & out
    return matches


def _monotonic(values: Array, length: int) -> Array:
    """Return a mask of values that end `length` values which only rise, or only fall."""
    matches = np.zeros(values.shape, bool)
    steps = np.diff(values)
    for direction in (1.0, -1.0):
        sums = np.convolve(direction * steps > 0, np.ones(length - 1, int))[: steps.size]
        matches[1:] |= sums >= length - 1
    return matches
