"""Waveforms of all drives against independent solutions: numbers by hand, SciPy's chirp, differences of samples."""

import json
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.signal import chirp

from drivers.drive_shapes import Drive, Hold, LinearSweep, PeriodicSweep, Ramp, Sine, Steps, as_record, from_record

SINE = Sine(100.0, 1.5, 2.5, 3)
UPWARD = LinearSweep(25.0, 525.0, 4.0, 2.0, 2.5)
DOWNWARD = LinearSweep(400.0, 100.0, 2.0, 0.5, 2.0)
FADED = LinearSweep(110.0, 125.0, 2.001, 2.0, 2.5, fade_s=0.3)  # 235.12 cycles
PERIODIC = PeriodicSweep(20.0, 180.0, 0.5, 3, 1.5, 2.5)
STEPS = Steps((2.5, 4.0, 1.0, 2.5), 1.0, 0.5)
EVERY: tuple[Drive, ...] = (Hold(3.5, 2.0), Ramp(2.5, 4.0, 0.5), SINE, UPWARD, DOWNWARD, FADED, PERIODIC, STEPS)


def sine_chirp(sweep: LinearSweep | PeriodicSweep, t: NDArray[np.float64], end_s: float) -> NDArray[np.float64]:
    return sweep.amplitude_v * np.asarray(chirp(t, sweep.start_hz, end_s, sweep.stop_hz, phi=-90))


def test_a_sine_has_its_values_at_every_quarter_of_its_cycles_and_rests_before_and_after() -> None:
    quarters = np.arange(13) / 400
    assert SINE.duration_s == pytest.approx(0.03)
    assert SINE.volts(quarters) == pytest.approx([2.5, 4.0, 2.5, 1.0] * 3 + [2.5])
    assert list(SINE.volts([-0.0025, -1.0, 0.0325, 9.0])) == [2.5] * 4
    assert SINE.slew_v_per_s == pytest.approx(942.4778)  # 2 pi 100 Hz 1.5 V


@pytest.mark.parametrize("sweep", [UPWARD, DOWNWARD])
def test_a_sweep_is_the_chirp_of_an_independent_library(sweep: LinearSweep) -> None:
    t = np.linspace(0.0, sweep.duration_s, 4_001)
    assert_allclose(sweep.volts(t) - sweep.offset_v, sine_chirp(sweep, t, sweep.duration_s), atol=1e-9)
    assert sweep.volts([-1.0, 0.0]) == pytest.approx([sweep.offset_v] * 2)
    assert sweep.volts([sweep.duration_s, 99.0]) == pytest.approx([sweep.end_levels_v[1]] * 2, abs=1e-9)


def test_the_end_of_a_sweep_that_is_not_whole_is_computed_and_not_assumed() -> None:
    sweep = LinearSweep(10.0, 30.0, 1.0125, 1.0, 2.5)  # 20.25 cycles
    assert sweep.end_levels_v == pytest.approx((2.5, 3.5))
    assert LinearSweep(10.0, 30.0, 1.0375, 1.0, 2.5).end_levels_v == pytest.approx((2.5, 1.5))  # 20.75 cycles


def test_a_faded_sweep_is_the_chirp_within_its_ends_and_rests_at_both() -> None:
    assert FADED.end_levels_v == pytest.approx((2.5, 2.5), abs=1e-12)
    assert FADED.volts([0.0, 2.001, 9.0]) == pytest.approx([2.5] * 3, abs=1e-12)
    inside, half_up = np.linspace(0.3, 1.701, 2001), np.linspace(0.145, 0.155, 2001)
    assert_allclose(FADED.volts(inside) - 2.5, sine_chirp(FADED, inside, 2.001), atol=1e-9)
    assert np.abs(FADED.volts(half_up) - 2.5).max() == pytest.approx(1.0, rel=0.06)


@pytest.mark.parametrize("drive", EVERY)
def test_the_slope_limit_is_told_from_what_the_samples_do(drive: Drive) -> None:
    """Not only an upper bound: a slope that is told too high would refuse drives that are harmless."""
    t = np.linspace(0.0, drive.duration_s, 100_001)
    steepest = float(np.abs(np.diff(drive.volts(t))).max() / (t[1] - t[0]))
    assert steepest <= drive.slew_v_per_s * (1 + 1e-9) + 1e-9
    assert drive.slew_v_per_s <= 1.05 * steepest  # the soft ends of a periodic sweep lie where it is steepest


def test_a_periodic_sweep_is_the_chirp_then_the_chirp_upside_down_with_soft_ends() -> None:
    assert PERIODIC.duration_s == pytest.approx(3.0)
    assert PERIODIC.period_s == pytest.approx(1.0)
    t = np.arange(0.0, 0.5, 1e-4)
    swing = PERIODIC.volts(t) - 2.5
    plain = sine_chirp(PERIODIC, t, 0.5)
    fade_s = 4 / 180  # cycles of the highest frequency
    inner = (t >= fade_s) & (t <= 0.5 - fade_s)
    assert_allclose(swing[inner], plain[inner], atol=1e-9)
    half, three_quarters = np.array([fade_s / 2, 0.5 - fade_s / 2]), np.array([0.75 * fade_s, 0.5 - 0.75 * fade_s])
    assert PERIODIC.volts(half) - 2.5 == pytest.approx(0.5 * sine_chirp(PERIODIC, half, 0.5), abs=1e-9)
    assert PERIODIC.volts(three_quarters) - 2.5 == pytest.approx(
        (0.5 + math.sqrt(0.125)) * sine_chirp(PERIODIC, three_quarters, 0.5), abs=1e-9
    )
    for turn in range(1, 6):
        assert_allclose(PERIODIC.volts(t + 0.5 * turn) - 2.5, swing * (-1) ** turn, atol=1e-9)
    assert PERIODIC.volts([-1.0, 0.0, 3.0, 7.0]) == pytest.approx([2.5] * 4, abs=1e-9)


def test_a_short_periodic_sweep_fades_within_an_eighth_of_it() -> None:
    short = PeriodicSweep(20.0, 60.0, 0.05, 1, 1.0, 2.5)
    at = np.array([0.05 / 16, 0.05 / 8, 0.05 * 7 / 8, 0.05 * 15 / 16])
    assert short.volts(at) - 2.5 == pytest.approx(np.array([0.5, 1, 1, 0.5]) * sine_chirp(short, at, 0.05), abs=1e-9)


def test_even_lines_of_a_periodic_sweep_are_empty() -> None:
    t = np.arange(10_000) / 10_000.0
    lines = np.abs(np.fft.rfft(PERIODIC.volts(t) - 2.5)) / 5_000
    assert lines[0::2].max() < 1e-9
    assert lines[21:180:2].min() > 0.05


def test_steps_hold_every_level_and_join_them_by_straight_lines() -> None:
    assert STEPS.duration_s == pytest.approx(5.5)
    corners = {0.0: 2.5, 1.0: 2.5, 1.25: 3.25, 1.5: 4.0, 2.5: 4.0, 2.75: 2.5, 3.0: 1.0, 4.0: 1.0, 4.25: 1.75, 4.5: 2.5, 5.5: 2.5}  # fmt: skip
    assert STEPS.volts(list(corners)) == pytest.approx(list(corners.values()))
    assert STEPS.volts([0.5, 2.0, 3.5, 5.0, 9.0]) == pytest.approx([2.5, 4.0, 1.0, 2.5, 2.5])
    assert STEPS.slew_v_per_s == pytest.approx(6.0)
    assert Steps((2.5,), 1.0, 0.5).slew_v_per_s == 0.0
    assert Steps((2.5,), 1.0, 0.5).duration_s == pytest.approx(1.0)


def test_a_level_and_a_ramp_have_the_values_in_their_names() -> None:
    assert list(Hold(3.5, 2.0).volts([-1.0, 0.0, 9.0])) == [3.5] * 3
    assert Ramp(2.5, 4.0, 0.5).volts([-1.0, 0.0, 0.1, 0.25, 0.5, 9.0]) == pytest.approx([2.5, 2.5, 2.8, 3.25, 4.0, 4.0])
    assert Ramp(4.0, 2.5, 0.5).slew_v_per_s == pytest.approx(3.0)


@pytest.mark.parametrize("drive", EVERY)
def test_extremes_are_those_of_the_samples(drive: Drive) -> None:
    v = drive.volts(np.linspace(0.0, drive.duration_s, 100_001))
    assert (drive.low_v, drive.high_v) == pytest.approx((v.min(), v.max()), abs=2e-3)


@pytest.mark.parametrize("drive", EVERY)
def test_a_drive_survives_a_file(drive: Drive) -> None:
    assert from_record(json.loads(json.dumps(as_record(drive)))) == drive


@pytest.mark.parametrize("drive", EVERY)
def test_a_quantity_of_zero_is_no_drive(drive: Drive) -> None:
    levels = {"level_v", "levels_v", "start_v", "stop_v", "offset_v", "fade_s"}
    for name in as_record(drive).keys() - levels - {"kind"}:
        with pytest.raises(ValueError, match=f"{drive.kind}: {name} must be positive, not 0"):
            from_record(as_record(drive) | {name: 0.0})
