"""Plant: agrees with the model where the model is exact, and keeps its state."""

import numpy as np
import pytest

from model.response.harmonic_response import amplifier_response
from model.response.latency import step_response
from model.response.statics import voltage_gain
from sim_hardware.plant.parameters import AmplifierParameters, Nonidealities, SimulationParameters
from sim_hardware.plant.plant import Plant
from sim_hardware.plant.segments import ConstantSegment, PeriodicSegment
from sim_hardware.plant.stepper import BLOCK, limit_slew
from sim_hardware.plant.voltage_history import VoltageHistory


def plant_with(*pieces, truth: SimulationParameters | None = None) -> Plant:
    history = VoltageHistory()
    history.append(0.0, ConstantSegment(2.5))
    history.switch_high_voltage(0.0, hv=True)
    for start, segment in pieces:
        history.append(start, segment)
    return Plant(truth or SimulationParameters(), history)


def fundamental(t, w, frequency_hz):
    basis = np.c_[np.ones(t.size), np.sin(2 * np.pi * frequency_hz * t), np.cos(2 * np.pi * frequency_hz * t)]
    c = np.linalg.lstsq(basis, w, rcond=None)[0]
    return c[1] + 1j * c[2]


@pytest.mark.parametrize("frequency_hz", [25.0, 80.0, 158.0, 250.0])
def test_dwell_has_the_models_fundamental_and_peak_to_peak(frequency_hz):
    plant = plant_with((0.0, PeriodicSegment(0.0, frequency_hz, 2.5, 2.5, 0.0, 2.5)))
    t = 1.0 + np.arange(49_997) / 49_997  # anywhere between the grid points
    w = plant.displacement(t)
    want = amplifier_response(SimulationParameters().tactor, frequency_hz)
    assert abs(fundamental(t, w, frequency_hz) / want.fundamental[0] - 1) < 5e-6
    assert w.max() - w.min() == pytest.approx(want.peak_to_peak[0], rel=1e-3)


def test_step_follows_the_models_own_step_response():
    plant = plant_with(
        (0.1, ConstantSegment(5.0)), truth=SimulationParameters(amplifier=AmplifierParameters(slew_v_per_s=1e12))
    )
    after = np.arange(1, 1000) / 50e3
    w = plant.displacement(0.1 + after)
    # A step between two grid points reaches the plant as a ramp of one grid step: half a step late.
    want = step_response(SimulationParameters().tactor, after + 0.5e-5, 1500.0)
    assert np.abs(w - want).max() < 2e-3 * np.abs(want).max()


def test_slew_limit_bounds_every_step_and_leaves_slow_drives_alone():
    target = np.concatenate([np.zeros(10), np.full(50, 100.0), np.linspace(100, 90, 40), np.full(30, -50.0)])
    out = limit_slew(target, 0.0, 7.0)
    assert np.abs(np.diff(out, prepend=0.0)).max() <= 7.0 + 1e-12
    assert out[59] == 100.0
    assert out[-1] == -50.0
    assert out[60:100] == pytest.approx(target[60:100])
    slow = np.sin(np.linspace(0, 6, 1000))
    assert limit_slew(slow, 0.0, 0.1) is slow


def test_slew_limit_does_not_depend_on_the_portions():
    target = 100 * np.sin(np.linspace(0, 40, 1000))
    whole = limit_slew(target, 0.0, 1.5)
    parts, at = [], 0.0
    for piece in np.split(target, 10):
        parts.append(limit_slew(piece, at, 1.5))
        at = float(parts[-1][-1])
    assert np.array_equal(np.concatenate(parts), whole)


def test_a_slow_amplifier_shrinks_the_response():
    dwell = (0.0, PeriodicSegment(0.0, 250.0, 2.5, 2.5, 0.0, 2.5))
    t = 0.5 + np.arange(10_000) / 50e3
    fast = np.ptp(plant_with(dwell).displacement(t))
    slow = np.ptp(
        plant_with(dwell, truth=SimulationParameters(amplifier=AmplifierParameters(slew_v_per_s=5e5))).displacement(t)
    )
    assert slow < 0.8 * fast


def test_disabled_high_voltage_moves_nothing():
    history = VoltageHistory()
    history.append(0.0, PeriodicSegment(0.0, 100.0, 2.5, 2.5, 0.0, 2.5))
    plant = Plant(SimulationParameters(), history)
    assert not plant.displacement(np.linspace(0.1, 0.2, 100)).any()


def test_portions_do_not_change_the_motion():
    dwell = (0.01, PeriodicSegment(0.01, 170.0, 2.5, 2.5, 0.0, 2.5))
    t = np.arange(20_000) / 50e3
    whole = plant_with(dwell).displacement(t)
    plant = plant_with(dwell)
    parts = np.concatenate([plant.displacement(p) for p in np.array_split(t, 173)])
    assert np.abs(parts - whole).max() < 1e-15


def test_a_long_unwatched_gap_is_skipped_without_a_trace():
    dwell = (0.0, PeriodicSegment(0.0, 100.0, 2.5, 2.5, 0.0, 2.5))
    t = 3000.0 + np.arange(500) / 5e3
    late = plant_with(dwell).displacement(t)
    # Ten cycles a tenth of a second: the same phase half an hour earlier.
    assert late == pytest.approx(plant_with(dwell).displacement(t - 2999.0), rel=1e-6, abs=1e-12)


def test_memory_is_bounded_and_asking_for_more_is_an_error():
    plant = plant_with((0.0, PeriodicSegment(0.0, 100.0, 2.5, 2.5, 0.0, 2.5)), truth=SimulationParameters(window_s=0.5))
    plant.displacement(np.linspace(0, 2.0, 100)[-20:])
    plant.displacement(np.array([1.9]))
    with pytest.raises(ValueError, match=r"remembers 0\.5"):
        plant.displacement(np.array([1.0]))


def test_ready_times_agree_with_each_other():
    plant = plant_with()
    for t in (0.0, 1e-5, 0.01234567, 1.265e-3, 1.28e-3, 3.0):
        ready = plant.available_at(t)
        assert plant.available_until(ready) >= t
        assert 0 < ready - t <= (BLOCK + 2) / 100e3


def test_what_stands_still_is_where_the_statics_have_it_and_goes_on_from_there():
    """A held level is not stepped; portions see that, one long stretch does not."""
    pieces = (
        (0.1, ConstantSegment(5.0)),
        (1.0, ConstantSegment(1.0)),
        (1.5, PeriodicSegment(1.5, 170.0, 2.0, 2.5, 0.0, 2.5)),
    )
    t = np.arange(100_000) / 50e3
    whole = plant_with(*pieces).displacement(t)
    plant = plant_with(*pieces)
    parts = np.concatenate([plant.displacement(p) for p in np.split(t, 100)])
    assert np.abs(parts - whole).max() < 1e-14
    still = parts[(t > 0.9) & (t < 0.97)]
    assert np.ptp(still) == 0.0
    assert still[0] == pytest.approx(1500 * voltage_gain(SimulationParameters().tactor), rel=1e-6)


@pytest.mark.deep
def test_a_held_level_creeps_without_its_motion_as_with_it(monkeypatch):
    truth = SimulationParameters(beyond=Nonidealities(creep_per_decade=0.015, hysteresis_width=0.05))
    steps = [(1.0, ConstantSegment(5.0)), (3.0, ConstantSegment(1.0)), (4.0, ConstantSegment(2.5))]
    t = np.arange(0.5, 6.0, 1e-3)
    quick = plant_with(*steps, truth=truth).displacement(t)
    monkeypatch.setattr(Plant, "_quasi_static_displacement", lambda *_: None)
    assert np.abs(quick - plant_with(*steps, truth=truth).displacement(t)).max() < 2e-9
    assert np.ptp(quick[(t > 2) & (t < 3)]) > 1e-6
