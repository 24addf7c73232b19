"""Sine fit and settling detector, against signals with known parameters."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.signals import SettlingDetector, fit_frequency, fit_sine

RATE = 5000.0


def signal(n: int, f: float, components: list[complex], offset: float = 0.0, drift: float = 0.0) -> np.ndarray:
    t = np.arange(n) / RATE
    v = offset + drift * (t - t.mean())
    for k, c in enumerate(components, 1):
        v = v + abs(c) * np.sin(2 * np.pi * k * f * t + np.angle(c))
    return v


@given(
    st.floats(10, 250),
    st.complex_numbers(min_magnitude=0.1, max_magnitude=3),
    st.complex_numbers(max_magnitude=1),
    st.floats(-5, 5),
    st.floats(-1, 1),
)
def test_an_exact_signal_is_recovered_exactly(
    f: float, first: complex, second: complex, offset: float, drift: float
) -> None:
    fit = fit_sine(signal(2000, f, [first, second], offset, drift), RATE, f, 4)
    assert fit.components[0] == pytest.approx(first, abs=1e-7)
    assert fit.components[1] == pytest.approx(second, abs=1e-7)
    assert fit.offset == pytest.approx(offset, abs=1e-7)
    assert fit.drift_per_s == pytest.approx(drift, abs=1e-6)


def test_amplitude_is_unbiased_and_reaches_the_cramer_rao_bound() -> None:
    rng = np.random.default_rng(1)
    n, f, sigma, truth = 1000, 155.0, 0.05, 1.0 * np.exp(0.7j)
    clean = signal(n, f, [truth])
    fits = [fit_sine(clean + sigma * rng.standard_normal(n), RATE, f, 3) for _ in range(600)]
    amplitudes = np.array([abs(fit.fundamental) for fit in fits])
    phases = np.array([np.angle(fit.fundamental) for fit in fits])
    bound = sigma * np.sqrt(2 / n)
    assert abs(amplitudes.mean() - 1.0) < 4 * bound / np.sqrt(600)
    assert amplitudes.std() == pytest.approx(bound, rel=0.1)
    assert phases.std() == pytest.approx(bound, rel=0.1)
    assert np.mean([fit.standard_error for fit in fits]) == pytest.approx(bound, rel=0.02)
    covered = np.mean([abs(abs(fit.fundamental) - 1.0) < 1.96 * fit.standard_error for fit in fits])
    assert 0.925 < covered < 0.975


def test_frequency_of_a_drifting_clock_is_found_to_its_bound() -> None:
    rng = np.random.default_rng(2)
    n, sigma, truth = 2500, 0.01, 160.0 * (1 + 50e-6)
    clean = signal(n, truth, [2.5], 2.5)
    found = np.array([fit_frequency(clean + sigma * rng.standard_normal(n), RATE, 160.0) for _ in range(200)])
    bound = np.sqrt(6) * sigma / (np.pi * 2.5 * (n / RATE) * np.sqrt(n))  # single tone, four parameters
    assert abs(found.mean() - truth) < 4 * bound / np.sqrt(200)
    assert found.std() == pytest.approx(bound, rel=0.15)


def test_harmonics_beyond_the_sample_rate_are_left_out() -> None:
    assert len(fit_sine(signal(500, 700, [1.0]), RATE, 700, 8).components) == 3


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(ValueError, match="needs more than 4 samples, not 4"):
        fit_sine(np.zeros(4), RATE, 100)


def detector(**changes: float) -> SettlingDetector:
    expected = {
        "rate_hz": RATE,
        "frequency_hz": 100.0,
        "window_samples": 200,
        "drive_amplitude_v": 2.0,
        "tolerance": 0.005,
    }
    return SettlingDetector(**(expected | changes))  # type: ignore[arg-type]


def test_a_ringing_response_is_not_settled_before_it_has_rung_out() -> None:
    n, tau = 20_000, 0.3
    t = np.arange(n) / RATE
    drive = 2.5 + 2.0 * np.sin(2 * np.pi * 100 * t)
    response = np.sin(2 * np.pi * 100 * t - 1) + 2 * np.exp(-t / tau) * np.sin(2 * np.pi * 103 * t)
    watch = detector()
    for k in range(0, n, 50):
        if watch.feed(drive[k : k + 50], response[k : k + 50]):
            break
    settled_after = k / RATE
    assert 2 * np.exp(-settled_after / tau) < 0.02
    assert settled_after < 10 * tau


def test_noise_alone_does_not_keep_it_from_settling() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(5000) / RATE
    drive = 2.0 * np.sin(2 * np.pi * 100 * t)
    response = 0.01 * np.sin(2 * np.pi * 100 * t) + 0.01 * rng.standard_normal(5000)
    assert detector(tolerance=1e-6).feed(drive, response)


def test_a_drive_that_is_not_there_never_settles() -> None:
    t = np.arange(5000) / RATE
    watch = detector()
    assert not watch.feed(np.full(5000, 2.5), np.sin(2 * np.pi * 100 * t))
    assert watch.drive_seen_v < 0.01


def test_it_does_not_matter_how_the_samples_are_cut() -> None:
    t = np.arange(3000) / RATE
    drive, response = 2.0 * np.sin(2 * np.pi * 100 * t), np.sin(2 * np.pi * 100 * t) * (1 - np.exp(-t / 0.05))
    whole, pieces = detector(), detector()
    assert whole.feed(drive, response)
    assert any(pieces.feed(drive[k : k + 7], response[k : k + 7]) for k in range(0, 3000, 7))


def test_noise_of_a_short_record_counts_its_degrees_of_freedom() -> None:
    """A variance over n, not n - unknowns, would be 6 / 12 of the truth here."""
    rng = np.random.default_rng(7)
    clean = signal(12, 600.0, [1.0 + 0j])
    noise = [fit_sine(clean + 0.1 * rng.standard_normal(12), RATE, 600.0, 2).noise for _ in range(500)]
    assert np.mean(np.square(noise)) == pytest.approx(0.1**2, rel=0.12)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("responses", "drives", "steady"),
    [
        ([1.0, 1.0, 1.0], [1, 1, 1], [0, 0, 1]),
        ([0.5, 1.0, 1.0, 1.0], [1, 1, 1, 1], [0, 0, 0, 1]),
        ([1.0, 1.0, 0.5, 0.5, 0.5], [1, 1, 1, 1, 1], [0, 0, 0, 0, 1]),
        ([1.0, 1.0, 1.0, 1.0, 1.0, 1.0], [1, 1, 0, 1, 1, 1], [0, 0, 0, 0, 0, 1]),
        ([1.0, 1.0, 1.0, 1.0], [1, 1, 1.06, 0.94], [0, 0, 0, 0]),
        ([1.0, 1.0, 1.0], [0.96, 1.04, 0.96], [0, 0, 1]),
        ([1.0, 1.0, -1.0, -1.0, -1.0], [1, 1, 1, 1, 1], [0, 0, 0, 0, 1]),
    ],
)
def test_a_response_is_steady_after_three_equal_windows_in_a_row_with_the_drive_on(
    responses: list[float], drives: list[float], steady: list[int]
) -> None:
    detector = SettlingDetector(RATE, 100.0, 500, 1.0, 0.01)
    wave = signal(500, 100.0, [1.0 + 0j])
    seen = [
        detector.feed(drive * wave, 1e-4 * drive * size * wave) for size, drive in zip(responses, drives, strict=True)
    ]
    assert seen == [bool(each) for each in steady]


@given(st.floats(-0.4, 0.4), st.floats(0.0, 2 * np.pi), st.integers(200, 3000))
def test_the_frequency_is_found_from_any_start_within_its_line(away: float, phase: float, samples: int) -> None:
    clean = signal(samples, 200.0, [np.exp(1j * phase)], 0.3, 0.1)
    assert fit_frequency(clean, RATE, 200.0 + away * RATE / samples) == pytest.approx(200.0, rel=1e-7)
