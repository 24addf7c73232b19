"""Source contract of a LabJack's analogue output on its wire, and its refusals, power-up level, power failure and stops."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from drivers.clock import Clock, WallClock
from drivers.drive_shapes import Drive, Hold, LinearSweep, PeriodicSweep, Ramp, Sine, SquareWave, Steps
from drivers.errors import InstrumentError
from drivers.labjack.output import HIGHEST_V, RESOLUTION_V, T7Output
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.labjack.t7_output import SimulatedT7Output
from sim_hardware.labjack.t7_server import SimulatedT7
from sim_hardware.service.served_bench import ServedBench
from sim_hardware.testing.source_contract import (  # noqa: F401 - pytest collects them here again, with this module's sources
    SourceUnderTest,
    energised,
    largest_deviation_v,
    test_close_leaves_the_output_at_rest,
    test_drive_from_another_level_is_rejected_and_output_stays_at_rest,
    test_initialize_at_rest_from_power_up_state,
    test_ramp_is_played,
    test_rest_check_is_harmless_with_high_voltage_on,
    test_sweep_and_steps_follow_the_drive_and_end_at_rest,
    test_unsupported_drive_is_rejected_and_output_stays_at_rest,
)
from tests.helpers.simulated_bench import assert_safe_voltage, simulated


@contextmanager
def served(clock: Clock | None = None, **card: object) -> Iterator[tuple[T7Output, SimulatedBench, SimulatedT7]]:
    truth = simulated(source="DAC0", card=card).simulation_parameters
    bench = SimulatedBench(truth, clock or VirtualClock())
    with ServedBench(bench) as serving:
        assert serving.labjack is not None
        source = T7Output(serving.source_address, "DAC0", bench.clock)
        yield source, bench, serving.labjack
        source.close()


@pytest.fixture
def device_under_test() -> Iterator[SourceUnderTest]:
    with served() as (source, bench, _):
        yield source, bench, bench.clock


def test_a_sine_of_the_largest_amplitude_starts_and_ends_at_rest_by_itself(device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    amplitude_v = HIGHEST_V - 2.5
    source.start_drive(Sine(50.0, amplitude_v, 2.5, 20))
    clock.sleep(20 / 50.0 + 0.2)
    report = bench.report()
    assert_safe_voltage(report)
    assert report.outside_rest_s == pytest.approx(0.4, rel=0.05)
    assert report.highest_v == pytest.approx(2.5 + amplitude_v, abs=RESOLUTION_V)
    assert report.lowest_v == pytest.approx(2.5 - amplitude_v, abs=RESOLUTION_V)
    assert source.is_at_rest(2.5, 0.0, 5.0)


@pytest.mark.parametrize("frequency_hz", [33.3, 123.4, 317.0])
def test_the_frequency_of_a_sine_is_the_commanded_one(frequency_hz: float, device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    begin_s, drive = clock.now(), Sine(frequency_hz, 0.5, 2.5, round(0.5 * frequency_hz))
    source.start_drive(drive)
    clock.sleep(drive.duration_s + 0.1)
    t = np.arange(begin_s, clock.now(), 1e-5)
    moved = np.flatnonzero(np.abs(bench.history.volts(t) - 2.5) > 2 * RESOLUTION_V)
    played_s = t[moved[-1]] - t[moved[0]]
    assert played_s == pytest.approx(drive.duration_s, abs=2e-4 + 1e-5 * drive.duration_s)
    assert_safe_voltage(bench.report())


def test_stop_from_any_phase_goes_to_rest_without_a_jump(device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    left_v = []
    for k in range(5):
        source.start_drive(Sine(40.0, 2.4, 2.5, 60))
        clock.sleep(0.1 + 0.0053 * k)
        left_v.append(float(bench.history.volts([clock.now()])[0]))
        source.stop()
        assert source.is_at_rest(2.5, 0.0, 5.0)
    assert max(left_v) - min(left_v) > 2  # the phases differed
    report = bench.report()
    assert_safe_voltage(report)
    assert report.largest_jump_v < 2 * RESOLUTION_V


@pytest.mark.parametrize(
    "drive",
    [
        LinearSweep(10.0, 30.0, 1.0, 0.5, 2.5),
        PeriodicSweep(10.0, 30.0, 0.5, 2, 0.5, 2.5),
        Steps((2.5, 3.0, 2.0, 2.5), 0.1, 0.05),
        SquareWave(20.0, 0.5, 2.5, 0.4, 3e-3, 10),
    ],
    ids=lambda drive: drive.kind,
)
def test_stop_of_every_drive_leaves_the_way_to_rest_in_small_steps(
    drive: Drive, device_under_test: SourceUnderTest
) -> None:
    source, bench, clock = energised(device_under_test)
    source.start_drive(drive)
    clock.sleep(0.37 * drive.duration_s)
    source.stop()
    source.ramp_to(2.5, 0.1)
    assert source.is_at_rest(2.5, 0.0, 5.0)
    assert_safe_voltage(bench.report())


def test_levels_are_reached_held_and_left_in_small_steps(device_under_test: SourceUnderTest) -> None:
    source, bench, clock = energised(device_under_test)
    for level in (4.8, 0.1, 2.5):
        source.ramp_to(level, 0.5)
        assert source.idle_level_v() == pytest.approx(level, abs=RESOLUTION_V)
        source.start_drive(Hold(level, 0.1))
        clock.sleep(0.05)
    report = bench.report()
    assert_safe_voltage(report)
    assert report.highest_v == pytest.approx(4.8, abs=RESOLUTION_V)
    assert report.lowest_v == pytest.approx(0.1, abs=RESOLUTION_V)


def test_a_second_process_stops_the_drive_of_a_dead_one_without_a_jump() -> None:
    with served() as (source, bench, device):
        energised((source, bench, bench.clock))
        source.start_drive(Sine(20.0, 2.0, 2.5, 200))
        bench.clock.sleep(0.161)
        source.close()  # as at the death of a program, which stops nothing
        watchdog = T7Output(device.address, "DAC0", bench.clock, checks_power_up=False)
        assert watchdog.is_left_live(2.5, 0.0, 5.0)
        watchdog.stop()
        watchdog.ramp_to(2.5, 0.25)
        assert watchdog.is_at_rest(2.5, 0.0, 5.0)
        watchdog.close()
        assert_safe_voltage(bench.report())


def test_a_drive_of_a_dead_program_ends_by_itself_at_rest() -> None:
    with served() as (source, bench, _):
        energised((source, bench, bench.clock))
        source.start_drive(Sine(20.0, 2.0, 2.5, 20))
        source.close()
        bench.clock.sleep(1.2)
        assert_safe_voltage(bench.report())
        assert bench.report().outside_rest_s == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize("stored_v", [0.0, 2.4963])
def test_another_power_up_level_than_rest_is_refused_with_the_output_at_rest(stored_v: float) -> None:
    with served(power_up_v=stored_v) as (source, bench, _):
        with pytest.raises(InstrumentError, match=r"DAC0 .*1\.2 mV.*2\.5 V.*Kipling"):
            source.initialize_at_rest(2.5, 0.0, 5.0)
        assert not source.is_at_rest(2.5, 0.0, 5.0)  # never armed
        assert bench.report().end_v == pytest.approx(2.5, abs=RESOLUTION_V)


def test_a_firmware_that_ignores_the_request_for_the_stored_level_is_not_taken_for_one_that_stores_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with served() as (source, _, _):
        monkeypatch.setattr(SimulatedT7Output, "power_up", lambda self: None)
        with pytest.raises(InstrumentError, match=r"2\.4\d+ V"):
            source.initialize_at_rest(2.5, 0.0, 5.0)


def test_with_an_interlock_the_power_up_level_is_not_read() -> None:
    with served(power_up_v=0.0) as (_, bench, device):
        interlocked = T7Output(device.address, "DAC0", bench.clock, checks_power_up=False)
        interlocked.initialize_at_rest(2.5, 0.0, 5.0)
        assert interlocked.is_at_rest(2.5, 0.0, 5.0)
        interlocked.close()


def test_a_power_failure_gives_zero_volts_and_then_the_stored_level() -> None:
    with served() as (source, bench, device):
        energised((source, bench, bench.clock))
        bench.inject("generator-power-off")
        assert bench.report().end_v == 0.0
        with pytest.raises(InstrumentError, match=r"127\.0\.0\.1"):
            source.is_at_rest(2.5, 0.0, 5.0)
        bench.clear("generator-power-off")
        assert bench.report().end_v == 0.0  # while it starts
        bench.clock.sleep(1.1)
        device.update_from_faults()
        assert bench.report().end_v == pytest.approx(2.5, abs=RESOLUTION_V)
        source.reconnect()
        assert source.is_at_rest(2.5, 0.0, 5.0)


def test_a_silent_device_is_a_sentence_and_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    with served() as (source, bench, _):
        energised((source, bench, bench.clock))
        source.start_drive(Sine(20.0, 1.0, 2.5, 4))
        bench.inject("scpi-dropped")
        with pytest.raises(InstrumentError, match=r"127\.0\.0\.1"):
            source.stop()
        bench.clear("scpi-dropped")
        bench.clock.sleep(0.5)
        source.reconnect()
        assert source.is_at_rest(2.5, 0.0, 5.0)  # the drive has ended by itself
        assert_safe_voltage(bench.report())


def test_its_own_watchdog_and_another_program_are_refused() -> None:
    with served() as (source, _, device):
        device.registers.values[61600] = 1
        with pytest.raises(InstrumentError, match="WATCHDOG_ENABLE_DEFAULT = 0"):
            source.initialize_at_rest(2.5, 0.0, 5.0)
        device.registers.values[61600] = 0
        source.initialize_at_rest(2.5, 0.0, 5.0)
        assert source.is_at_rest(2.5, 0.0, 5.0)
        device.registers.values[61600] = 1  # by another program, meanwhile
        assert not source.is_at_rest(2.5, 0.0, 5.0)
        device.registers.values[61600] = 0
        source.start_drive(Sine(20.0, 0.5, 2.5, 400))
        device.registers.values[46100] = 0  # another program's
        with pytest.raises(InstrumentError, match="another"):
            source.stop()


@pytest.mark.parametrize(
    ("drive", "told"),
    [
        (Sine(50.0, 2.5, 2.5, 5), r"4\.9"),
        (Sine(900.0, 1.0, 2.5, 5), "100000"),
        (Steps((2.5, 3.5, 2.5), 100.0, 0.2), "8190"),
        (Ramp(2.5, 4.95, 1.0), r"4\.95"),
    ],
)
def test_what_it_cannot_play_is_refused_before_anything_is_written(drive: Drive, told: str) -> None:
    with served() as (source, bench, device):
        energised((source, bench, bench.clock))
        before = dict(device.registers.values)
        with pytest.raises(InstrumentError, match=told):
            source.start_drive(drive)
        assert {k: v for k, v in device.registers.values.items() if 4000 <= k < 4500} == {
            k: v for k, v in before.items() if 4000 <= k < 4500
        }
        assert bench.report().outside_rest_s == 0


def test_at_real_speed_on_its_wire_a_stopped_sine_is_at_rest() -> None:
    with served(WallClock(5.0)) as (source, bench, _):
        energised((source, bench, bench.clock))
        source.start_drive(Sine(10.0, 2.0, 2.5, 10_000))
        bench.clock.sleep(0.33)
        source.stop()
        assert source.is_at_rest(2.5, 0.0, 5.0)
        assert_safe_voltage(bench.report())
