"""Joint fit: true parameters recovered, correct errors, undetermined parameters reported."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.campaigns import SENSOR, SHARED, Noise, World, perfect
from model.amplifier_map import AmplifierMap
from model.identification.fit_options import FitCancelled, FitOptions, IdentificationError
from model.identification.fit_result import JointFit
from model.identification.forward_model import with_predictions
from model.identification.joint_least_squares import _starting_points, joint_fit
from model.identification.observations import (
    FrequencyResponseObservation,
    MassResonanceObservation,
    MembraneSagObservation,
    Observation,
    ObservationSet,
    SharedError,
    StaticLoadingObservation,
    VoltageStepsObservation,
)
from model.identification.residuals import PRIOR_REACH, LeastSquaresProblem
from model.membrane import skin
from model.parameter_spec import ParameterError
from model.parameters import Membrane, Tactor
from model.response.harmonic_response import amplifier_response
from model.response.statics import load_compliance, voltage_gain
from tests.helpers.model.redrawn import resample

TRUE = {"k2": 7e-3, "mu": -1.33e-5, "m_add": 7.73e-3, "c0": 159.0, "E_m": 6.95e6, "c_s_0": 165.0, "c_s_delta": 5.48e4}
PERFECT = perfect(World(), Noise(), SHARED)


def without(*kinds: type) -> ObservationSet:
    return ObservationSet(tuple(r for r in PERFECT.runs if not isinstance(r, kinds)))


def free_only(
    tactor: Tactor | None = None, f: np.ndarray | None = None, **more: object
) -> FrequencyResponseObservation:
    f = np.arange(60.0, 251, 10) if f is None else f
    F = amplifier_response(tactor or Tactor(), f).fundamental
    return FrequencyResponseObservation("free", f, F, 0.003 * abs(F), **more)  # type: ignore[arg-type]


@pytest.mark.one_in(100)
@pytest.mark.parametrize("by_elements", [False, True], ids=["closed form", "finite elements"])
def test_the_truth_of_an_independent_solution_comes_back(by_elements: bool) -> None:
    """Within 2e-4, the error of 20 shapes; and from a start that is 30 % off everywhere."""
    data = perfect(World(by_elements=True), Noise(), ()) if by_elements else PERFECT
    start = {n: 1.3 * v for n, v in TRUE.items()}
    fit = joint_fit(data, FitOptions(n=20, start=start))
    assert {e.name: e.value for e in fit.estimates()} == pytest.approx(TRUE, rel=2e-4)
    assert fit.converged
    assert fit.chi_square < 0.1


@pytest.mark.deep
def test_what_is_known_moves_by_twelve_uncertainties_at_most() -> None:
    """A lag that the model lacks, of dwells with errors of 1 nm, asks for another strip."""
    sweep = free_only()
    assert sweep.fundamental_m is not None
    drifted = replace(sweep, fundamental_m=sweep.fundamental_m * (1 + 0.2j * sweep.frequency_hz / 250), errors_m=1e-9)
    priors = {"L": (22e-3, 3e-4), "L1": (8e-3, 3e-4), "L2": (15e-3, 3e-4)}
    fit = joint_fit(ObservationSet((drifted,)), FitOptions(priors=priors), max_starts=1)
    at = dict(zip(fit.names, fit.theta, strict=True))
    away = {name: (at[name] - value) / error for name, (value, error) in priors.items()}
    assert max(map(abs, away.values())) == pytest.approx(PRIOR_REACH, rel=1e-3)
    assert not fit.unidentified_combinations


def test_geometry_can_be_identified_where_a_caliper_helps() -> None:
    data = with_predictions(
        PERFECT,
        LeastSquaresProblem(PERFECT, FitOptions(tactor=Tactor(L1=8.1e-3))).forward_model,
        LeastSquaresProblem(PERFECT, FitOptions()).start,
    )
    free = (*TRUE, "L1")
    fit = joint_fit(data, FitOptions(free=free, priors={"L1": (8e-3, 2e-4)}))
    got = {e.name: e for e in fit.estimates()}
    assert got["L1"].value == pytest.approx(8.1e-3, rel=3e-3)
    assert got["L1"].standard_error < 2e-4


F3 = np.array([60.0, 80, 150])
DRIVEN = amplifier_response(Tactor(), F3, skin=skin(Membrane(), 0.01))
WIDTH = FrequencyResponseObservation(
    "width", F3, peak_to_peak_m=DRIVEN.peak_to_peak, peak_to_peak_errors_m=1e-6 * np.ones(3), shared_errors=(SENSOR,)
)
MODULUS = FrequencyResponseObservation("modulus", F3, abs(DRIVEN.fundamental), 1e-6 * np.ones(3), elongation_m=1.7e-3)
UNDAMPED = MassResonanceObservation("undamped", np.array([2e-3, 5e-3]), np.array([280.0, 190]), np.ones(2), "undamped")
EVERY = ("k2", "mu", "c0", "m_add", "E_m", "c_s_0", "c_s_delta", "L", "L1", "L2", "E_Al", "h_Al", "rho1", "rho2", "h_m", "L_m",
         "contact_length", "asymmetry", "c_s(1.27 mm)", "k_s(2.54 mm)", "creep", "hysteresis", "mass_fraction", "gain_below_rest")  # fmt: skip


@pytest.mark.deep
@pytest.mark.parametrize(
    ("runs", "free"),
    [
        ((*PERFECT.runs, MODULUS, replace(free_only(), label="bare", added_mass_kg=2e-3), UNDAMPED), EVERY),
        ((WIDTH,), ("k2", "mu", "c0", "L1")),
    ],
    ids=["every kind of run and parameter", "max - min"],
)
def test_the_slopes_are_those_of_the_predictions(runs: tuple[Observation, ...], free: tuple[str, ...]) -> None:
    problem = LeastSquaresProblem(ObservationSet(runs), FitOptions(free=free))
    theta = problem.start * 1.01 + 1e-3 * (problem.start == 0)
    _, J = problem.evaluate(theta)
    for i, name in enumerate(problem.names):
        h = np.zeros(theta.size)
        h[i] = 3e-5 * max(abs(theta[i]), 1e-6)
        plain = -(problem.evaluate(theta + h)[0] - problem.evaluate(theta - h)[0]) / (2 * h[i])
        assert J[:, i] == pytest.approx(plain, rel=1e-3, abs=2e-5 * abs(plain).max()), name


def test_shared_errors_widen_what_they_act_on_and_nothing_else() -> None:
    """mu goes with the product of two gains of 0.2 % and 0.5 %; more points do not help it below that."""
    fit = joint_fit(PERFECT)
    alone = joint_fit(ObservationSet(tuple(replace(r, shared_errors=()) for r in PERFECT.runs)))
    error = {e.name: abs(e.standard_error / e.value) for e in fit.estimates()}
    ideal = {e.name: abs(e.standard_error / e.value) for e in alone.estimates()}
    assert error["mu"] > 0.005 > 3 * ideal["mu"]
    assert error["E_m"] == pytest.approx(ideal["E_m"], rel=0.06)


def test_dwells_on_one_voltage_cannot_tell_the_gain_from_the_coupling() -> None:
    """Parameters that only enter as a product with mu are reported as a combination, never as a number."""
    run = free_only()
    fit = joint_fit(ObservationSet((run,)), FitOptions(free=("k2", "mu", "c0", "m_add", "rho1", "rho2", "E_Al"), n=7))
    lost = max(fit.unidentified_combinations, key=lambda c: c.standard_error)
    assert lost.standard_error == np.inf
    assert set(lost.shares) == set(fit.names)
    assert np.ptp([abs(s) for s in lost.shares.values()]) < 1e-4, "all move by the same share"
    assert len({np.sign(s) for s in lost.shares.values()}) == 1
    assert not fit.estimates()


def test_what_is_not_lost_is_still_told() -> None:
    """Two further free parameters do not hide k2."""
    data = ObservationSet(tuple(r for r in PERFECT.runs if isinstance(r, StaticLoadingObservation)))
    fit = joint_fit(data, FitOptions(free=("k2", "c0", "mu")))
    assert {n for c in fit.unidentified_combinations for n in c.shares} == {"c0", "mu"}
    assert [c.standard_error for c in fit.unidentified_combinations] == [np.inf, np.inf]
    (k2,) = fit.estimates()
    assert k2.value == pytest.approx(7e-3, rel=1e-3)
    assert k2.source == ("mfc", "aluminium")


@pytest.mark.deep
@pytest.mark.one_in(4)
@pytest.mark.parametrize("factor", [0.1, 0.3, 3.0, 10.0])
def test_bad_starts_find_the_truth(factor: float) -> None:
    noisy, _ = resample(PERFECT, np.random.default_rng(2))
    start = {n: factor * v for n, v in TRUE.items()}
    fit = joint_fit(noisy, FitOptions(start=start))
    good = joint_fit(noisy)
    assert fit.chi_square == pytest.approx(good.chi_square, rel=1e-3)
    assert fit.theta == pytest.approx(good.theta, rel=1e-3, abs=1e-5)


def test_contradictory_runs_get_an_answer_and_the_verdict_says_so() -> None:
    F = np.array([1.0, 2.0, 5.0])
    a, b = (StaticLoadingObservation(s, F, w * F, 1e-6 * np.ones(3)) for s, w in (("a", 1.2e-4), ("b", 1.6e-4)))
    fit = joint_fit(ObservationSet((a, b)))
    (k2,) = fit.estimates()
    apart = [joint_fit(ObservationSet((r,))).estimates()[0].value for r in (a, b)]
    assert min(apart) < k2.value < max(apart)
    assert f"{fit.error_scale:.2g}" in fit.verdict
    assert k2.standard_error > 10 * np.sqrt(fit.covariance[0, 0]) / 1.001
    assert all(r.outliers for r in fit.residuals)


def test_one_point_is_an_answer_without_a_test() -> None:
    w = load_compliance(Tactor()) * 2.0
    fit = joint_fit(
        ObservationSet((StaticLoadingObservation("one", np.array([2.0]), np.array([w]), np.array([1e-6])),))
    )
    assert fit.estimates()[0].value == pytest.approx(7e-3)
    assert "1 more point" in fit.verdict


def test_fewer_points_than_parameters_is_told() -> None:
    run = free_only(f=np.array([150.0]))
    fit = joint_fit(ObservationSet((run,)), FitOptions(free=("k2", "mu", "c0", "m_add")))
    assert len(fit.unidentified_combinations) == 2
    assert not fit.estimates()


VOLTS = AmplifierMap().specimen_v(np.array([0.5, 1.5, 3.5, 4.5]))
LEVELS = VoltageStepsObservation(
    "levels", np.array([0.5, 1.5, 3.5, 4.5]), voltage_gain(Tactor()) * VOLTS, np.array([1e-6, 2e-6, 1e-6, 3e-6])
)


def test_a_linear_fit_has_the_standard_error_of_the_textbook() -> None:
    per = voltage_gain(Tactor(mu=1.0)) * VOLTS / LEVELS.errors_m
    plain = joint_fit(ObservationSet((LEVELS,))).estimates()[0].standard_error
    assert plain == pytest.approx((per @ per) ** -0.5, rel=1e-6)
    gain = SharedError("gain", "displacement", 0.01)
    shared = joint_fit(ObservationSet((replace(LEVELS, shared_errors=(gain,)),))).estimates()[0].standard_error
    assert shared == pytest.approx(np.hypot(plain, 0.01 * 1.33e-5), rel=1e-4)


def test_a_robust_fit_does_not_count_what_it_let_go() -> None:
    w = np.array(LEVELS.deflection_m)
    w[0] += 1e-3
    without = replace(LEVELS, good=np.array([False, True, True, True]))
    robust = joint_fit(ObservationSet((replace(LEVELS, deflection_m=w),)), FitOptions(loss="cauchy"))
    honest = joint_fit(ObservationSet((without,)))
    assert np.sqrt(robust.covariance[0, 0]) == pytest.approx(np.sqrt(honest.covariance[0, 0]), rel=1e-3)


@pytest.mark.deep
def test_a_robust_loss_lets_go_of_an_outlier_and_names_it() -> None:
    runs = list(PERFECT.runs)
    w = np.array(runs[0].deflection_m)
    w[-1] *= 1.3
    runs[0] = replace(runs[0], deflection_m=w)
    plain, robust = (
        joint_fit(ObservationSet(tuple(runs)), FitOptions(n=20, loss=loss)) for loss in ("linear", "cauchy")
    )
    off = [abs(next(e.value for e in fit.estimates() if e.name == "k2") / 7e-3 - 1) for fit in (plain, robust)]
    assert off[1] < off[0] / 3
    assert robust.residuals[0].outliers == (4,)


def test_flagged_points_are_out() -> None:
    runs = list(PERFECT.runs)
    w = np.array(runs[0].deflection_m)
    w[-1] = np.nan
    good = np.array([True, True, True, True, False])
    runs[0] = replace(runs[0], deflection_m=w, good=good)
    fit = joint_fit(ObservationSet(tuple(runs)), FitOptions(n=20))
    assert fit.residuals[0].values.size == 4
    assert {e.name: e.value for e in fit.estimates()} == pytest.approx(TRUE, rel=2e-4)


def test_tied_and_fixed() -> None:
    fit = joint_fit(PERFECT, FitOptions(n=20, tied={"c_s_delta": ("c_s_0", 5.48e4 / 165)}, fixed={"E_m": 6.95e6}))
    got = {e.name: e.value for e in fit.estimates()}
    assert set(got) == {"k2", "mu", "m_add", "c0", "c_s_0"}
    assert got["c_s_0"] == pytest.approx(165, rel=2e-4)
    assert fit.values["c_s_delta"] == pytest.approx(5.48e4, rel=2e-4)


def test_damping_at_each_elongation() -> None:
    fit = joint_fit(PERFECT, FitOptions(n=20, per_elongation=True))
    got = {e.name: e.value for e in fit.estimates()}
    for mm in (0, 1.27, 2.54, 3.81, 5.08, 6.35):
        assert got[f"c_s({mm:g} mm)"] == pytest.approx(165 + 5.48e4 * mm * 1e-3 / 0.17, rel=3e-4)


def test_a_side_that_is_softer() -> None:
    F = np.array([1.0, 2.0, 5.0])
    C = load_compliance(Tactor())
    sides = tuple(
        StaticLoadingObservation(s, F, C * (1 + a) * F, 1e-6 * np.ones(3), s)
        for s, a in (("mfc", 0.04), ("aluminium", -0.04))
    )
    fit = joint_fit(ObservationSet(sides), FitOptions(free=("k2", "asymmetry")))
    assert {e.name: e.value for e in fit.estimates()} == pytest.approx({"k2": 7e-3, "asymmetry": 0.04})


def test_cancel_progress_and_bound() -> None:
    stop, seen = threading.Event(), []

    def progress(evaluations: int, chi_square: float) -> None:
        seen.append((evaluations, chi_square))
        if evaluations == 2:
            stop.set()

    with pytest.raises(FitCancelled):
        joint_fit(PERFECT, FitOptions(start={"k2": 2e-2}), progress, stop.is_set)
    assert [n for n, _ in seen] == [1, 2]
    late = joint_fit(PERFECT, FitOptions(start={"k2": 2e-2}), max_evaluations=2)
    assert not late.converged
    assert late.evaluations == 2
    assert "stopped after 2 evaluations; the best so far" in late.message
    assert joint_fit(PERFECT, FitOptions(start={"k2": 2e-2}), max_evaluations=0).evaluations == 1


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ObservationSet(()), "no run to identify"),
        (lambda: ObservationSet((free_only(), free_only())), "two runs are called 'free'"),
        (lambda: ObservationSet((free_only(good=np.zeros(20, bool)),)), "no usable point"),
        (lambda: free_only(shared_errors=(SharedError("x", "colour", 1.0),)), "acts on 'colour'"),  # type: ignore[arg-type]
        (lambda: SharedError("x", "volts", 0.0), "must be positive"),
        (
            lambda: MassResonanceObservation("m", np.array([1e-3]), np.array([np.nan]), np.array([1.0])),
            "not finite at a point",
        ),
        (
            lambda: MassResonanceObservation("m", np.array([1e-3, 2e-3]), np.array([100.0]), np.array([1.0])),
            "give one each",
        ),
        (
            lambda: VoltageStepsObservation("v", np.array([1.0]), np.array([1e-5]), np.array([0.0])),
            "standard error must be positive",
        ),
        (lambda: MembraneSagObservation("s", np.array([]), np.array([])), "at least one value"),
        (lambda: joint_fit(PERFECT, FitOptions(free=("k3",))), "k3 is not an identifiable parameter"),
        (lambda: joint_fit(PERFECT, FitOptions(free=("k2", "k2"))), "named twice"),
        (lambda: joint_fit(PERFECT, FitOptions(free=("k2",), fixed={"k2": 7e-3})), "both free and fixed"),
        (lambda: joint_fit(PERFECT, FitOptions(free=("k2",), priors={"mu": (1.0, 1.0)})), "not free"),
        (lambda: joint_fit(PERFECT, FitOptions(start={"k2": -1.0})), "k2"),
        (lambda: FitOptions(fixed={"k2": -1.0}), "greater than 0"),
        (lambda: FitOptions(loss="huber"), "choose linear"),  # type: ignore[arg-type]
    ],
)
def test_bad_input_is_a_sentence(call: object, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        call()  # type: ignore[operator]


def test_nothing_free_is_a_sentence() -> None:
    with pytest.raises(IdentificationError, match="no parameter is free"):
        joint_fit(PERFECT, FitOptions(free=()))


def test_robust_weights_are_the_derivative_of_the_chosen_loss() -> None:
    """soft_l1: rho' = (1 + r^2)^-1/2; cauchy: rho' = (1 + r^2)^-1 (Triggs et al., Bundle adjustment, 2000)."""
    data = ObservationSet((free_only(Tactor(c0=100.0)),))
    for loss, power, c in (("soft_l1", -0.25, 1.345), ("cauchy", -0.5, 2.385)):
        options = FitOptions(n=5, free=("c0",), loss=loss)  # type: ignore[arg-type]
        fit = joint_fit(data, options)
        residuals, jacobian = LeastSquaresProblem(data, options).evaluate(fit.theta)
        assert fit.jacobian == pytest.approx(jacobian * (1 + (residuals / c) ** 2)[:, None] ** power)
        assert np.abs(residuals).max() > 0.1  # else every loss has the same weights


def test_starts_are_the_options_the_chain_the_defaults_and_points_within_a_factor_of_two() -> None:
    """A start far away ends in another minimum: the first resonance on the place of the second."""
    problem = LeastSquaresProblem(PERFECT, FitOptions(free=("k2", "m_add", "c0", "mu"), start={"c0": 200.0}))
    given, chain, table, *spread = _starting_points(problem)
    named = problem.names.index("c0")
    assert (given[named], table[named]) == (200.0, 159.0)
    assert chain[:4] == pytest.approx(table[:4], rel=0.01)
    assert len(spread) == 6
    for start in spread:
        assert (0.5 * np.abs(table) <= np.abs(start)).all()
        assert (np.abs(start) <= 2.0 * np.abs(table)).all()
    k2 = problem.names.index("k2")
    shares = np.array([start[k2] / table[k2] for start in spread])
    assert shares.min() < 0.8
    assert shares.max() > 1.25


def test_a_misfit_is_called_converged_only_where_two_starts_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    data = ObservationSet((free_only(),))
    good = joint_fit(data, FitOptions(n=5, free=("c0",)))
    scale = np.sqrt(max(good.degrees_of_freedom, 1) / len(good.weighted_residuals))

    def ends(*costs: float) -> JointFit:
        left = iter(costs)
        monkeypatch.setattr(
            "model.identification.joint_least_squares._FitMonitor.fit",
            lambda *_: replace(good, weighted_residuals=np.full_like(good.weighted_residuals, scale * next(left))),
        )
        return joint_fit(data, FitOptions(n=5, free=("c0",)))

    first = ends(4.0, 9.0, 8.0, 7.0, 6.0, 5.0)
    assert first.weighted_residuals[0] == pytest.approx(4.0 * scale), "the best of all starts, whichever it was"
    alone = ends(9.0, 8.0, 7.0, 6.0, 5.0, 4.0)
    assert not alone.converged
    assert ends(9.0, 5.0, 5.0).converged
    assert ends(9.0, 1.0).converged
