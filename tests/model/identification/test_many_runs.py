"""Many runs of one specimen: shared points are computed once, and the results are those of runs taken one by one."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.campaigns import SHARED, Noise, World, perfect
from model import AmplifierMap, Tactor
from model.identification import FitOptions, FrequencyResponseObservation, ObservationSet
from model.identification.attribution.evidence import Evidence
from model.identification.joint_least_squares import joint_fit
from model.identification.observations import Observation, SharedError, conditions_of, over_errors
from model.identification.receptance import frequency_nodes
from model.identification.residuals import LeastSquaresProblem
from model.response import exact_response, fourier_series

FREE = ("k2", "mu", "m_add", "c0", "E_m", "c_s_0", "c_s_delta")
KINDS = {"mass from", "clamp from", "mass of", "scale", "drift", "point", "mount", "parameter"}
"""Kinds of causes whose effects are stored in different forms."""
EFFECTS = {"creep": 0.01, "hysteresis": 0.02, "stiffening": 0.003, "gain_drift": 0.01, "clamp_flexibility": 0.01}


def repeated(repeats: int = 3, scatter: float = 1.0) -> ObservationSet:
    """A campaign whose free dwell was repeated with new noise, with points left out and once clamped anew."""
    rng, few = np.random.default_rng(5), perfect(World(), Noise(), SHARED)
    dwell = next(r for r in few.runs if isinstance(r, FrequencyResponseObservation) and r.elongation_m is None)
    runs: list[Observation] = list(few.runs)
    for i in range(repeats):
        y = dwell.fundamental_m + scatter * dwell.errors_m * (
            rng.standard_normal(dwell.frequency_hz.size) + 1j * rng.standard_normal(dwell.frequency_hz.size)
        )
        run = replace(dwell, label=f"again {i}", fundamental_m=y, good=rng.random(y.size) > 0.2, order=float(i))
        if i == 1:
            again = SharedError("clamped anew", "clamp", 0.02)
            run = replace(run, shared_errors=(*run.shared_errors, again))
        if i == 2:
            shape = np.linspace(0, 1, y.size)
            drift = SharedError("drift", "reading", 0.02)
            run = replace(run, shared_errors=(*run.shared_errors, drift), shapes={"drift": shape})
        runs.append(run)
    return ObservationSet(tuple(runs))


@pytest.mark.parametrize("effects", [(), tuple(EFFECTS)])
def test_each_run_has_the_prediction_that_it_has_alone(effects: tuple[str, ...]) -> None:
    observations = repeated()
    problem = LeastSquaresProblem(observations, FitOptions(free=FREE, also=effects))
    theta = problem.start.copy()
    for name, size in {**EFFECTS, "clamped anew": 0.01, "drift": 0.01}.items():
        if name in problem.names:
            theta[problem.names.index(name)] = size
    together = problem.forward_model.predict(theta)
    residuals, slopes = problem.evaluate(theta)
    ends = np.cumsum([2 * p.values.size if np.iscomplexobj(p.values) else p.values.size for p in together])
    dwells = observations.of_type(FrequencyResponseObservation)
    first = next(r for r in dwells if r.label == "again 0")
    times = [float(np.max(r.order)) for r in dwells if r.order is not None]
    for run, got, stop in zip(observations.runs, together, ends, strict=True):
        if not run.label.startswith("again"):
            continue
        # the clock of a drift begins and ends with the same runs
        beside = (
            [replace(first, label=f"{run.label}, {at}", order=at) for at in (min(times), max(times))] if effects else []
        )
        alone = LeastSquaresProblem(
            ObservationSet((run, *beside)), FitOptions(free=FREE, also=effects, per_elongation=False)
        )
        own = [theta[problem.names.index(name)] for name in alone.names]
        single = alone.forward_model.predict(np.array(own))[0]
        assert got.values == pytest.approx(single.values, rel=1e-12)
        place = [problem.names.index(name) for name in alone.names]
        assert got.derivatives[place] == pytest.approx(single.derivatives, rel=1e-9, abs=1e-15)
        rows = over_errors(run, single.derivatives).T
        assert slopes[stop - len(rows) : stop, place] == pytest.approx(rows, rel=1e-9, abs=1e-9)
    assert np.isfinite(residuals).all()


def test_points_that_runs_share_are_computed_once() -> None:
    observations = repeated()
    conditions = [c for c in conditions_of(observations) if "again 0" in c.places]
    assert len(conditions) == 1
    assert "again 1" not in conditions[0].places, "it was clamped anew"
    points = sum(at.size for at in conditions[0].places.values())
    assert points > 3 * conditions[0].run.frequency_hz.size


def test_nearly_equal_measured_frequencies_are_solved_together_and_predicted_each_by_itself() -> None:
    """Every run has its own measured frequencies and drives, as from a card; the closed form knows nothing of groups."""
    dwell = next(r for r in repeated().runs if r.label == "again 0")
    rng, f = np.random.default_rng(3), np.array([25.0, 149.0, 150.0, 151.0, 250.0])
    base = replace(
        dwell, frequency_hz=f, fundamental_m=np.ones(5) + 0j, errors_m=np.full(5, 1e-7), good=np.ones(5, bool),
        harmonics_m=None, harmonic_errors_m=None, drive_amplitude_v=2.5, drive_offset_v=2.5, shared_errors=(),
    )  # fmt: skip
    runs = tuple(
        replace(
            base, label=f"run {i}", frequency_hz=f * (1 + 1e-6 * rng.standard_normal(5)),
            drive_amplitude_v=2.4 + 1e-3 * rng.standard_normal(5), drive_offset_v=2.5 + 1e-3 * rng.standard_normal(5),
        )
        for i in range(60)
    )  # fmt: skip
    problem = LeastSquaresProblem(ObservationSet(runs), FitOptions(free=("c0", "k2"), n=20))
    together = problem.forward_model.predict(problem.start)
    omega = 2 * np.pi * np.concatenate([run.frequency_hz for run in runs])
    nodes = frequency_nodes(np.zeros(omega.size, int), omega)
    assert nodes is not None
    assert nodes.omega.size < omega.size / 2
    assert frequency_nodes(np.arange(omega.size), omega) is None, "every row has factors of its own"
    for run, got in zip(runs[::7], together[::7], strict=True):
        alone = LeastSquaresProblem(ObservationSet((run,)), problem.options)
        single = alone.forward_model.predict(problem.start)[0]
        assert got.values == pytest.approx(single.values, rel=1e-11)
        assert got.derivatives == pytest.approx(single.derivatives, rel=1e-9)
        volts = [
            fourier_series("sine", a, o, AmplifierMap(), 1)[1]
            for a, o in zip(run.drive_amplitude_v, run.drive_offset_v, strict=True)
        ]
        exact = np.abs(exact_response(Tactor(), run.frequency_hz)) * np.abs(volts)
        assert np.abs(got.values) == pytest.approx(exact, rel=2e-3)


def test_means_of_shared_points_have_the_minimum_of_all_points() -> None:
    observations = repeated(scatter=2.0)
    problem = LeastSquaresProblem(observations, FitOptions(free=FREE))
    few = problem.condensed
    assert few is not problem
    assert few.names == problem.names
    (r, J), (s, K) = problem.evaluate(problem.start), few.evaluate(problem.start)
    assert s.size < r.size
    assert s @ s == pytest.approx(r @ r, rel=1e-11)
    assert K.T @ s == pytest.approx(J.T @ r, rel=1e-8, abs=1e-6 * np.abs(J.T @ r).max())
    information = J.T @ J
    assert K.T @ K - information == pytest.approx(0 * information, abs=1e-12 * np.abs(information).max())
    robust = LeastSquaresProblem(observations, FitOptions(free=FREE, loss="cauchy"))
    assert robust.condensed is robust


def test_the_evidence_for_a_cause_is_that_of_its_whole_effect() -> None:
    """Gain and price of every cause, from its effect over all rows, by a second way."""
    fit = joint_fit(repeated(scatter=2.0), FitOptions(free=FREE))
    evidence = Evidence(fit)
    left, found = evidence.outside_fit(evidence.residuals), {id(e.cause): e for e in evidence.linear}
    kinds = {c.kind for c in evidence.causes}
    assert kinds >= KINDS
    for cause in evidence.causes:
        effect = evidence.effect(cause)
        d = evidence.outside_fit(effect)
        d = d * ((d * d).sum(axis=0) > 1e-6 * (effect * effect).sum(axis=0))
        values, vectors = np.linalg.eigh(d.T @ d)
        values = np.where(values > 1e-9, values, 0.0)
        gain = float((((left @ d) @ vectors) ** 2 / (1 + values)).sum())
        assert found[id(cause)].gain == pytest.approx(gain, rel=1e-6, abs=1e-8)
        assert found[id(cause)].price == pytest.approx(0.5 * float(np.log1p(values).sum()), rel=1e-6, abs=1e-8)
