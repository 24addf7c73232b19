"""Comparison of series: interpolation to common places, normalised values, difference and ratio with combined uncertainty.

Assumed of the uncertainties: statistical errors of two runs are independent; the relative error of the sensor's gain is one number
for each run, with a correlation of 1 between runs of the same sensor in the same state of calibration, and of 0 between others. A gain
error that is common to both runs therefore cancels in a ratio, and acts on a difference in proportion to it.
Between two points of the reference, the curve may leave the straight line by half its second difference; a third of the square of
that bound is added to the variance (rectangular distribution, JCGM 100:2008, 4.3.7).
"""

import math
from dataclasses import replace
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from model.arrays import Array
from model.series import Series, SeriesAxis


class Relation(StrEnum):
    """What is shown of a series, some in relation to a reference."""

    VALUES = "values"
    NORMALISED = "normalised"
    """Over the largest value of its own."""
    DIFFERENCE = "difference"
    """Less the reference."""
    RATIO = "ratio"
    """Over the reference."""

    @property
    def has_reference(self) -> bool:
        """Whether it needs a reference."""
        return self in (Relation.DIFFERENCE, Relation.RATIO)


class GainErrors(NamedTuple):
    """Relative standard uncertainties of the sensor's gain in a run and in its reference, and their correlation, 0..1."""

    own: float = 0.0
    reference: float = 0.0
    correlation: float = 0.0


EXACT: Final = GainErrors()

NEAR: Final = 1e-3
"""Share of a step by which a place may lie outside the points: sources play a frequency within their resolution."""


def rising(series: Series) -> Series:
    """Return the usable finite values at rising x as moduli; values at equal x are averaged."""
    good = series.fit_rows & np.isfinite(series.x) & np.isfinite(series.plotted)
    x, group = np.unique(series.x[good], return_inverse=True)
    count = np.bincount(group, minlength=x.size)
    y = np.bincount(group, series.plotted[good], x.size) / np.maximum(count, 1)

    def of_means(errors: Array | None) -> Array | None:
        return None if errors is None else np.sqrt(np.bincount(group, errors[good] ** 2, x.size)) / count

    return Series(
        x, y, of_means(series.errors), x_axis=series.x_axis, y_axis=series.y_axis, name=series.name, label=series.label,
        role=series.role, entry=series.entry,
    )  # fmt: skip


def interpolated(series: Series, x: Array) -> Series:
    """Return a rising series at places x, (N,): linear between its points, NaN outside them by more than `NEAR` of a step.

    Errors are those of the two neighbours, and of the line in place of a curve between them; None if the series has none.
    """
    known, y = series.x, series.plotted
    if known.size < 2:
        same = np.isclose(x, known[0], rtol=1e-9, atol=0.0) if known.size else np.zeros(x.size, bool)
        errors = None if series.errors is None else np.where(same, series.errors[:1] if known.size else np.nan, np.nan)
        return replace(series, x=x, y=np.where(same, y[0] if known.size else np.nan, np.nan), errors=errors)
    left = np.clip(np.searchsorted(known, x, "right") - 1, 0, known.size - 2)
    step = known[left + 1] - known[left]
    share = (x - known[left]) / step
    inside = (share >= -NEAR) & (share <= 1 + NEAR)
    share = np.clip(share, 0.0, 1.0)
    values = np.where(inside, (1 - share) * y[left] + share * y[left + 1], np.nan)
    if series.errors is None:
        return replace(series, x=x, y=values)
    bends = np.abs(np.diff(np.diff(y) / np.diff(known)) / (known[2:] - known[:-2])) if known.size > 2 else np.zeros(0)
    bend = np.maximum(np.append(0.0, np.append(bends, 0.0))[left], np.append(bends, (0.0, 0.0))[left])
    line = share * (1 - share) * step**2 * bend / math.sqrt(3)
    errors = np.sqrt(((1 - share) * series.errors[left]) ** 2 + (share * series.errors[left + 1]) ** 2 + line**2)
    return replace(series, x=x, y=values, errors=np.where(inside, errors, np.nan))


def related(series: Series, relation: Relation, reference: Series | None = None, gains: GainErrors = EXACT) -> Series:
    """Return the usable values of a series in a relation, at its own places, with statistical and total errors.

    Values at which the reference has none are NaN, as is a ratio to zero. The reference in relation to itself is 0 or 1 without errors.

    Raises:
        ValueError: the relation has a reference, and none is given.
    """
    own = rising(series)
    if relation is Relation.VALUES:
        return _with_total(own, gains.own * np.abs(own.plotted))
    if relation is Relation.NORMALISED:
        return _normalised(own)
    if reference is None:
        raise ValueError(f"a {relation} needs a reference; name one")
    base = interpolated(rising(reference), own.x)
    a, b = own.plotted, base.plotted
    same = series is reference
    errors = None if own.errors is None or base.errors is None else (own.errors, base.errors)
    cross = 2 * gains.correlation * gains.own * gains.reference
    if relation is Relation.DIFFERENCE:
        variance = np.maximum((gains.own * a) ** 2 + (gains.reference * b) ** 2 - cross * a * b, 0.0)
        statistical = None if errors is None else np.hypot(*errors)
        result, common = replace(own, y=a - b), np.sqrt(variance)
    else:
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(b != 0, a / np.where(b != 0, b, 1.0), np.nan)
            # The forms of a ratio's error that stay finite where the numerator is 0.
            statistical = None if errors is None else np.hypot(errors[0] / b, ratio * errors[1] / b)
        spread = max(gains.own**2 + gains.reference**2 - cross, 0.0)
        result, common = replace(own, y=ratio, y_axis=_pure(own, "ratio")), np.abs(ratio) * math.sqrt(spread)
    if same:
        statistical, common = None if statistical is None else 0.0 * a, 0.0 * a
    return _with_total(replace(result, errors=statistical), common)


def _normalised(own: Series) -> Series:
    """Return values over their largest, which has no error of its own: it is 1 by definition, and a gain cancels."""
    if not own.x.size or (top := int(own.plotted.argmax())) < 0 or own.plotted[top] == 0:
        return replace(own, y=np.full(own.x.size, np.nan), errors=None, y_axis=_pure(own, "share of the largest"))
    share = own.plotted / own.plotted[top]
    errors = None
    if own.errors is not None:
        errors = np.hypot(own.errors, share * own.errors[top]) / abs(own.plotted[top])
        errors[top] = 0.0
    return _with_total(replace(own, y=share, errors=errors, y_axis=_pure(own, "share of the largest")), 0.0 * share)


def _pure(own: Series, name: str) -> SeriesAxis:
    return SeriesAxis(
        f"{own.y_axis.name}_{name.replace(' ', '_')}", "1", f"{own.y_axis.name.replace('_', ' ')}, {name}"
    )


def _with_total(series: Series, common: Array) -> Series:
    total = None if series.errors is None else np.hypot(series.errors, common)
    return replace(series, total_errors=total, usable=None, fit=None, coherence=None)
