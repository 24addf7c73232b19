"""Uncertainty bands: linearised and sampled propagation agree."""

import numpy as np
import pytest

from model.parameters import Tactor
from model.response.statics import voltage_gain
from model.specimen import Specimen
from model.studies.parameter_study import Study
from model.studies.uncertainty import EstimateSet, linear_band
from tests.helpers.sampled import model_curve, sampled_band

STUDY = Study({}, tuple(np.linspace(20, 250, 47)))
SMALL = EstimateSet(("k2", "c0", "mu"), (7e-3, 159.0, -1.33e-5), np.diag([5e-5, 3.0, 1e-7]) ** 2)


def test_the_band_of_a_line_is_known() -> None:
    """y = a + b x with correlated a and b."""
    S = np.array([[0.04, -0.01], [-0.01, 0.01]])
    x = np.linspace(0, 5, 6)
    est = EstimateSet(("c0", "c_s_0"), (3.0, 2.0), S)
    band = linear_band(lambda v: v["c0"][:, None] + v["c_s_0"][:, None] * x, est, coverage=0.95)
    assert band.standard_error == pytest.approx(np.sqrt(0.04 - 0.02 * x + 0.01 * x**2))
    assert band.upper - band.centre == pytest.approx(1.959964 * band.standard_error)
    assert band.centre == pytest.approx(3 + 2 * x)


def test_linear_and_sampled_bands_agree_for_small_errors() -> None:
    curve = model_curve(STUDY)
    linear, sampled = linear_band(curve, SMALL), sampled_band(curve, SMALL, draws=4000)
    assert sampled.centre == pytest.approx(linear.centre)
    assert sampled.standard_error == pytest.approx(linear.standard_error, rel=0.05)
    assert sampled.lower == pytest.approx(linear.lower, abs=0.25 * linear.standard_error.max())
    assert sampled.upper == pytest.approx(linear.upper, abs=0.25 * linear.standard_error.max())


def test_the_coupling_alone_gives_its_relative_error() -> None:
    est = EstimateSet(("mu",), (-1.33e-5,), np.array([[(1.33e-7) ** 2]]))
    band = linear_band(model_curve(Study({}, (0.5,))), est)
    assert band.standard_error / band.centre == pytest.approx(0.01, rel=1e-6)
    assert band.centre == pytest.approx(2000 * voltage_gain(Tactor()), rel=2e-3)


def test_at_a_physical_limit_the_derivative_is_taken_inwards() -> None:
    est = EstimateSet(("c_s", "c0"), (0.0, 159.0), np.diag([1.0, 3.0]) ** 2)
    linear = linear_band(model_curve(STUDY), est)
    assert (linear.standard_error > 0).all()
    both_sides = linear_band(model_curve(STUDY), EstimateSet(("c_s", "c0"), (1e-3, 159.0), np.diag([1.0, 3.0]) ** 2))
    assert linear.standard_error == pytest.approx(both_sides.standard_error, rel=1e-3)


def test_estimates_replace_the_specimens_values() -> None:
    soft = Study({}, STUDY.frequency_hz, Specimen(Tactor(k2=5e-3, c0=100.0)))
    assert linear_band(model_curve(soft), SMALL).centre == pytest.approx(STUDY.run().values)
