"""Source contract tests: checks any source driver by the volts at the simulated amplifier's input.

They need a fixture `device_under_test` that yields a source, the bench with its amplifier, and their clock. `python -m
sim_hardware.testing --source module:factory` runs them on any driver.
"""

import re

import numpy as np
import pytest

from drivers import (
    Clock,
    Drive,
    Hold,
    InstrumentError,
    LinearSweep,
    LinkError,
    PeriodicSweep,
    Ramp,
    Sine,
    Source,
    SquareWave,
    Steps,
)
from sim_hardware.bench import SimulatedBench
from sim_hardware.testing.safe_volts import assert_safe_voltage

SourceUnderTest = tuple[Source, SimulatedBench, Clock]


def energised(device_under_test: SourceUnderTest) -> SourceUnderTest:
    """Initialize with high voltage off, then switch it on at rest."""
    source, bench, _ = device_under_test
    source.initialize_at_rest(2.5, 0.0, 5.0)
    bench.enable_hv()
    return device_under_test


def test_initialize_at_rest_from_power_up_state(device_under_test: SourceUnderTest) -> None:
    source, bench, _ = device_under_test
    assert not source.is_at_rest(2.5, 0.0, 5.0)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    assert source.is_at_rest(2.5, 0.0, 5.0)
    assert source.idle_level_v() == pytest.approx(2.5, abs=1e-3)
    assert bench.report().end_v == pytest.approx(2.5, abs=1e-3)


def test_rest_check_is_harmless_with_high_voltage_on(device_under_test: SourceUnderTest) -> None:
    source, bench, _ = energised(device_under_test)
    assert source.is_at_rest(2.5, 0.0, 5.0)
    assert_safe_voltage(bench.report())


def test_sine_starts_and_ends_at_rest_by_itself(device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    begin = clock.now()
    source.start_drive(Sine(50.0, 2.5, 2.5, 20))
    clock.sleep(20 / 50.0 + 0.2)
    report = bench.report()
    assert_safe_voltage(report)
    assert report.outside_rest_s == pytest.approx(0.4, rel=0.05)
    assert report.highest_v == pytest.approx(5.0, abs=1e-3)
    assert report.lowest_v == pytest.approx(0.0, abs=1e-3)
    assert clock.now() > begin


def largest_deviation_v(bench: SimulatedBench, drive: Drive, begin_s: float, end_s: float) -> float:
    """Return the largest deviation of the amplifier's input from the drive, for a start between these times."""
    leaves_v, grid = 0.02, np.arange(begin_s, end_s, 1e-4)
    own = np.arange(0.0, drive.duration_s, 1e-4)
    left = grid[np.argmax(np.abs(bench.history.volts(grid) - drive.end_levels_v[0]) > leaves_v)]
    start_s = left - own[np.argmax(np.abs(drive.volts(own) - drive.end_levels_v[0]) > leaves_v)]
    starts = start_s + np.arange(-5e-3, 5e-3, 1e-4)
    return min(float(np.abs(bench.history.volts(start + own) - drive.volts(own)).max()) for start in starts)


@pytest.mark.parametrize(
    "drive",
    [
        LinearSweep(10.0, 30.0, 1.0, 0.5, 2.5),
        PeriodicSweep(10.0, 30.0, 0.5, 2, 0.5, 2.5),
        Steps((2.5, 3.0, 2.0, 2.5), 0.1, 0.05),
        Steps((2.5, 3.2, 2.5), 0.1, 0.05),
        SquareWave(20.0, 0.5, 2.5, 0.4, 3e-3, 10),
    ],
    ids=["sweep", "periodic sweep", "steps", "steps to one side", "square wave"],
)
def test_sweep_and_steps_follow_the_drive_and_end_at_rest(drive: Drive, device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    begin_s = clock.now()
    source.start_drive(drive)
    clock.sleep(drive.duration_s + 0.2)
    assert largest_deviation_v(bench, drive, begin_s, clock.now()) < 0.06
    report = bench.report()
    assert_safe_voltage(report)
    assert report.highest_v == pytest.approx(drive.high_v, abs=0.02)
    assert report.lowest_v == pytest.approx(drive.low_v, abs=0.02)


def test_small_and_large_drives_in_sequence_cause_no_jump(device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    for drive in (Sine(80.0, 0.05, 2.5, 8), Steps((2.5, 2.7, 2.5), 0.05, 0.05), Sine(80.0, 2.5, 2.5, 8)):
        source.start_drive(drive)
        clock.sleep(drive.duration_s + 0.05)
        source.stop()
    assert_safe_voltage(bench.report())
    assert source.is_at_rest(2.5, 0.0, 5.0)


def test_unsupported_drive_is_rejected_and_output_stays_at_rest(device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    with pytest.raises(InstrumentError, match=r"(limit|at most|holds \d+|the card).*[Nn]othing was sent"):
        source.start_drive(LinearSweep(20.0, 520.0, 1000.0, 2.5, 2.5))
    clock.sleep(0.1)
    assert bench.report().outside_rest_s == 0


def test_stop_ramps_a_sine_down_from_any_phase(device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    for k in range(4):
        source.start_drive(Sine(40.0, 2.5, 2.5, 60))
        clock.sleep(0.1 + 0.0063 * k)
        source.stop()
        assert source.is_at_rest(2.5, 0.0, 5.0)
        clock.sleep(0.05)
    assert_safe_voltage(bench.report())


def test_levels_are_reached_and_left_in_small_steps(device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    for level in (5.0, 0.0, 2.5):
        source.ramp_to(level, 0.2)
        assert source.idle_level_v() == pytest.approx(level, abs=1e-3)
        source.start_drive(Hold(level, 0.1))
        clock.sleep(0.05)
    report = bench.report()
    assert_safe_voltage(report)
    assert report.highest_v == pytest.approx(5.0, abs=0.006)
    assert report.lowest_v == pytest.approx(0.0, abs=0.006)


def test_ramp_is_played(device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    source.start_drive(Ramp(2.5, 3.0, 0.1))
    clock.sleep(0.2)
    assert bench.report().end_v == pytest.approx(3.0, abs=1e-3)
    source.ramp_to(2.5, 0.1)
    clock.sleep(0.02)
    assert_safe_voltage(bench.report())


def test_drive_from_another_level_is_rejected_and_output_stays_at_rest(device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    with pytest.raises(InstrumentError, match="nothing was sent"):
        source.start_drive(Sine(50.0, 1.0, 3.0, 5))
    clock.sleep(0.1)
    assert bench.report().outside_rest_s == 0


@pytest.mark.parametrize("fault", ["scpi-silent", "scpi-late", "scpi-garbled", "scpi-half", "scpi-dropped"])
def test_failed_link_raises_link_error_and_reconnects(fault: str, device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    bench.inject(fault)
    with pytest.raises(LinkError, match=rf"{re.escape(source.identity.model)}: |which "):
        source.idle_level_v()
    bench.clear(fault)
    clock.sleep(5.0)  # a late answer has come by then
    source.reconnect()
    assert source.is_at_rest(2.5, 0.0, 5.0)
    assert_safe_voltage(bench.report())


def test_close_leaves_the_output_at_rest(device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    source.close()
    clock.sleep(0.2)
    report = bench.report()
    assert_safe_voltage(report)
    assert report.outside_rest_s == 0
