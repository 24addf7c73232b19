"""Weight step detection on traces of weights, bumps, drift and a sensor out of range."""

import numpy as np
import pytest

from protocols.signals.step_detection import StepDetectionState, WeightStep, WeightStepDetector
from tests.helpers.coverage import coverage_factor

RATE = 2000.0


def trace(
    rng: np.random.Generator, seconds: float = 6.0, noise: float = 0.5, drift: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(round(seconds * RATE)) / RATE
    return t, noise * rng.standard_normal(t.size) + np.sin(2 * np.pi * 50 * t + 0.3) + drift * t


def landing(t: np.ndarray, at: float, size: float) -> np.ndarray:
    """A mass that swings at 30 Hz and comes to rest."""
    s = np.maximum(t - at, 0)
    return size * (1 - np.exp(-20 * s) * np.cos(2 * np.pi * 30 * s)) * (t >= at)


def bump(t: np.ndarray, at: float, size: float) -> np.ndarray:
    s = np.maximum(t - at, 0)
    return size * np.exp(-8 * s) * np.sin(2 * np.pi * 7 * s)


def fed(detector: WeightStepDetector, samples: np.ndarray, block: int = 97) -> WeightStep | None:
    for k in range(0, samples.size, block):
        if found := detector.feed(samples[k : k + block]):
            return found
    return None


def test_a_landing_is_told_once_with_time_and_size() -> None:
    t, y = trace(np.random.default_rng(1))
    watch = WeightStepDetector(RATE, min_step=5.0)
    found = fed(watch, y + landing(t, 2.0, 137.0))
    assert found is not None
    assert 2.0 <= found.crossed_at_s < 2.06
    assert found.crossed_at_s < found.settled_at_s < 2.6
    assert found.size == pytest.approx(137.0, abs=5 * found.standard_error + 0.05)
    assert watch.state is StepDetectionState.SETTLED
    assert watch.feed(y) is None


def test_the_size_is_covered() -> None:
    rng = np.random.default_rng(2)
    inside = []
    for _ in range(400):
        t, y = trace(rng, 1.5)
        found = fed(WeightStepDetector(RATE, min_step=5.0), y + 40.0 * (t > 0.7), 500)
        assert found is not None
        inside.append(abs(found.size - 40.0) <= coverage_factor(found.degrees_of_freedom) * found.standard_error)
    assert 0.93 < np.mean(inside) < 0.97


def test_bumps_are_no_landing_and_are_counted() -> None:
    t, y = trace(np.random.default_rng(3), 12.0)
    watch = WeightStepDetector(RATE, min_step=5.0)
    assert fed(watch, y + bump(t, 2.0, 60.0) + bump(t, 5.0, -60.0)) is None
    assert watch.state is StepDetectionState.READY
    again = WeightStepDetector(RATE, min_step=5.0)
    found = fed(again, y + bump(t, 2.0, 60.0) + bump(t, 5.0, -60.0) + landing(t, 8.0, 30.0))
    assert found is not None
    assert (found.bumps, found.size) == (2, pytest.approx(30.0, abs=0.3))
    assert 8.0 <= found.crossed_at_s < 8.1


def test_a_mass_that_is_lifted_is_a_landing_downwards() -> None:
    t, y = trace(np.random.default_rng(4))
    found = fed(WeightStepDetector(RATE, min_step=5.0), y + 100 - landing(t, 3.0, 100.0))
    assert found is not None
    assert found.size == pytest.approx(-100, abs=0.5)


def test_slow_drift_is_followed_and_is_no_landing() -> None:
    t, y = trace(np.random.default_rng(5), 30.0, drift=0.3)
    watch = WeightStepDetector(RATE, min_step=5.0)
    assert fed(watch, y) is None
    assert watch.state is StepDetectionState.READY
    found = fed(WeightStepDetector(RATE, min_step=5.0), y + landing(t, 20.0, 50.0))
    assert found is not None
    assert found.size == pytest.approx(50.0, abs=0.5)


def test_out_of_range_is_neither_zero_nor_landing() -> None:
    t, y = trace(np.random.default_rng(6), 8.0)
    y = y + 50.0 * (t > 3.0)
    y[(t > 3.0) & (t < 4.5)] = np.nan
    watch = WeightStepDetector(RATE, min_step=5.0)
    found = fed(watch, y)
    assert found is not None
    assert found.size == pytest.approx(50.0, abs=0.5)
    assert 4.5 <= found.crossed_at_s < 4.6
    assert fed(WeightStepDetector(RATE, min_step=5.0), np.full(8000, np.nan)) is None


def test_it_does_not_matter_how_the_samples_are_cut() -> None:
    t, y = trace(np.random.default_rng(7))
    y = y + landing(t, 2.0, 20.0)
    assert fed(WeightStepDetector(RATE, min_step=5.0), y, 7) == fed(WeightStepDetector(RATE, min_step=5.0), y, 12_000)


def test_settings_that_cannot_work_are_refused() -> None:
    with pytest.raises(ValueError, match="less than half of the smallest step, 5"):
        WeightStepDetector(RATE, min_step=5.0, tolerance=3.0)
    with pytest.raises(ValueError, match="at least 3 windows of 8 samples"):
        WeightStepDetector(RATE, min_step=5.0, window_s=0.001)


@pytest.mark.one_in(1)
@pytest.mark.parametrize("size", [4.5, -4.5, 2.6, 1.0])
def test_a_change_below_the_smallest_step_is_no_landing_and_its_level_is_the_new_zero(size: float) -> None:
    t, y = trace(np.random.default_rng(8), 8.0, noise=0.05)
    small, watch = y + size * (t > 2.0), WeightStepDetector(RATE, min_step=5.0)
    assert fed(watch, small[t < 5.0]) is None
    assert watch.state is StepDetectionState.READY
    assert watch.zero_level == pytest.approx(size, abs=0.05)
    found = fed(watch, small[t >= 5.0] + 30.0 * (t[t >= 5.0] > 6.0))
    assert found is not None
    assert (found.bumps, found.size) == (1, pytest.approx(30.0, abs=0.05))
