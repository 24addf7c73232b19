"""Priors next to a limit, assumed parameters and temperatures: moments by integration, values by their definition."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from model.identification.attribution.model_error import NO_TEMPERATURE, with_temperature_error
from model.identification.fit_options import FitOptions
from model.identification.joint_least_squares import joint_fit
from model.identification.observations import ObservationSet, StaticLoadingObservation
from model.identification.priors import assumed_parameters, normal_equivalents, usual_effects
from model.identification.priors.bounded import near_limit, prior_moments, truncated_moments
from model.identification.uncertainty_budget import uncertainty_budget
from model.parameters import Tactor
from model.response.statics import load_compliance

LOADS = np.array([0.5, 1.0, 2.0, 5.0])


def loading(label: str, tactor: Tactor, temperature_c: float | None) -> StaticLoadingObservation:
    w = load_compliance(tactor) * LOADS
    return StaticLoadingObservation(label, LOADS, w, 1e-4 * w, temperature_c=temperature_c)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("mean", [-20.0, -3.0, 0.0, 0.5, 6.0])
def test_moments_of_a_truncated_normal_distribution(mean: float, side: int) -> None:
    got = truncated_moments(side * mean, 1.0, 0.0, side)
    expected = stats.truncnorm(-mean, np.inf, loc=mean)
    assert got == pytest.approx((side * expected.mean(), expected.std()), rel=1e-4)


def test_far_beyond_a_limit_a_truncated_distribution_is_exponential() -> None:
    assert truncated_moments(-50.0, 1.0, 0.0, 1) == pytest.approx((1 / 50, 1 / 50), rel=1e-3)


def test_only_effects_with_a_sign_have_a_limit() -> None:
    assert near_limit("creep", (0.0, 0.02)) == (0.0, 1)
    assert near_limit("mass_fraction", (1.0, 0.2)) == (1.0, -1)
    assert near_limit("asymmetry", (0.0, 0.05)) is None
    assert near_limit("k2", (7e-3, 1e-3)) is None
    assert prior_moments("creep", (0.0, 0.02)) == pytest.approx(
        (0.02 * (2 / np.pi) ** 0.5, 0.02 * (1 - 2 / np.pi) ** 0.5)
    )


def test_a_normal_prior_in_the_place_of_a_half_gives_its_posterior_mean_and_variance() -> None:
    """Two parameters, one reading y = creep + other with an error of 1: the posterior on a grid against the linear fit."""
    sigma, sigma_other, y = 1.5, 0.8, -0.7
    grid = np.linspace(-6, 8, 1401)
    creep, other = np.meshgrid(grid, grid, indexing="ij")
    density = np.exp(-0.5 * ((y - creep - other) ** 2 + (creep / sigma) ** 2 + (other / sigma_other) ** 2)) * (
        creep >= 0
    )
    density[grid == 0] *= 0.5
    density /= density.sum()
    mean = (density * creep).sum()
    deviation = (density * (creep - mean) ** 2).sum() ** 0.5
    prior = {"creep": (0.0, sigma)}
    start = {"creep": prior_moments("creep", prior["creep"])}

    def linear_fit(m: float, s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        jacobian = np.array([[1.0, 1.0], [1 / s, 0.0], [0.0, 1 / sigma_other]])
        at = np.linalg.lstsq(jacobian, np.array([y, m / s, 0.0]), rcond=None)[0]
        return at, jacobian, np.array([y, m / s, 0.0]) - jacobian @ at

    sites = normal_equivalents(("creep", "other"), prior, start, linear_fit(*start["creep"]))
    at, jacobian, _ = linear_fit(*sites["creep"])
    assert at[0] == pytest.approx(mean, rel=1e-2)
    assert np.linalg.inv(jacobian.T @ jacobian)[0, 0] ** 0.5 == pytest.approx(deviation, rel=1e-2)


def test_a_prior_beside_runs_that_leave_only_rounding_of_it_keeps_a_finite_width() -> None:
    runs = np.array([[1e10], [1 / 0.02]]), np.zeros(2)
    priors = {"creep": (0.0, 0.02)}
    sites = normal_equivalents(("creep",), priors, {"creep": (0.016, 0.012)}, (np.array([0.3]), *runs))
    assert np.isfinite(sites["creep"]).all()
    assert 0 < sites["creep"][1] <= 0.02


def test_readings_against_the_sign_of_an_effect_leave_it_positive_and_small() -> None:
    found = joint_fit(
        ObservationSet((loading("a", Tactor(), None),)),
        FitOptions(free=("k2",), also=("creep",), priors={"creep": (0.0, 0.02), "k2": (6.97e-3, 3e-5)}),
    )
    creep = {e.name: e for e in found.estimates()}["creep"]
    assert 0 < creep.value < 0.02
    assert 0.5 < creep.value / creep.standard_error < 1.5


@pytest.mark.parametrize("share", [0.99, 0.9, 0.5])
def test_a_stiffness_that_contradicts_the_loads_takes_no_effect_beyond_its_limit(share: float) -> None:
    prior = (share * Tactor().k2, 1e-6)
    found = joint_fit(
        ObservationSet((loading("a", Tactor(), None),)),
        FitOptions(
            free=("k2",),
            also=("creep", "clamp_flexibility"),
            priors={"k2": prior, "creep": (0.0, 0.02), "clamp_flexibility": (0.0, 0.02)},
        ),
    )
    assert min(e.value for e in found.estimates()) >= 0


def test_a_parameter_that_neither_sheet_nor_runs_determine_has_a_wide_prior() -> None:
    steps_only = assumed_parameters(ObservationSet((replace(loading("a", Tactor(), None)),)))
    assert "k2" not in steps_only  # loads determine it
    assert set(usual_effects(ObservationSet((loading("a", Tactor(), None),)))) == {"creep", "clamp_flexibility"}


def test_runs_at_two_temperatures_determine_the_coefficient_of_the_stiffness() -> None:
    runs = tuple(loading(f"{t}", Tactor(k2=7e-3 * (1 - 2e-3 * (t - 25))), t) for t in (20.0, 30.0))
    observations = ObservationSet(runs)
    assert observations.reference_c == 25.0
    prior = usual_effects(observations)
    assert prior["k2_per_kelvin"] == (0.0, 1e-3)
    fit = joint_fit(
        observations, FitOptions(free=("k2",), also=("k2_per_kelvin",), priors={"k2_per_kelvin": (0.0, 1e-3)})
    )
    values = {e.name: e.value for e in fit.estimates()}
    assert values["k2"] == pytest.approx(7e-3, rel=1e-3)
    assert values["k2_per_kelvin"] == pytest.approx(-2e-3, rel=0.05)


def test_an_unstated_temperature_is_in_the_totals_as_one_kelvin() -> None:
    fit = joint_fit(ObservationSet((loading("a", Tactor(), None),)), FitOptions(free=("k2",)))
    total = with_temperature_error(fit)
    budget = uncertainty_budget(total)
    k2 = total.estimates()[0]
    assert budget.components[budget.sources.index(NO_TEMPERATURE), 0] == pytest.approx(1e-3 * k2.value)
    assert k2.standard_error == pytest.approx(np.hypot(1e-3 * k2.value, fit.estimates()[0].standard_error))
    stated = joint_fit(ObservationSet((loading("a", Tactor(), 23.0),)), FitOptions(free=("k2",)))
    assert with_temperature_error(stated).further_shifts == ()
