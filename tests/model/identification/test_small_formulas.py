"""Vertex of a parabola and text of a probability, by numbers worked out by hand."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import ncx2

from model.identification import adequacy
from model.identification.adequacy import noncentral_chi_square_tail
from model.identification.fit_result import format_p_value
from model.identification.paper_chain import parabola_vertex


def test_the_vertex_of_a_parabola_through_three_points() -> None:
    x = np.array([1.0, 2.0, 4.0])
    assert parabola_vertex(x, 7.0 - 3.0 * (x - 2.5) ** 2) == pytest.approx((2.5, 7.0))


@pytest.mark.parametrize("curvature", [0.0, 2.0])
def test_three_points_without_a_top_give_the_middle_one(curvature: float) -> None:
    x = np.array([1.0, 2.0, 4.0])
    assert parabola_vertex(x, 3.0 * x + curvature * (x - 9.0) ** 2) == pytest.approx((2.0, 6.0 + 49.0 * curvature))


@pytest.mark.parametrize(
    ("probability", "digits", "text"),
    [(0.0123, None, "p = 0.01"), (0.0123, 2, "p = 0.012"), (0.0, None, "p < 1e-300"), (0.5, None, "p = 0.5")],
)
def test_a_probability_has_one_digit_unless_more_are_asked_for(
    probability: float, digits: int | None, text: str
) -> None:
    assert (format_p_value(probability) if digits is None else format_p_value(probability, digits)) == text


@pytest.mark.parametrize(
    ("value", "degrees", "noncentrality"), [(3.0, 2, 0.0), (40.0, 36, 5.0), (900.0, 72, 200.0), (9e4, 400, 8e4)]
)
def test_the_tail_of_a_noncentral_chi_square_is_scipys(value: float, degrees: int, noncentrality: float) -> None:
    expected = float(ncx2.sf(value, degrees, max(noncentrality, 1e-12)))
    assert 0 < noncentral_chi_square_tail(value, degrees, noncentrality) == pytest.approx(expected, rel=1e-9)


def test_each_harmonic_is_compared_with_its_own_prediction(monkeypatch: pytest.MonkeyPatch) -> None:
    orders_m = 1e-4 * np.array([1.0, 0.1, 0.05, 0.02, 0.01])
    monkeypatch.setattr(adequacy, "_receptances", lambda *_: [np.ones(5)])
    monkeypatch.setattr(adequacy, "_acting_volts", lambda _fit, _run, k: np.full(5, orders_m[k - 1]))
    run = SimpleNamespace(
        label="dwell", harmonics_m=np.tile(orders_m, (6, 1)), usable=np.arange(6) != 2, errors_m=None,
        harmonic_errors_m=np.full(6, 1e-8), fundamental_m=np.full(6, 1e-4),
    )  # fmt: skip
    run.harmonics_m[2] = 1.0  # of a point that is not usable
    fit: Any = SimpleNamespace(observations=SimpleNamespace(of_type=lambda _: [run]))
    assert [finding.probability > 0.3 for finding in adequacy._harmonic_tests(fit)] == [True] * 4
    run.harmonics_m[:, 2] *= 1.5
    assert [finding.probability > 0.3 for finding in adequacy._harmonic_tests(fit)] == [True, False, True, True]
