"""Adequacy: noise is accepted; hysteresis, creep, drift and a compliant clamp are detected, named and sized."""

import re
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.campaigns import SHARED, Noise, World, perfect
from model.identification.adequacy import Adequacy, assess_adequacy
from model.identification.attribution.evidence import Evidence, chance_of_first
from model.identification.fit_options import FitOptions
from model.identification.joint_least_squares import joint_fit
from model.identification.observations import (
    FrequencyResponseObservation,
    MassResonanceObservation,
    ObservationSet,
    StaticLoadingObservation,
)
from model.parameters import Tactor
from model.response.closed_form import exact_response
from model.response.harmonic_response import frequency_response
from tests.helpers.model.redrawn import resample


def judged(world: World, seed: int = 1, drives_v: tuple[float, ...] = (2.5,)) -> Adequacy:
    measured, _ = resample(perfect(world, Noise(), SHARED, drives_v), np.random.default_rng(seed))
    return assess_adequacy(joint_fit(measured, FitOptions(n=20)))


@pytest.mark.deep
def test_noise_is_called_noise() -> None:
    """One alarm in twenty campaigns is what the tests promise; three are tried here, some hundred in docs/attribution-matrix.md."""
    campaign = perfect(World(), Noise(), SHARED)
    verdicts = []
    for seed in range(3):
        measured, _ = resample(campaign, np.random.default_rng(seed))
        verdicts.append(assess_adequacy(joint_fit(measured, FitOptions(n=20))))
    assert sum(not v.adequate for v in verdicts) == 0
    assert "the misfit is noise: none of" in verdicts[0].message
    assert verdicts[0].test_count > 60


@pytest.mark.deep
@pytest.mark.parametrize(
    ("world", "drives_v", "cause", "truth"),
    [
        (World(hysteresis=0.02), (2.5,), "hysteresis", 0.02),
        (World(hysteresis=0.04), (2.5, 1.25), "hysteresis", 0.04),
        (World(creep=0.02), (2.5,), "creep", 0.015),
        (World(drift=0.01), (2.5,), "gain_drift", 0.01),
        (World(clamp=15.0), (2.5,), "clamp_flexibility", 1 / 15),
    ],
)
def test_an_effect_outside_the_model_is_named_with_its_size(
    world: World, drives_v: tuple[float, ...], cause: str, truth: float
) -> None:
    verdict = judged(world, drives_v=drives_v)
    assert verdict.adequate is False
    assert verdict.message.startswith("the model is wrong for these runs, most likely because ")
    assert verdict.diagnosis is not None
    named = {e.cause.title: e for e in verdict.diagnosis.likeliest}
    assert named[cause].size == pytest.approx(truth, rel=0.3)
    assert all(e.check for e in verdict.diagnosis.likeliest)


@pytest.mark.deep
def test_hysteresis_is_seen_in_the_third_harmonic_without_a_dwell_at_another_drive() -> None:
    findings = judged(World(hysteresis=0.02)).findings
    assert any(f.kind == "harmonic" and "third harmonic" in f.text for f in findings)


@pytest.mark.deep
@pytest.mark.parametrize("seed", [1, 2])
def test_errors_that_are_too_small_are_not_called_a_wrong_model(seed: int) -> None:
    """All noise is twice what the runs state."""
    campaign, _ = resample(perfect(World(), Noise(), ()), np.random.default_rng(seed))
    hopeful = []
    for run in campaign.runs:
        name = "errors_hz" if isinstance(run, MassResonanceObservation) else "errors_m"
        hopeful.append(replace(run, **{name: getattr(run, name) / 2}))
    verdict = assess_adequacy(joint_fit(ObservationSet(tuple(hopeful)), FitOptions(n=20)))
    assert verdict.adequate is False
    assert re.match(r"the misfit is (1\.9|2(\.\d)?) times the errors given but follows none of", verdict.message), (
        verdict.message
    )


def test_nothing_left_over_is_no_verdict() -> None:
    run = StaticLoadingObservation("one", np.array([1.0]), np.array([1.4e-4]), np.array([1e-6]))
    assert assess_adequacy(joint_fit(ObservationSet((run,)))).adequate is None


def test_a_finding_is_as_probable_as_the_best_of_all_tests() -> None:
    """Bonferroni: the probability of one test, times their number."""
    loads = np.linspace(0.5, 5, 40)
    run = StaticLoadingObservation("static", loads, 1.38e-4 * loads * (1 + 0.004 * loads), np.full(40, 1.8e-6))
    fit = joint_fit(ObservationSet((run,)), FitOptions(free=("k2",)))
    found = assess_adequacy(fit, attribute=False)
    ((_, _, _, p),) = Evidence(fit).patterns()
    assert [f.probability for f in found.findings] == pytest.approx([p * found.test_count], rel=1e-6, abs=0)


def test_the_effect_of_a_time_base_is_the_one_of_stretched_frequencies() -> None:
    """The linearized effect against a response computed at other frequencies."""
    f = np.arange(100.0, 251, 10)
    measured = 1000 * frequency_response(Tactor(), f)
    runs = [FrequencyResponseObservation(name, f, measured, 1e-6 * np.ones(f.size)) for name in ("free", "again")]
    evidence = Evidence(joint_fit(ObservationSet(tuple(runs)), FitOptions(free=("mu",), n=7)))
    cause = next(c for c in evidence.causes if c.title == "time base of free")
    size = cause.errors[0].error.standard_error
    rows = (1000 * frequency_response(Tactor(), f * 1.0001) - measured) / 1e-6 / 1e-4
    effect = evidence.effect(cause)[: 2 * f.size, 0] / size
    assert effect == pytest.approx(np.concatenate((rows.real, rows.imag)), rel=0.01, abs=3.0)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(("factor", "adequate"), [(1.02, True), (0.98, True), (1.3, False)])
def test_a_harmonic_of_the_amplifiers_slopes_is_expected_to_three_percent(factor: float, adequate: bool) -> None:
    """Of 200 and 600 V/V the second harmonic of a sine is 2 (600 - 200) / (3 pi) V per volt: Fourier series of a half wave."""
    f = np.arange(30.0, 131, 20)
    per_volt = 4 / (3 * np.pi) * 200 * 2.0
    second = factor * np.abs(per_volt * frequency_response(Tactor(), 2 * f))
    run = FrequencyResponseObservation(
        "run",
        f,
        800 * frequency_response(Tactor(), f),
        np.full(f.size, 1e-10),
        2.0,
        harmonics_m=np.column_stack((second, second)),
    )
    found = assess_adequacy(joint_fit(ObservationSet((run,)), FitOptions(free=("mu",), n=7)), attribute=False)
    assert found.adequate is adequate


def test_a_soft_clamp_in_the_closed_form_is_the_one_of_finite_elements() -> None:
    world = World(clamp=10.0)
    f = np.array([0.0, 50, 150, 300])
    spring = 10 * Tactor().k1 / Tactor().L1
    assert exact_response(Tactor(), f, clamp_stiffness=spring) == pytest.approx(world.response(Tactor(), f), rel=1e-5)
    assert abs(exact_response(Tactor(), f, clamp_stiffness=spring)[0] / exact_response(Tactor(), f)[0]) > 1.03


@pytest.mark.parametrize(("bend", "word"), [(0.2, "more"), (-0.2, "less")])
def test_the_text_of_a_cause_has_its_sign(bend: float, word: str) -> None:
    loads = np.linspace(0.5, 5, 10)
    w = 1.38e-4 * loads * (1 + bend * loads / 5)
    run = StaticLoadingObservation("static", loads, w, 1e-7 * np.ones(10))
    diagnosis = assess_adequacy(joint_fit(ObservationSet((run,)), FitOptions(free=("k2",)))).diagnosis
    assert diagnosis is not None
    first = diagnosis.likeliest[0]
    assert first.cause.title == "softening under load"
    assert first.size == pytest.approx(bend, rel=1e-3)
    assert re.match(rf"the loadings: the deflection is [\d.]+ ± \S+ % {word} at the largest reading than", first.text)


def test_the_chance_of_the_rarest_of_many_tests_is_uniform_under_noise() -> None:
    """Ranked among the draws alone, while each draw counts itself, 6.8 % lie below 5 %."""
    random, draws, repeats = np.random.default_rng(28), 99, 4000
    chances = np.array([chance_of_first(random.standard_normal((2, draws + 1))) for _ in range(repeats)])
    levels = np.array([0.05, 0.1, 0.2, 0.5])
    shares = np.mean(chances[:, None] <= levels + 1e-9, axis=0)
    assert (shares <= levels + 3 * np.sqrt(levels * (1 - levels) / repeats)).all(), shares
    assert (shares > levels - 0.02).all(), shares
