"""Errors of inputs (weights, masses, levels, elongations, frequencies): they enter every fit, once for each input.

The data come from finite elements and the closed form, which share nothing with the model of the fit.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.campaigns import LOADS_N, MASSES_KG, elements, peak_hz
from model.identification.fit_options import FitOptions
from model.identification.joint_least_squares import joint_fit
from model.identification.observations import (
    FrequencyResponseObservation,
    MassResonanceObservation,
    Observation,
    ObservationSet,
    SharedError,
    StaticLoadingObservation,
    VoltageStepsObservation,
    over_errors,
)
from model.identification.residuals import LeastSquaresProblem
from model.membrane import skin
from model.parameter_spec import ParameterError
from model.parameters import Membrane, Tactor
from model.response.closed_form import exact_response

T = Tactor()
PER_NEWTON = elements(T, np.zeros(1), None, np.inf, load=True)[0].real
PER_VOLT = elements(T, np.zeros(1), None, np.inf)[0].real
LEVELS = np.array([0.5, 1.5, 4.0])
FREQUENCIES = np.array([60.0, 100.0, 130.0, 150.0, 165.0, 180.0, 210.0])
ELONGATIONS = (1.27e-3, 3.81e-3, 6.35e-3)


def single_errors(target: str, values: np.ndarray, size: float) -> tuple[SharedError, ...]:
    return tuple(SharedError(f"{target} {x:g}", target, size, at=float(x)) for x in values)  # type: ignore[arg-type]


def static(rng: np.random.Generator) -> tuple[Observation, ...]:
    """Five weights of 1 %, ten times each on both sides; the reading's own error is a tenth of a percent."""
    loads = LOADS_N * (1 + 0.01 * rng.standard_normal(LOADS_N.size))
    each = np.tile(loads, 10)
    runs = []
    for side in ("mfc", "aluminium"):
        w = PER_NEWTON * each
        w = w * (1 + 1e-3 * rng.standard_normal(w.size))
        weights = single_errors("load", LOADS_N, 0.01)
        runs.append(
            StaticLoadingObservation(side, np.tile(LOADS_N, 10), w, 1e-3 * abs(w), side, shared_errors=weights)  # type: ignore[arg-type]
        )
    return tuple(runs)


def masses(rng: np.random.Generator) -> tuple[Observation, ...]:
    off = 2e-4 * rng.standard_normal(MASSES_KG.size)
    f = np.array([peak_hz(lambda x, m=m: exact_response(replace(T, m_add=m), x)) for m in MASSES_KG + off])
    f = np.concatenate((f, f)) + 0.05 * rng.standard_normal(2 * f.size)
    errors = single_errors("mass", MASSES_KG, 2e-4)
    return (MassResonanceObservation("m", np.tile(MASSES_KG, 2), f, np.full(f.size, 0.05), shared_errors=errors),)


def steps(rng: np.random.Generator) -> tuple[Observation, ...]:
    level = np.tile(LEVELS + 0.05 * rng.standard_normal(LEVELS.size), 5)
    V = np.where(level < 2.5, 200 * (level - 2.5), 600 * (level - 2.5))
    w = PER_VOLT * V + 1e-7 * rng.standard_normal(V.size)
    errors = single_errors("level", LEVELS, 0.05)
    return (VoltageStepsObservation("v", np.tile(LEVELS, 5), w, np.full(w.size, 1e-7), shared_errors=errors),)


def dwell(rng: np.random.Generator, width: bool = False) -> tuple[Observation, ...]:
    f = FREQUENCIES + 0.5 * rng.standard_normal(FREQUENCIES.size)
    F = 1000 * exact_response(T, f)
    F = F + 1e-7 * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
    errors = single_errors("frequency", FREQUENCIES, 0.5)
    return (FrequencyResponseObservation("f", FREQUENCIES, F, np.full(f.size, 1e-7), shared_errors=errors),)


def stretched(rng: np.random.Generator) -> tuple[Observation, ...]:
    runs = []
    for e in ELONGATIONS:
        there = e + 1e-4 * rng.standard_normal()
        F = 1000 * exact_response(T, FREQUENCIES, skin(Membrane(), there / Membrane().L_m, tactor=T))
        F = F + 1e-7 * (rng.standard_normal(F.size) + 1j * rng.standard_normal(F.size))
        error = (SharedError(f"elongation {e:g}", "elongation", 1e-4, at=e),)
        runs.append(
            FrequencyResponseObservation(
                f"s {e:g}", FREQUENCIES, F, np.full(F.size, 1e-7), elongation_m=e, shared_errors=error
            )
        )
    return tuple(runs)


CASES: dict[str, tuple[Callable[..., tuple[Observation, ...]], tuple[str, ...]]] = {
    "weights": (static, ("k2",)),
    "masses": (masses, ("k2",)),
    "levels": (steps, ("mu",)),
    "frequencies": (dwell, ("mu", "m_add", "c0")),
    "elongations": (stretched, ("E_m", "c_s_0", "c_s_delta")),
}
TRUTH = {
    name: getattr(T, name, None) or getattr(Membrane(), name, None)
    for name in ("k2", "mu", "m_add", "c0", "E_m", "c_s_0", "c_s_delta")
}


def fitted(case: str, seed: int) -> list[float]:
    make, free = CASES[case]
    fit = joint_fit(ObservationSet(make(np.random.default_rng((5, seed)))), FitOptions(free=free, n=20))
    return [(e.value - float(TRUTH[e.name])) / e.standard_error for e in fit.estimates()]  # type: ignore[arg-type]


@pytest.mark.deep
@pytest.mark.parametrize("case", CASES)
def test_stated_errors_of_inputs_are_the_scatter(case: str) -> None:
    """40 specimens measured with wrong weights, masses, levels, frequencies, elongations: rms z is 1."""
    z = np.array([fitted(case, seed) for seed in range(40)])
    assert abs(np.sqrt((z**2).mean()) - 1) < 0.25
    assert (abs(z) < 1.96).mean() > 0.88


def test_five_weights_are_five_errors_not_a_hundred() -> None:
    (error,) = (
        e.standard_error / e.value
        for e in joint_fit(ObservationSet(static(np.random.default_rng(1))), FitOptions(free=("k2",))).estimates()
    )
    up, down = (elements(replace(T, k2=T.k2 * x), np.zeros(1), None, np.inf, load=True)[0].real for x in (1.01, 0.99))
    share = abs(up - down) / (0.02 * PER_NEWTON)  # of the compliance that is k2's
    assert error == pytest.approx(0.01 / np.sqrt(5) / share, rel=0.05)


@pytest.mark.deep
@pytest.mark.parametrize("case", CASES)
def test_slopes_to_the_errors_of_inputs_are_those_of_the_predictions(case: str) -> None:
    make, free = CASES[case]
    runs = make(np.random.default_rng(0))
    if case == "frequencies":  # max - min, too
        f = np.array([60.0, 80.0])
        errors = single_errors("frequency", f, 0.5)
        w = np.full(2, 1e-6)
        runs += (
            FrequencyResponseObservation("w", f, peak_to_peak_m=w, peak_to_peak_errors_m=w, shared_errors=errors[1:]),
        )
    problem = LeastSquaresProblem(ObservationSet(runs), FitOptions(free=free))
    theta = problem.start.copy()
    shared = problem.observations.shared_errors
    steps = {n: 1e-4 * e.standard_error for n, e in shared.items()}
    for i, name in enumerate(problem.names):
        if name in shared:
            theta[i] = 0.3 * shared[name].standard_error
    _, J = problem.evaluate(theta)
    for i, name in enumerate(problem.names):
        if name in shared:
            ends = [problem.evaluate(theta + side * steps[name] * (np.arange(theta.size) == i))[0] for side in (1, -1)]
            numeric = (ends[1] - ends[0]) / (2 * steps[name])
            assert J[:, i] == pytest.approx(numeric, rel=1e-3, abs=1e-5 * abs(numeric).max()), name


def test_an_elongation_of_nothing_has_an_error_too() -> None:
    error = SharedError("elongation", "elongation", 1e-4, at=0.0)
    F = 1000 * exact_response(T, FREQUENCIES, skin(Membrane(), 0.0, tactor=T))
    run = FrequencyResponseObservation(
        "s", FREQUENCIES, F, np.full(F.size, 1e-7), elongation_m=0.0, shared_errors=(error,)
    )
    problem = LeastSquaresProblem(ObservationSet((run,)), FitOptions(free=("c_s_0",)))
    (low, middle, high) = (problem.evaluate(np.array([165.0, x]))[0][:-1] for x in (-1e-4, 0.0, 1e-4))
    assert np.linalg.norm(high - middle) > 10
    assert high - middle == pytest.approx(middle - low, rel=0.3, abs=0.1 * abs(high - middle).max())


def test_a_phase_with_an_error_of_its_own_weighs_by_it() -> None:
    F = np.array([1e-4 + 1e-4j, 2e-4j])
    run = FrequencyResponseObservation(
        "p", np.array([100.0, 150]), F, 1e-6 * np.ones(2), phase_errors_rad=0.1 * np.ones(2)
    )
    turned = over_errors(run, 1e-3j * F)  # a milliradian later
    assert turned == pytest.approx([0, 0, 0.01, 0.01], abs=1e-9)
    longer = over_errors(run, 1e-6 * F / abs(F))
    assert longer == pytest.approx([1, 1, 0, 0], abs=1e-9)


def test_a_gain_has_no_single_input() -> None:
    with pytest.raises(ParameterError, match="cannot act at 2 only"):
        SharedError("gain", "displacement", 0.01, at=2.0)
