"""The current into the simulated specimen: parallel RC, constant loss, reciprocity, resonance; the current monitor."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from model import Tactor
from model.response import frequency_response, load_compliance, system_matrices, voltage_gain
from protocols.signals.sine import fit_sine
from sim_hardware.plant.parameters import AmplifierParameters, ElectricalParameters, SimulationParameters
from sim_hardware.plant.specimen_current import SpecimenCurrent, reciprocal_charge_c_per_m
from sim_hardware.plant.stepper import BLOCK
from tests.helpers.electrical.truth import true_admittance, true_capacitance, true_loss

RATE_HZ = 100e3
HALF_STEP_S = 0.5 / RATE_HZ


def bench(electrical: ElectricalParameters, monitor_hz: float = 1e7) -> SimulationParameters:
    return SimulationParameters(
        electrical=electrical, amplifier=AmplifierParameters(current_monitor_hz=monitor_hz), plant_rate_hz=RATE_HZ
    )


def measured_admittance(parameters: SimulationParameters, f: float, seconds: float = 1.0) -> complex:
    """Admittance under a sine of 100 V, from the second half of the record."""
    t = (np.arange(round(seconds * RATE_HZ / BLOCK) * BLOCK) + 1) / RATE_HZ
    volts = 100 * np.sin(2 * np.pi * f * t)
    moved = (100 * frequency_response(parameters.tactor, f, n=parameters.modes) * np.exp(2j * np.pi * f * t)).imag
    amps, _ = SpecimenCurrent(parameters).process(volts, moved)
    half = t.size // 2
    v, i = (fit_sine(x[half:], RATE_HZ, f).fundamental for x in (volts, amps))
    return complex(i / v) * np.exp(2j * np.pi * f * HALF_STEP_S)


@pytest.mark.parametrize("f", [20.0, 400.0])
def test_a_parallel_rc_has_its_closed_form(f: float) -> None:
    load = ElectricalParameters(2e-9, loss_per_decade=0.0, leakage_ohm=5e7, coupling=0.0)
    expected = 1 / 5e7 + 2j * np.pi * f * 2e-9
    assert abs(measured_admittance(bench(load), f) / expected - 1) < 1e-3


@pytest.mark.parametrize("f", [30.0, 300.0])
def test_loss_and_coupling_have_their_closed_form(f: float) -> None:
    parameters = bench(ElectricalParameters(1.1e-9, loss_per_decade=0.03, leakage_ohm=1e12))
    assert abs(measured_admittance(parameters, f) / true_admittance(parameters, np.array(f)) - 1) < 1e-3


def test_the_dielectric_loss_is_the_same_at_all_frequencies() -> None:
    parameters = bench(ElectricalParameters(loss_per_decade=0.03, leakage_ohm=1e15, coupling=0.0))
    loss = true_loss(parameters, np.geomspace(1, 1000, 9))
    assert loss == pytest.approx(np.pi / 2 / np.log(10) * 0.03, rel=0.15)
    assert true_capacitance(parameters, np.array([100.0]))[0] == pytest.approx(1.2e-9, rel=0.01)


def test_resonance_shows_in_the_capacitance() -> None:
    parameters = bench(ElectricalParameters())
    static, below, above = true_capacitance(parameters, np.array([1.0, 120.0, 200.0]))
    assert below > 1.1 * static > 2 * above


def test_charge_and_bending_are_reciprocal() -> None:
    """A force at the centre charges the short-circuited electrodes by the displacement that a volt makes."""
    tactor = Tactor()
    m = system_matrices(tactor, None, 40)
    charge_per_newton = 2 * float(m.B @ np.linalg.solve(m.K, m.B_F))
    assert charge_per_newton == pytest.approx(float(voltage_gain(tactor)), rel=0.02)
    by_voltage = reciprocal_charge_c_per_m(tactor, 40) * float(voltage_gain(tactor))
    assert by_voltage == pytest.approx(2 * float(m.B @ np.linalg.solve(m.K, m.B)), rel=0.02)
    assert float(voltage_gain(tactor)) ** 2 < by_voltage * float(load_compliance(tactor))  # the energy is positive


def test_a_steady_voltage_leaves_the_leakage() -> None:
    load = SpecimenCurrent(bench(ElectricalParameters(leakage_ohm=1e9)), 1000.0)
    assert load.process(np.full(4 * BLOCK, 1000.0), np.zeros(4 * BLOCK))[0, -1] == pytest.approx(1e-6, rel=1e-3)


@pytest.mark.parametrize(
    ("electrodes", "siemens"), [("open", 3e-11 * 2 * np.pi * 100), ("damaged", 1 / 2e5), ("reversed", 1.2e-9 * 628.3)]
)
def test_faults_of_the_connection(electrodes: str, siemens: float) -> None:
    load = ElectricalParameters(electrodes=electrodes, coupling=0.0)
    assert abs(measured_admittance(bench(load), 100.0)) == pytest.approx(siemens, rel=0.03)


@pytest.mark.parametrize("sense_ohm", [1e5, 1e9])
def test_a_sense_capacitor_integrates_the_current_and_takes_its_share(sense_ohm: float) -> None:
    load = ElectricalParameters(2e-9, 0.0, leakage_ohm=5e7, coupling=0.0, sense_f=1e-7, sense_ohm=sense_ohm)
    f, t = 20.0, (np.arange(round(RATE_HZ / BLOCK) * BLOCK) + 1) / RATE_HZ
    volts = 100 * np.sin(2 * np.pi * f * t)
    _, charge = SpecimenCurrent(bench(load)).process(volts, np.zeros(t.size))
    half, jw = t.size // 2, 2j * np.pi * f
    v, q = (fit_sine(x[half:], RATE_HZ, f).fundamental for x in (volts, charge))
    sensed = (jw * 2e-9 + 1 / 5e7) / (jw + 1 / (1e-7 * sense_ohm)) / 1.02
    assert complex(q / v) == pytest.approx(sensed, rel=2e-3)


def test_a_gap_leaves_the_charge_of_the_leakage() -> None:
    load = SpecimenCurrent(bench(ElectricalParameters(leakage_ohm=1e9, sense_ohm=1e6)))
    load.advance(1000.0, 0.5)
    held = load.process(np.full(BLOCK, 1000.0), np.zeros(BLOCK))[1, -1]
    assert held == pytest.approx(1e-6 + (1.2e-6 - 1e-6) * np.exp(-0.5), rel=0.05)


def test_the_monitor_is_of_first_order() -> None:
    load = ElectricalParameters(loss_per_decade=0.0, leakage_ohm=1e15, coupling=0.0)
    f, corner = 1000.0, 5000.0
    ratio = measured_admittance(bench(load, corner), f) / measured_admittance(bench(load), f)
    assert abs(ratio * (1 + 1j * f / corner) - 1) < 3e-3


def test_blocks_and_copies_continue_alike() -> None:
    parameters = bench(ElectricalParameters(), 20e3)
    t = np.arange(8 * BLOCK) / RATE_HZ
    volts, moved = 50 * np.sin(600 * t), 1e-5 * np.cos(600 * t)
    whole = SpecimenCurrent(parameters).process(volts, moved)
    parts, pieces = SpecimenCurrent(parameters), []
    for k in range(0, t.size, 2 * BLOCK):
        here, other = slice(k, k + 2 * BLOCK), copy(parts)
        pieces.append(parts.process(volts[here], moved[here]))
        assert np.array_equal(other.process(volts[here], moved[here]), pieces[-1])
    assert np.concatenate(pieces, axis=1) == pytest.approx(whole, abs=1e-12)


def test_impossible_loads_are_refused() -> None:
    with pytest.raises(ValueError, match="loose"):
        ElectricalParameters(electrodes="loose")
    with pytest.raises(ValueError, match="leakage_ohm"):
        replace(ElectricalParameters(), leakage_ohm=0.0)
