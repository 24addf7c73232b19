"""Rehearsal: rejects impossible runs before anything is driven; predicts travel as the model does."""

import re
import shutil
from collections.abc import Generator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from app.config.bench_file import BenchConfig
from drivers.bench.drive_limits import DriveLimits, HvAmplifier
from drivers.clock import WallClock
from drivers.drive_shapes import Drive, Hold, LinearSweep, Sine, Steps
from drivers.errors import DriveRejectedError
from drivers.sensors.laser_sensor import LaserSensor
from model.amplifier_map import AmplifierMap
from model.parameters import Tactor
from model.response.harmonic_response import tactor_modal_form
from protocols.base import PlanEntry, Prompt, RunStatus, Step
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.sweep import Sweep
from protocols.predicted_travel import predict_travel
from protocols.rehearsal import CannotRunError, rehearse
from tests.helpers.messages import assert_names
from tests.helpers.sampled import march
from tests.helpers.simulated_bench import laboratory, run, simulated

SENSOR = LaserSensor("laser", 1e-4)


class Metered(SineDwell):
    """Reads a meter that no bench has."""

    name: ClassVar[str] = "metered"

    @property
    def meters(self) -> tuple[str, ...]:
        return ("scale",)

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, None]:
        raise AssertionError("nothing is measured")


def guard(**limits: float) -> HvAmplifier:
    return HvAmplifier(SimpleNamespace(), AmplifierMap(), DriveLimits(**limits), WallClock())  # type: ignore[arg-type]


def reach(drive: Drive, setup: Prompt | None = None) -> tuple[float, float]:
    """Micrometres below and above rest."""
    found = list(predict_travel([(PlanEntry("entry", (drive,), 1.0, setup=setup), drive)], Tactor(), AmplifierMap()))
    return 1e6 * min(r.low_m for r in found), 1e6 * max(r.high_m for r in found)


@pytest.mark.parametrize(("frequency", "table"), [(75, 702.7), (100, 760.1), (150, 1154.2), (250, 291.8)])
def test_a_sine_is_expected_to_move_as_far_as_the_physics_page_says(frequency: float, table: float) -> None:
    low, high = reach(Sine(frequency, 2.5, 2.5, 10))
    assert high - low == pytest.approx(table, rel=1e-3)
    assert high > -low  # the amplifier's upper slope is the steeper one


def test_a_sweep_is_expected_to_pass_the_resonance_of_the_mass_that_is_on() -> None:
    heavy = Prompt("fix-mass", "Fix 9.75 g", {"mass_kg": 9.75e-3}, hands_on=True)
    sweep = LinearSweep(100, 125, 40, 2.5, 2.5)
    low, high = reach(sweep, heavy)
    at_end_low, at_end_high = reach(Sine(125, 2.5, 2.5, 10), heavy)
    assert (low, high) == pytest.approx((at_end_low, at_end_high), rel=0.02)  # rising towards 141.8 Hz
    assert high > 1.1 * reach(sweep)[1]


def test_a_held_level_does_not_ring_and_a_fast_step_does() -> None:
    assert reach(Hold(5.0, 1.0)) == pytest.approx((0.0, 356.8), rel=1e-3)
    low, high = reach(Steps((2.5, 5.0, 2.5), 0.1, 1e-4))
    rate = 1e5
    t = np.arange(0, 0.3, 1 / rate)
    moved = 1e6 * march(
        tactor_modal_form(Tactor()), AmplifierMap().specimen_v(Steps((2.5, 5.0, 2.5), 0.1, 1e-4).volts(t)), rate
    )
    assert high == pytest.approx(moved.max(), rel=0.02)
    assert low == pytest.approx(moved.min(), rel=0.05)


def test_displacement_beyond_sensor_range_is_a_caution() -> None:
    near = LaserSensor("laser", 1e-4, valid_low_v=-3, valid_high_v=3)
    rehearsal = rehearse(SineDwell(), guard(), sensor=near, tactor=Tactor())
    assert re.fullmatch(r"150 Hz: \+\d+ µm .* \d+ % .*sensor.*", rehearsal.worst)
    assert any("leave the sensor's range" in text for text in rehearsal.cautions)
    assert not any("sensor" in text for text in rehearse(SineDwell(), guard(), sensor=SENSOR, tactor=Tactor()).cautions)


def test_the_current_into_the_specimen_is_held_against_the_amplifiers() -> None:
    # 600 V/V x 2 pi 250 Hz x 2.5 V x 1.2 nF
    rehearsal = rehearse(SineDwell(), guard(current_limit_a=3e-3, specimen_capacitance_f=1.2e-9))
    assert rehearsal.worst == "2.8 mA into the specimen, 94 % of its limit, at 250 Hz"
    assert rehearsal.cautions == ()
    with pytest.raises(
        DriveRejectedError, match=r"^250 Hz: Sine refused: it needs 2.83 mA into 1.2 nF, and .* 2.5 mA; lower"
    ):
        rehearse(SineDwell(frequencies_hz=(100, 250)), guard(current_limit_a=2.5e-3, specimen_capacitance_f=1.2e-9))
    assert "current is not checked" in rehearse(SineDwell(), guard()).cautions[0]


def test_under_rest_only_the_lower_slope_counts() -> None:
    amplifier = guard(current_limit_a=1, specimen_capacitance_f=1e-9)
    assert amplifier.peak_current_a(Steps((2.5, 2.0, 2.5), 1, 1)) == pytest.approx(0.5 * 200 * 1e-9)
    assert amplifier.peak_current_a(Steps((2.5, 3.0, 2.5), 1, 1)) == pytest.approx(0.5 * 600 * 1e-9)


def test_a_meter_that_is_not_there_is_told_before_anything_moves(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(Metered(), tmp_path, lab)
    assert ran.status is RunStatus.FAILED
    assert ran.reason == (
        "Sine dwell reads the meter 'scale', and this bench has no such meter (it has: none); "
        "add [meters.scale] to the bench file"
    )
    assert "Asked" not in ran.kinds()


def test_a_sine_on_a_supply_is_told_before_anybody_is_asked_for_high_voltage(tmp_path: Path) -> None:
    record = {**simulated().model_dump(), "source": {"kind": "dc-supply"}}
    with laboratory(BenchConfig.model_validate(record)) as lab:
        ran = run(SineDwell(), tmp_path, lab)
    assert ran.status is RunStatus.FAILED
    assert "E36312A can hold and step, but not play a Sine" in ran.reason
    assert "Asked" not in ran.kinds()
    assert ran.report.live_s == 0


def test_a_disk_without_room_is_told_before_anything_moves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = SimpleNamespace(free=32_400_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    with pytest.raises(CannotRunError, match=r"has 32 MB left; this takes about 1 MB, and 32 MB are kept"):
        rehearse(SineDwell(), guard(), folder=tmp_path / "not" / "there" / "yet")
    with laboratory() as lab:
        ran = run(SineDwell(), tmp_path, lab)
    assert ran.status is RunStatus.FAILED
    assert str(tmp_path) in ran.reason
    assert_names(ran.reason, 32, "MB")
    assert "Asked" not in ran.kinds()


def test_a_recording_that_no_memory_holds_is_told_before_anything_moves() -> None:
    with pytest.raises(CannotRunError, match=r"a recording of 1\d\d million scans does not fit into memory \(limit 50"):
        rehearse(Sweep(sweep_s=10, periods=30, sample_rate_hz=250_000), guard())


def test_a_dwell_is_not_refused_for_its_length() -> None:
    rehearse(SineDwell(frequencies_hz=(200,), record_s=600, sample_rate_hz=250_000), guard())
