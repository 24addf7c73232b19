"""Power of a drive: closed forms of sine and square, the balance of energy, and the scatter of drawn parameters."""

import math
from dataclasses import replace

import numpy as np
import pytest

from model import AmplifierMap, ParameterError, Specimen, Tactor
from model.response import system_matrices
from model.studies.design import DesignAnswer, required_drive
from model.studies.power import EDGES_S, battery_life, drive_power, least_power, load_set
from model.studies.uncertainty import EstimateSet

EVEN = AmplifierMap(slope_below=400.0, slope_above=400.0)
STIFF = Specimen(replace(Tactor(), mu=-1e-10))
"""A specimen that nearly does not bend: a capacitor."""


def volts_peak_to_peak(drive_v: float) -> float:
    return 400.0 * drive_v


@pytest.mark.parametrize("hz", [20.0, 200.0])
def test_a_sine_takes_what_the_closed_form_says(hz: float) -> None:
    found = drive_power(STIFF, "sine", hz, 1e-10, load_set((1.8e-9, 0), (0.03, 0)), amplifier=EVEN)
    vpp = volts_peak_to_peak(found.drive_v.value)
    assert found.specimen_w.value == pytest.approx(math.pi * hz * 1.8e-9 * 0.03 * vpp**2 / 4, rel=1e-6)
    without_loss = drive_power(STIFF, "sine", hz, 1e-10, load_set((1.8e-9, 0), (0, 0), (0.5, 0)), amplifier=EVEN)
    assert without_loss.specimen_w.value < 1e-6 * found.specimen_w.value
    assert without_loss.driver_w.value == pytest.approx(2 * hz * 1.8e-9 * vpp**2 / 4, rel=1e-3)


@pytest.mark.parametrize(("waveform", "hz"), [("square", 200.0), ("belt", 50.0), ("belt", 400.0)])
def test_a_square_through_a_resistance_takes_what_the_closed_form_says(waveform: str, hz: float) -> None:
    load = load_set((1.8e-9, 0), (0, 0))
    found = drive_power(STIFF, waveform, hz, 1e-10, load, amplifier=EVEN)  # type: ignore[arg-type]
    vpp = volts_peak_to_peak(found.drive_v.value)
    swing = math.tanh(1 / (4 * hz * EDGES_S[waveform]))  # type: ignore[index]
    assert found.driver_w.value == pytest.approx(hz * 1.8e-9 * vpp**2 / 4 * swing**2, rel=3e-3)


@pytest.mark.parametrize("hz", [20.0, 110.0, 150.0, 300.0])
def test_without_dielectric_loss_the_dampers_take_all_power(hz: float) -> None:
    tactor = replace(Tactor(), k2=7.5e-3)
    m, omega = system_matrices(tactor), 2 * math.pi * np.array([20.0, hz])
    q = [np.linalg.solve(m.K + 1j * w * m.C - w**2 * m.M, m.B) for w in omega]
    loss = -2 * float((m.B @ q[0]).imag) / 1.8e-9  # of the bending at 20 Hz
    found = drive_power(Specimen(tactor), "sine", hz, 1e-5, load_set((1.8e-9, 0), (loss, 0)), amplifier=EVEN)
    volts = volts_peak_to_peak(found.drive_v.value) / 2
    dissipated = omega[1] ** 2 * volts**2 * float((np.conj(q[1]) @ m.C @ q[1]).real)  # of both halves of the beam
    assert found.specimen_w.value == pytest.approx(dissipated, rel=1e-6)
    assert found.drive_v.value == pytest.approx(required_drive(Specimen(tactor), hz, 1e-5, None, EVEN).value, rel=1e-4)


@pytest.mark.deep
def test_least_power_is_the_least_of_its_frequencies() -> None:
    load, hz = load_set((1.83e-9, 2e-11), (0.03, 0.002)), np.linspace(80, 240, 17).tolist()
    best = least_power(Specimen(), "sine", hz, 100e-6, load)
    others = [drive_power(Specimen(), "sine", f, 100e-6, load).driver_w.value for f in hz]
    assert best.driver_w.value == min(others)
    assert best.frequency_hz == hz[int(np.argmin(others))]
    with pytest.raises(ParameterError):
        least_power(Specimen(), "sine", [20.0], 1e-2, load)
    with pytest.raises(ParameterError):
        drive_power(Specimen(), "sine", 100.0, 1e-4, load_set((1e-10, 0), (0.03, 0)))


@pytest.mark.deep
def test_the_errors_are_the_scatter_of_drawn_values() -> None:
    names, values, errors = ("k2", "mu"), np.array([7.1e-3, -1.3e-5]), np.array([5e-5, 2e-7])
    estimates = EstimateSet(names, tuple(values), np.diag(errors**2))
    load = (1.83e-9, 3e-11), (0.03, 0.003), (0.7, 0.05)
    found = drive_power(Specimen(), "belt", 100.0, 80e-6, load_set(*load), estimates)
    rng, drawn = np.random.default_rng(2), []
    for _ in range(300):
        tactor = replace(Tactor(), **dict(zip(names, rng.normal(values, errors), strict=True)))
        one = load_set(*((float(rng.normal(*each)), 0.0) for each in load))
        got = drive_power(Specimen(tactor), "belt", 100.0, 80e-6, one)
        assert got.driver_w.standard_error is None
        drawn.append((got.drive_v.value, got.specimen_w.value, got.driver_w.value))
    for answer, scatter in zip((found.drive_v, found.specimen_w, found.driver_w), np.std(drawn, axis=0), strict=True):
        assert answer.standard_error == pytest.approx(scatter, rel=0.15)


def test_a_battery_lasts_its_energy_over_the_power() -> None:
    life = battery_life(10.0, DesignAnswer(0.5, 0.05), on_share=0.2, idle_w=0.1)
    assert life.value == pytest.approx(10 / 0.2)
    assert life.standard_error == pytest.approx(life.value * 0.01 / 0.2)
    assert battery_life(1.0, DesignAnswer(1.0, None)).standard_error is None
