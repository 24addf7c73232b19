"""Levels, steps and creep: bias, scatter against the bound, and coverage, over hundreds of seeds."""

import numpy as np
import pytest

from protocols.signals.held_level import LevelEstimate, combine_errors, estimate_level, estimate_step, fit_creep
from tests.helpers.coverage import coverage_factor

RATE = 5000.0


def slow_noise(rng: np.random.Generator, n: int, memory: float) -> np.ndarray:
    """First-order noise of variance 1 that forgets with `memory` per sample."""
    from scipy.signal import lfilter

    white = rng.standard_normal(n + 200)
    return lfilter([np.sqrt(1 - memory**2)], [1, -memory], white)[200:]


def covered(values: np.ndarray, truth: float, errors: np.ndarray, freedoms: np.ndarray) -> float:
    factors = np.array([coverage_factor(f) for f in freedoms])
    return float(np.mean(np.abs(values - truth) <= factors * errors))


@pytest.mark.one_in(2)
@pytest.mark.parametrize("memory", [0.0, 0.95])
def test_a_level_is_covered_whether_its_noise_is_white_or_slow(memory: float) -> None:
    rng = np.random.default_rng(11)
    n, seeds = 2000, 400
    t = np.arange(n) / RATE
    mains = 3.0 * np.sin(2 * np.pi * 50 * t + 0.4) + 0.5 * np.sin(2 * np.pi * 150 * t)
    found = [estimate_level(2.0 + mains + slow_noise(rng, n, memory), RATE) for _ in range(seeds)]
    values = np.array([f.value for f in found])
    bound = np.sqrt((1 + memory) / (1 - memory) / n)  # of the mean of first-order noise, long record
    assert abs(values.mean() - 2.0) < 4 * bound / np.sqrt(seeds)
    assert values.std() == pytest.approx(bound, rel=0.12)
    rate = covered(
        values, 2.0, np.array([f.standard_error for f in found]), np.array([f.degrees_of_freedom for f in found])
    )
    assert 0.93 < rate < 0.97


def test_a_variance_alone_would_have_promised_four_times_too_much() -> None:
    rng = np.random.default_rng(12)
    found = estimate_level(slow_noise(rng, 5000, 0.95), RATE)
    assert found.standard_error > 4 * found.noise / np.sqrt(5000)


def test_a_step_is_read_where_it_is_asked_for() -> None:
    rng = np.random.default_rng(13)
    n, seeds = 4000, 300
    t = np.arange(n) / RATE - 0.2
    size = np.where(t > 0, 1 + 0.02 * np.log10(np.maximum(t, 1e-4)), 0.0)
    truth = 1 + 0.02 * np.log10(0.5)
    found = [estimate_step(7 + size + 0.01 * rng.standard_normal(n), RATE, 0.2, 0.5) for _ in range(seeds)]
    values = np.array([f.value for f in found])
    bound = 0.01 * np.sqrt(2 / 500)
    assert abs(values.mean() - truth) < 4 * bound / np.sqrt(seeds) + 3e-5  # the log bends by 2e-5 over the window
    assert values.std() == pytest.approx(bound, rel=0.1)
    rate = covered(
        values, truth, np.array([f.standard_error for f in found]), np.array([f.degrees_of_freedom for f in found])
    )
    assert 0.93 < rate < 0.97
    assert found[0].before.value == pytest.approx(7, abs=0.005)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("step_s", "read_s", "message"),
    [
        (0.05, 0.3, "0.05 s were recorded before the step, 0.1 s are needed"),
        (0.5, 0.02, "begins before the step"),
        (0.5, 0.49, "ends 0.5 s after the step, 0.54 s are needed"),
    ],
)
def test_a_window_that_is_not_there_is_named(step_s: float, read_s: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        estimate_step(np.zeros(5000), RATE, step_s, read_s)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("samples", "mains_hz", "message"),
    [
        (np.zeros(5), None, "has 5 samples, at least 24"),
        (np.full(100, np.nan), None, "100 of 100 samples are not finite"),
        (np.zeros(50), 50.0, "10 ms are shorter than a cycle of the mains"),
    ],
)
def test_a_level_of_nothing_is_refused(samples: np.ndarray, mains_hz: float | None, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        estimate_level(samples, RATE, mains_hz)


def test_creep_reaches_the_bound_and_covers_it() -> None:
    rng = np.random.default_rng(14)
    rate, sigma, seeds = 200.0, 0.05, 500
    t = np.arange(20, 12_000) / rate  # 0.1 to 60 s
    clean = 5 + 1 + 0.02 * np.log10(t)
    found = [fit_creep(t, clean + sigma * rng.standard_normal(t.size), zero=5.0) for _ in range(seeds)]
    columns = np.stack([np.ones(t.size), np.log10(t)], axis=1)
    bound = sigma * np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
    slopes = np.array([f.per_decade for f in found])
    assert abs(slopes.mean() - 0.02) < 4 * bound[1] / np.sqrt(seeds)
    assert slopes.std() == pytest.approx(bound[1], rel=0.08)
    errors, freedom = np.array([f.per_decade_error for f in found]), np.array([f.degrees_of_freedom for f in found])
    assert 0.93 < covered(slopes, 0.02, errors, freedom) < 0.97
    values, value_errors = np.array([f.value for f in found]), np.array([f.value_error for f in found])
    assert 0.93 < covered(values, 1.0, value_errors, freedom) < 0.97


def test_creep_over_too_little_time_is_refused() -> None:
    with pytest.raises(ValueError, match=r"from 1 to 2 s are 0\.30 decades, at least 0\.5"):
        fit_creep(np.linspace(1, 2, 100), np.zeros(100))
    with pytest.raises(ValueError, match="must rise from above 0"):
        fit_creep(np.linspace(0, 2, 100), np.zeros(100))


def test_the_interval_of_the_shortest_level_covers_the_truth() -> None:
    """With fewer than four noise components the error of a short record is a matter of luck."""
    rng = np.random.default_rng(3)
    estimates = [estimate_level(rng.standard_normal(24), 5000.0, None) for _ in range(1500)]
    assert {round(estimate.degrees_of_freedom) for estimate in estimates} <= {3, 4}
    scatter = np.std([estimate.standard_error**2 for estimate in estimates])
    mean = np.mean([estimate.standard_error**2 for estimate in estimates])
    assert scatter / mean < 0.85  # chi-square with 4 degrees of freedom: 0.71; with 2: 1


def test_the_degrees_of_freedom_of_a_difference_are_those_of_welch_and_satterthwaite() -> None:
    one, two = LevelEstimate(0.0, 3.0, 4.0, 0.0, 0.0), LevelEstimate(0.0, 4.0, 16.0, 0.0, 0.0)
    assert combine_errors(one, two) == pytest.approx((5.0, 625 / (81 / 4 + 256 / 16)))
