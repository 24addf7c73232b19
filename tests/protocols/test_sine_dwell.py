"""Sine dwell on a simulated bench with known parameters."""

import json
import re
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from app.common import UsageError
from app.session import build_protocol
from drivers import LevelAction, Sine
from model.parameters import Tactor
from model.response.harmonic_response import amplifier_response
from protocols.base import (
    EntryStarted,
    LogMessage,
    Quality,
    Recording,
    RecordingFinished,
    ReferenceModel,
    RunStatus,
    SettlingFinished,
)
from protocols.measurements.sine_dwell import PAPER_FREQUENCIES_HZ, SineDwell, refinement_frequencies, sine_point
from protocols.rehearsal import rehearse
from protocols.runfile.reader import Run
from protocols.runfile.record import RunRecord
from protocols.runner.request import RunRequest
from protocols.runner.runner import initial_record
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import Trigger, laboratory, run, simulated


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory):
    with laboratory(simulated(seed=8)) as lab:
        yield run(SineDwell(), tmp_path_factory.mktemp("runs"), lab)


def test_all_eighteen_fundamentals_agree_with_model_within_three_sigma(ran) -> None:
    model = amplifier_response(Tactor(), np.array([p.frequency for p in ran.points]), 2.5)
    assert [round(p.frequency) for p in ran.points] == list(PAPER_FREQUENCIES_HZ)
    for point, truth in zip(ran.points, np.abs(model.fundamental), strict=True):
        assert abs(point.fundamental - truth) < 3 * point.fundamental_errors, point.frequency


def test_uncertainties_are_neither_too_small_nor_too_large(ran) -> None:
    """18 normalised deviations: their rms is 1, give or take a third (three sigma of 1/sqrt(36) twice)."""
    model = amplifier_response(Tactor(), np.array([p.frequency for p in ran.points]), 2.5)
    z = [(p.fundamental - abs(m)) / p.fundamental_errors for p, m in zip(ran.points, model.fundamental, strict=True)]
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.5


def test_phase_is_that_of_the_model_with_the_sensors_delay_removed(ran) -> None:
    model = amplifier_response(Tactor(), np.array([p.frequency for p in ran.points]), 2.5)
    for point, truth in zip(ran.points, np.angle(model.fundamental), strict=True):
        assert abs(np.angle(np.exp(1j * (point.phase - truth)))) < 4 * point.phase_errors, point.frequency


@pytest.mark.deep
def test_phase_matches_model_for_any_interchannel_delay(tmp_path: Path) -> None:
    """80 us between the conversions are 7 degrees at 250 Hz; the file and the live run both correct for them."""
    protocol = SineDwell(frequencies_hz=(100, 250), record_s=0.2)
    model = amplifier_response(Tactor(), np.array([100.0, 250.0]), 2.5)
    with laboratory(simulated(card={"convert_s": 8e-5})) as lab:
        ran = run(protocol, tmp_path, lab)
    for point, truth in zip(ran.points, np.angle(model.fundamental), strict=True):
        assert abs(np.angle(np.exp(1j * (point.phase - truth)))) < 4 * point.phase_errors, point.frequency
    with Run(ran.path) as file:
        again = [protocol.point((), [recording], True) for recording in file.recordings()]
    assert [p.phase for p in again] == [p.phase for p in ran.points]


def test_peak_to_peak_shows_the_amplifiers_harmonics_near_half_the_resonance(ran) -> None:
    """The table of the physics page: at 75 Hz max - min is 18 % above twice the fundamental, at 160 Hz they agree."""
    ratio = {round(p.frequency): p.peak_to_peak / (2 * p.fundamental) for p in ran.points}
    assert ratio[75] == pytest.approx(702.7 / 594.2, abs=0.01)
    assert ratio[160] == pytest.approx(1115.7 / 1115.4, abs=0.01)
    points = {round(p.frequency): p for p in ran.points}
    for f, table_um in {25: 491.0, 50: 537.4, 75: 702.7, 100: 760.1, 150: 1154.2, 200: 596.8, 250: 291.8}.items():
        assert abs(1e6 * points[f].peak_to_peak - table_um) < 3e6 * points[f].peak_to_peak_errors + 0.1, f


def test_every_point_records_drive_and_flags(ran) -> None:
    for p in ran.points:
        assert p.drive_amplitude == pytest.approx(2.5, abs=1e-3)
        assert p.drive_offset == pytest.approx(2.5, abs=1e-3)
        assert Quality(p.quality) is Quality.SIMULATED
        assert p.cycles == pytest.approx(round(p.cycles), abs=0.1)
        assert p.harmonics[1] / p.harmonics[0] == pytest.approx(p.thd, rel=0.2)


def test_resonance_and_damping_are_those_of_the_first_pole(ran) -> None:
    with Run(ran.path) as file:
        found = {e.name: e for e in file.record.estimates}
    assert found["natural_frequency"].value == pytest.approx(158.31, abs=0.1)
    assert found["damping_ratio"].value == pytest.approx(0.2110, abs=0.001)


@pytest.mark.deep
def test_the_file_gives_the_numbers_of_the_live_run(ran) -> None:
    protocol = SineDwell()
    with Run(ran.path) as file:
        again = [protocol.point((), [recording], file.record.simulated) for recording in file.recordings()]
        columns = file.points()
    assert again == ran.points
    assert columns["fundamental"].tolist() == [p.fundamental for p in ran.points]
    assert columns["harmonics"].shape == (18, 8)


@pytest.mark.deep
def test_the_same_seed_gives_the_same_bytes_of_samples_and_another_does_not(tmp_path: Path) -> None:
    raws = []
    for seed in (3, 3, 4):
        with laboratory(simulated(seed=seed)) as lab:
            ran = run(SineDwell(frequencies_hz=(160,)), tmp_path, lab)
        with Run(ran.path) as file:
            raws.append(file.trace.read_raw("displacement"))
    assert np.array_equal(raws[0], raws[1])
    assert not np.array_equal(raws[0], raws[2])


@pytest.mark.deep
def test_a_sensor_out_of_range_is_a_flag_and_never_counts(tmp_path: Path) -> None:
    with laboratory(simulated(sensor={"range_m": 4.2e-4})) as lab:
        ran = run(SineDwell(frequencies_hz=(25, 150)), tmp_path, lab)
    quiet, loud = (Quality(p.quality) for p in ran.points)
    assert quiet.usable
    assert Quality.OUT_OF_RANGE in loud
    assert not loud.usable


def test_a_clipped_converter_is_a_flag(tmp_path: Path) -> None:
    with laboratory(simulated(sensor={"gain_m_per_v": 2e-5, "range_m": 1e-3, "invalid_v": 12.0})) as lab:
        lab.bench.levels = replace(lab.bench.levels, stroke=LevelAction.WARNING, rate=LevelAction.WARNING)
        ran = run(SineDwell(frequencies_hz=(150,)), tmp_path, lab)
    assert Quality.CLIPPED in Quality(ran.points[0].quality)


def test_what_does_not_settle_is_recorded_and_flagged(tmp_path: Path) -> None:
    """Almost undamped, the tactor rings for seconds: half a second of patience is not enough."""
    with laboratory(simulated(tactor={"c0": 1.0})) as lab:
        lab.bench.levels = replace(lab.bench.levels, stroke=LevelAction.WARNING)
        protocol = SineDwell(frequencies_hz=(120,), settle_limit_s=0.5, record_s=0.2)
        ran = run(protocol, tmp_path, lab)
    assert Quality.UNSETTLED in Quality(ran.points[0].quality)
    assert ran.status == "completed"


@pytest.mark.deep
def test_rehearsal_tells_what_the_run_then_needs(tmp_path: Path) -> None:
    with laboratory() as lab:
        rehearsal = rehearse(SineDwell(), lab.bench.amplifier)
        begin = lab.bench.clock.now()
        ran = run(SineDwell(), tmp_path, lab)
        took = lab.bench.clock.now() - begin
    assert rehearsal.duration_s == pytest.approx(took, rel=0.25)
    assert rehearsal.file_bytes == pytest.approx(ran.path.stat().st_size, rel=0.35)
    assert (rehearsal.lowest_specimen_v, rehearsal.highest_specimen_v) == (-500, 1500)
    assert rehearsal.entries == 18
    assert "250 Hz" in rehearsal.worst


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"frequencies_hz": (100, 3000)}, "less than or equal to 2000"),
        ({"frequencies_hz": ()}, "at least 1"),
        ({"frequencies_hz": (1500,)}, "too low for a sine of 1500 Hz; at least 30000 Hz is needed"),
        ({"peak_to_peak_v": 5.1}, "less than or equal to 5"),
        ({"record_s": float("nan")}, "finite"),
        ({"settle_limit_s": 0.5, "frequencies_hz": (5,)}, "no three windows of 0.4 s at 5 Hz, .* at least 1.2 s"),
        ({"decay_s": 2.0}, "at least 6 s is needed"),
        ({"budget_s": 5.0}, "budget_s of 5 s is too short: 18 frequencies take about"),
        ({"voltage": 3}, "Extra inputs are not permitted"),
    ],
)
def test_parameters_outside_their_range_are_refused(settings: dict, says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        SineDwell(**settings)


def test_the_header_names_everything_a_reader_needs() -> None:
    with laboratory() as lab:
        told = initial_record(RunRequest(SineDwell(), Path(), "T9"), lab.bench, ReferenceModel())
    assert told.configuration["simulation"]["tactor"]["k2"] == 7.0e-3
    assert told.configuration["identities"]["generator"].startswith("Keysight")
    assert told.simulated


class Forgetful:
    """A card that loses one block on request."""

    def __init__(self, digitizer: Any, when: threading.Event) -> None:
        self._digitizer, self._when = digitizer, when

    def __getattr__(self, name: str) -> Any:
        return getattr(self._digitizer, name)

    def stream(self, rate_hz: float, block: int) -> Any:
        stream = self._digitizer.stream(rate_hz, block)
        read, when, kept = stream.read, self._when, [0]

        def reading() -> Any:
            kept[0] += when.is_set()
            if kept[0] == 3:
                read()
            return read()

        stream.read = reading
        return stream


def notes(ran) -> list[str]:
    return [event.text for event in ran.events if isinstance(event, LogMessage)]


@pytest.mark.deep
def test_a_specimen_that_does_not_move_is_flagged_and_said_to(tmp_path: Path) -> None:
    """High voltage that was not switched on: the drive is correct, and the tactor does not move."""
    with laboratory(simulated(tactor={"mu": -1e-13})) as lab:
        ran = run(SineDwell(frequencies_hz=(100, 160)), tmp_path, lab)
    assert ran.status == "completed"
    for point in ran.points:
        assert Quality.NO_RESPONSE in Quality(point.quality)
        assert not Quality(point.quality).usable
        assert point.drive_amplitude == pytest.approx(2.5, abs=1e-3)
    messages = [text for text in notes(ran) if "no response" in text]
    assert len(messages) == 2
    assert_names(messages[0], "voltage", "laser", "2.5", "V")
    with Run(ran.path) as file:
        assert file.record.estimates == ()


@pytest.mark.deep
def test_a_drive_that_is_a_twentieth_off_is_flagged(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(SineDwell(frequencies_hz=(160,)), tmp_path, lab)
    with Run(ran.path) as file:
        (recording,) = file.recordings()
    for share, flagged in ((0.94, True), (0.96, False), (1.04, False), (1.06, True)):
        seen = replace(recording, drive_v=2.5 + share * (recording.drive_v - 2.5))
        assert (Quality.DRIVE_OFF in Quality(SineDwell().point((), [seen], True).quality)) is flagged, share


@pytest.mark.deep
def test_an_entry_that_lost_scans_is_measured_again(tmp_path: Path) -> None:
    """The card lost a block while it was recorded: the samples are there, the time between them is not."""
    with laboratory() as lab:
        recording = threading.Event()
        digitizer = Forgetful(lab.bench.digitizer, recording)
        lab.bench.digitizer = digitizer
        watch = Trigger(lambda e: isinstance(e, SettlingFinished), recording.set)
        ran = run(SineDwell(frequencies_hz=(100, 160)), tmp_path, lab, watch)
    assert [event.index for event in ran.events if isinstance(event, EntryStarted)] == [0, 0, 1]
    with Run(ran.path) as file:
        flags = [r.quality for r in file.recordings()]
    assert [Quality.DROPPED in flag for flag in flags] == [True, False, False]
    assert all(Quality(p.quality).usable for p in ran.points)


def test_a_former_name_of_a_parameter_is_read_as_the_present_one() -> None:
    assert SineDwell.model_validate({"wanted": 0.01}).target_relative_uncertainty == 0.01
    assert RunRecord.from_json('{"parameters": {"wanted": 0.01, "settle_tolerance": 0.005}}').parameters == {
        "target_relative_uncertainty": 0.01,
        "settle_tolerance": 0.005,
    }
    assert RunRecord.from_json('{"parameters": {"wanted": 0.01}}').parameters == {"wanted": 0.01}, "another protocol's"
    own = {"resonance": 1.0, "damping": 0.1, "peak": 2.0, "peak_response": 3.0}
    assert RunRecord.from_json(json.dumps({"parameters": own})).parameters == own, (
        "former names of columns are no parameters'"
    )


def test_a_parameter_by_its_former_and_its_present_name_is_refused() -> None:
    twice = {"wanted": 0.01, "target_relative_uncertainty": 0.02}
    with pytest.raises(ValidationError, match=r"target_relative_uncertainty.*twice"):
        SineDwell.model_validate(twice)
    with pytest.raises(UsageError, match=r"target_relative_uncertainty.*twice"):
        build_protocol(SineDwell, twice)


@pytest.mark.deep
def test_averaging_continues_to_target_uncertainty_and_reports_progress(tmp_path: Path) -> None:
    protocol = SineDwell(frequencies_hz=(160,), peak_to_peak_v=0.02, record_s=0.2, target_relative_uncertainty=0.015)
    with laboratory(simulated(sensor={"noise_m": 2e-6})) as lab:
        once = run(protocol.model_copy(update={"target_relative_uncertainty": 0.0}), tmp_path, lab).points[0]
        ran = run(protocol, tmp_path, lab)
    (point,) = ran.points
    recorded = sum(isinstance(e, RecordingFinished) for e in ran.events)
    assert once.relative_uncertainty > 0.015 > point.relative_uncertainty
    assert recorded == pytest.approx((once.relative_uncertainty / 0.015) ** 2, abs=2)
    assert point.cycles == pytest.approx(recorded * once.cycles, rel=1e-3)
    reported = [re.search(r"(\d+) more to reach 1.5 %", text) for text in notes(ran)]
    assert sum(int(found[1]) for found in reported if found) == recorded - 1
    truth = abs(amplifier_response(Tactor(), np.array([160.0]), 0.01).fundamental[0])
    assert abs(point.fundamental - truth) < 4 * point.fundamental_errors
    with Run(ran.path) as file:
        assert protocol.point((160.0,), list(file.recordings()), True) == point


@pytest.mark.deep
def test_averaging_stops_where_the_time_budget_ends(tmp_path: Path) -> None:
    protocol = SineDwell(frequencies_hz=(160,), peak_to_peak_v=0.02, target_relative_uncertainty=1e-4, budget_s=4.0)
    with laboratory() as lab:
        begin = lab.bench.clock.now()
        ran = run(protocol, tmp_path, lab)
        took_s = lab.bench.clock.now() - begin
    assert 2 < sum(isinstance(e, RecordingFinished) for e in ran.events) < 8
    assert took_s < 4.0 + 3.0  # arming and the way out are not the measurement's
    assert any("as many as the time allows" in text for text in notes(ran))


@pytest.mark.deep
def test_points_are_added_around_the_peak_until_they_lie_as_close_as_asked(tmp_path: Path) -> None:
    protocol = SineDwell(frequencies_hz=(100, 140, 180, 220), refine_to_hz=5.0, record_s=0.1)
    with laboratory() as lab:
        ran = run(protocol, tmp_path, lab)
    fine = np.linspace(140, 170, 3001)
    peak = fine[np.abs(amplifier_response(Tactor(), fine, 2.5).fundamental).argmax()]
    frequencies = np.sort([p.frequency for p in ran.points])
    below, above = frequencies[frequencies < peak][-1], frequencies[frequencies > peak][0]
    assert above - below <= 5.1
    assert len(frequencies) < 4 + 8


@given(st.lists(st.tuples(st.floats(20, 500), st.floats(1e-6, 1e-3), st.booleans()), max_size=12), st.floats(1, 50))
def test_refinement_ends(points: list[tuple[float, float, bool]], closest_hz: float) -> None:
    have = [
        SimpleNamespace(frequency=f, fundamental=a, drive_amplitude=1.0, quality=0 if q else 2) for f, a, q in points
    ]
    for _ in range(100):
        added = refinement_frequencies(have, closest_hz)
        if not added:
            return
        have += [SimpleNamespace(frequency=f, fundamental=1e-4, drive_amplitude=1.0, quality=0) for f in added]
    raise AssertionError("it never ends")


@pytest.mark.deep
def test_settling_of_a_ringing_tactor_needs_its_decay_time(tmp_path: Path) -> None:
    """Decay time 0.4 s: between windows of 40 ms hardly anything changes, and what is still to come is missing."""
    truth = abs(amplifier_response(Tactor(c0=2.0), np.array([158.0]), 0.01).fundamental[0])
    protocol = SineDwell(frequencies_hz=(158,), peak_to_peak_v=0.02, settle_limit_s=20, settle_tolerance=0.03)
    with laboratory(simulated(tactor={"c0": 2.0})) as lab:
        hasty = run(protocol, tmp_path, lab).points[0].fundamental / truth
        patient = run(protocol.model_copy(update={"decay_s": 0.4}), tmp_path, lab).points[0].fundamental / truth
    assert abs(patient - 1) < 0.005
    assert hasty < 0.97


def test_a_recording_in_parts_has_the_same_point_and_error(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, t = np.random.default_rng(4), np.arange(30_000) / 5000
    drive = 2.5 + 2.5 * np.sin(2 * np.pi * 160 * t) + 1e-4 * rng.standard_normal(t.size)
    moved = 5e-4 * np.sin(2 * np.pi * 160 * t - 0.7) + 1e-6 * rng.standard_normal(t.size)
    whole = Recording(0, (0, t.size), 5000.0, Sine(160.0, 2.5, 2.5, 1000), drive, moved, Quality.GOOD, 0.0)
    one = sine_point([whole], simulated=True)
    monkeypatch.setattr(Recording.parts, "__defaults__", (7_500,))
    four = sine_point([whole], simulated=True)
    assert four.fundamental == pytest.approx(one.fundamental, abs=0.2 * one.fundamental_errors)
    assert four.phase == pytest.approx(one.phase, abs=0.2 * one.phase_errors)
    assert four.fundamental_errors == pytest.approx(one.fundamental_errors, rel=0.05)
    assert (four.cycles, four.quality) == (pytest.approx(one.cycles), one.quality)


@pytest.mark.deep
@pytest.mark.parametrize(("drive_noise_v", "sensor_noise_m"), [(5e-3, 1e-7), (2.7e-4, 5e-7)])
def test_the_phase_error_has_the_noise_of_the_drive_channel(drive_noise_v: float, sensor_noise_m: float) -> None:
    """200 recordings of half a second: the scatter of the phase is its stated error."""
    rng, t = np.random.default_rng(3), np.arange(2500) / 5000
    z = []
    for _ in range(200):
        drive = 2.5 + 2.5 * np.sin(2 * np.pi * 160 * t) + drive_noise_v * rng.standard_normal(t.size)
        moved = 5e-4 * np.sin(2 * np.pi * 160 * t - 0.7) + sensor_noise_m * rng.standard_normal(t.size)
        sine = Sine(160.0, 2.5, 2.5, 1000)
        point = sine_point([Recording(0, (0, t.size), 5000.0, sine, drive, moved, Quality.GOOD, 0.0)], simulated=True)
        z.append((point.phase + 0.7) / point.phase_errors)
    assert 0.85 < np.sqrt(np.mean(np.square(z))) < 1.15


@pytest.mark.parametrize(
    "model",
    ["33511B", *(pytest.param(m, marks=pytest.mark.deep) for m in ("33220A", "DG1032Z", "SDG1032X", "AFG1022"))],
)
def test_a_dwell_gives_the_same_point_whoever_made_the_generator(model: str, tmp_path: Path) -> None:
    dwell = SineDwell(frequencies_hz=(60.0, 150.0), settle_limit_s=1.0, record_s=0.2)
    with laboratory(simulated(generator={"model": model})) as lab:
        ran = run(dwell, tmp_path, lab)
    assert ran.status == RunStatus.COMPLETED, ran.reason
    assert lab.bench.amplifier.identity.model == model
    assert [p.drive_amplitude for p in ran.points] == pytest.approx([2.5, 2.5], rel=1e-3)
    assert [1e6 * p.peak_to_peak for p in ran.points] == pytest.approx([588.35, 1154.18], rel=2e-3)
