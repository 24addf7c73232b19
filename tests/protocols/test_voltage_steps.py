"""Voltage steps: static deflection, creep and loop of the plant are measured with every kind of source."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from app.config.bench_file import BenchConfig
from app.identification.observations import read_observations
from drivers.drive_shapes import Hold
from model.amplifier_map import AmplifierMap
from model.parameters import Tactor
from model.response.statics import voltage_gain
from protocols.base import Quality, Recording, RunStatus
from protocols.measurements.mass_resonance import MassResonance
from protocols.measurements.voltage_steps import PAPER_LEVELS_V, VoltageSteps
from protocols.registry import PROTOCOLS
from protocols.rehearsal import rehearse
from protocols.runfile.reader import Run
from tests.helpers.simulated_bench import laboratory, run, simulated

BRIEF = VoltageSteps(levels_v=(0.5, 2.5, 4.0), repeats=3, rest_s=0.3, read_s=0.5, hold_s=1.0)
RATE_HZ = 5000.0


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory):
    with laboratory(simulated(seed=11)) as lab:
        yield run(BRIEF, tmp_path_factory.mktemp("runs"), lab)


def expected_m(level_v: float) -> float:
    """Eq. (8) of the paper, in closed form."""
    return float(voltage_gain(Tactor()) * AmplifierMap().specimen_v(level_v))


@cache
def creeping(share: float, ramp_s: float, level_v: float = 4.5, noise_m: float = 0.0) -> Recording:
    """A tactor that follows immediately and creeps as share x log10(t / 1 s), under a straight ramp: a sum of small steps."""
    n = round(8.0 * RATE_HZ)
    t = np.arange(n) / RATE_HZ
    begin_s = 1.0
    drive = np.interp(t, [begin_s, begin_s + ramp_s], [2.5, level_v])
    pieces = 200
    moved = np.zeros(n)
    for k in range(pieces):
        since = t - (begin_s + ramp_s * (k + 0.5) / pieces)
        on = since > 0
        moved[on] += expected_m(level_v) / pieces * (1 + share * np.log10(np.maximum(since[on], 1e-3)))
    noise = np.random.default_rng(3).normal(0, 1, (2, n))
    return Recording(
        0, (0, n), RATE_HZ, Hold(level_v, 6.0), drive + 3e-4 * noise[0], moved + 1e-6 + noise_m * noise[1], Quality.GOOD
    )  # fmt: skip


def test_every_level_is_where_the_closed_form_says(ran) -> None:
    assert ran.status is RunStatus.COMPLETED
    assert [(p.level, p.direction) for p in ran.points] == [
        (0.5, 1), (2.5, 1), (4.0, 1), (4.0, -1), (2.5, -1), (0.5, -1), (0.5, 1), (2.5, 1), (4.0, 1),
    ]  # fmt: skip
    for p in ran.points:
        # The generator's and the card's own errors of a millivolt, and the Galerkin basis' static error.
        systematic = 600 * 1e-3 * voltage_gain(Tactor()) + 2e-3 * abs(expected_m(p.level))
        assert abs(p.deflection - expected_m(p.level)) < 4 * p.deflection_errors + systematic, p
        assert p.drive == pytest.approx(p.level, abs=2e-3)
        assert p.ramp_time == pytest.approx(abs(p.level - 2.5) / 5.0, rel=0.2, abs=1e-9)  # commands take time
        assert Quality(p.quality) is Quality.SIMULATED


def test_what_does_not_creep_has_no_creep_and_no_loop(ran) -> None:
    with Run(ran.path) as file:
        found = {e.name: e for e in file.record.estimates}
    assert abs(found["creep_per_decade"].value) < 4 * found["creep_per_decade"].standard_error
    assert abs(found["loop_width"].value) < 4 * found["loop_width"].standard_error
    assert 0 < found["repeatability"].value < 1e-6
    above, below = found["static_gain_above_rest"], found["static_gain_below_rest"]
    assert above.value / below.value == pytest.approx(3, rel=0.01)
    assert above.value == pytest.approx(600 * voltage_gain(Tactor()), rel=3e-3)


def test_the_history_of_a_run_is_the_drive_that_the_card_saw(ran) -> None:
    """Every way to rest, too, which begins later than planned and takes longer; the loop before the first level is as planned."""
    (steps,) = read_observations([ran.path])[1].runs
    with Run(ran.path) as file:
        time_s, drive_v = file.trace.time_s(), file.trace.drive_v()
    smooth_v = np.convolve(drive_v, np.full(51, 1 / 51), "same")
    within = (time_s > steps.history.zero_s[0, 0]) & (time_s < steps.history.zero_s[-1, 0])
    taken_v = np.interp(time_s, steps.history.time_s, steps.history.drive)
    np.testing.assert_allclose(taken_v[within], smooth_v[within], atol=0.15)


@pytest.mark.deep
def test_a_sweep_that_faded_out_leaves_nothing_in_the_steps(tmp_path: Path) -> None:
    """It leaves rest in the middle of the loop, a sine at its lower side: the first step would be up to 5 um larger."""
    sweep = MassResonance(masses_kg=(7.73e-3,), sweep_s=5.0, piece_s=5.0)
    deflections = []
    for name, protocols in (("rested", (BRIEF,)), ("swept", (sweep, BRIEF))):
        with laboratory(simulated(seed=11, beyond={"hysteresis_width": 0.05}, modes=7)) as lab:
            *_, ran = [run(each, tmp_path / name, lab, safe=False) for each in protocols]
        deflections.append([p.deflection for p in ran.points])
        assert {p.conditioned for p in ran.points} == {1.0}
    np.testing.assert_allclose(*deflections, rtol=0, atol=0.2e-6)


def test_the_file_gives_the_numbers_of_the_live_run(ran) -> None:
    plan = BRIEF.plan(2.5)
    with Run(ran.path) as file:
        again = [BRIEF.point(plan[r.entry].key, [r], file.record.simulated) for r in file.recordings()]
    assert again == ran.points


@pytest.mark.parametrize(("share", "ramp_s"), [(0.03, 0.4), (0.03, 0.01), (-0.01, 0.4), (0.0, 0.4)])
def test_creep_is_that_of_an_ideal_step_whatever_the_ramp(share: float, ramp_s: float) -> None:
    protocol = VoltageSteps(hold_s=6.0)
    p = protocol.point((4.5, 1.0, "up"), [creeping(share, ramp_s)], True)
    assert p.ramp_time == pytest.approx(ramp_s, abs=0.02 * ramp_s + 2 / RATE_HZ)
    assert p.creep == pytest.approx(share * expected_m(4.5), abs=2e-4 * expected_m(4.5))
    # Read one second after the ramp, which counts a little more than a second of creep.
    assert p.deflection == pytest.approx(expected_m(4.5) * (1 + share * np.log10(1 + ramp_s / 2)), rel=3e-4)


@pytest.mark.deep
def test_errors_of_creep_and_deflection_are_what_repetition_shows() -> None:
    protocol, z, c = VoltageSteps(hold_s=6.0), [], []
    quiet = creeping(0.02, 0.4)
    truth = protocol.point((4.5, 1.0, "up"), [quiet], True).deflection
    rng = np.random.default_rng(5)
    for _ in range(40):
        noisy = replace(quiet, displacement_m=quiet.displacement_m + 5e-7 * rng.normal(0, 1, quiet.drive_v.size))
        p = protocol.point((4.5, 1.0, "up"), [noisy], True)
        z.append((p.deflection - truth) / p.deflection_errors)
        c.append((p.creep - 0.02 * expected_m(4.5)) / p.creep_errors)
    assert 0.6 < np.std(z) < 1.4
    assert 0.6 < np.std(c) < 1.4


@pytest.mark.deep
def test_creep_per_decade_and_the_loop_come_out_of_many_points() -> None:
    protocol = VoltageSteps(levels_v=(0.5, 3.5, 4.5), hold_s=6.0, order="up-down", repeats=4)
    points = []
    for entry in protocol.plan(2.5):
        level_v, _, way = entry.key
        recording = creeping(0.03, 0.3, float(level_v), 2e-7)
        seconds = np.arange(recording.drive_v.size) / RATE_HZ
        up = np.interp(seconds, [1.0, 1.3], [0.0, 4e-6]) * (
            way == "down"
        )  # along the ramp: a jump would be a disturbance
        points.append(
            protocol.point(entry.key, [replace(recording, displacement_m=recording.displacement_m + up)], True)
        )
    found = {e.name: e for e in protocol.estimates(points)}
    assert found["loop_width"].value == pytest.approx(4e-6, abs=3e-8)
    assert found["creep_per_decade"].value == pytest.approx(0.03, abs=0.003)  # the loop is in what creep is divided by


def test_a_level_that_does_not_arrive_is_flagged() -> None:
    recording = creeping(0.0, 0.3)
    p = VoltageSteps(hold_s=6.0).point((4.6, 1.0, "up"), [recording], True)
    assert Quality.DRIVE_OFF in Quality(p.quality)


def test_defaults_are_the_papers_and_shuffled_order_depends_on_seed() -> None:
    plan = VoltageSteps().plan(2.5)
    assert len(plan) == 50
    assert {entry.key[0] for entry in plan} == set(PAPER_LEVELS_V)
    shuffled = [VoltageSteps(order="random", seed=s).plan(2.5) for s in (4, 4, 5)]
    assert shuffled[0] == shuffled[1] != shuffled[2]
    rows = [[e.key[0] for e in shuffled[0]][k : k + 10] for k in range(0, 50, 10)]
    assert all(sorted(row) == list(PAPER_LEVELS_V) for row in rows)
    assert len({tuple(row) for row in rows}) == 5


@pytest.mark.deep
def test_a_supply_that_can_only_hold_will_do(tmp_path: Path) -> None:
    record = {**simulated().model_dump(), "source": {"kind": "dc-supply"}}
    with laboratory(BenchConfig.model_validate(record)) as lab:
        ran = run(VoltageSteps(levels_v=(1.0, 4.0), repeats=1, order="up", rest_s=0.5), tmp_path, lab, safe=False)
        lab.bench.clock.sleep(1.0)  # its output falls the last millivolts
    assert ran.status is RunStatus.COMPLETED, ran.reason
    for p in ran.points:
        assert p.deflection == pytest.approx(expected_m(p.level), rel=0.02)


@pytest.mark.deep
def test_the_rehearsal_tells_how_long_it_takes(tmp_path: Path) -> None:
    assert PROTOCOLS["voltage-steps"] is VoltageSteps
    with laboratory() as lab:
        short = BRIEF.model_copy(update={"repeats": 1})
        rehearsal = rehearse(short, lab.bench.amplifier)
        begin_s = lab.bench.clock.now()
        run(short, tmp_path, lab)
        took_s = lab.bench.clock.now() - begin_s
    assert rehearsal.duration_s == pytest.approx(took_s, rel=0.25)
    assert rehearsal.highest_specimen_v == 900
    assert rehearsal.lowest_specimen_v == -400


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"read_s": 6.0}, r"must lie within hold_s of 5 s"),
        ({"read_s": 0.01}, r"half of window_s \(0.05 s\) away"),
        ({"levels_v": (6,)}, "less than or equal to 5"),
        ({"order": "sideways"}, "up-down"),
    ],
)
def test_what_makes_no_sense_is_refused(settings: dict, says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        VoltageSteps(**settings)
