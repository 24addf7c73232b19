"""Max - min of noisy recordings against waveforms whose max - min is known."""

import numpy as np
import pytest

from protocols.signals import estimate_max_min

RATE_HZ = 5000.0


def dense_max_min(frequency_hz: float, size: float) -> float:
    """Max - min of the waveform by a million points of one cycle; no part of the program is used."""
    t = np.linspace(0, 1 / frequency_hz, 1_000_001)
    return float(np.ptp(response(t, frequency_hz, size)))


def response(t: np.ndarray, frequency_hz: float, size: float) -> np.ndarray:
    """A response with the second harmonic of a two-slope amplifier."""
    angle = 2 * np.pi * frequency_hz * t
    return np.asarray(size * (300e-6 * np.sin(angle) + 60e-6 * np.cos(2 * angle + 0.3) + 3e-6 * np.sin(4 * angle + 1)))


def estimates(frequency_hz: float, noise_m: float, repeats: int, size: float = 1.0, step_m: float = 0.0) -> np.ndarray:
    """Deviation from the truth, stated error and uncorrected deviation of each repeat, (repeats, 3)."""
    random = np.random.default_rng(round(10 * frequency_hz))
    truth, found = dense_max_min(frequency_hz, size), []
    count = int(np.ceil(max(20 / frequency_hz, 0.5) * RATE_HZ))
    for _ in range(repeats):
        t = np.arange(count) / RATE_HZ + random.uniform(0, 1 / frequency_hz)
        seen = response(t, frequency_hz, size) + noise_m * random.standard_normal(count)
        if step_m:
            seen = step_m * np.round(seen / step_m)
        got = estimate_max_min(seen, RATE_HZ, frequency_hz)
        found.append((got.value - truth, got.standard_error, np.ptp(seen) - truth))
    return np.array(found)


def test_max_min_is_that_of_the_waveform_and_not_of_its_noise() -> None:
    off, error, uncorrected = estimates(160.0, 1e-6, 3).T
    assert uncorrected.min() > 3e-6
    assert abs(off).max() < 4 * error.max()
    assert error.max() < 1e-6


@pytest.mark.deep
@pytest.mark.parametrize("frequency_hz", [25.0, 50.0, 100.0, 160.0, 250.0, 490.0])
def test_the_bias_by_noise_is_corrected_and_the_error_is_the_scatter_at_every_frequency(frequency_hz: float) -> None:
    off, error, uncorrected = estimates(frequency_hz, 1e-6, 60).T
    z = off / error
    assert uncorrected.mean() > 1.8e-6  # what was stated before
    assert abs(off.mean()) < 0.3e-6
    assert 0.7 < z.std() < 1.25
    assert np.mean(abs(z) < 1.96) > 0.88


@pytest.mark.deep
def test_max_min_of_a_response_hardly_larger_than_the_noise_is_honest() -> None:
    off, error, uncorrected = estimates(100.0, 1e-6, 60, size=0.01).T
    assert uncorrected.mean() > 5e-6
    assert np.mean(abs(off / error) < 1.96) > 0.85


@pytest.mark.deep
def test_coarse_steps_of_the_converter_are_in_the_error() -> None:
    off, error, _ = estimates(160.0, 0.05e-6, 60, step_m=0.3e-6).T
    assert np.mean(abs(off / error) < 1.96) > 0.9
    assert error.max() < 0.3e-6


def test_a_waveform_above_the_harmonics_that_can_be_fitted_has_a_large_error() -> None:
    t = np.arange(2500) / RATE_HZ
    seen = 300e-6 * np.sin(2 * np.pi * 1234.5 * t) + 60e-6 * np.cos(2 * np.pi * 2469 * t)
    got = estimate_max_min(seen, RATE_HZ, 1234.5)
    # dense max - min of the same waveform
    fine = np.linspace(0, 1, 100_001)
    truth = np.ptp(300e-6 * np.sin(2 * np.pi * fine) + 60e-6 * np.cos(4 * np.pi * fine))
    assert abs(got.value - truth) < 3 * got.standard_error


def test_a_clean_sine_is_exact() -> None:
    seen = 1e-4 * np.sin(2 * np.pi * 155 * np.arange(2500) / RATE_HZ) + 3e-5
    assert estimate_max_min(seen, RATE_HZ, 155.0).value == pytest.approx(2e-4, rel=1e-6)
