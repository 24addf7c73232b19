"""Manual actions on the simulated bench, against independent results of the model."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drivers.errors import BenchError
from model.membrane import sag, skin
from model.parameters import Membrane, Tactor
from model.response.harmonic_response import amplifier_response, frequency_response, poles
from model.response.modes import natural_frequencies
from model.response.statics import load_compliance, voltage_gain
from protocols.base import Prompt
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.operator import SimulatedOperator
from sim_hardware.plant.parameters import AmplifierParameters, Nonidealities, OperatorTiming, SimulationParameters
from sim_hardware.plant.plant import Plant
from sim_hardware.plant.segments import ConstantSegment, PeriodicSegment
from sim_hardware.plant.setup_state import GRAVITY, SENSOR_ACTIONS, SPECIMEN_ACTIONS
from sim_hardware.plant.voltage_history import VoltageHistory
from sim_hardware.service.process import BenchProcess

TACTOR = Tactor()
COMPLIANCE = load_compliance(TACTOR)
AT_REST = AmplifierParameters(open_v=2.5)


def bench_of(**truth: Any) -> SimulatedBench:
    return SimulatedBench(SimulationParameters(**{"amplifier": AT_REST, **truth}), VirtualClock())


def seen(bench: SimulatedBench, *times: float) -> np.ndarray:
    """Return the sensor's reading at these times from now."""
    t = bench.clock.now() + np.asarray(times, float)
    bench.clock.sleep(float(times[-1]) + 0.01)
    return bench.laser_view.displacement(t)


def level(bench: SimulatedBench, after_s: float = 8.0) -> float:
    return float(seen(bench, after_s)[0])


@pytest.mark.parametrize("side", [1, -1])
def test_weights_deflect_the_centre_as_eq_7_says_on_either_side(side: int) -> None:
    bench = bench_of()
    bench.perform_action("turn-side", {"side": side})
    bench.perform_action("place-weight", {"mass_kg": 0.01})
    assert level(bench) == pytest.approx(0.01 * GRAVITY * COMPLIANCE, rel=1e-6)
    for mass_kg in (0.02, 0.5):
        bench.perform_action("place-weight", {"mass_kg": mass_kg})
        assert level(bench) == pytest.approx((0.01 + mass_kg) * GRAVITY * COMPLIANCE, rel=1e-6)
        bench.perform_action("remove-weight", {})
        assert level(bench) == pytest.approx(0.01 * GRAVITY * COMPLIANCE, rel=1e-6)


def test_turning_takes_every_weight_off_but_the_offset_that_is_asked_for() -> None:
    bench = bench_of()
    for side in (1, 1, -1):
        bench.perform_action("place-weight", {"mass_kg": 0.2})
        bench.perform_action("turn-side", {"side": side})
        assert level(bench) == pytest.approx(0.0, abs=1e-12)
    bench.perform_action("turn-side", {"side": 1, "offset_kg": 0.01, "shorted": 1})
    assert level(bench) == pytest.approx(0.01 * GRAVITY * COMPLIANCE, rel=1e-6)
    assert bench.plant.setup_state.shorted


def test_weight_lands_after_delay_and_oscillates_with_loaded_modes() -> None:
    bench = bench_of(hands=OperatorTiming(reach_s=1.0, release_s=0.2))
    bench.perform_action("place-weight", {"mass_kg": 0.5})
    t = np.arange(0.0, 3.0, 1e-3)
    w = seen(bench, *t)
    assert not w[t < 0.99].any()
    final = 0.5 * GRAVITY * COMPLIANCE
    assert w.max() > 1.01 * final  # a little bounce
    ring = (w - final)[t > 1.25]
    rises = np.flatnonzero((ring[:-1] < 0) & (ring[1:] >= 0))
    seen_hz = (len(rises) - 1) / (rises[-1] - rises[0]) * 1e3
    there = replace(TACTOR, m_add=TACTOR.m_add + 0.5)
    damped = abs(poles(there)[0].imag) / 2 / np.pi
    assert seen_hz == pytest.approx(damped, rel=2e-3)
    assert damped == pytest.approx(natural_frequencies(there)[0], rel=2e-3)
    assert np.abs(ring[-200:]).max() < 0.02 * np.abs(ring[:200]).max()


@pytest.mark.parametrize("mass_kg", [0.0, 1.75e-3, 9.75e-3])
def test_a_fixed_mass_moves_the_resonance_to_the_models_frequency(mass_kg: float) -> None:
    history = VoltageHistory()
    history.append(0.0, ConstantSegment(2.5))
    history.switch_high_voltage(0.0, hv=True)
    plant = Plant(SimulationParameters(), history)
    plant.schedule_change(VirtualClock(), lambda now: replace(now, fixed_kg=mass_kg))
    f = natural_frequencies(replace(TACTOR, m_add=mass_kg))[0]
    start = 0.0128
    history.append(start, PeriodicSegment(start, f, 0.5, 3.5, 0.0, 3.5))  # all above rest: one slope, so a pure sine
    t = 1.0 + np.arange(20_000) / 20e3
    basis = np.c_[np.sin(2 * np.pi * f * (t - start)), np.cos(2 * np.pi * f * (t - start)), np.ones(t.size)]
    in_phase, quadrature, _ = np.linalg.lstsq(basis, plant.displacement(t), rcond=None)[0]
    turned = in_phase + 1j * quadrature
    # At the undamped frequency the first mode lags by a quarter; what the higher ones add is in phase.
    assert np.angle(turned) == pytest.approx(-np.pi / 2, abs=0.1)
    response = frequency_response(replace(TACTOR, m_add=mass_kg), f)[0]
    assert abs(turned / (300.0 * response) - 1) < 1e-3


@pytest.mark.parametrize("elongation_m", [0.0, 1.27e-3, 6.35e-3])
def test_a_membrane_at_an_elongation_gives_the_models_response(elongation_m: float) -> None:
    bench = bench_of()
    bench.perform_action("stretch-membrane", {"elongation_m": elongation_m})
    bench.enable_hv()
    bench.history.append(0.1, PeriodicSegment(0.1, 150.0, 2.5, 2.5, 0.0, 2.5))
    on = skin(Membrane(), elongation_m / Membrane().L_m)
    want = amplifier_response(TACTOR, 150.0, skin=on).peak_to_peak[0]
    assert np.ptp(seen(bench, *(1.0 + np.arange(5000) / 50e3))) == pytest.approx(want, rel=1e-3)
    bench.disable_hv()
    bench.perform_action("remove-membrane", {})
    bench.enable_hv()
    want = amplifier_response(TACTOR, 150.0).peak_to_peak[0]
    assert np.ptp(seen(bench, *(1.0 + np.arange(5000) / 50e3))) == pytest.approx(want, rel=1e-3)


def test_the_motion_goes_on_from_where_it_was_with_the_new_modes() -> None:
    history = VoltageHistory()
    history.append(0.0, ConstantSegment(2.5))
    history.switch_high_voltage(0.0, hv=True)
    clock = VirtualClock()
    plant = Plant(SimulationParameters(), history)
    history.append(0.01, ConstantSegment(5.0))
    clock.sleep(0.0125)  # in full swing
    changed = plant.schedule_change(clock, lambda now: replace(now, fixed_kg=0.1, skin=skin(Membrane(), 0.0)))
    t = changed + np.arange(-40, 40) * 1e-5
    w = plant.displacement(t)
    v = np.diff(w) / 1e-5
    assert np.abs(v).max() > 0.05  # m/s: it is moving
    assert np.abs(np.diff(v)).max() < 0.02 * np.abs(v).max()
    later = plant.displacement(np.array([4.0]))[0]
    want = amplifier_response(TACTOR, 1e-3, 0.001, 4.999, skin=skin(Membrane(), 0.0)).harmonics[0, 0].real
    assert later == pytest.approx(want, rel=1e-3)


def test_shorted_electrodes_block_voltage_and_turned_side_reverses_bending() -> None:
    bench = bench_of()
    bench.history.append(0.0, ConstantSegment(3.0))
    bench.perform_action("short-electrodes", {})
    bench.enable_hv()
    assert level(bench) == 0.0
    bench.disable_hv()
    bench.perform_action("connect-electrodes", {})
    bench.enable_hv()
    bent = 300.0 * voltage_gain(TACTOR)
    assert level(bench) == pytest.approx(bent, rel=1e-3)
    bench.disable_hv()
    bench.perform_action("turn-side", {"side": -1})
    bench.enable_hv()
    assert level(bench) == pytest.approx(-bent, rel=1e-3)


def test_nobody_reaches_for_a_live_specimen() -> None:
    bench = bench_of()
    bench.enable_hv()
    for action in SPECIMEN_ACTIONS:
        if action in ("connect-electrodes", "remove-membrane", "remove-weight", "tidy-up"):
            continue  # nothing of that is there
        with pytest.raises(ValueError, match="a live specimen must not be touched"):
            bench.perform_action(action, {"mass_kg": 0.1, "side": -1, "elongation_m": 1e-3})
    bench.perform_action("zero-sensor", {})


@pytest.mark.parametrize(
    ("action", "values", "says"),
    [
        ("juggle", {}, "choose from place-weight"),
        ("place-weight", {}, "mass_kg is missing"),
        ("place-weight", {"mass_kg": 0.0}, "must be positive"),
        ("fix-mass", {"mass_kg": -1.0}, "must not be negative"),
        ("turn-side", {"side": 0}, r"\+1 \(MFC up\) or -1"),
        ("stretch-membrane", {"elongation_m": -1e-3}, "must not be negative"),
        ("remove-weight", {}, "no weight lies"),
        ("remove-weight", {"mass_kg": 0.2}, "no weight lies"),
        ("hang-membrane", {"reference_m": 0.0, "elongation_m": -1.0}, "must not be negative"),
    ],
)
def test_what_hands_cannot_do_is_a_sentence(action: str, values: dict[str, float], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        bench_of().perform_action(action, values)


def test_the_sensor_is_zeroed_bumped_and_drifts() -> None:
    bench = bench_of(beyond=Nonidealities(drift_m_per_s=1e-9))
    bench.perform_action("place-weight", {"mass_kg": 0.2})
    bench.clock.sleep(8.0)
    bench.perform_action("zero-sensor", {})
    assert abs(level(bench, 0.1)) < 1e-9
    bench.perform_action("bump-sensor", {"by_m": 3e-5})
    assert level(bench, 10.0) == pytest.approx(3e-5 + 1e-8, abs=2e-10)
    bench.perform_action("remove-weight", {})
    assert level(bench) == pytest.approx(3e-5 - 0.2 * GRAVITY * COMPLIANCE, abs=3e-8)


def test_the_sensor_sees_the_membrane_hang_and_then_the_tactor_again() -> None:
    bench = bench_of()
    bench.perform_action("place-reference", {"reference_m": 3e-3})
    assert level(bench, 1.0) == 0.0
    bench.perform_action("hang-membrane", {"reference_m": 3e-3})
    assert level(bench, 5.0) == pytest.approx(sag(Membrane()).centre_m - 3e-3, abs=1e-8)
    bench.perform_action("place-weight", {"mass_kg": 0.1})
    assert level(bench) == pytest.approx(0.1 * GRAVITY * COMPLIANCE, rel=1e-6)


def test_what_nobody_watched_ends_where_watching_ends() -> None:
    ends = []
    for watched in (True, False):
        bench = bench_of(window_s=1.0)
        bench.perform_action("place-weight", {"mass_kg": 0.05})
        for _ in range(20 if watched else 1):
            level(bench, 1.0 if watched else 20.0)
        ends.append(level(bench, 50.0))
    assert ends[0] == pytest.approx(ends[1], rel=1e-9)


def test_creep_gains_the_same_in_every_decade_and_hysteresis_opens_a_loop() -> None:
    bench = bench_of(beyond=Nonidealities(creep_per_decade=0.02), window_s=1.0)
    bench.enable_hv()
    bench.history.append(0.0, ConstantSegment(5.0))
    decades = [level(bench, by) for by in (1.0, 9.0, 90.0, 900.0)]
    step = 1500.0 * voltage_gain(TACTOR)
    assert np.diff(decades) / step == pytest.approx([0.02] * 3, rel=0.02)
    assert decades[0] / step == pytest.approx(1 + 0.02 * np.log10(2 * np.pi * 100), abs=2e-4)

    looped = bench_of(beyond=Nonidealities(hysteresis_width=0.05))
    looped.enable_hv()
    at_rest = []
    for k, volts in enumerate((0.0, 2.5, 5.0, 2.5)):
        looped.history.append(1.0 + k, ConstantSegment(volts))
        at_rest.append(level(looped, 1.9 if k == 0 else 0.99))
    up, down = at_rest[1], at_rest[3]
    # a parabola either way from the ends: at rest, a quarter of the stroke from the lower one, three quarters of the largest width
    assert (down - up) / (2000.0 * voltage_gain(TACTOR)) == pytest.approx(0.75 * 0.05, rel=1e-3)
    back = []
    for k, volts in enumerate((5.0, 2.5)):  # a closed loop leaves nothing
        looped.history.append(5.0 + k, ConstantSegment(volts))
        back.append(level(looped, 0.99))
    assert back == pytest.approx(at_rest[2:], rel=1e-6)


def test_a_clamp_gives_for_good_sides_differ_and_weights_err() -> None:
    bench = bench_of(beyond=Nonidealities(clamp_gives_m_per_n=2e-6, side_difference=0.1, weight_error=0.02), seed=3)
    bench.perform_action("place-weight", {"mass_kg": 0.5})
    mfc_up = level(bench)
    bench.perform_action("remove-weight", {})
    true_n = 0.5 * GRAVITY * (1 + 0.02 * np.random.default_rng((3, 500_000_000)).normal())
    assert true_n != pytest.approx(0.5 * GRAVITY, rel=1e-4)
    assert level(bench) == pytest.approx(2e-6 * true_n, rel=1e-3)
    assert mfc_up == pytest.approx(true_n * (load_compliance(replace(TACTOR, k2=1.05 * TACTOR.k2)) + 2e-6), rel=1e-3)
    bench.perform_action("turn-side", {"side": -1})
    bench.perform_action("place-weight", {"mass_kg": 0.5})
    want = true_n * (load_compliance(replace(TACTOR, k2=0.95 * TACTOR.k2)) + 2e-6)
    assert level(bench) == pytest.approx(want, rel=1e-3)


@pytest.mark.parametrize("side", [1, -1])
def test_without_a_load_the_specimen_has_the_mean_stiffness_of_both_sides(side: int) -> None:
    bench = bench_of(beyond=Nonidealities(side_difference=0.1))
    bench.perform_action("turn-side", {"side": side})
    bench.enable_hv()
    bench.history.append(0.0, ConstantSegment(5.0))
    assert level(bench) == pytest.approx(side * 1500.0 * voltage_gain(TACTOR), rel=1e-3)


def test_the_simulated_operator_places_a_weight_and_presses_the_key_only_later() -> None:
    bench = bench_of()
    operator = SimulatedOperator(bench, patience_s=10.0)
    operator.show(1, Prompt("place-weight", "Place 50 g", {"mass_kg": 0.05}))
    assert operator.answer(1) is None
    assert level(bench, 0.9) == 0.0
    assert level(bench, 5.0) > 0.9 * 0.05 * GRAVITY * COMPLIANCE
    assert operator.answer(1) is None
    bench.clock.sleep(6.0)
    assert operator.answer(1) == "done"
    assert operator.answer(1) is None


def test_a_short_is_taken_off_before_high_voltage_comes_on() -> None:
    bench = bench_of()
    operator = SimulatedOperator(bench)
    operator.show(1, Prompt("short-electrodes", "Short them"))
    assert bench.plant.setup_state.shorted
    operator.show(2, Prompt("enable-high-voltage", "On"))
    assert not bench.plant.setup_state.shorted
    assert bench.history.high_voltage_on
    assert [operator.answer(k) for k in (1, 2)] == ["done", "done"]


@pytest.mark.deep
def test_hands_reach_into_a_bench_in_another_process() -> None:
    with BenchProcess(
        SimulationParameters(amplifier=AT_REST, hands=OperatorTiming(reach_s=0.0, release_s=0.0)), 20.0
    ) as bench:
        assert bench.perform_action("place-weight", {"mass_kg": 0.1}) >= 0.0
        with pytest.raises(BenchError, match="choose from place-weight"):
            bench.perform_action("juggle", {})
        begun_s = bench.now()
        while bench.now() < begun_s + 5.0:
            pass
        assert bench.laser_reading_m() == pytest.approx(0.1 * GRAVITY * COMPLIANCE, rel=1e-2)


def test_every_action_has_been_named() -> None:
    assert not set(SPECIMEN_ACTIONS) & set(SENSOR_ACTIONS)
