"""Capacitance, loss, loop and energy against closed forms; statistical and total uncertainties against their scatter."""

import numpy as np
import pytest
from scipy.signal import lfilter

from model import Tactor
from model.response import frequency_response
from protocols.measurements.electrical import Electrical
from protocols.signals.electrical import InputErrors, electrical_response, leakage_current

RATE_HZ, F = 50e3, 40.0
T = np.arange(50_000) / RATE_HZ
FARADS, OHMS = 1.3e-9, 2e8


def rc_current(t: np.ndarray, f: float = F, c_per_m: float = 0.0) -> np.ndarray:
    """Current of a parallel RC, and of a charge that follows the tactor's displacement, under 100 V sin."""
    w = 2 * np.pi * f
    y = 1 / OHMS + 1j * w * (FARADS + c_per_m * complex(frequency_response(Tactor(), f)[()].item()))
    return np.asarray(100 * (y * np.exp(1j * w * t)).imag)


def volts(t: np.ndarray, f: float = F) -> np.ndarray:
    return np.asarray(100 * np.sin(2 * np.pi * f * t))


def test_a_parallel_rc_has_its_closed_form() -> None:
    seen = electrical_response(volts(T), rc_current(T), RATE_HZ, F)
    assert seen.capacitance.value == pytest.approx(FARADS, rel=1e-9)
    assert seen.loss.value == pytest.approx(1 / (OHMS * 2 * np.pi * F * FARADS), rel=1e-9)
    assert seen.energy.value == pytest.approx(100**2 / OHMS / (2 * F), rel=1e-9)
    assert abs(1 / seen.admittance_s) == pytest.approx(100 / np.abs(rc_current(T)).max(), rel=1e-4)


@pytest.mark.one_in(1)
@pytest.mark.parametrize("f", [20.0, 150.0, 180.0])
def test_the_bending_adds_its_charge(f: float) -> None:
    c_per_m = 5e-4
    seen = electrical_response(volts(T, f), rc_current(T, f, c_per_m), RATE_HZ, f)
    bent = c_per_m * complex(frequency_response(Tactor(), f)[()].item())
    assert seen.capacitance.value == pytest.approx(FARADS + bent.real, rel=1e-6)
    assert seen.loss.value > 1 / (OHMS * 2 * np.pi * f * FARADS)


def test_delays_are_removed_from_the_loss() -> None:
    v_delay_s, i_delay_s = 12e-6, 40e-6
    errors = InputErrors(v_delay_s, i_delay_s)
    seen = electrical_response(volts(T - v_delay_s), rc_current(T - i_delay_s), RATE_HZ, F, errors)
    assert seen.loss.value == pytest.approx(1 / (OHMS * 2 * np.pi * F * FARADS), rel=1e-6)


def test_a_charge_on_a_bled_sense_capacitor_gives_the_same() -> None:
    bleed_s, w = 0.05, 2 * np.pi * F
    y = 1 / OHMS + 1j * w * FARADS
    charge = 100 * (y / (1j * w + 1 / bleed_s) * np.exp(1j * w * T)).imag
    seen = electrical_response(volts(T), charge, RATE_HZ, F, InputErrors(bleed_s=bleed_s), is_charge=True)
    assert seen.capacitance.value == pytest.approx(FARADS, rel=1e-9)
    assert seen.loss.value == pytest.approx(1 / (OHMS * w * FARADS), rel=1e-7)


def test_the_energy_is_the_area_of_the_loop() -> None:
    """Also for a voltage with harmonics, as the amplifier's two slopes make it."""
    w = 2 * np.pi * F
    v = 100 * np.sin(w * T) + 30 * np.cos(2 * w * T)
    i = v / OHMS + FARADS * (100 * w * np.cos(w * T) - 60 * w * np.sin(2 * w * T))
    seen = electrical_response(v, i, RATE_HZ, F)
    x, q, _ = seen.loop()
    area = float(np.sum(0.5 * (x[1:] + x[:-1]) * np.diff(q)))
    assert seen.energy.value == pytest.approx((100**2 + 30**2) / OHMS / (2 * F), rel=1e-6)
    at = np.arange(129) / 128 / F
    assert x == pytest.approx(100 * np.sin(w * at) + 30 * np.cos(2 * w * at), abs=1e-6)
    assert area == pytest.approx(seen.energy.value, rel=5e-3)
    assert np.ptp(q) == pytest.approx(FARADS * np.ptp(x), rel=0.01)


@pytest.mark.parametrize("f", Electrical().frequencies_hz[-2:])
def test_the_jump_of_the_current_does_not_alias_into_the_loss(f: float) -> None:
    """A capacitor behind an amplifier of two slopes, seen by a monitor of 20 kHz, a fifth of a sample after the jump."""
    rate_hz, corner_s, fine_s = Electrical().sample_rate_hz, 1 / (2 * np.pi * 20e3), 2e-7
    t = np.arange(int(0.5 / fine_s)) * fine_s
    wave = np.sin(2 * np.pi * f * t)
    v = np.where(wave > 0, 600, 200) * wave
    current = lfilter([1 - np.exp(-fine_s / corner_s)], [1, -np.exp(-fine_s / corner_s)], np.gradient(v, fine_s))
    at = 0.1 + (np.arange(int(0.3 * rate_hz)) + 0.2) / rate_hz
    delay = InputErrors(flow_delay_s=corner_s - 0.5 * fine_s)
    seen = electrical_response(np.interp(at, t, v), np.interp(at, t, current), rate_hz, f, delay)
    power = 0.5 * float(np.sum(np.abs(seen.voltage * seen.current)))
    assert abs(seen.loss.value) < 5e-5
    assert abs(seen.energy.value * f) < 1e-4 * power


@pytest.mark.deep
def test_uncertainties_are_the_scatter() -> None:
    rng, gain, delay = np.random.default_rng(3), 0.01, 2e-5
    errors = InputErrors(gain_relative=gain, delay_s=delay)
    clean_v, w = volts(T[:5000]), 2 * np.pi * F
    pulls = []
    for _ in range(200):
        late_s = rng.normal(0, delay)
        i = (1 + rng.normal(0, gain)) * rc_current(T[:5000] - late_s) + rng.normal(0, 3e-6, 5000)
        seen = electrical_response(clean_v, i, RATE_HZ, F, errors)
        truth = (FARADS, 1 / (OHMS * w * FARADS), 100**2 / OHMS / (2 * F))
        figures = (seen.capacitance, seen.loss, seen.energy)
        pulls.append([(each.value - true) / each.total for each, true in zip(figures, truth, strict=True)])
        assert all(each.statistical < each.total for each in figures)
    assert np.sqrt(np.mean(np.square(pulls), axis=0)) == pytest.approx([1, 1, 1], abs=0.15)


def test_leakage_is_the_current_less_the_rest() -> None:
    rng = np.random.default_rng(1)
    rest, held = (offset + rng.normal(0, 1e-8, 5000) for offset in (3e-8, 8e-8))
    seen = leakage_current(held, rest, RATE_HZ, InputErrors(gain_relative=0.01), is_charge=False)
    assert abs(seen.value - 5e-8) < 4 * seen.statistical < 1e-9
    assert seen.total == pytest.approx(np.hypot(seen.statistical, 5e-10), rel=0.02)


def test_leakage_of_a_charge_is_its_slope() -> None:
    held = 1e-9 + 5e-8 * T
    seen = leakage_current(held, np.zeros(100), RATE_HZ, InputErrors(), is_charge=True)
    assert seen.value == pytest.approx(5e-8, rel=1e-6)


def test_a_voltage_without_the_sine_is_refused() -> None:
    noise = np.random.default_rng(0).normal(size=T.size)
    with pytest.raises(ValueError, match="no sine of 40 Hz"):
        electrical_response(noise, rc_current(T), RATE_HZ, F)


@pytest.mark.deep
@pytest.mark.parametrize("f", [20.0, 150.01, 401.3])
def test_the_kink_of_the_drive_is_no_noise(f: float) -> None:
    """An amplifier with two slopes makes harmonics beyond the fitted ones; current and energy of the whole have closed forms."""
    rng, found, delay_s = np.random.default_rng(5), [], 1e-6
    t, w, v_noise, i_noise = T[: round(12 * RATE_HZ / f)], 2 * np.pi * f, 0.3, 4e-6
    drive, slope = np.sin(w * t + 0.3), np.where(np.sin(w * t + 0.3) > 0, *(slopes := (1500.0, 500.0)))
    v, i = slope * drive, slope * (drive / OHMS + FARADS * w * np.cos(w * t + 0.3))
    for _ in range(60):
        noisy = (v + v_noise * rng.normal(size=t.size), i + i_noise * rng.normal(size=t.size))
        seen = electrical_response(*noisy, RATE_HZ, f, InputErrors(delay_s=delay_s))
        found.append([(e.value, e.statistical) for e in (seen.capacitance, seen.loss, seen.energy)])
    values, stated = np.moveaxis(np.array(found), 2, 0)
    # At most a third too wide, where a period is no whole number of samples.
    assert np.all((values.std(axis=0) > 0.7 * stated.mean(axis=0)) & (values.std(axis=0) < 1.3 * stated.mean(axis=0)))
    turned = delay_s * 0.25 * FARADS * w * w * sum(each**2 for each in slopes) / f
    assert np.sqrt(seen.energy.total**2 - seen.energy.statistical**2) == pytest.approx(turned, rel=0.03)
