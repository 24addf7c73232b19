"""Hum on the simulated bench: measured at rest, stored, counted in the points, the same from the file."""

import re
from pathlib import Path

import pytest

from app.session.messages import describe_event
from protocols.base import InterferenceMeasured, LogMessage, Quality
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.voltage_steps import VoltageSteps
from protocols.registry import BUILT_IN_PROTOCOLS, PROTOCOLS
from protocols.runfile.reader import Run
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import laboratory, run, simulated

BUILT_IN = {name: PROTOCOLS[name] for name in BUILT_IN_PROTOCOLS}


@pytest.mark.deep
def test_hum_is_measured_at_rest_and_counts_in_the_points_live_and_from_the_file(tmp_path: Path) -> None:
    with laboratory(simulated(beyond={"hum_m": 1e-6})) as lab:
        ran = run(SineDwell(frequencies_hz=(50, 155)), tmp_path, lab)
    (event,) = [event for event in ran.events if isinstance(event, InterferenceMeasured)]
    assert event.lines[0].amplitude_m == pytest.approx(1e-6, rel=0.05)
    assert event.lines[0].frequency_hz == pytest.approx(50.02, abs=0.01)
    described = describe_event(event)
    assert described is not None
    assert re.search(r"\b(0\.9|1\.0)\d* .*µm .*\b50\.0", described[1])
    assert_names(described[1], "mains", 50, "Hz")
    at_mains, beside = ran.points
    assert at_mains.fundamental_errors == pytest.approx(1e-6 / 2**0.5, rel=0.1)
    assert Quality.INTERFERENCE in Quality(at_mains.quality)
    assert beside.fundamental_errors < 3e-8
    assert Quality(beside.quality) is Quality.SIMULATED
    with Run(ran.path) as file:
        again = [SineDwell().point((), [recording], True) for recording in file.recordings()]
        first, last = next(e.fields["rows"] for e in file.events() if e.kind == InterferenceMeasured.kind)
        assert abs(file.trace.drive_v(first, last) - 2.5).max() < 0.05
    assert again == ran.points


def test_every_protocol_measures_at_rest_for_a_second_but_the_wiring_check() -> None:
    assert {name: protocol.rest_record_s for name, protocol in BUILT_IN.items()} == {
        name: 0.0 if name == "wiring-check" else 1.0 for name in BUILT_IN
    }


@pytest.mark.deep
def test_hum_is_measured_before_steps_and_is_one_of_their_results(tmp_path: Path) -> None:
    steps = VoltageSteps(levels_v=(2.0, 3.0), repeats=1, hold_s=1.5)
    with laboratory(simulated(beyond={"hum_m": 1e-6})) as lab:
        ran = run(steps, tmp_path, lab)
    (event,) = [event for event in ran.events if isinstance(event, InterferenceMeasured)]
    assert event.rows[1] - event.rows[0] == 5000
    assert event.lines[0].frequency_hz == pytest.approx(50.02, abs=0.01)
    with Run(ran.path) as file:
        found = {e.name: e for e in file.record.estimates}["interference_at_rest"]
        stored = next(e.fields["lines"][0] for e in file.events() if e.kind == InterferenceMeasured.kind)
        again = [
            steps.point((p.level, p.repeat, "up"), [r], True)
            for p, r in zip(ran.points, file.recordings(), strict=True)
        ]
    assert found.value == pytest.approx(1e-6, rel=0.05)
    assert set(stored) >= {"amplitude_m", "error_m", "frequency_hz", "frequency_error_hz", "phase_rad"}
    assert [p.deflection for p in again] == [p.deflection for p in ran.points]
    assert max(p.deflection_errors for p in ran.points) < 1e-7  # 1 um of hum is not in them


@pytest.mark.deep
def test_a_shifted_list_measures_beside_the_mains(tmp_path: Path) -> None:
    with laboratory(simulated(beyond={"hum_m": 1e-6})) as lab:
        ran = run(SineDwell(frequencies_hz=(50,), mains_shift_hz=3), tmp_path, lab)
    (point,) = ran.points
    assert point.frequency == pytest.approx(47, abs=0.01)
    assert point.fundamental_errors < 3e-8


@pytest.mark.deep
def test_a_tone_above_half_the_sample_rate_is_flagged_and_reported(tmp_path: Path) -> None:
    """20 um at 4.9 kHz looks like 100 Hz at 5 kS/s: the point was 1300 stated errors off, without a flag."""
    with laboratory(simulated(beyond={"tone_m": 20e-6, "tone_hz": 4900.0})) as lab:
        ran = run(SineDwell(frequencies_hz=(100, 155)), tmp_path, lab)
    _, event = [event for event in ran.events if isinstance(event, InterferenceMeasured)]
    assert [line.folded_from_hz for line in event.lines] == pytest.approx([4900], abs=0.1)
    described = describe_event(event)
    assert described is not None
    assert_names(described[1], 4900, "Hz")
    assert any("It lies on 100 Hz" in event.text for event in ran.events if isinstance(event, LogMessage))
    with Run(ran.path) as file:
        flags = [Quality(int(each)) for each in file.points()["quality"]]
        again = [SineDwell().point((), [recording], True) for recording in file.recordings()]
        amplitude, error = (file.points()[name][0] for name in ("fundamental", "fundamental_errors"))
    assert Quality.FOLDED in flags[0]
    assert flags[0].usable
    assert flags[1] is Quality.SIMULATED
    assert [Quality(point.quality) for point in again] == flags
    assert abs(amplitude - 361.99e-6) < 2 * error
