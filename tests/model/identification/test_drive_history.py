"""Drive history: creep of a sequence of steps and Rayleigh's law with its memory, against sums of lags and of switches."""

import numpy as np
import pytest

from benchmarks.campaigns import staircase
from drivers import PeriodicSweep
from model import AmplifierMap, ParameterError
from model.drive_history import DriveHistory, rayleigh_loop, rayleigh_response
from model.response.lag import loop_share

REFERENCE_S = 1 / (200 * np.pi)


def history(time_s: list[float], drive: list[float], start_s: float, read_s: float, zero_s: float) -> DriveHistory:
    return DriveHistory(*map(np.array, (time_s, drive, [start_s], [read_s], [[zero_s]])))


def test_a_step_from_long_rest_creeps_by_its_decades() -> None:
    one = history([10.0, 10.0], [0.0, 2.0], 10.0, 11.0, 9.0)
    assert one.steps(one.drive) == pytest.approx([2.0])
    assert one.crept(one.drive, REFERENCE_S) == pytest.approx(2 * one.decades(REFERENCE_S))
    assert one.decades(REFERENCE_S) == pytest.approx([np.log10(200 * np.pi)])


def test_what_earlier_steps_and_ramps_creep_is_the_sum_of_lags() -> None:
    time_s, drive = [1.0, 1.4, 6.4, 6.8, 9.0, 9.1], [0.0, 3.0, 3.0, 0.0, 0.0, -1.0]
    several = history(time_s, drive, 9.1, 10.1, 8.9)
    tau = np.logspace(-6, 6, 12 * 8 + 1)
    t = np.arange(0, 10.2, 1e-3)
    u = np.interp(t, time_s, drive)
    lags, crept, keep = np.zeros(tau.size), [], np.exp(-1e-3 / tau)
    for level in u:  # every lag follows the drive; their sum over a spectrum even in log time is its logarithm
        lags = level + (lags - level) * keep
        crept.append(lags.sum() / 8)
    begin = np.log10(tau[0]) - 1 / 16
    offset = begin - np.log10(REFERENCE_S) - np.euler_gamma / np.log(10)
    at = [round(each * 1000) for each in (10.1, 8.9)]
    wanted = np.diff([crept[i] + offset * u[i] for i in at[::-1]])
    assert several.crept(several.drive, REFERENCE_S) == pytest.approx(wanted, rel=2e-3)


def test_a_closed_loop_is_forgotten_and_switches_say_the_same() -> None:
    """Rayleigh's law is that of relays with even thresholds (Preisach)."""
    rng = np.random.default_rng(4)
    volts = np.concatenate(([0.0], rng.uniform(-500, 1500, 40).round(-1), [0.0, 300, 0, 300, 0]))
    grid = np.arange(-500, 1500, 10) + 5.0
    up, down = np.meshgrid(grid, grid, indexing="ij")
    relays = up >= down  # a relay switches up at `up` and back at `down`
    on = np.zeros(relays.shape, bool)
    summed = []
    for v in [1500.0, -500.0, *volts.tolist()]:
        on = np.where(up < v, True, np.where(down > v, False, on))
        summed.append(float((on & relays).sum()) * 100)
    found = rayleigh_response(volts, -500.0, 1500.0)
    wanted = np.array(summed[2:])
    assert found - found[0] == pytest.approx(wanted - wanted[0], abs=0.02 * np.ptp(wanted))
    assert found[-1] == found[-3]


def test_a_loop_has_the_response_of_its_turning_points() -> None:
    turn = 2 * np.pi * np.arange(400) / 400
    volts = 500 + 1000 * np.sin(turn)
    twice = rayleigh_response(np.concatenate(([0.0], np.tile(volts, 2))), -500.0, 1500.0)
    assert np.ptp(twice[401:] - rayleigh_loop(volts)) < 1e-6
    ratio = np.fft.fft(rayleigh_loop(volts))[1] / np.fft.fft(volts)[1] / 1000
    assert ratio == pytest.approx(1 - 4j / (3 * np.pi), abs=1e-4)  # the textbook's, of a sine


def test_a_drift_that_eases_off_follows_the_logarithm_and_is_one_from_first_to_last_zero() -> None:
    t = np.array([2.0, 2.5, 12.0, 12.5, 22.0, 22.5])
    run = DriveHistory(t, np.zeros(6), t[1::2], t[1::2] + 1, t[::2, None] - 0.5)
    zero, read = np.array([1.5, 11.5, 21.5]), np.array([3.5, 13.5, 23.5])
    age = 10.0  # the run begins with its first zero
    wanted = np.log((read - 1.5 + age) / (zero - 1.5 + age)) / np.log((21.5 - 1.5 + age) / age)
    assert run.easing_drift(age) == pytest.approx(wanted)


@pytest.mark.parametrize("read_s", [9.0, float("nan")])
def test_a_reading_before_its_step_or_without_a_time_is_refused(read_s: float) -> None:
    with pytest.raises(ParameterError, match="history"):
        history([10.0, 10.0], [0.0, 2.0], 10.0, read_s, 9.0)


def test_the_loops_of_a_sweep_are_those_of_many_plays() -> None:
    """Rayleigh's law is an even distribution of plays (backlashes) over their widths: here 1000 of them, moved sample by sample."""
    samples, amplifier = 4000, AmplifierMap()
    drive = PeriodicSweep(20.0, 80.0, 0.5, 2, 2.5, 2.5)
    volts = drive.volts(np.arange(samples) * drive.period_s / samples)
    lines = np.arange(21, 80, 2)
    radii = np.arange(0.5, 1000.0) * 1.0  # V on the specimen, over the whole range of -500 to 1500 V
    plays, loop = np.full(radii.size, -500.0) + radii, []
    for v in np.tile(amplifier.specimen_v(volts), 2).tolist():
        plays = np.clip(plays, v - radii, v + radii)
        loop.append(2.0 * plays.sum() / 1000)
    expected = np.fft.rfft(loop[samples:])[lines] / np.fft.rfft(amplifier.specimen_v(volts))[lines]
    found = loop_share(volts, lines, amplifier)
    np.testing.assert_allclose(found, expected, atol=2e-3 * np.abs(expected).max())
    assert np.abs(found - found.mean()).max() > 0.05 * np.abs(found.mean())  # a sine's would be alike at all lines


@pytest.mark.parametrize("stairs", [True, False])
def test_levels_without_times_are_a_staircase_or_each_from_rest(stairs: bool) -> None:
    """Against plays of all widths, whose every step creeps by itself."""
    levels = np.array([0.5, 1.5, 3.5, 5.0, 3.5, 1.5, 0.5])
    volts = AmplifierMap().specimen_v
    history = DriveHistory.of_levels(levels, 2.5, np.ones(7), stairs)
    loop = history.steps(rayleigh_response(volts(history.drive), -500.0, 1500.0)) / 1000
    crept = history.crept(volts(history.drive), REFERENCE_S)
    path = volts(levels)
    rows = slice(None)
    if not stairs:
        path, rows = np.column_stack((path, np.zeros(7))).ravel(), slice(0, None, 2)
    plays = staircase(path, 1.0, 0.0, REFERENCE_S) - path
    at_zeros = np.concatenate(([0.0], plays[1:-1:2])) if not stairs else 0.0
    np.testing.assert_allclose(loop, plays[rows] - at_zeros, atol=0.1)
    creep = staircase(path, 0.0, 1.0, REFERENCE_S) - path if stairs else volts(levels) * np.log10(1 / REFERENCE_S)
    np.testing.assert_allclose(crept, np.asarray(creep), atol=0.5)
