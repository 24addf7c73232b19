"""Lines of a sweep and poles of a free decay in the joint fit, against finite elements that share nothing with it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.campaigns import AMPLIFIER, DELAY, SENSOR, SHARED, Noise, World, elements, perfect
from model import Array, Complex, ParameterError, Tactor
from model.identification import (
    DecayPoleObservation,
    FitOptions,
    FrequencyResponseObservation,
    JointFit,
    Observation,
    ObservationSet,
    assess_adequacy,
    default_candidates,
    joint_fit,
    rank_candidates,
)
from model.identification.experiment_design import ExpectedPrecision
from model.identification.observations import observed_values, with_observed_values
from model.identification.residuals import LeastSquaresProblem
from tests.helpers.model.redrawn import resample

PAPER = Tactor()
LINES_HZ = np.arange(26.0, 526, 2)
VOLTS = 400 * 2.5
"""Peak of the fundamental on the specimen under 5 V peak to peak."""
SHAPES = 20
FREE = ("k2", "mu", "m_add", "c0")


def response(tactor: Tactor, f: Array | Complex) -> Complex:
    return np.asarray(elements(tactor, f, None, np.inf))


@cache
def pole_hz(tactor: Tactor) -> complex:
    """The pole over 2 pi of the finite elements, by the secant method on the inverse response at complex frequencies."""
    f, g = 155 + 33j, 155.1 + 33j
    for _ in range(60):
        a, b = (1 / response(tactor, np.array([x]))[0] for x in (f, g))
        if abs(g - f) < 1e-10:
            break
        f, g = g, g - b * (g - f) / (b - a)
    return complex(1j * g)


def sweep(tactor: Tactor = PAPER, error_m: float = 1e-7) -> FrequencyResponseObservation:
    return FrequencyResponseObservation(
        "sweep",
        LINES_HZ,
        VOLTS * response(tactor, LINES_HZ),
        np.full(LINES_HZ.size, error_m),
        swept=True,
        shared_errors=(SENSOR, AMPLIFIER, DELAY),
        simulated=True,
    )


def decay(tactor: Tactor = PAPER) -> DecayPoleObservation:
    p, ten = pole_hz(tactor), np.ones(10)
    return DecayPoleObservation("decay", abs(p) * ten, 0.05 * ten, -p.real / abs(p) * ten, 3e-4 * ten, simulated=True)


def statics_and_dwell() -> tuple[Observation, ...]:
    runs = perfect(World(by_elements=True), Noise(), SHARED).runs
    return tuple(run for run in runs if run.label in ("mfc", "aluminium", "free"))


def fit(*runs: Observation, rng: np.random.Generator | None = None) -> JointFit:
    data = ObservationSet(runs)
    return joint_fit(data if rng is None else resample(data, rng)[0], FitOptions(n=SHAPES))


@pytest.mark.deep
def test_the_pole_is_that_of_finite_elements() -> None:
    p = pole_hz(PAPER)
    problem = LeastSquaresProblem(ObservationSet((decay(),)), FitOptions(free=("m_add", "c0"), n=SHAPES))
    (found,) = problem.forward_model.predict(problem.start)
    assert found.values == pytest.approx(np.full(10, p), rel=2e-4)


@pytest.mark.deep
def test_the_slopes_of_pole_and_lines_are_those_of_the_predictions() -> None:
    free = (*FREE, "L1", "h_Al")
    problem = LeastSquaresProblem(ObservationSet((decay(), sweep())), FitOptions(free=free, n=7))
    theta = problem.start
    _, J = problem.evaluate(theta)
    for i in range(len(free)):
        step = np.zeros(theta.size)
        step[i] = 1e-4 * theta[i]
        slope = (problem.evaluate(theta - step)[0] - problem.evaluate(theta + step)[0]) / (2 * step[i])
        assert abs(slope - J[:, i]).max() < 1e-6 * abs(J[:, i]).max(), free[i]


def test_a_pole_survives_the_way_into_a_fit_and_back() -> None:
    ten = np.ones(10)
    run = DecayPoleObservation("decay", 158.2 * ten, 0.05 * ten, 0.211 * ten, 3e-4 * ten, good=np.arange(10) > 2)
    values, _ = observed_values(run)
    assert np.abs(values) == pytest.approx(run.frequency_hz[3:])
    moved = with_observed_values(run, 1.01 * values)
    assert isinstance(moved, DecayPoleObservation)
    assert moved.frequency_hz[3:] == pytest.approx(1.01 * run.frequency_hz[3:])
    assert moved.damping == pytest.approx(run.damping)
    with pytest.raises(ParameterError, match="does not ring"):
        replace(run, damping=np.full(10, 1.2))


@pytest.mark.deep
def test_the_stated_errors_are_the_cramer_rao_bound_of_an_independent_solution() -> None:
    """Information of statics, dwell, sweep and decay from finite elements, differentiated numerically, with shared errors."""

    def predicted(x: Array, runs: tuple[Observation, ...]) -> Array:
        """Whitened predictions at log parameters x[:4] and shared errors x[4:] in standard errors, with the latter's priors."""
        t = replace(PAPER, **{name: getattr(PAPER, name) * np.exp(v) for name, v in zip(FREE, x[:4], strict=True)})
        gain, volts, late, load = (
            s * e.standard_error for s, e in zip(x[4:], (SENSOR, AMPLIFIER, DELAY, SHARED[3]), strict=True)
        )
        rows = [x[4:]]
        for run in runs:
            y, errors = observed_values(run)
            match run:
                case DecayPoleObservation():
                    p = pole_hz(t)
                    rows += [
                        np.full(y.size, abs(p)) / errors,
                        np.full(y.size, np.arcsin(-p.real / abs(p))) / run.phase_errors_rad,
                    ]
                case FrequencyResponseObservation():
                    f = run.frequency_hz
                    F = VOLTS * response(t, f) * (1 + gain) * (1 + volts) * np.exp(-2j * np.pi * f * late)
                    rows += [F.real / errors, F.imag / errors]
                case _:
                    loads = getattr(run, "load_n")  # noqa: B009
                    per = elements(t, np.zeros(1), None, np.inf, load=True)[0].real
                    rows += [per * loads * (1 + gain) * (1 + load) / errors]
        return np.concatenate(rows)

    def bound(*runs: Observation) -> Array:
        steps = 1e-4 * np.eye(8)
        J = np.array([(predicted(s, runs) - predicted(-s, runs)) / 2e-4 for s in steps])
        return np.sqrt(np.diag(np.linalg.inv(J @ J.T)))[:4]

    few = statics_and_dwell()
    before = None
    for runs in (few, (*few, sweep()), (*few, sweep(), decay())):
        stated = {e.name: e.standard_error / abs(e.value) for e in fit(*runs).estimates()}
        ratio = np.array([stated[name] for name in FREE]) / bound(*runs)
        assert ratio == pytest.approx(np.ones(4), abs=0.02)
        before = before or stated
    assert before["c0"] / stated["c0"] > 1.9  # what the sweep adds


@pytest.mark.deep
def test_the_truth_comes_back_from_sweep_and_decay_within_the_stated_errors() -> None:
    """Forty draws of all noise and shared errors, k2 from the loads."""
    rng = np.random.default_rng(5)
    runs = (*statics_and_dwell(), sweep(), decay())
    z, false_alarms = [], 0
    for _ in range(40):
        found = fit(*runs, rng=rng)
        z += [(e.value - getattr(PAPER, e.name)) / e.standard_error for e in found.estimates()]
        false_alarms += found.p_value < 0.01
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=0.2)
    assert false_alarms <= 3


def test_a_sweep_tells_the_delay_without_bias_by_the_basis_of_the_fit() -> None:
    """Without noise, at the errors of a good laboratory: seven shape functions are 0.9 standard errors off, twenty 0.00."""
    f = LINES_HZ[LINES_HZ < 425]
    exact = VOLTS * response(PAPER, f)
    errors = 0.002 * abs(exact) + 1e-7
    run = FrequencyResponseObservation("sweep", f, exact, errors, swept=True, shared_errors=(DELAY,), simulated=True)
    found = joint_fit(ObservationSet((run,)), FitOptions(free=FREE))
    true = {name: getattr(PAPER, name, 0.0) for name in found.names}
    z = [
        (v - true[n]) / s for n, v, s in zip(found.names, found.theta, np.sqrt(np.diag(found.covariance)), strict=True)
    ]
    assert z == pytest.approx(np.zeros(5), abs=0.1)


@pytest.mark.deep
def test_a_decay_that_contradicts_is_named_with_the_sign_of_its_words() -> None:
    few = (*statics_and_dwell(), sweep(error_m=2e-7))
    wrong = replace(decay(), frequency_hz=1.01 * decay().frequency_hz)
    found = fit(*few, wrong)
    verdict = assess_adequacy(found)
    assert verdict.adequate is False
    assert verdict.diagnosis is not None
    assert verdict.diagnosis.explanations[0].text.startswith("the frequencies of decay are 0.990 ± 0.010 % too high")


@pytest.mark.deep
def test_next_best_weighs_sweep_and_decay_and_says_what_a_run_then_does() -> None:
    """The promised error is the one that a fit with that sweep states."""
    few = statics_and_dwell()
    before = fit(*few)
    expected = ExpectedPrecision(floor_m=1e-7, relative_error=1e-6, shared_errors=SHARED)
    proposals = {p.candidate.run.label: p for p in rank_candidates(before, default_candidates(before, expected), "c0")}
    after = {e.name: e.standard_error / abs(e.value) for e in fit(*few, sweep()).estimates()}
    assert proposals["sweep, free, 250 lines"].error_after == pytest.approx(after["c0"], rel=0.03)
    ranked = [p.candidate.run.label for p in rank_candidates(before, default_candidates(before, expected), "c0")]
    assert {"sweep, free, 250 lines", "free decay, ten edges"} & set(ranked[:3])


@pytest.mark.one_in(1)
@pytest.mark.parametrize("damping", [-0.3, 0.02, 0.3, 0.8])
def test_the_errors_of_a_pole_are_those_of_its_frequency_and_damping(damping: float) -> None:
    def made(frequency_hz: float, ratio: float) -> DecayPoleObservation:
        return DecayPoleObservation("decay", *(np.array([each]) for each in (frequency_hz, 0.5, ratio, 1e-4)))

    run = made(160.0, damping)
    assert run.pole_hz == pytest.approx(160.0 * (-damping + 1j * np.sqrt(1 - damping**2)))
    turned = np.angle(made(160.0, damping + 1e-4).pole_hz / run.pole_hz)
    assert run.phase_errors_rad == pytest.approx(turned, rel=1e-3)
    again = run.with_pole(run.pole_hz)
    assert (again.frequency_hz, again.damping) == (pytest.approx(160.0), pytest.approx(damping))


def test_a_run_keeps_its_values_whatever_becomes_of_the_columns_that_it_was_made_of() -> None:
    for run in (sweep(), decay()):
        for name in ("frequency_hz", "errors_m", "errors_hz", "fundamental_m", "damping", "good"):
            if (column := getattr(run, name, None)) is not None:
                assert not column.flags.writeable
    given = LINES_HZ.copy()
    run = FrequencyResponseObservation("sweep", given, given, given)
    given[:] = 0.0
    assert np.array_equal(run.frequency_hz, LINES_HZ)
