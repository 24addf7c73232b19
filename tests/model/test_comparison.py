"""Comparison of series: against sums written out value by value, and against the scatter of simulated gains and noise."""

import math
from bisect import bisect_right

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from model import GainErrors, Relation, Series, interpolated, related, rising

SIZES = st.floats(1e-6, 1e-3)
FREQUENCIES = st.lists(st.integers(1, 400), min_size=2, max_size=12, unique=True)


@st.composite
def measured(draw: st.DrawFn) -> Series:
    x = np.array(draw(FREQUENCIES), float)
    y = draw(arrays(float, x.size, elements=SIZES))
    return Series(x, y, draw(arrays(float, x.size, elements=st.floats(0.0, 1e-5))))


def line_by_hand(series: Series, at: float) -> float:
    pairs = sorted(zip(series.x.tolist(), series.y.tolist(), strict=True))
    if not pairs[0][0] <= at <= pairs[-1][0]:
        return math.nan
    i = min(bisect_right([x for x, _ in pairs], at), len(pairs) - 1) - 1
    (x0, y0), (x1, y1) = pairs[i], pairs[i + 1]
    return y0 + (y1 - y0) * (at - x0) / (x1 - x0)


@given(measured(), measured())
def test_differences_and_ratios_are_those_written_out_value_by_value(a: Series, b: Series) -> None:
    difference, ratio = (related(a, relation, b) for relation in (Relation.DIFFERENCE, Relation.RATIO))
    assert difference.x.tolist() == sorted(a.x.tolist())
    for at, less, over in zip(difference.x, difference.y, ratio.y, strict=True):
        own, base = line_by_hand(a, at), line_by_hand(b, at)
        assert less == pytest.approx(own - base, abs=1e-15, nan_ok=True)
        assert over == pytest.approx(own / base, rel=1e-9, nan_ok=True)


@given(measured())
def test_a_run_over_itself_is_one_without_error_and_its_largest_is_one(a: Series) -> None:
    gains = GainErrors(0.01, 0.01, 1.0)
    ratio, difference = related(a, Relation.RATIO, a, gains), related(a, Relation.DIFFERENCE, a, gains)
    assert ratio.y.tolist() == pytest.approx([1.0] * a.x.size)
    assert not np.any(ratio.total_errors)
    assert not np.any(difference.y)
    assert not np.any(difference.total_errors)
    share = related(a, Relation.NORMALISED)
    assert share.y.max() == 1.0
    assert share.errors is not None
    assert share.errors[share.y.argmax()] == 0.0


@given(measured(), st.floats(0.5, 2.0))
def test_a_gain_of_the_same_sensor_cancels_in_a_ratio_and_two_sensors_add_theirs(a: Series, factor: float) -> None:
    b = Series(a.x, factor * a.y, np.zeros(a.x.size))
    a = Series(a.x, a.y, np.zeros(a.x.size))
    same, other = (related(a, Relation.RATIO, b, GainErrors(0.01, 0.01, r)) for r in (1.0, 0.0))
    assert same.total_errors == pytest.approx(0.0, abs=1e-9)
    assert other.total_errors == pytest.approx(np.full(a.x.size, 0.01 * math.sqrt(2) / factor), rel=1e-6)


@pytest.mark.parametrize("correlation", [0.0, 1.0])
@pytest.mark.parametrize("relation", [Relation.DIFFERENCE, Relation.RATIO])
def test_the_combined_uncertainty_is_the_scatter_of_repeated_measurements(
    relation: Relation, correlation: float
) -> None:
    """A hundred thousand measurements with noise and gains drawn anew, at places half way between the reference's points."""
    dice = np.random.default_rng(5)
    x, true_a, true_b = np.array([1.5, 2.5]), np.array([2.0, 5.0]), np.array([4.0, 6.0, 8.0])
    gain_a = dice.normal(0, 0.01, 100_000)
    gain_b = gain_a if correlation else dice.normal(0, 0.01, 100_000)
    a = (true_a + dice.normal(0, 0.02, (100_000, 2))) * (1 + gain_a[:, None])
    b = (true_b + dice.normal(0, 0.03, (100_000, 3))) * (1 + gain_b[:, None])
    middle = (b[:, :-1] + b[:, 1:]) / 2
    scatter = (a - middle if relation is Relation.DIFFERENCE else a / middle).std(axis=0)
    one = Series(x, true_a, np.full(2, 0.02))
    reference = Series(np.array([1.0, 2.0, 3.0]), true_b, np.full(3, 0.03))
    result = related(one, relation, reference, GainErrors(0.01, 0.01, correlation))
    assert result.total_errors == pytest.approx(scatter, rel=0.02)


def test_a_peak_between_two_points_of_the_reference_is_in_the_uncertainty() -> None:
    f = np.arange(50.0, 251.0, 25.0)

    def response(at: np.ndarray) -> np.ndarray:
        return np.asarray(1.0 / np.hypot(1 - (at / 160) ** 2, 0.44 * at / 160))

    coarse = Series(f, response(f), np.zeros(f.size))
    fine = np.arange(60.0, 240.0, 1.0)
    line = interpolated(rising(coarse), fine)
    assert line.errors is not None
    assert np.abs(line.y - response(fine)).max() > 0.02
    assert (np.abs(line.y - response(fine)) <= 3 * line.errors + 1e-12).all()


def test_repeats_are_averaged_unusable_points_left_out_and_nothing_is_extrapolated() -> None:
    usable = np.array([True, True, True, False])
    points = rising(
        Series(np.array([2.0, 1.0, 2.0, 3.0]), np.array([4.0, 1.0, 6.0, 9.0]), np.full(4, 0.2), usable=usable)
    )
    assert points.x.tolist() == [1.0, 2.0]
    assert points.y.tolist() == [1.0, 5.0]
    assert points.errors == pytest.approx([0.2, 0.2 / math.sqrt(2)])
    assert np.isnan(interpolated(points, np.array([0.9, 2.1])).y).all()
    lone = interpolated(rising(Series(np.array([2.0]), np.array([4.0]), np.array([0.1]))), np.array([1.0, 2.0]))
    assert lone.y.tolist() == pytest.approx([math.nan, 4.0], nan_ok=True)


def test_without_errors_there_is_no_uncertainty_and_without_a_reference_no_ratio() -> None:
    bare = Series(np.array([1.0, 2.0]), np.array([1.0, 0.0]))
    known = Series(np.array([1.0, 2.0]), np.array([1.0, 2.0]), np.array([0.1, 0.1]))
    assert related(known, Relation.RATIO, bare).total_errors is None
    assert related(known, Relation.RATIO, bare).y.tolist() == pytest.approx([1.0, math.nan], nan_ok=True)
    zero = related(bare, Relation.NORMALISED).at(slice(1, 2))
    assert zero.y.tolist() == [0.0]
    assert np.isnan(related(Series(bare.x, 0 * bare.y), Relation.NORMALISED).y).all()
    with pytest.raises(ValueError, match="difference"):
        related(known, Relation.DIFFERENCE)
