"""Creep and hysteresis of the simulated specimen: logarithm over all times, loss angle of a sine, parabolas that close."""

import numpy as np
import pytest

from sim_hardware.plant.creep import REFERENCE_S, CreepModel
from sim_hardware.plant.hysteresis import PLAY_COUNT, PLAY_SPACING_V, HysteresisModel

STEP_S = 1e-5
SHARE = 0.015


@pytest.mark.deep
def test_a_step_creeps_alike_in_every_decade_from_a_millisecond_on() -> None:
    creep = CreepModel(SHARE, STEP_S)
    crept = creep.process(np.ones(128 * 800), 0.0)
    t = STEP_S * (np.arange(crept.size) + 1)
    late = t > 1e-3
    assert crept[late] == pytest.approx(1 + SHARE * np.log10(t[late] / REFERENCE_S), abs=1e-4)
    on, per_s = creep.hold(1.0, 100)
    assert on[0] == pytest.approx(crept[-1], abs=1e-6)
    assert per_s[0] == pytest.approx(SHARE / np.log(10) / t[-1], rel=0.02)
    creep.advance(1.0, 1e3)
    assert creep.crept(1.0) == pytest.approx(1 + SHARE * np.log10(1e3 / REFERENCE_S), abs=1e-4)


def test_a_sine_lags_by_the_angle_that_belongs_to_the_logarithm() -> None:
    creep, f = CreepModel(SHARE, STEP_S), 100.0
    t = STEP_S * (np.arange(128 * 1600) + 1)
    sine = np.sin(2 * np.pi * f * t)
    last = np.exp(-2j * np.pi * f * t)[-100_000:]
    factor = (creep.process(sine, 0.0)[-100_000:] @ last) / (sine[-100_000:] @ last)
    wanted = 1 - SHARE * (np.euler_gamma + 0.5j * np.pi) / np.log(10)
    assert abs(factor - wanted) < 3e-5


def test_branches_are_parabolas_and_closed_loops_are_forgotten() -> None:
    width = 0.05
    specimen = HysteresisModel(width, -500.0, 1500.0)

    def ends(*volts: float) -> np.ndarray:
        return np.array(
            [specimen.process(np.linspace(a, b, 50))[-1] for a, b in zip((0.0, *volts), volts, strict=False)]
        )

    k = 4 * width / 2000 / 2  # half the curvature of a branch: the width in the middle is k (2000 V)^2 / 2 over 2000 V
    assert ends(-400.0)[0] == pytest.approx(-400 - k * 400**2, abs=0.1)
    assert ends(0.0)[0] == pytest.approx(0.0, abs=0.1)
    first = ends(1500.0, -500.0, 1500.0, 300.0, 900.0, 300.0, 900.0)
    assert first[4] == pytest.approx(first[6], abs=1e-9)
    assert first[3] == pytest.approx(first[5], abs=1e-9)
    assert first[0] == pytest.approx(first[2], abs=1e-9)
    up = specimen.process(np.linspace(900.0, 1500.0, 100))  # on, as if the small loop had not been
    assert up[-1] == pytest.approx(first[0], abs=1e-9)


def test_the_response_is_that_of_plays_moved_one_by_one() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(400) / 400
    volts = np.concatenate(
        (
            np.interp(t, np.sort(rng.uniform(0, 1, 40)), rng.uniform(-500, 1500, 40)),
            np.repeat(rng.uniform(-500, 1500, 40), 5),
            500 + 1000 * np.sin(12 * np.pi * t),
        )
    )
    specimen, plays, sums = HysteresisModel(0.05, -500.0, 1500.0), np.zeros(PLAY_COUNT), []
    half = PLAY_SPACING_V * (np.arange(PLAY_COUNT) + 0.5)
    for v in (1500.0, -500.0, 0.0, *volts.tolist()):
        plays = np.clip(plays, v - half, v + half)
        sums.append(plays.sum())
    pieces = [specimen.process(part) for part in np.split(volts, (1, 2, 300, 301, 500, 777))]
    weight = 0.05 * 2000 * 2 * PLAY_SPACING_V / 1000**2
    assert np.concatenate(pieces) == pytest.approx(volts + weight * (np.array(sums[3:]) - sums[2]), abs=1e-9)


def test_the_creep_is_the_logarithm_of_time_within_a_decade_and_the_loop_a_parabola() -> None:
    grown = []
    for t in np.logspace(-2, 1, 31):
        crept = CreepModel(0.015, 1e-5)
        crept.advance(1.0, float(t))
        grown.append(crept.crept(1.0))
    np.testing.assert_allclose(np.diff(grown) * 10, 0.015, rtol=5e-4)
    specimen = HysteresisModel(0.05, -500.0, 1500.0)
    at = specimen.process(np.array([0.0, 1500.0]))[-1]
    fallen = np.linspace(1500.0, -500.0, 2001)[1:]
    curve = specimen.process(fallen) - fallen - (at - 1500.0)
    np.testing.assert_allclose(-curve, 0.05 * 4000 * ((1500.0 - fallen) / 2000) ** 2, atol=0.02)
