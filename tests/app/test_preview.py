"""Min/max decimation of a long record: every extreme is kept, at the right time."""

import numpy as np
import pytest

from app.live.minmax_trace import MinMaxTrace


def test_nothing_taken_gives_an_empty_curve() -> None:
    time, values = MinMaxTrace(1.0).decimated_curve()
    assert time.size == values.size == 0


@pytest.mark.parametrize("block", [1, 7, 100, 12_345])
def test_every_extreme_is_seen_however_the_blocks_are_cut(block: int) -> None:
    rate, columns = 50_000.0, 500
    signal = np.random.default_rng(1).standard_normal(50_000)
    signal[31_415] = 40.0
    trace = MinMaxTrace(1.0, columns)
    trace.reset(rate)
    for start in range(0, signal.size, block):
        trace.append(signal[start : start + block])
    time, values = trace.decimated_curve()
    assert values.size == 2 * columns
    grid = signal.reshape(columns, -1)
    np.testing.assert_array_equal(values[0::2], grid.min(axis=1))
    np.testing.assert_array_equal(values[1::2], grid.max(axis=1))
    np.testing.assert_allclose(time[0::2], np.arange(columns) * 100 / rate)


def test_only_the_last_seconds_are_kept() -> None:
    trace = MinMaxTrace(0.5, 50)
    trace.reset(1000.0)
    ramp = np.arange(3000) / 1000.0
    for start in range(0, 3000, 90):
        trace.append(ramp[start : start + 90])
    time, values = trace.decimated_curve()
    assert time[0] == pytest.approx(2.5)
    np.testing.assert_allclose(values[0::2], time[0::2])


def test_the_end_of_a_record_is_the_end_of_the_whole() -> None:
    trace = MinMaxTrace(0.5, 50)
    trace.reset(1000.0)
    for samples, filled in ((120, 12), (400, 50), (333, 50)):  # not full yet, full, and around the end of its memory
        trace.append(np.arange(float(samples)))
        (time, values), (end_s, end) = trace.decimated_curve(), trace.decimated_curve(0.1)
        assert (time.size, end_s.size) == (2 * filled, 2 * 11)
        np.testing.assert_array_equal(end_s, time[-22:])
        np.testing.assert_array_equal(end, values[-22:])


def test_a_slow_signal_gets_a_column_a_sample() -> None:
    trace = MinMaxTrace(0.1, 1000)
    trace.reset(5000.0)
    trace.append(np.arange(10.0))
    _, values = trace.decimated_curve()
    np.testing.assert_array_equal(values, np.repeat(np.arange(10.0), 2))


def test_a_new_record_begins_empty() -> None:
    trace = MinMaxTrace(1.0)
    trace.reset(1000.0)
    trace.append(np.ones(500))
    trace.reset(2000.0)
    assert trace.decimated_curve()[0].size == 0
