"""The descent along narrow, bent valleys: its minimum is the one found along the valley's floor by another method."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from model import Array
from model.identification.valley_descent import Box, Linearization, descend

STIFF = 1e6
"""The errors across the valley over those along it."""


def residuals(x: Array) -> Array:
    """A valley whose floor is y = sin(2 x) + x^2 / 2, with two priors that pull along it."""
    return np.array([STIFF * (x[1] - np.sin(2 * x[0]) - x[0] ** 2 / 2), x[0] - 3.0, (x[1] - 1.0) / 2])


def slopes(x: Array) -> Array:
    return np.array([[-STIFF * (2 * np.cos(2 * x[0]) + x[0]), STIFF], [1.0, 0.0], [0.0, 0.5]])


def on_floor(x: float) -> Array:
    return np.array([x, np.sin(2 * x) + x**2 / 2])


def run(start: tuple[float, float], box: Box, evaluations: int = 200) -> tuple[Array, bool, int]:
    asked = 0

    def linearize(x: Array) -> Linearization:
        nonlocal asked
        asked += 1
        r = residuals(x)
        return Linearization(float(r @ r), r, slopes(x))

    def values(x: Array) -> tuple[float, Array]:
        r = residuals(x)
        return (float(r @ r) if x[0] < 3.5 else np.inf), r

    return *descend(np.array(start), box, linearize, values, (evaluations, 0.0)), asked


FREE = Box(np.full(2, -np.inf), np.full(2, np.inf), np.ones(2))


def test_the_minimum_along_the_floor_of_a_bent_valley_is_found_in_few_evaluations() -> None:
    end, settled, asked = run((1.5, 8.0), FREE)
    true = minimize_scalar(
        lambda x: float(np.sum(residuals(on_floor(x)) ** 2)),
        bounds=(1.2, 3.4),
        method="bounded",
        options={"xatol": 1e-11},
    )
    assert settled
    assert asked < 60
    np.testing.assert_allclose(end, on_floor(true.x), atol=2e-6)


def test_the_rounding_of_a_large_cost_leaves_the_minimum_as_it_is() -> None:
    def values(x: Array) -> tuple[float, Array]:
        r = np.array([np.exp(x[0]) - 2.0, x[1] - x[0], 1e5])  # differences of the cost below 2e-6 are rounding
        return float(r @ r), r

    def linearize(x: Array) -> Linearization:
        return Linearization(*values(x), np.array([[np.exp(x[0]), 0.0], [-1.0, 1.0], [0.0, 0.0]]))

    end, settled = descend(np.array([2.0, -1.0]), FREE, linearize, values, (200, 0.0))
    assert settled
    np.testing.assert_allclose(end, np.log(2.0), atol=1e-6)


def test_a_limit_holds_a_parameter_and_the_other_is_best_there() -> None:
    end, settled, _ = run((1.5, 8.0), Box(np.array([-np.inf, -np.inf]), np.array([2.0, np.inf]), np.ones(2)))
    assert settled
    assert end[0] == pytest.approx(2.0, abs=1e-9)
    assert end[1] == pytest.approx(on_floor(2.0)[1], abs=1e-5)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(("low", "high", "start"), [(1.5, np.inf, 1.5), (-np.inf, 3.3, 3.3), (1.5, 3.3, 1.5)])
def test_a_start_on_a_limit_leaves_it_for_the_minimum_inside(low: float, high: float, start: float) -> None:
    free, _, _ = run((1.5, 8.0), FREE)
    end, settled, _ = run((start, 8.0), Box(np.array([low, -np.inf]), np.array([high, np.inf]), np.ones(2)))
    assert settled
    np.testing.assert_allclose(end, free, atol=2e-6)


def test_too_few_evaluations_are_told() -> None:
    assert run((1.5, 8.0), FREE, evaluations=3)[1:] == (False, 3)
