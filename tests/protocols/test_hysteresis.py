"""Hysteresis: the simulated hysteresis is measured, damping is distinguished, neither is invented."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from app.common.formatting import format_series
from drivers import Sine
from model.amplifier_map import AmplifierMap
from model.parameters import Tactor
from model.response.harmonic_response import amplifier_response
from model.response.statics import voltage_gain
from protocols.base import InterferenceLine, PointMeasured, Quality, Recording, RunStatus, SeriesReady
from protocols.measurements.hysteresis import Hysteresis
from protocols.measurements.voltage_steps import VoltageSteps
from protocols.registry import PROTOCOLS
from protocols.rehearsal import rehearse
from protocols.runfile.reader import Run
from tests.helpers.simulated_bench import laboratory, run, simulated

LOOPS = Hysteresis(frequencies_hz=(1.0, 2.0, 5.0), cycles=3)
WIDTH, CREEP = 0.1, 0.02


def truth_of_damping(frequency_hz: float) -> float:
    """Width over stroke that the model's damping alone makes: falling minus rising where the drive passes rest."""
    driven = amplifier_response(Tactor(), np.array([frequency_hz]), 2.5, 2.5, AmplifierMap())
    theta = 2 * np.pi * np.arange(4000) / 4000
    k = np.arange(driven.harmonics.shape[1])
    w = (np.abs(driven.harmonics[0]) * np.sin(np.outer(theta, k) + np.angle(driven.harmonics[0]))).sum(1)
    return float((w[2000] - w[0]) / (w[1000] - w[3000]))


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory):
    with laboratory(simulated(seed=2)) as lab:
        yield run(LOOPS, tmp_path_factory.mktemp("runs"), lab)


@pytest.fixture(scope="module")
def looped(tmp_path_factory: pytest.TempPathFactory):
    with laboratory(simulated(seed=3, beyond={"hysteresis_width": WIDTH})) as lab:
        yield run(LOOPS, tmp_path_factory.mktemp("runs"), lab)


def found(ran) -> dict:
    with Run(ran.path) as file:
        return {e.name: e for e in file.record.estimates}


def test_without_hysteresis_the_loop_is_that_of_the_models_damping(plain) -> None:
    assert plain.status is RunStatus.COMPLETED
    for p in plain.points:
        assert Quality(p.quality) is Quality.SIMULATED
        assert p.frequency == pytest.approx(round(p.frequency), rel=1e-4)
        # Errors of three cycles have two degrees of freedom: 9.9 of them hold 99 %. Folding costs a little of the stroke.
        assert abs(p.share - truth_of_damping(p.frequency)) < 9.9 * p.share_errors + 2e-4, p
    hysteresis = found(plain)["loop_hysteresis"]
    assert abs(hysteresis.value) < max(4 * hysteresis.standard_error, 5e-4)


def test_each_loop_is_told_whole_the_moment_it_is_measured(plain, looped) -> None:
    told = [event for event in plain.events if isinstance(event, PointMeasured | SeriesReady)]
    assert [type(event) for event in told] == 3 * [PointMeasured, SeriesReady]
    for ran in (plain, looped):
        with Run(ran.path) as file:
            curves = file.series()
        assert [(c.name, c.label, c.entry) for c in curves] == [
            (("loop", f"{f} Hz", i)) for i, f in enumerate((1, 2, 5))
        ]
        for curve, point in zip(curves, ran.points, strict=True):
            drive, moved, errors = curve.x, curve.y, curve.errors
            assert (drive[0], moved[0]) == (drive[-1], moved[-1]), "it is closed"
            assert np.ptp(drive) == pytest.approx(5.0, rel=2e-3)
            assert moved[drive.argmax()] - moved[drive.argmin()] == pytest.approx(point.stroke, rel=1e-3)
            area = 0.5 * float(np.sum(moved[1:] * drive[:-1] - moved[:-1] * drive[1:]))
            assert abs(area) == pytest.approx(abs(point.area), rel=0.02)
            assert 0 < np.median(errors) < 1e-6
            assert format_series(curve) == ""
    # Where the model's displacement is at that drive, rising and falling, by its own harmonics.
    driven = amplifier_response(Tactor(), np.array([1.0]), 2.5, 2.5, AmplifierMap())
    with Run(plain.path) as file:
        slowest = file.series()[0]
    drive, moved = slowest.x[:-1], slowest.y[:-1]
    turn = 2 * np.pi * np.arange(128) / 128
    theta = turn + np.angle(1j * (drive * np.exp(-1j * turn)).sum())  # the drive as it was recorded is sin(theta)
    k = np.arange(driven.harmonics.shape[1])
    truth = (np.abs(driven.harmonics[0]) * np.sin(np.outer(theta, k) + np.angle(driven.harmonics[0]))).sum(1)
    # The mean over a phase rounds the kink of the two slopes by 1.4e-6 m.
    np.testing.assert_allclose(moved - moved.mean(), truth - truth.mean(), atol=1.5e-6)


def test_the_hysteresis_that_was_put_in_comes_out(looped) -> None:
    # Rayleigh's law: at its ends the loop is steeper than what follows at once, by twice its width over the stroke.
    width_m = WIDTH * 2000 * voltage_gain(Tactor())
    stroke_m = (1 + 2 * WIDTH) * 2000 * voltage_gain(Tactor())
    slowest = looped.points[0]
    assert slowest.width == pytest.approx(0.75 * width_m, rel=0.1)  # at rest; damping at 1 Hz adds a few percent of it
    assert slowest.stroke == pytest.approx(stroke_m, rel=5e-3)
    hysteresis = found(looped)["loop_hysteresis"]
    assert hysteresis.value == pytest.approx(0.75 * width_m / stroke_m, rel=0.05)
    # Rest is a quarter of the stroke from its lower end, so most of the area lies above it.
    assert slowest.asymmetry > 0.2


def test_what_is_damping_is_told_apart_from_hysteresis(plain, looped) -> None:
    without, with_it = (found(ran)["loop_width_per_frequency"].value for ran in (plain, looped))
    assert without == pytest.approx((truth_of_damping(5.0) - truth_of_damping(1.0)) / 4, rel=0.05)
    assert with_it == pytest.approx(without, rel=0.3)


def test_hum_at_an_even_harmonic_is_the_same_half_a_cycle_later() -> None:
    """Width and stroke lose it; hum at an odd harmonic, and any in the largest width, is in the errors."""
    t, rng, hum_m = np.arange(6500) / 5000, np.random.default_rng(4), 1e-6
    drive_v = 2.5 + 2.5 * np.sin(10 * np.pi * t)
    moved = 1e-4 * np.sin(10 * np.pi * t - 0.05) + 1e-8 * rng.standard_normal(t.size)
    points = {
        hz: LOOPS.point(
            (5.0,),
            [
                Recording(0, (0, t.size), 5000.0, Sine(5.0, 2.5, 2.5, 8), drive_v, moved + hum_m * np.sin(2 * np.pi * hz * t),
                    Quality.GOOD, interference=(InterferenceLine(hz, hum_m, 1e-8),))
            ],
            True,
        )
        for hz in (45.0, 50.0)
    }  # fmt: skip
    assert points[45.0].width_errors > hum_m > 10 * points[50.0].width_errors
    assert abs(points[50.0].width - 2e-4 * np.sin(0.05)) < hum_m / 20
    assert points[50.0].largest_errors > hum_m
    assert Quality.INTERFERENCE in Quality(points[50.0].quality)


def test_the_file_gives_the_numbers_of_the_live_run(looped) -> None:
    plan = LOOPS.plan(2.5)
    with Run(looped.path) as file:
        again = [LOOPS.point(plan[r.entry].key, [r], file.record.simulated) for r in file.recordings()]
    assert again == looped.points


@pytest.mark.deep
def test_voltage_steps_find_the_creep_and_the_loop_that_were_put_in(tmp_path: Path) -> None:
    steps = VoltageSteps(levels_v=(3.5, 4.5), repeats=2, order="up", rest_s=10.0, hold_s=10.0, read_s=1.0)
    with laboratory(simulated(seed=4, beyond={"creep_per_decade": CREEP})) as lab:
        ran = run(steps, tmp_path, lab)
    creep = found(ran)["creep_per_decade"]
    # The plant's creep is a share of the step; relative to what is read after a second it is a little less.
    assert creep.value == pytest.approx(CREEP / (1 + CREEP), rel=0.2)
    assert creep.standard_error < 0.2 * creep.value


@pytest.mark.deep
def test_it_is_one_of_the_protocols_and_the_rehearsal_tells_how_long_it_takes(tmp_path: Path) -> None:
    assert PROTOCOLS["hysteresis"] is Hysteresis
    short = Hysteresis(frequencies_hz=(1.0,), cycles=2)
    with laboratory() as lab:
        rehearsal = rehearse(short, lab.bench.amplifier)
        begin_s = lab.bench.clock.now()
        ran = run(short, tmp_path, lab)
        assert rehearsal.duration_s == pytest.approx(lab.bench.clock.now() - begin_s, rel=0.3)
    assert ran.points[0].cycles == 2


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"frequencies_hz": (20.0,)}, "too low for loops at 20 Hz; at least 5632 Hz is needed"),
        ({"cycles": 1}, "greater than or equal to 2"),
        ({"dropped": 0}, "greater than or equal to 1"),
    ],
)
def test_what_makes_no_sense_is_refused(settings: dict, says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        Hysteresis(**settings)
