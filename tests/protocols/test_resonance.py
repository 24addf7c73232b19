"""Resonance and damping from the points of a dwell: not biased by noise or higher modes."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from model.parameters import Tactor
from model.response.harmonic_response import tactor_modal_form
from protocols.measurements.mass_resonance import MassResonance
from protocols.measurements.sine_dwell import PAPER_FREQUENCIES_HZ, fit_resonance
from tests.helpers.simulated_bench import laboratory, run, simulated

AMPLITUDE_V = 2.5


def first_pole(tactor: Tactor) -> tuple[float, float]:
    """Natural frequency and damping ratio as the model's own eigenvalues have them."""
    poles = tactor_modal_form(tactor, None, 7).poles
    first = min(poles[poles.imag > 0], key=abs)
    return abs(first) / (2 * np.pi), -first.real / abs(first)


def dwelt(tactor: Tactor, frequencies_hz: np.ndarray, noise: float, rng: np.random.Generator) -> list[SimpleNamespace]:
    """Points of a linear tactor with complex noise relative to the largest of them."""
    form = tactor_modal_form(tactor, None, 7)
    s = 2j * np.pi * frequencies_hz
    response = 400 * np.sum(form.residues[:, None] / (s[None, :] - form.poles[:, None]), axis=0)
    noisy = response + noise * np.abs(response).max() * (rng.standard_normal((2, s.size)) * [[1], [1j]]).sum(axis=0)
    return [
        SimpleNamespace(
            frequency=f,
            fundamental=AMPLITUDE_V * abs(h),
            fundamental_errors=AMPLITUDE_V * noise * float(np.abs(response).max()),
            phase=float(np.angle(h)),
            drive_amplitude=AMPLITUDE_V,
        )
        for f, h in zip(frequencies_hz, noisy, strict=True)
    ]


@pytest.mark.deep
@pytest.mark.parametrize("noise", [1e-5, 3e-3])
@pytest.mark.parametrize("m_add", [7.73e-3, 2.75e-3])
def test_pulls_are_those_of_honest_standard_errors(noise: float, m_add: float) -> None:
    """Deviation over standard error: rms near 1 where noise rules, and never far above it where the model's error does."""
    rng = np.random.default_rng(5)
    tactor = replace(Tactor(), m_add=m_add)
    f = np.array(PAPER_FREQUENCIES_HZ, float) if m_add > 5e-3 else np.linspace(50, 450, 18)
    truth = first_pole(tactor)
    pulls = []
    for _ in range(40):
        found = [e for e in fit_resonance(dwelt(tactor, f, noise, rng)) if e.name != "damped_frequency"]
        pulls.append([(e.value - t) / e.standard_error for e, t in zip(found, truth, strict=True)])
    rms = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert np.all(rms < 1.3), rms
    assert np.all(rms > (0.6 if noise > 1e-4 else 0.05)), rms
    assert np.all(np.abs(np.mean(pulls, axis=0)) < 0.4)


def test_points_on_one_side_of_the_resonance_tell_none() -> None:
    rng = np.random.default_rng(6)
    assert fit_resonance(dwelt(Tactor(), np.linspace(20, 60, 8), 1e-4, rng)) == ()
    assert fit_resonance(dwelt(Tactor(), np.array([100.0, 150, 200, 250]), 0.0, rng)) == ()


def test_a_tactor_that_moves_away_from_the_sensor_has_the_same_resonance() -> None:
    points = dwelt(Tactor(), np.array(PAPER_FREQUENCIES_HZ, float), 1e-5, np.random.default_rng(7))
    for point in points:
        point.phase = float(np.angle(-np.exp(1j * point.phase)))
    frequency, _, damping = (e.value for e in fit_resonance(points))
    assert (frequency, damping) == (pytest.approx(158.31, abs=0.01), pytest.approx(0.2110, abs=1e-4))


def test_the_frequency_of_a_mass_is_the_largest_response_and_the_spectrum_stands_beside_it(tmp_path: Path) -> None:
    mass = 9.75e-3
    with laboratory(simulated(seed=4)) as lab:
        ran = run(MassResonance(masses_kg=(mass,), sweep_s=10, piece_s=10), tmp_path, lab)
    (point,) = ran.points
    fine = np.linspace(100, 200, 100_001)
    form = tactor_modal_form(replace(Tactor(), m_add=mass), None, 7)
    response = np.sum(form.residues[:, None] / (2j * np.pi * fine - form.poles[:, None]), axis=0)
    peak = fine[np.abs(response).argmax()]
    assert abs(point.frequency - peak) < 5 * point.frequency_errors < 0.2
    assert (point.spectrum_peak, point.spectrum_peak_errors) != (point.frequency, point.frequency_errors)
