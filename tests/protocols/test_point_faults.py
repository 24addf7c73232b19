"""Faults in the middle of a point, planted at the simulated sensor and cable: the point is flagged, the verdict says what to do."""

from dataclasses import replace
from pathlib import Path

import pytest

from drivers import LevelAction
from protocols.base import BlockStored, Outcome, Quality, SettlingFinished
from protocols.base.quality import REMEDIES
from protocols.measurements.sine_dwell import SineDwell
from protocols.runfile.reader import Run
from protocols.signals import judge_recording
from tests.helpers.point_faults import SETTINGS, clean_run, faulty_run
from tests.helpers.simulated_bench import Trigger, laboratory, run, simulated


def settled(event: object) -> bool:
    return isinstance(event, SettlingFinished)


def test_a_sensor_that_sticks_in_the_middle_of_a_point_leaves_no_result(tmp_path: Path) -> None:
    with laboratory(simulated(seed=5)) as lab:
        stick = Trigger(settled, lambda: lab.control.faults.inject("sensor-stuck", lab.control.now() + 0.25))
        ran = run(SineDwell(frequencies_hz=(150.0,)), tmp_path, lab, stick)
    (point,) = ran.points
    assert point.peak_to_peak > 100e-6  # a plausible value
    assert Quality.DISTURBED in Quality(point.quality)
    assert ran.verdict.outcome is Outcome.NO_RESULT
    assert "1 disturbed" in ran.verdict.reasons[0]
    assert REMEDIES[Quality.DISTURBED] in ran.verdict.reasons[0]
    with Run(ran.path) as file:  # the stored samples give the same judgement
        assert Quality.DISTURBED in judge_recording(file.trace.recording(0))
        assert file.trace.recording(0).rest_noise_m == pytest.approx(5e-7, rel=0.1)


def test_a_laser_that_moves_between_two_points_disturbs_none(tmp_path: Path) -> None:
    with laboratory(simulated(seed=6)) as lab:
        first = Trigger(
            lambda event: event.kind == "PointMeasured",
            lambda: lab.control.perform_action("bump-sensor", {"by_m": 5e-5}),
        )
        ran = run(SineDwell(frequencies_hz=(150.0, 160.0)), tmp_path, lab, first)
    assert all(Quality(point.quality).usable for point in ran.points)


@pytest.mark.breaks_the_drive
def test_a_drive_lost_for_a_block_flags_the_point_although_its_amplitude_is_right(tmp_path: Path) -> None:
    with laboratory(simulated(seed=7)) as lab:
        lab.bench.levels = replace(
            lab.bench.levels, drive=LevelAction.OFF, rate=LevelAction.OFF, stroke=LevelAction.OFF
        )
        blocks: list[BlockStored] = []
        is_settled: list[bool] = []

        def cut(event: object) -> None:
            is_settled.extend([True] * settled(event))
            if is_settled and isinstance(event, BlockStored):
                blocks.append(event)
                if len(blocks) == 10:
                    lab.control.inject("drive-cable-off")
                elif len(blocks) == 11:
                    lab.control.clear("drive-cable-off")

        ran = run(SineDwell(frequencies_hz=(150.0,), record_s=3.0), tmp_path, lab, cut, safe=False)
    (point,) = ran.points
    assert point.drive_amplitude == pytest.approx(2.5, rel=0.05)
    assert Quality.DRIVE_OFF in Quality(point.quality)


@pytest.mark.deep
@pytest.mark.parametrize("row", SETTINGS)
def test_a_fault_in_the_middle_of_a_point_flags_it_in_every_protocol(row: str, tmp_path: Path) -> None:
    twin = clean_run(row, "sim", 21, tmp_path)
    assert all(Quality(int(point.quality)).usable for point in twin.ran.points)
    planted = list(faulty_run(row, "sim", 21, tmp_path, twin))
    assert planted
    assert [fault for fault, is_flagged in planted if not is_flagged] == []
