"""Criteria for rest: voltages of a scripted card, block by block."""

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from drivers.bench.rest import (
    MAX_NOISE_RATIO,
    NOISE_MARGIN_V,
    REST_DURATION_S,
    REST_NOISE_V,
    REST_REPEATABILITY_V,
    REST_TOLERANCE_V,
    STALE_SAMPLES_S,
    RestMeasurement,
    verify_rest,
)
from sim_hardware.clock import VirtualClock

pytestmark = pytest.mark.one_in(1)

RATE_HZ, BLOCK = 1000.0, 50
REST_V = 2.5


def watched(
    volts: Callable[[np.ndarray], np.ndarray],
    before: RestMeasurement | None = None,
    begin_s: float = 0.0,
    start_time_s: float = 0.0,
    rate_hz: float = RATE_HZ,
    block: int = BLOCK,
) -> RestMeasurement:
    """Return the verdict on a drive `volts(t)`, measured from `begin_s` for two seconds; the card started at `start_time_s`."""
    clock = VirtualClock(start_time_s)
    clock.sleep(begin_s)
    index = int(begin_s * rate_hz)

    def next_volts() -> tuple[int, np.ndarray]:
        nonlocal index
        start, index = index, index + block
        clock.sleep(block / rate_hz)
        return start, np.asarray(volts(np.arange(start, index) / rate_hz), float)

    return verify_rest(next_volts, clock, start_time_s, rate_hz, REST_V, 2.0, before)


def steady(level_v: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda t: np.full(t.size, level_v)


@pytest.mark.parametrize("side", [-1, 1])
def test_rest_is_within_fifty_millivolts_and_not_beyond(side: int) -> None:
    assert REST_TOLERANCE_V == 0.05  # 30 V on the specimen on the steep side
    assert watched(steady(REST_V + side * 0.049)).confirmed
    assert not watched(steady(REST_V + side * 0.051)).confirmed


@pytest.mark.parametrize("side", [-1, 1])
def test_where_rest_was_seen_before_it_is_that_level_to_ten_millivolts(side: int) -> None:
    assert REST_REPEATABILITY_V == 0.01
    before = RestMeasurement(True, REST_V + 0.02, "", 1e-3)
    assert watched(steady(REST_V + 0.02 + side * 0.009), before).confirmed
    assert not watched(steady(REST_V + 0.02 + side * 0.011), before).confirmed


def test_every_sample_of_a_tenth_of_a_second_lies_there() -> None:
    assert REST_DURATION_S == 0.1

    def a_spike_every(period: int) -> Callable[[np.ndarray], np.ndarray]:
        return lambda t: np.where(np.rint(t * RATE_HZ) % period == 0, REST_V + 0.2, REST_V)

    assert watched(a_spike_every(151)).confirmed  # a block ends somewhere behind a hundred good ones
    assert not watched(a_spike_every(100)).confirmed  # 99: the mean is rest to 2 mV


@pytest.mark.one_in(1)
@pytest.mark.parametrize(("period_s", "still"), [(0.09, False), (0.11, True)])
def test_rest_begins_behind_the_last_of_several_excursions_in_a_block(period_s: float, still: bool) -> None:
    """So short that they show neither in the mean nor in the noise."""
    period = round(period_s * 10e3)
    seen = watched(lambda t: np.where(np.rint(t * 10e3) % period == 0, 2.56, 2.5), rate_hz=10e3, block=2000)
    assert seen.confirmed is still


def test_samples_from_before_the_command_count_for_nothing() -> None:
    """The card is read with delay: what lies in its buffer was taken while the drive still stood at rest."""
    assert STALE_SAMPLES_S == 0.1
    begin_s = 1.0
    leaves = begin_s + STALE_SAMPLES_S
    assert not watched(lambda t: np.where(t < leaves, REST_V, 4.0), begin_s=begin_s - 0.0).confirmed


def test_a_small_sine_is_not_rest_although_its_mean_is() -> None:
    before = RestMeasurement(True, REST_V, "", 1e-3)
    rng = np.random.default_rng(1)

    def noisy(rms_v: float) -> Callable[[np.ndarray], np.ndarray]:
        return lambda t: REST_V + rms_v * math.sqrt(2) * np.sin(2 * np.pi * 50 * t) + 0 * rng.random(t.size)

    limit_v = MAX_NOISE_RATIO * before.noise_v + NOISE_MARGIN_V
    assert limit_v == pytest.approx(4e-3)
    assert watched(noisy(0.9 * limit_v), before).confirmed
    seen = watched(noisy(1.1 * limit_v), before)
    assert not seen.confirmed
    assert "noise 0.0044 V" in seen.message
    assert watched(noisy(0.9 * REST_NOISE_V)).confirmed
    assert not watched(noisy(1.1 * REST_NOISE_V)).confirmed


def words_of(levels: Sequence[float], period_s: float = 0.3) -> str:
    return watched(lambda t: np.asarray(levels)[(t / period_s).astype(int) % len(levels)]).message


def test_failed_rest_check_reports_lowest_and_highest_voltage() -> None:
    """A mean of 2.5 V is also that of a sine that shakes the specimen from -500 to 1500 V."""
    seen = watched(lambda t: 2.5 + 2.5 * np.sin(2 * np.pi * 25 * t))
    assert "(lowest 0.000 V, highest 5.000 V)" in seen.message
    seen = watched(lambda t: 2.5 + np.where(t < 0.5, 2.0, 0.3) * np.sin(2 * np.pi * 25 * t))
    assert "(lowest 2.200 V, highest 2.800 V)" in seen.message  # earlier samples are not reported
    assert "lowest 1.000 V, highest 4.000 V" in words_of((1.0, 4.0))  # slower than a block


def test_it_is_watched_for_as_long_as_was_said() -> None:
    assert watched(lambda t: np.where(t < 1.7, 4.0, REST_V)).confirmed
    assert not watched(lambda t: np.where(t < 2.3, 4.0, REST_V)).confirmed


def test_a_card_that_is_late_is_waited_for_although_the_time_has_passed() -> None:
    """Its blocks from before the command tell nothing: the first ones after it decide."""
    clock, blocks = VirtualClock(), iter(range(0, 2000, BLOCK))

    def next_volts() -> tuple[int, np.ndarray]:
        clock.sleep(0.5)
        start = next(blocks)
        return start, np.full(BLOCK, REST_V if start >= 400 else 4.0)

    clock.sleep(0.4)
    assert verify_rest(next_volts, clock, 0.0, RATE_HZ, REST_V, 2.0).confirmed


@pytest.mark.parametrize(("spike_v", "confirmed"), [(2.549, True), (2.551, False), (2.48, True)])
def test_single_samples_are_limited_about_nominal_rest_not_about_rest_at_arming(
    spike_v: float, confirmed: bool
) -> None:
    before = RestMeasurement(True, 2.54, "", 1e-2)
    spikes = watched(lambda t: np.where(np.rint(t * RATE_HZ) % 50 == 0, spike_v, 2.54), before)
    assert spikes.confirmed is confirmed


@pytest.mark.parametrize("start_time_s", [0.0, 700.0])
def test_samples_count_from_a_tenth_of_a_second_after_the_command_whenever_the_card_was_started(
    start_time_s: float,
) -> None:
    """A drive that rests for less than a tenth of a second after the samples that may be old, and no longer."""

    def rests_until(end_s: float) -> RestMeasurement:
        return watched(lambda t: np.where(t < end_s, REST_V, 4.0), begin_s=1.0, start_time_s=start_time_s)

    assert not rests_until(1.0 + STALE_SAMPLES_S + REST_DURATION_S - 0.002).confirmed
    assert rests_until(1.0 + STALE_SAMPLES_S + REST_DURATION_S).confirmed


@pytest.mark.parametrize(("spike_s", "reported"), [(0.85, False), (0.97, True), (1.98, True)])
def test_extremes_of_the_last_second_are_reported(spike_s: float, reported: bool) -> None:
    seen = watched(lambda t: np.where(np.abs(t - spike_s) < 1e-4, 4.5, np.where(t < 3.0, 3.0, 2.5)))
    assert not seen.confirmed
    assert ("(lowest 3.000 V, highest 4.500 V)" in seen.message) == reported


def test_a_confirmed_rest_reports_mean_and_noise_of_its_samples() -> None:
    seen = watched(lambda t: np.where(np.rint(t * RATE_HZ) % 2 == 0, REST_V + 0.012, REST_V + 0.008))
    assert seen.confirmed
    assert seen.measured_v == pytest.approx(2.51)
    assert seen.noise_v == pytest.approx(0.002)
    assert seen.message == "the card sees 2.510 V at the amplifier's input: rest"


def test_rest_that_was_never_measured_long_enough_reports_the_last_block() -> None:
    seen = watched(lambda t: np.where((t * 25).astype(int) % 2 == 0, REST_V, 3.5))
    assert not seen.confirmed
    assert 2.5 < seen.measured_v < 3.5
    assert seen.noise_v == pytest.approx(0.4, abs=0.01)
