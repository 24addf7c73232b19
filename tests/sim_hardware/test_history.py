"""Voltage history: past values are unchanged, and the report shows the errors of a naive sequence."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.plant.history_report import make_voltage_report
from sim_hardware.plant.segments import ChirpSegment, ConstantSegment, PeriodicSegment, RelayGlitchSegment
from sim_hardware.plant.voltage_history import REMEMBERED, REMEMBERED_S, VoltageHistory

RATE = 100e3


@dataclass(frozen=True)
class RampSegment:
    """A straight line from `start_v` at `origin_s` to `stop_v`, then held."""

    origin_s: float
    start_v: float
    stop_v: float
    duration_s: float

    @property
    def constant_from_s(self) -> float:
        return self.origin_s + self.duration_s

    @property
    def breakpoints_s(self) -> tuple[float, ...]:
        return (self.constant_from_s,)

    def volts(self, t):
        return np.interp(t, [self.origin_s, self.constant_from_s], [self.start_v, self.stop_v])


def report(history: VoltageHistory, until: float):
    return make_voltage_report(history.entries(), until, RATE, rest_v=2.5, tolerance_v=0.02)


def at(segment, *t: float) -> list[float]:
    return [float(v) for v in segment.volts(np.array(t))]


def test_past_samples_show_the_setting_of_their_own_time():
    history = VoltageHistory()
    history.append(1.0, ConstantSegment(2.5))
    history.append(2.0, ConstantSegment(3.0))
    assert history.volts([0.5, 1.0, 1.999, 2.0, 9.0]).tolist() == [0.0, 2.5, 2.5, 3.0, 3.0]


def test_what_has_been_read_cannot_be_changed_any_more():
    history, clock = VoltageHistory(), VirtualClock()
    history.append(0.0, ConstantSegment(2.5))
    history.volts([0.0, 0.7])
    with pytest.raises(ValueError, match="past"):
        history.append(0.5, ConstantSegment(0.0))
    with history.at_instant(clock) as t:
        assert t == 0.7  # a change now is stamped after everything that was read
        history.append(t, ConstantSegment(1.0))
    assert history.volts([0.69, 0.7]).tolist() == [2.5, 1.0]


def test_a_burst_ends_at_its_idle_level_by_itself():
    burst = PeriodicSegment(
        origin_s=1.0, frequency_hz=100.0, amplitude_v=1.0, offset_v=2.5, phase_rad=0.0, idle_v=2.5, cycles=3
    )
    assert at(burst, 1.0, 1.0025, 1.0275, 1.031, 50.0) == pytest.approx([2.5, 3.5, 1.5, 2.5, 2.5])
    assert burst.constant_from_s == pytest.approx(1.03)


def test_a_burst_train_repeats_from_its_origin():
    train = PeriodicSegment(0.0, 100.0, 1.0, 2.5, 0.0, 2.5, cycles=1, period_s=0.05)
    assert at(train, 0.0025, 0.02, 0.0525, 0.0575) == pytest.approx([3.5, 2.5, 3.5, 1.5])


def test_a_triggered_sweep_goes_on_at_its_start_frequency():
    chirp = ChirpSegment(0.0, 10.0, 110.0, 1.0, 1.0, 0.0, 0.0)
    t = np.linspace(2.0, 3.0, 20001)
    crossings = np.flatnonzero(np.diff(np.signbit(chirp.volts(t))))
    assert len(crossings) in (19, 20)  # two zero crossings a cycle, 10 Hz


def test_report_counts_only_what_high_voltage_could_feel():
    history = VoltageHistory()
    history.append(0.0, ConstantSegment(0.0))
    history.append(0.5, ConstantSegment(2.5))
    history.switch_high_voltage(1.0, hv=True)
    history.append(2.0, PeriodicSegment(2.0, 100.0, 1.0, 2.5, 0.0, 2.5, cycles=100))
    history.switch_high_voltage(4.0, hv=False)
    history.append(5.0, ConstantSegment(0.0))
    seen = report(history, 6.0)
    assert seen.lowest_v == pytest.approx(1.5)
    assert seen.highest_v == pytest.approx(3.5)
    assert seen.largest_jump_v == pytest.approx(0.0, abs=1e-9)
    assert seen.steepest_v_per_s == pytest.approx(2 * math.pi * 100, rel=1e-4)
    assert seen.live_s == pytest.approx(3.0)
    assert seen.outside_rest_s == pytest.approx(1.0, rel=0.03)
    assert seen.switched_at_rest
    assert not seen.ends_at_rest
    assert seen.end_v == 0.0


def test_report_sees_jumps_between_and_inside_segments():
    history = VoltageHistory()
    history.append(0.0, ConstantSegment(2.5))
    history.switch_high_voltage(0.0, hv=True)
    history.append(1.0, RelayGlitchSegment(until_s=1.005, during_v=0.0, following=ConstantSegment(2.6)))
    seen = report(history, 2.0)
    assert seen.lowest_v == 0.0
    assert seen.largest_jump_v == pytest.approx(2.6)
    assert report(history, 0.9).largest_jump_v == 0.0


def test_a_staircase_that_takes_no_time_is_one_jump():
    history = VoltageHistory()
    history.append(0.0, ConstantSegment(2.5))
    history.switch_high_voltage(0.0, hv=True)
    for i in range(11):
        history.append(1.0, ConstantSegment(2.5 + 0.1 * i))
    assert report(history, 2.0).largest_jump_v == pytest.approx(1.0)
    spread = VoltageHistory()
    spread.append(0.0, ConstantSegment(2.5))
    spread.switch_high_voltage(0.0, hv=True)
    for i in range(11):
        spread.append(1.0 + 0.01 * i, ConstantSegment(2.5 + 0.1 * i))
    assert report(spread, 2.0).largest_jump_v == pytest.approx(0.1)


def test_a_level_that_stood_for_no_time_is_still_seen():
    history = VoltageHistory()
    history.append(0.0, ConstantSegment(2.5))
    history.switch_high_voltage(0.0, hv=True)
    history.append(1.0, ConstantSegment(0.0))
    history.append(1.0, ConstantSegment(2.5))
    seen = report(history, 2.0)
    assert seen.lowest_v == 0.0


def test_report_of_a_slope_has_no_jump():
    history = VoltageHistory()
    history.append(0.0, ConstantSegment(2.5))
    history.switch_high_voltage(0.0, hv=True)
    history.append(1.0, RampSegment(1.0, 2.5, 3.5, 0.5))
    seen = report(history, 2.0)
    assert seen.largest_jump_v == pytest.approx(0.0)
    assert seen.steepest_v_per_s == pytest.approx(2.0, rel=1e-3)
    assert not seen.ends_at_rest


def test_a_long_idle_bench_is_cheap_to_report_on():
    history = VoltageHistory()
    history.append(0.0, ConstantSegment(2.5))
    history.switch_high_voltage(0.0, hv=True)
    history.append(1.0, PeriodicSegment(1.0, 250.0, 2.5, 2.5, 0.0, 2.5, cycles=25))
    seen = report(history, 1e7)  # four months at rest
    assert seen.ends_at_rest
    assert seen.outside_rest_s < 0.11


def history_of(changes: int, keeps_past: bool = False, reads: bool = True) -> VoltageHistory:
    """A change every second, each read at once."""
    history = VoltageHistory()
    history.keeps_past = keeps_past
    for k in range(1, changes + 1):
        history.append(float(k), ConstantSegment(1e-4 * k))
        if reads:
            history.volts([float(k)])
    return history


def test_the_past_that_nothing_reads_any_more_is_dropped() -> None:
    bounded, whole = history_of(10 * REMEMBERED), history_of(10 * REMEMBERED, keeps_past=True)
    assert len(bounded._entries) <= 2 * REMEMBERED
    assert bounded.change_count == whole.change_count == len(whole.entries()) == 10 * REMEMBERED + 1
    late_s = np.linspace(10 * REMEMBERED - REMEMBERED_S, 10 * REMEMBERED, 1000)
    np.testing.assert_array_equal(bounded.volts(late_s), whole.volts(late_s))
    with pytest.raises(ValueError, match="were dropped: set keeps_past"):
        bounded.entries()


def test_a_past_that_was_not_read_yet_is_not_dropped() -> None:
    assert history_of(5 * REMEMBERED, reads=False).volts([1.5])[0] == pytest.approx(1e-4)


def test_no_voltage_report_is_made_of_a_history_without_its_begin() -> None:
    bench = SimulatedBench(clock=VirtualClock())
    for k in range(5 * REMEMBERED):
        bench.clock.sleep(1.0)
        bench.history.append(bench.clock.now(), ConstantSegment(2.5 + 1e-4 * (k % 2)))
        bench.history.volts([bench.clock.now()])
    with pytest.raises(ValueError, match="set keeps_past"):
        bench.report()
