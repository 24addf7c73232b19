"""Standard errors of robust fits with outliers, and errors enlarged run by run; the data come from the closed form."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.campaigns import elements
from model.identification.adequacy import assess_adequacy
from model.identification.fit_options import FitOptions
from model.identification.joint_least_squares import joint_fit
from model.identification.misfit_scale import LOSS_SCALES, influence_moments, robust_scale
from model.identification.observations import (
    FrequencyResponseObservation,
    ObservationSet,
    StaticLoadingObservation,
    VoltageStepsObservation,
)
from model.parameters import Tactor
from model.response.closed_form import exact_response

T = Tactor()
F = np.linspace(40.0, 250, 18)
TRUTH = 1000 * exact_response(T, F)
LOADS = np.array([0.2, 0.5, 1.0, 2.0, 5.0])
PER_NEWTON = elements(T, np.zeros(1), None, np.inf, load=True)[0].real
PER_VOLT = elements(T, np.zeros(1), None, np.inf)[0].real
FREE = ("k2", "mu", "m_add", "c0")


def dwells(seed: int, outliers: int, runs: int = 7) -> ObservationSet:
    """126 points in seven dwells with errors of 0.3 % + 0.3 um; some of the points are off by 10 % (one sigma)."""
    rng = np.random.default_rng((3, seed))
    bad = rng.choice(runs * F.size, outliers, replace=False)
    error = 0.003 * abs(TRUTH) + 3e-7
    made = []
    for i in range(runs):
        y = TRUTH + error * (rng.standard_normal(F.size) + 1j * rng.standard_normal(F.size))
        at = bad[bad // F.size == i] % F.size
        y[at] *= 1 + 0.1 * rng.standard_normal(at.size)
        made.append(FrequencyResponseObservation(f"dwell {i}", F, y, error))
    return ObservationSet(tuple(made))


@pytest.mark.parametrize("loss", ["cauchy", "soft_l1"])
def test_normal_data_lose_five_percent_of_their_information(loss: str) -> None:
    a, b = influence_moments(loss, 1.0)  # type: ignore[arg-type]
    assert b / a**2 == pytest.approx(1.05, abs=0.005)
    assert set(LOSS_SCALES) == {"linear", "cauchy", "soft_l1"}
    assert influence_moments("linear", 2.0) == (1.0, 4.0)


def test_a_robust_scale_is_not_moved_by_outliers() -> None:
    r = 3 * np.random.default_rng(1).standard_normal(200)
    r[:5] = 1000
    assert robust_scale(r, 200) == pytest.approx(3, rel=0.15)
    assert robust_scale(r / 3, 200) == 1.0


@pytest.mark.deep
@pytest.mark.parametrize("loss", ["cauchy", "soft_l1"])
def test_a_prior_in_conflict_with_the_data_keeps_its_weight_in_a_robust_fit(loss: str) -> None:
    options = FitOptions(free=FREE, priors={"c0": (3 * T.c0, 0.02 * T.c0)}, loss=loss)  # type: ignore[arg-type]
    fit = joint_fit(dwells(1, 0, 2), options)
    at = fit.names.index("c0")
    assert abs(fit.weighted_residuals[-1]) > 3
    assert abs(fit.jacobian[-1, at]) == pytest.approx(1 / (0.02 * T.c0))


@pytest.mark.deep
@pytest.mark.parametrize("outliers", [0, 1, 3])
@pytest.mark.parametrize("loss", ["cauchy", "soft_l1"])
def test_the_stated_error_of_a_robust_fit_is_its_scatter(loss: str, outliers: int) -> None:
    """60 campaigns of 126 points: rms z is 1, with 0, 1 and 3 outliers."""
    z = []
    for seed in range(60):
        fit = joint_fit(dwells(seed, outliers), FitOptions(free=("mu", "m_add", "c0"), loss=loss, n=20))  # type: ignore[arg-type]
        z.append([(e.value - getattr(T, e.name)) / e.standard_error for e in fit.estimates()])
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1, abs=0.15)


@pytest.mark.deep
def test_an_outlier_of_a_robust_fit_is_named_and_left_out_of_the_verdict() -> None:
    runs = list(dwells(1, 0, runs=3).runs)
    y = np.array(runs[1].fundamental_m)  # type: ignore[union-attr]
    y[9] *= 1.15
    runs[1] = replace(runs[1], fundamental_m=y)  # type: ignore[call-arg]
    data = ObservationSet(tuple(runs))
    robust, plain = (
        joint_fit(data, FitOptions(free=("mu", "m_add", "c0"), loss=loss, n=20)) for loss in ("cauchy", "linear")
    )  # type: ignore[arg-type]
    assert "without 2 outlying residuals (dwell 1)" in robust.verdict
    assert robust.error_scale == 1
    assert robust.residuals[1].outliers == (9,)
    assert assess_adequacy(robust).adequate
    assert not assess_adequacy(plain).adequate


def test_errors_are_enlarged_in_the_run_that_needs_it_and_not_in_the_others() -> None:
    """The loads deflect the two sides 4 % differently; coupling, mass and damping come from other runs."""
    rng = np.random.default_rng(4)
    w = PER_NEWTON * np.tile(LOADS, 4)
    sides = [
        StaticLoadingObservation(
            side,
            np.tile(LOADS, 4),
            w * (1 + sign * 0.04) * (1 + 0.002 * rng.standard_normal(w.size)),
            0.002 * w,
            "both",
        )
        for side, sign in (("up", 1), ("down", -1))
    ]
    levels = np.tile([0.5, 1.5, 3.5, 4.5], 3)
    V = np.where(levels < 2.5, 200 * (levels - 2.5), 600 * (levels - 2.5))
    moved = PER_VOLT * V * (1 + 0.002 * rng.standard_normal(V.size))
    steps = VoltageStepsObservation("steps", levels, moved, 0.002 * abs(PER_VOLT * V))
    fit = joint_fit(ObservationSet((*sides, steps, *dwells(1, 0, runs=1).runs)), FitOptions(free=FREE, n=20))
    scale = {r.label: r.error_scale for r in fit.residuals}
    assert scale["up"] > 10
    assert scale["down"] > 10
    assert scale["steps"] == scale["dwell 0"] == 1
    plain = np.sqrt(np.diag(fit.covariance))
    factor = dict(zip(fit.names, np.sqrt(np.diag(fit.enlarged_covariance)) / plain, strict=True))
    assert factor["c0"] < 0.7 * fit.error_scale
    assert "(up)" in fit.verdict
    assert "(steps)" not in fit.verdict
    assert "standard errors are enlarged by that, run by run, " in fit.verdict


def test_errors_that_explain_the_misfit_are_left_alone() -> None:
    fit = joint_fit(dwells(2, 0, runs=2), FitOptions(free=("mu", "m_add", "c0"), n=20))
    assert fit.run_error_scales == (1.0, 1.0)
    assert fit.enlarged_covariance is fit.covariance
