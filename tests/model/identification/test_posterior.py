"""Posterior by Monte Carlo, and the distance of the paper's chain: against distributions and effects that are known."""

import numpy as np
import pytest

from benchmarks.campaigns import Noise, World, perfect
from model.identification.fit_options import FitCancelled, FitOptions
from model.identification.joint_least_squares import joint_fit
from model.identification.nonidealities import LOADING_TIME_S
from model.identification.observations import ObservationSet, StaticLoadingObservation
from model.identification.paper_chain import PaperChainOptions, chain_differences, identify_by_paper_chain
from model.identification.posterior import sample_posterior
from model.parameter_spec import ParameterError
from model.parameters import Tactor
from model.response.lag import REFERENCE_S
from model.response.statics import load_compliance
from tests.helpers.laboratory import Laboratory, measure

LOADS = np.array([0.5, 1.0, 2.0, 5.0])
DEFLECTIONS = load_compliance(Tactor()) * LOADS
RUNS = ObservationSet((StaticLoadingObservation("a", LOADS, DEFLECTIONS, 3e-3 * DEFLECTIONS),))


def test_where_the_problem_is_linear_the_posterior_is_the_linear_fit() -> None:
    fit = joint_fit(RUNS, FitOptions(free=("k2",), also=("load_gain",), priors={"load_gain": (0.0, 2e-3)}))
    posterior = sample_posterior(fit, 400)
    assert posterior.failed == 0
    assert posterior.independent > 300
    assert posterior.ratios == pytest.approx(1.0, abs=0.12)
    assert posterior.shifts == pytest.approx(0.0, abs=0.2)
    assert posterior.correlation[0, 1] == pytest.approx(posterior.linear_correlation[0, 1], abs=0.1)


def test_a_posterior_next_to_a_limit_is_the_truncated_distribution() -> None:
    """k2 is known and the loads say no creep: half of a normal distribution, with the interval from its quantiles."""
    options = FitOptions(free=("k2",), also=("creep",), priors={"k2": (7e-3, 1e-8), "creep": (0.0, 0.02)})
    fit = joint_fit(RUNS, options)
    posterior = sample_posterior(fit, 600)
    (i,) = (posterior.names.index("creep"),)
    decades = np.log10(LOADING_TIME_S / REFERENCE_S)
    error = 1 / np.hypot(1 / 0.02, 2 * decades / 3e-3)  # four readings
    assert posterior.draws[:, i].min() >= 0
    assert posterior.means[i] == pytest.approx(error * (2 / np.pi) ** 0.5, rel=0.1)
    low, high = posterior.interval("creep")
    assert (low, high) == pytest.approx((0.0313 * error, 2.241 * error), rel=0.2)


def test_a_robust_fit_has_no_posterior_and_a_stop_is_obeyed() -> None:
    with pytest.raises(ParameterError):
        sample_posterior(joint_fit(RUNS, FitOptions(free=("k2",), loss="cauchy")))
    with pytest.raises(FitCancelled):
        sample_posterior(joint_fit(RUNS, FitOptions(free=("k2",))), cancelled=lambda: True)


@pytest.mark.deep
def test_the_distance_of_the_chain_is_told_with_the_effects_it_leaves_out() -> None:
    """The masses act with 80 % of their weight: the chain, which has no such share, takes them as they are."""
    observations = measure(Laboratory(mass_fraction=0.8), 3, small=True)
    fit = joint_fit(observations, FitOptions(n=20, also=("mass_fraction",), priors={"mass_fraction": (1.0, 0.2)}))
    chain = identify_by_paper_chain(observations, PaperChainOptions(n=20))
    found = {d.name: d for d in chain_differences(chain.values, observations, PaperChainOptions(n=20), fit)}
    assert abs(found["k2"].sigmas) > 3
    assert found["k2"].parts[0][0] == "mass_fraction"
    assert found["k2"].parts[0][1] == pytest.approx(found["k2"].share, rel=0.3)
    assert "mass_fraction" in found["k2"].reasons


def test_a_chain_on_runs_without_effects_agrees_with_the_joint_fit() -> None:
    observations = perfect(World(), Noise(), ())
    fit = joint_fit(observations, FitOptions())
    chain = identify_by_paper_chain(observations, PaperChainOptions())
    for d in chain_differences(chain.values, observations, PaperChainOptions(), fit):
        assert abs(d.share) < 0.01, d.name
