"""A recording judged as a whole: sound ones pass, a sensor's fault in the middle is found, on both sides of each limit."""

import math

import numpy as np
import pytest

from drivers.drive_shapes import Drive, Hold, LinearSweep, Sine, SquareWave, Steps
from protocols.base import InterferenceLine, Quality, Recording
from protocols.measurements.sine_dwell import sine_point
from protocols.signals import judge_recording, prediction_noise

RATE_HZ, COUNT, NOISE_M = 5000.0, 5000, 0.5e-6
T = np.arange(COUNT) / RATE_HZ
MIDDLE = COUNT // 2 + 7

SWING_M = 100e-6 * (np.sin(2 * np.pi * 40 * T - 0.4) + 0.2 * np.sin(2 * np.pi * 80 * T))
"""Response of a specimen with two slopes."""


def is_disturbed(recording: Recording) -> bool:
    flags = judge_recording(recording)
    assert Quality.DRIVE_OFF not in flags
    return Quality.DISTURBED in flags


def recording(moved_m: np.ndarray, rest_noise_m: float = math.nan, hertz: float = 40.0, **fields) -> Recording:
    t = np.arange(moved_m.size) / RATE_HZ
    drive_v = 2.5 + 2.5 * np.sin(2 * np.pi * hertz * t) + 3e-4 * np.random.default_rng(2).standard_normal(t.size)
    values = {"drive": Sine(hertz, 2.5, 2.5, 1000), "drive_v": drive_v} | fields
    return Recording(
        0, (0, t.size), RATE_HZ, displacement_m=moved_m, quality=Quality.GOOD, rest_noise_m=rest_noise_m, **values
    )


def level(moved_m: np.ndarray, **fields) -> Recording:
    noise = 3e-4 * np.random.default_rng(3).standard_normal(moved_m.size)
    return recording(moved_m, drive=Hold(2.5, 10.0), drive_v=2.5 + noise, **fields)


def noise(seed: int = 1, scale: float = NOISE_M, count: int = COUNT) -> np.ndarray:
    return scale * np.random.default_rng(seed).standard_normal(count)


def from_the_middle(offset_m: float, scans: int = COUNT) -> np.ndarray:
    at = np.arange(COUNT)
    return np.where((at >= MIDDLE) & (at < MIDDLE + scans), offset_m, 0.0)


@pytest.mark.parametrize(("make", "swing"), [(level, 0.0), (recording, SWING_M)])
def test_a_jump_and_a_dropout_of_ten_times_the_noise_are_found(make, swing) -> None:
    expected = {(1.5, COUNT): False, (10.0, COUNT): True, (-10.0, 25): True}
    moved = {case: swing + noise() + from_the_middle(case[0] * NOISE_M, case[1]) for case in expected}
    assert {case: is_disturbed(make(moved[case])) for case in expected} == expected


def test_a_shift_in_steps_below_the_limit_of_single_scans_is_found_in_averaged_ones() -> None:
    ramp = np.clip((np.arange(COUNT) - MIDDLE + 1) / 12, 0.0, 1.0)
    assert [is_disturbed(level(noise(seed) + 6.0 * NOISE_M * ramp)) for seed in range(1, 5)] == [True] * 4


def test_a_sensor_that_sticks_at_a_level_has_no_noise() -> None:
    expected = {1.0: False, 0.75: False, 0.2: True, 0.0: True}
    quiet = {share: noise() * np.where(from_the_middle(1.0, 200) > 0, share, 1.0) for share in expected}
    assert {share: is_disturbed(level(quiet[share])) for share in expected} == expected


def test_a_sensor_that_sticks_in_motion_is_found_although_its_noise_goes_on() -> None:
    stuck = np.where(np.arange(COUNT) < MIDDLE, SWING_M, SWING_M[MIDDLE])
    assert is_disturbed(recording(stuck + noise()))


def test_cycles_cut_off_from_the_middle_on_differ_from_the_others() -> None:
    expected = {0.0: False, 0.005: False, 0.03: True}
    limits = {
        share: np.where(np.arange(COUNT) < MIDDLE, np.inf, SWING_M.max() - share * np.ptp(SWING_M))
        for share in expected
    }
    found = {share: is_disturbed(recording(np.minimum(SWING_M, limits[share]) + noise())) for share in expected}
    assert found == expected


def test_the_noise_is_compared_with_the_noise_at_rest() -> None:
    expected = {0.3: True, 0.8: False, 8.0: False, 12.0: True, math.nan: False}
    assert {r: is_disturbed(level(noise(), rest_noise_m=NOISE_M / r)) for r in expected} == expected


def test_the_noise_at_rest_is_the_white_part_of_hum_and_drift() -> None:
    hum = 3e-6 * np.sin(2 * np.pi * 50.02 * T) + 2e-6 * T
    assert prediction_noise(hum + noise()) == pytest.approx(NOISE_M, rel=0.1)
    assert math.isnan(prediction_noise(noise(count=20)))


def test_sound_records_with_other_drives_pass() -> None:
    sweep = LinearSweep(20.0, 120.0, 1.0, 2.5, 2.5)
    moved = 40e-6 * (sweep.volts(np.maximum(T - 1e-3, 0.0)) - 2.5)
    assert not is_disturbed(recording(moved + noise(), drive=sweep, drive_v=sweep.volts(T)))
    assert is_disturbed(recording(moved + noise() + from_the_middle(6e-6), drive=sweep, drive_v=sweep.volts(T)))
    square = SquareWave(50.0, 2.5, 2.5, 0.5, 5e-4, 100)
    drive_v = square.volts(T * (1 + 3e-5) + 1e-3)  # the clocks of source and card differ
    waves = 40e-6 * square.volts(T * (1 + 3e-5))
    assert not is_disturbed(recording(waves + noise(), drive=square, drive_v=drive_v))
    assert is_disturbed(recording(waves + noise() + from_the_middle(6e-6), drive=square, drive_v=drive_v))


def test_interference_that_cannot_be_separated_from_the_response_is_no_disturbance() -> None:
    hum = InterferenceLine(40.6, 8e-6, 1e-8)
    moved = SWING_M + noise() + 8e-6 * np.sin(2 * np.pi * 40.6 * T)
    assert not is_disturbed(recording(moved, interference=(hum,)))
    assert is_disturbed(recording(moved))


def test_a_recording_too_short_is_not_judged_and_one_with_a_value_missing_is_disturbed() -> None:
    short = noise(count=50)
    short[25] += 1e-3
    assert not is_disturbed(level(short))
    missing = noise()
    missing[MIDDLE] = math.nan
    assert is_disturbed(level(missing))


@pytest.mark.parametrize(("count", "most"), [(40, 0), pytest.param(3000, 3, marks=pytest.mark.deep)])
def test_sound_records_are_flagged_as_rarely_as_stated(count: int, most: int) -> None:
    assert sum(is_disturbed(level(noise(seed, count=1000))) for seed in range(count)) <= most


def test_a_disturbed_point_is_not_usable_and_says_so() -> None:
    sound, stuck = SWING_M + noise(), np.where(np.arange(COUNT) < MIDDLE, SWING_M, SWING_M[MIDDLE]) + noise()
    assert Quality(sine_point([recording(sound)], simulated=False).quality) is Quality.GOOD
    flags = Quality(sine_point([recording(sound), recording(stuck)], simulated=False).quality)
    assert Quality.DISTURBED in flags
    assert not flags.usable


def test_a_drive_that_swings_otherwise_than_commanded_is_off() -> None:
    for share, is_off in ((0.94, True), (0.96, False), (1.04, False), (1.06, True)):
        sound = recording(SWING_M + noise())
        seen = recording(SWING_M + noise(), drive_v=2.5 + share * (sound.drive_v - 2.5))
        assert (Quality.DRIVE_OFF in judge_recording(seen)) is is_off, share


@pytest.mark.parametrize("drive", [Sine(40.0, 2.5, 2.5, 8), Steps((2.5, 5.0, 2.5), 0.08, 3e-3)])
def test_a_drive_that_begins_in_the_recording_is_compared_to_its_end_and_before_it(drive: Drive) -> None:
    begin_s = 0.3137

    def is_off(*others: tuple[Drive, float]) -> bool:
        volts = drive.volts(T - begin_s) + sum(other.volts(T - at_s) - 2.5 for other, at_s in others)
        noisy = np.clip(volts, 0, 5) + 3e-4 * np.random.default_rng(4).standard_normal(COUNT)
        return Quality.DRIVE_OFF in judge_recording(recording(noise(), drive=drive, drive_v=noisy))

    assert not is_off()
    assert is_off((drive, begin_s + drive.duration_s + 0.01))  # played twice
    assert is_off((Sine(170.0, 1.0, 2.5, 5), begin_s - 0.05))  # another program's, before it
    assert is_off((Sine(170.0, 0.4, 2.5, 20), begin_s))
    assert not is_off((Sine(170.0, 0.05, 2.5, 20), begin_s))
    late = drive.volts(1.003 * (T - begin_s))
    assert Quality.DRIVE_OFF not in judge_recording(recording(noise(), drive=drive, drive_v=late))
