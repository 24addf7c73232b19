"""Next best measurement, profile likelihood, and a live fit during a dwell."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from app.identification.specimen_sheet import SpecimenSheet
from benchmarks.campaigns import SHARED, Noise, World, perfect
from model.identification.experiment_design import (
    BetterKnowledge,
    Candidate,
    ExpectedPrecision,
    default_candidates,
    rank_candidates,
)
from model.identification.fit_options import FitCancelled, FitOptions
from model.identification.joint_least_squares import joint_fit
from model.identification.live_fit import LiveFit
from model.identification.observations import (
    FrequencyResponseObservation,
    MembraneSagObservation,
    ObservationSet,
    StaticLoadingObservation,
)
from model.identification.profile_likelihood import profile_interval
from model.membrane import skin
from model.parameter_spec import ParameterError
from model.parameters import Membrane, Tactor
from model.response.harmonic_response import amplifier_response
from model.response.statics import load_compliance
from tests.helpers.model.redrawn import resample

PERFECT = perfect(World(), Noise(), SHARED)
FEW = ObservationSet(tuple(r for r in PERFECT.runs if r.label in ("mfc", "steps", "free")))


def test_the_promise_of_a_candidate_is_kept_when_it_is_measured() -> None:
    fit = joint_fit(FEW)
    (masses,) = (r for r in PERFECT.runs if r.label == "masses")
    (proposal,) = rank_candidates(fit, (Candidate(masses, 60.0),), "k2")
    done = {e.name: e for e in joint_fit(ObservationSet((*FEW.runs, masses))).estimates()}["k2"]
    assert proposal.error_after == pytest.approx(done.standard_error / done.value, rel=0.01)
    assert proposal.error_after < proposal.error_before


@pytest.mark.deep
def test_a_better_ruler_is_a_candidate_and_keeps_its_promise() -> None:
    """With ruler and caliper of the paper; a sweep, which takes a fifth of the time, comes second."""
    options = SpecimenSheet().fit_options(FitOptions(), FEW, plain=True)
    known = dict(options.priors)
    fit = joint_fit(FEW, options)
    best, *_ = rank_candidates(fit, default_candidates(fit, ExpectedPrecision(shared_errors=SHARED)), "k2")
    assert isinstance(best.candidate.run, BetterKnowledge)
    name, error = best.candidate.run.parameter, best.candidate.run.standard_error
    better = joint_fit(FEW, replace(options, priors={**known, name: (known[name][0], error)}))
    done = {e.name: e for e in better.estimates()}["k2"]
    assert best.error_after == pytest.approx(done.standard_error / done.value, rel=0.02)
    assert rank_candidates(fit, default_candidates(fit, ExpectedPrecision()))[0].parameter not in known


@pytest.mark.deep
def test_a_candidate_on_an_unknown_skin_has_the_skin_to_find_as_well() -> None:
    fit = joint_fit(FEW)
    (run,) = (r for r in PERFECT.runs if r.label == "membrane 6.35 mm")
    (proposal,) = rank_candidates(fit, (Candidate(run, 5.0),), "k2")
    free = (*fit.free_parameters, "c_s(6.35 mm)", "k_s(6.35 mm)")
    done = {e.name: e for e in joint_fit(ObservationSet((*FEW.runs, run)), FitOptions(free=free)).estimates()}["k2"]
    assert proposal.error_after == pytest.approx(done.standard_error / done.value, rel=0.02)


def test_the_best_is_what_tells_the_worst_parameter() -> None:
    """E_m without a sag or a dwell on the membrane: unknown, until the membrane hangs."""
    fit = joint_fit(FEW, FitOptions(free=("k2", "mu", "m_add", "c0", "E_m")))
    best, *rest = rank_candidates(fit, default_candidates(fit, ExpectedPrecision(shared_errors=SHARED)))
    assert best.parameter == "E_m"
    assert isinstance(best.candidate.run, MembraneSagObservation | FrequencyResponseObservation)
    assert best.error_before > 1 > best.error_after
    assert "E_m from not identified to ±" in best.summary
    assert "% less a minute" in best.summary
    assert all(a.improvement_per_minute >= b.improvement_per_minute for a, b in zip([best, *rest], rest, strict=False))
    static = next(p for p in rest if isinstance(p.candidate.run, StaticLoadingObservation))
    assert static.error_after == pytest.approx(static.error_before)


def test_longer_is_not_better_per_minute() -> None:
    fit = joint_fit(FEW)
    run = FEW.runs[0]
    quick, slow = rank_candidates(
        fit, (Candidate(replace(run, label="slow"), 100.0), Candidate(replace(run, label="q"), 1.0)), "k2"
    )
    assert quick.candidate.run.label == "q"
    assert quick.error_after == pytest.approx(slow.error_after)


def test_a_plan_without_sense_is_refused() -> None:
    fit = joint_fit(FEW)
    with pytest.raises(ParameterError, match="there is no candidate to choose from"):
        rank_candidates(fit, ())
    with pytest.raises(ParameterError, match="takes 0 minutes"):
        rank_candidates(fit, (Candidate(FEW.runs[0], 0.0),))
    with pytest.raises(ParameterError, match="rho1 was not free"):
        rank_candidates(fit, (Candidate(FEW.runs[0], 1.0),), "rho1")


def test_where_errors_are_small_the_profile_is_the_standard_error() -> None:
    measured, _ = resample(FEW, np.random.default_rng(1))
    fit = joint_fit(measured)
    e = {e.name: e for e in fit.estimates()}["c0"]
    got = profile_interval(fit, "c0")
    assert got.low == pytest.approx(e.value - 1.96 * e.standard_error, abs=0.1 * e.standard_error)
    assert got.high == pytest.approx(e.value + 1.96 * e.standard_error, abs=0.1 * e.standard_error)


def test_the_profile_of_one_nonlinear_parameter_is_known() -> None:
    """One load that determines k2 poorly: the interval is where the deflection is within 1.96 errors, and it is lopsided."""
    w = load_compliance(Tactor())
    run = StaticLoadingObservation("one", np.ones(1), np.array([w]), np.array([0.1 * w]))
    got = profile_interval(joint_fit(ObservationSet((run,))), "k2")
    assert got.low is not None
    assert got.high is not None
    assert load_compliance(Tactor(k2=got.low)) == pytest.approx(1.196 * w, rel=2e-3)
    assert load_compliance(Tactor(k2=got.high)) == pytest.approx(0.804 * w, rel=2e-3)
    assert got.high - 7e-3 > 1.2 * (7e-3 - got.low)


def test_scatter_beyond_the_errors_given_widens_a_profile_as_it_widens_the_standard_error() -> None:
    w = load_compliance(Tactor()) * (1 + 0.005 * np.array([1, -1, 1, -1]))
    fit = joint_fit(ObservationSet((StaticLoadingObservation("scattered", np.ones(4), w, 1e-3 * w),)))
    wide = float(np.sqrt(fit.enlarged_covariance[0, 0]))
    assert wide > 4 * float(np.sqrt(fit.covariance[0, 0]))
    got = profile_interval(fit, "k2")
    assert got.low is not None
    assert got.high is not None
    assert got.high - got.low == pytest.approx(2 * 1.96 * wide, rel=0.02)


def test_what_is_known_beforehand_counts_in_a_profile() -> None:
    """Data and a caliper of equal weight: half the variance."""
    w = load_compliance(Tactor())
    run = StaticLoadingObservation("one", np.ones(1), np.array([w]), np.array([1e-3 * w]))
    alone = joint_fit(ObservationSet((run,)), FitOptions(free=("k2", "c0"), priors={"c0": (159.0, 1.0)}))
    error = alone.estimates()[0].standard_error
    both = joint_fit(
        ObservationSet((run,)), FitOptions(free=("k2", "c0"), priors={"c0": (159.0, 1.0), "k2": (7e-3, error)})
    )
    got = profile_interval(both, "k2")
    assert got.low is not None
    assert got.high is not None
    assert got.high - got.low == pytest.approx(2 * 1.96 * error / np.sqrt(2), rel=0.02)


def test_an_open_side_is_none() -> None:
    """A load that deflects by no more than its error: any stiffer would do."""
    run = StaticLoadingObservation("stiff", np.ones(1), np.array([1e-6]), np.array([5e-5]))
    got = profile_interval(joint_fit(ObservationSet((run,)), FitOptions(start={"k2": 0.1})), "k2")
    assert got.high is None
    with pytest.raises(ParameterError, match="mu was not free"):
        profile_interval(joint_fit(ObservationSet((run,))), "mu")


def test_a_profile_can_be_cancelled() -> None:
    stop = threading.Event()
    stop.set()
    with pytest.raises(FitCancelled):
        profile_interval(joint_fit(FEW), "c0", cancelled=stop.is_set)


@pytest.mark.deep
def test_a_dwell_tells_its_parameters_while_it_runs() -> None:
    truth = Tactor(m_add=8.2e-3, c0=140.0, mu=-1.2e-5)
    f = np.array([25.0, 75, 125, 150, 160, 175, 200, 250])
    F = amplifier_response(truth, f, n=FitOptions.n).fundamental
    live = LiveFit()
    first, *_, last = [live.add_point(*point) for point in zip(f, F, 1e-3 * abs(F), strict=True)]
    assert not first.estimates
    assert "not identifiable yet" in first.message
    assert {e.name: e.value for e in last.estimates} == pytest.approx(
        {"m_add": 8.2e-3, "c0": 140, "mu": -1.2e-5}, rel=1e-6
    )


def test_on_the_membrane_the_skin_is_told() -> None:
    f = np.array([25.0, 75, 125, 150, 175, 200, 250])
    on = skin(Membrane(), 2.54e-3 / 0.17)
    F = amplifier_response(Tactor(), f, skin=on, n=FitOptions.n).fundamental
    live = LiveFit(elongation_m=2.54e-3)
    last = [live.add_point(*point) for point in zip(f, F, 1e-3 * abs(F), strict=True)][-1]
    got = {e.name: e.value for e in last.estimates}
    assert got == pytest.approx({"c_s(2.54 mm)": on.c_s, "k_s(2.54 mm)": on.k_s}, rel=1e-5)


def test_a_point_that_is_none_is_told_and_forgotten() -> None:
    live = LiveFit()
    f = np.array([100.0, 140, 160, 200])
    F = amplifier_response(Tactor(), f).fundamental
    for point in zip(f, F, 1e-3 * abs(F), strict=True):
        before = live.add_point(*point)
    refused = live.add_point(150.0, complex("nan"), 1e-6)
    assert "is not finite at a point that counts as good; flag it" in refused.message
    assert refused.estimates == ()
    assert live.add_point(150.0, F[1], 1e-3).estimates[0].value == pytest.approx(before.estimates[0].value, rel=1e-3)


def test_a_live_fit_that_ends_early_says_so() -> None:
    live = LiveFit(max_evaluations=2)
    ended = live.add_point(150.0, amplifier_response(Tactor(), 150.0).fundamental[0], 1e-6)
    (combination,) = ended.unidentified_combinations
    assert combination.description in ended.message
