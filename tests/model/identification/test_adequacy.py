"""Adequacy: noise is accepted; hysteresis, creep, drift and a compliant clamp are detected, named and sized."""

import re
from dataclasses import replace

import numpy as np
import pytest
from model.identification.model_discrepancy import possible_discrepancies

from benchmarks.campaigns import SHARED, Noise, World, perfect
from model.identification.adequacy import Adequacy, assess_adequacy
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
    ("world", "drives_v", "kind", "truth", "message"),
    [
        (World(hysteresis=0.02), (2.5,), "loop", 0.02, "hysteresis"),
        (World(hysteresis=0.02), (2.5, 1.25), "harmonic", None, "third harmonic"),
        (World(hysteresis=0.04), (2.5, 1.25), "amplitude", 0.04, "at full drive the dwells"),
        (World(creep=0.02), (2.5,), "creep", None, "creep"),
        (World(drift=0.01), (2.5,), "drift", 0.01, "from the first to the last"),
        (World(clamp=15.0), (2.5,), "clamp", 1 / 15, "the clamp turns by"),
    ],
)
def test_what_is_outside_the_model_is_noticed(
    world: World, drives_v: tuple[float, ...], kind: str, truth: float | None, message: str
) -> None:
    verdict = judged(world, drives_v=drives_v)
    assert verdict.adequate is False
    assert verdict.message.startswith("the model is wrong for these runs, most likely because ")
    named = [f for f in verdict.findings if f.kind == kind and message in f.words]
    assert named, [f.words for f in verdict.findings]
    if truth is not None:
        assert named[0].size == pytest.approx(truth, rel=0.3)


@pytest.mark.deep
def test_a_clamp_that_gives_comes_first_among_what_it_causes() -> None:
    assert judged(World(clamp=15.0)).findings[0].kind == "clamp"


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
    assert re.match(r"the misfit is (1\.9|2(\.\d)?) times the errors given but follows no pattern", verdict.message), (
        verdict.message
    )


def test_nothing_left_over_is_no_verdict() -> None:
    run = StaticLoadingObservation("one", np.array([1.0]), np.array([1.4e-4]), np.array([1e-6]))
    assert assess_adequacy(joint_fit(ObservationSet((run,)))).adequate is None


def test_a_departure_of_the_predictions_is_what_its_direction_says() -> None:
    """The tuning direction against a response computed at stretched frequencies."""
    f = np.arange(100.0, 251, 10)
    run = FrequencyResponseObservation("free", f, 1000 * frequency_response(Tactor(), f), 1e-6 * np.ones(f.size))
    fit = joint_fit(ObservationSet((run,)), FitOptions(free=("mu",)))
    tuning = next(d for d in possible_discrepancies(fit) if d.kind == "tuning")
    slow = 1000 * frequency_response(Tactor(), f / 1.001)
    rows = (slow - 1000 * frequency_response(Tactor(), f)) / 1e-6 / 0.001
    assert tuning.direction == pytest.approx(np.concatenate((rows.real, rows.imag)), rel=0.02, abs=6.0)


def test_a_soft_clamp_in_the_closed_form_is_the_one_of_finite_elements() -> None:
    world = World(clamp=10.0)
    f = np.array([0.0, 50, 150, 300])
    spring = 10 * Tactor().k1 / Tactor().L1
    assert exact_response(Tactor(), f, clamp_stiffness=spring) == pytest.approx(world.response(Tactor(), f), rel=1e-5)
    assert abs(exact_response(Tactor(), f, clamp_stiffness=spring)[0] / exact_response(Tactor(), f)[0]) > 1.03


def test_words_of_a_finding_follow_its_sign_and_name_no_other_run_where_there_is_none() -> None:
    loads = np.linspace(0.5, 5, 10)
    for bend, word in ((0.2, "softer"), (-0.2, "stiffer")):
        w = 1.38e-4 * loads * (1 + bend * loads / 5)
        run = StaticLoadingObservation("static", loads, w, 1e-7 * np.ones(10))
        found = assess_adequacy(joint_fit(ObservationSet((run,)), FitOptions(free=("k2",)))).findings
        (words,) = (f.words for f in found if f.kind == "bend")
        assert re.fullmatch(
            rf"static is [\d.]+ ± \S+ % {word} at its largest load than at none: it is not linear", words
        )
    heavy = MassResonanceObservation("m", np.array([2e-3, 5e-3, 9e-3]), np.array([400.0, 280, 210]), 0.1 * np.ones(3))
    gains = [d for d in possible_discrepancies(joint_fit(ObservationSet((heavy,)))) if d.kind == "gain"]
    assert [d.describe(-0.14, 0.01) for d in gains] == [
        "m resonates 14.0 ± 1.0 % lower than the parameters that are held allow"
    ]
