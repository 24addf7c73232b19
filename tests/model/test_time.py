"""Steps, sampled drives, sweeps and latency agree with one another and with the static and steady limits."""

import numpy as np
import pytest

from model.amplifier_map import AmplifierMap
from model.membrane import skin
from model.parameters import Membrane, Skin, Tactor
from model.response.harmonic_response import frequency_response, tactor_modal_form
from model.response.latency import sine_latency, step_latency, step_response
from model.response.statics import voltage_gain
from tests.helpers.model.sweep_response import chirp_response, sweep_response
from tests.helpers.sampled import march

ON = skin(Membrane(), 0.01)


@pytest.mark.parametrize("on", [None, ON, Skin(100.0, 2e4)])
def test_step_is_the_sampled_drive_that_never_changes(on: Skin | None) -> None:
    t = np.arange(2000) / 20_000
    w = step_response(Tactor(), t, 1500.0, on)
    for hold in ("linear", "zero"):
        assert march(tactor_modal_form(Tactor(), on), np.full(2000, 1500.0), 20_000, hold) == pytest.approx(
            w, abs=1e-12
        )
    assert w[0] == 0
    assert step_response(Tactor(), 10.0, 1500.0) == pytest.approx(1500 * voltage_gain(Tactor()), rel=2e-3)


def test_step_begins_with_no_speed() -> None:
    """A step of voltage is a step of moment: deflection starts with t^2, not with a jump or a slope."""
    early = step_response(Tactor(), np.array([1e-7, 2e-7]))
    assert early[1] / early[0] == pytest.approx(4, rel=0.01)


def test_march_is_exact_for_a_ramp_whatever_the_rate() -> None:
    coarse, fine = (march(tactor_modal_form(Tactor()), np.arange(n) / (n - 1), (n - 1) / 0.02) for n in (21, 2001))
    assert coarse == pytest.approx(fine[::100], abs=1e-12 * abs(fine).max())


@pytest.mark.deep
@pytest.mark.parametrize(
    ("start", "stop"),
    [
        (25.0, 525.0),
        pytest.param(525.0, 25.0, marks=pytest.mark.deep),
        pytest.param(140.0, 140.0, marks=pytest.mark.deep),
    ],
)
def test_chirp_in_closed_form_is_the_sampled_chirp(start: float, stop: float) -> None:
    T, rate = 0.4, 200_000
    t = np.arange(int(T * rate) + 1) / rate
    theta = 2 * np.pi * (start * t + (stop - start) * t**2 / (2 * T))
    sampled = march(tactor_modal_form(Tactor(), ON), np.cos(theta), rate)
    exact = chirp_response(tactor_modal_form(Tactor(), ON), t, 2 * np.pi * start, 2 * np.pi * (stop - start) / T)
    assert exact.real == pytest.approx(sampled, abs=1e-5 * abs(sampled).max())


@pytest.mark.deep
def test_sweep_through_the_amplifier() -> None:
    T, rate = 0.3, 100_000
    t = np.arange(int(T * rate) + 1) / rate
    u = 2.5 + 2.5 * np.sin(2 * np.pi * (25 * t + 500 * t**2 / (2 * T)))
    sampled = march(tactor_modal_form(Tactor()), AmplifierMap().specimen_v(u), rate)
    w = sweep_response(Tactor(), t[::7], duration_s=T, orders=32)
    assert w == pytest.approx(sampled[::7], abs=2e-4 * np.ptp(sampled))


@pytest.mark.deep
def test_sweep_around_an_offset_begins_at_its_deflection() -> None:
    T, rate, hold = 0.2, 100_000, 20_000
    t = np.arange(int(T * rate) + 1) / rate
    u = 3.2 + 1.5 * np.sin(2 * np.pi * (50 * t + 250 * t**2 / (2 * T)))
    sampled = march(
        tactor_modal_form(Tactor()), AmplifierMap().specimen_v(np.concatenate((np.full(hold, 3.2), u))), rate
    )[hold:]
    w = sweep_response(Tactor(), t[::7], 50.0, 300.0, T, amplitude_v=1.5, offset_v=3.2, orders=32)
    assert w == pytest.approx(sampled[::7], abs=2e-4 * np.ptp(sampled))
    assert w[0] == pytest.approx(600 * 0.7 * voltage_gain(Tactor()), rel=1e-2)


def test_the_papers_slow_sweep_is_a_steady_state_at_every_moment() -> None:
    """300 s from 25 to 525 Hz: around 250 s the amplitude is that of the frequency response."""
    at = 270.0 + np.linspace(0, 0.01, 400)
    w = sweep_response(Tactor(), at)
    f = 25 + 500 * 270.0 / 300
    assert np.ptp(w) == pytest.approx(2000 * abs(frequency_response(Tactor(), f)[0]), rel=0.01)


def test_latency_figures_are_those_of_a_finely_sampled_step() -> None:
    t = np.arange(0, 0.05, 1e-6)
    w = step_response(Tactor(), t, -500.0, ON)
    final = abs(w[-1])
    got = step_latency(Tactor(), -500.0, threshold_m=20e-6, skin=ON)
    assert got.final_m == pytest.approx(final, rel=1e-6)
    assert got.to_threshold_s == pytest.approx(t[np.argmax(-w >= 20e-6)], abs=2e-6)
    low, high = (t[np.argmax(-w >= share * final)] for share in (0.1, 0.9))
    assert got.rise_s == pytest.approx(high - low, abs=3e-6)
    assert got.settling_s == pytest.approx(t[np.flatnonzero(abs(-w - final) > 0.02 * final)[-1]], abs=3e-6)


def test_sine_onset() -> None:
    t = np.arange(0, 0.1, 2e-6)
    v = AmplifierMap().specimen_v(2.5 + 2.5 * np.sin(2 * np.pi * 100 * t))
    w = march(tactor_modal_form(Tactor()), v, 500_000)
    got = sine_latency(Tactor(), 100.0)
    assert got.to_threshold_s == pytest.approx(t[np.argmax(abs(w) >= 50e-6)], abs=4e-6)
    assert got.final_m == pytest.approx(724.0e-6 / 2, rel=1e-4)
    assert got.rise_s is not None
    assert 1e-3 < got.rise_s < 1 / 100
    assert got.settling_s is not None
    assert 0.01 < got.settling_s < 0.03


def test_what_never_happens_is_none() -> None:
    assert step_latency(Tactor(), 100.0).to_threshold_s is None
    assert step_latency(Tactor(c0=0.0)).settling_s is None
    assert step_latency(Tactor(mu=0.0)).rise_s is None
