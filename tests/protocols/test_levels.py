"""Abort levels: each acts in the acquisition, is stored and reported, and leaves ordinary runs undisturbed."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from app.session.bench_connection import UNATTENDED_BLOCK_S, connect
from drivers import Block, Hold, InputChannel, LevelAction, LevelSettings, LinearSweep, Scale, Sine, SquareWave
from protocols.base import (
    Ask,
    BlockStored,
    DriveReadbackChanged,
    DriveStarted,
    LevelExceeded,
    LogMessage,
    Outcome,
    PointMeasured,
    Prompt,
    PromptShown,
    Protocol,
    Quality,
    Record,
    RunStatus,
)
from protocols.measurements.mass_resonance import MassResonance
from protocols.measurements.membrane_sag import MembraneSag
from protocols.measurements.membrane_series import MembraneSeries
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.sweep import Sweep
from protocols.measurements.voltage_steps import VoltageSteps
from protocols.runfile.reader import Run
from protocols.runner.abort_levels import LevelMonitor, LevelQuestion
from protocols.runner.acquisition import RunAcquisition
from protocols.runner.publisher import RunCancelled
from protocols.runner.readback import DriveReadback
from sim_hardware.clock import VirtualClock
from tests.helpers.level_protocol import Levels
from tests.helpers.messages import assert_names
from tests.helpers.scripted_protocol import SETTLE, SHORT, Hesitant, Scripted
from tests.helpers.simulated_bench import Ran, Trigger, laboratory, run, simulated

REPORTED_WITHIN_S = 0.1
LONG = SineDwell(frequencies_hz=(100, 120, 140, 160), record_s=0.1, min_cycles=10)


def run_with(
    folder: Path,
    config: Any = None,
    levels: dict[str, Any] | None = None,
    act: Any = None,
    protocol: Any = LONG,
    **how: Any,
) -> tuple[Ran, list[tuple[float, Any]]]:
    """Run on a bench with blocks of 50 ms; return the run, and every event with its bench time."""
    timed: list[tuple[float, Any]] = []
    with laboratory(config) as lab:
        lab.bench.levels = replace(lab.bench.levels, **(levels or {}))
        trigger = Trigger(lambda e: isinstance(e, PointMeasured), lambda: act(lab)) if act else lambda _: None
        ran = run(protocol, folder, lab, lambda e: timed.append((lab.bench.clock.now(), e)), trigger, **how)
    return ran, timed


def exceeded(ran: Ran) -> list[LevelExceeded]:
    return [event for event in ran.events if isinstance(event, LevelExceeded)]


def readbacks(ran: Ran) -> list[DriveReadbackChanged]:
    return [event for event in ran.events if isinstance(event, DriveReadbackChanged)]


def time_of(timed: list[tuple[float, Any]], kind: type) -> float:
    return next(t for t, event in timed if isinstance(event, kind))


def test_a_lost_laser_brings_the_run_to_rest_and_asks(tmp_path: Path) -> None:
    ran, timed = run_with(tmp_path, act=lambda lab: lab.control.inject("sensor-out-of-range"))
    (event,) = exceeded(ran)
    assert (event.level, event.channel, event.action, event.unit) == ("laser_lost", "displacement", "ask", "s")
    assert (ran.status, ran.verdict.outcome) == (RunStatus.STOPPED, Outcome.STOPPED)
    assert "the laser sensor has been out of range" in ran.verdict.reasons[0].lower()
    (asked,) = (e.prompt for e in ran.events if isinstance(e, PromptShown) and e.prompt.action == "abort-level")
    assert event.words in asked.text
    assert asked.choices == ("stop", "again", "ignore")
    assert ran.report.ends_at_rest
    second_drive = [t for t, e in timed if isinstance(e, DriveStarted)][1]
    hold_s = LevelSettings().laser_lost_s
    assert time_of(timed, LevelExceeded) - second_drive < hold_s + 0.05 + REPORTED_WITHIN_S  # 50 ms are the latency
    with Run(ran.path) as file:
        stored = next(e for e in file.events() if e.kind == "LevelExceeded")
        assert stored.fields["limit"] == hold_s < stored.fields["value"]
        assert stored.fields["words"] in file.record.verdict.reasons[0]


@pytest.mark.parametrize("volts", [5.0])
def test_a_sharp_specimen_does_not_swing_into_its_spacers(volts: float, tmp_path: Path) -> None:
    protocol = SineDwell(frequencies_hz=(100, 150, 156, 158, 160), peak_to_peak_v=volts, record_s=0.1, min_cycles=10)
    ran, _ = run_with(tmp_path, simulated(tactor={"c0": 2.0}), protocol=protocol)
    assert exceeded(ran)[0].level == "stroke"
    assert exceeded(ran)[0].value > exceeded(ran)[0].limit == 0.77e-3
    assert ran.status == RunStatus.STOPPED
    assert ran.report.ends_at_rest


@pytest.mark.deep
def test_the_gap_is_a_number_of_the_bench_file(tmp_path: Path) -> None:
    config = simulated()
    narrow = config.model_copy(update={"specimen": config.specimen.model_copy(update={"gap_m": 1e-5})})
    ran, _ = run_with(tmp_path, narrow, protocol=SHORT)
    assert (exceeded(ran)[0].level, exceeded(ran)[0].limit) == ("stroke", 1e-5)


def test_a_warning_flags_the_points_and_makes_the_run_doubtful(tmp_path: Path) -> None:
    ran, _ = run_with(tmp_path, levels={"stroke": LevelAction.WARNING, "stroke_m": 1e-4}, protocol=SHORT)
    assert ran.status == RunStatus.COMPLETED
    flagged = [bool(Quality(p.quality) & Quality.LEVEL_EXCEEDED) for p in ran.points]
    assert flagged == [True, True]
    assert all(Quality(p.quality).usable for p in ran.points)
    assert len(exceeded(ran)) == 2  # once per entry
    assert ran.verdict.outcome is Outcome.DOUBTFUL
    assert_names(ran.verdict.reasons[0], "points", "level", 2)


@pytest.mark.deep
def test_a_level_that_is_off_says_nothing(tmp_path: Path) -> None:
    ran, _ = run_with(tmp_path, levels={"stroke": LevelAction.OFF, "stroke_m": 1e-4}, protocol=SHORT)
    assert (ran.status, exceeded(ran)) == (RunStatus.COMPLETED, [])


def test_a_level_that_ends_the_run_names_it_in_the_verdict(tmp_path: Path) -> None:
    ran, _ = run_with(tmp_path, levels={"rate": LevelAction.REST, "rate_m_per_s": 0.05}, protocol=SHORT)
    assert (ran.status, ran.verdict.outcome) == (RunStatus.FAILED, Outcome.FAILED)
    (event,) = exceeded(ran)
    assert (event.level, event.limit) == ("rate", 0.05)
    assert event.words in ran.verdict.reasons[0]
    assert "operator" not in ran.reason, "nobody is blamed for the answer of a simulated one"
    assert_names(event.words, "0.05", "m/s")
    assert ran.report.ends_at_rest


class Answering:
    """An operator who answers the question about a level."""

    def __init__(self, operator: Any, *answers: str) -> None:
        self._operator, self._answers, self._asked = operator, list(answers), set[int]()
        self.on_asked: Callable[[], object] = lambda: None

    def show(self, ask_id: int, prompt: Any) -> None:
        if prompt.action == "abort-level":
            self._asked.add(ask_id)
            self.on_asked()
        else:
            self._operator.show(ask_id, prompt)

    def answer(self, ask_id: int) -> str | None:
        return self._answers.pop(0) if ask_id in self._asked else self._operator.answer(ask_id)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("answers", "actions", "status"),
    [
        (("ignore",), ["ask", "warning", "warning"], RunStatus.COMPLETED),
        (("again", "ignore"), ["ask", "ask", "warning", "warning"], RunStatus.COMPLETED),
        (("again", "stop"), ["ask", "ask"], RunStatus.STOPPED),
    ],
)
def test_a_level_is_ignored_for_the_rest_of_the_run_only_if_the_operator_says_so(
    answers: tuple[str, ...], actions: list[str], status: RunStatus, tmp_path: Path
) -> None:
    with laboratory() as lab:
        lab.bench.levels = replace(lab.bench.levels, stroke_m=1e-4)
        operator, rests = Answering(lab.operator, *answers), list[bool]()
        operator.on_asked = lambda: rests.append(lab.control.report().ends_at_rest)
        ran = run(SHORT, tmp_path, lab, operator=operator)
    assert rests == [True] * len(answers), "the drive must not go on while the question stands"
    assert ran.status == status
    assert [event.action for event in exceeded(ran)] == actions
    assert ran.kinds().count("Paused") == len(answers)
    assert ran.kinds().count("Resumed") == len(answers) - answers.count("stop")


def test_no_drive_begins_before_the_question_about_a_level_that_was_exceeded_while_the_run_waited(
    tmp_path: Path,
) -> None:
    waits = Prompt("look", "Look at the specimen.")
    with laboratory() as lab:
        fault = Trigger(
            lambda e: isinstance(e, PromptShown) and e.prompt == waits,
            lambda: lab.control.inject("sensor-out-of-range"),
        )
        protocol = Scripted(script=(SETTLE, Ask(waits), SETTLE, Record(0.1)))
        ran = run(protocol, tmp_path, lab, fault, operator=Hesitant(lab.operator, 10))
    assert [event.level for event in exceeded(ran)] == ["laser_lost"]
    assert ran.status == RunStatus.STOPPED
    assert ran.kinds().count("DriveStarted") + ran.kinds().count("Playing") == 1


@pytest.mark.breaks_the_drive
@pytest.mark.parametrize(("amplitude_v", "settles"), [(0.4, False), (0.6, True)])
def test_a_sine_of_less_than_half_of_what_is_driven_does_not_settle_although_its_level_is_off(
    amplitude_v: float, settles: bool, tmp_path: Path
) -> None:
    def turn_down() -> None:
        lab.control.link().write(f"VOLT {2 * amplitude_v:g}")

    with laboratory() as lab:
        lab.bench.levels = replace(lab.bench.levels, drive=LevelAction.OFF)
        trigger = Trigger(lambda e: isinstance(e, DriveStarted), turn_down)
        ran = run(Scripted(script=(SETTLE, Record(0.1))), tmp_path, lab, trigger, safe=False)
    assert ran.status == (RunStatus.COMPLETED if settles else RunStatus.FAILED)
    assert (f"{amplitude_v:.2f}" in ran.reason and "100 Hz" in ran.reason) is not settles
    assert ran.report.ends_at_rest


class Unreachable(Answering):
    """An operator who cannot answer."""

    unreachable_reason = "nobody is there"


def test_where_nobody_can_be_asked_the_run_says_so_at_its_start_and_ends_at_rest(tmp_path: Path) -> None:
    with laboratory() as lab:
        lab.bench.levels = replace(lab.bench.levels, stroke_m=1e-4, rate=LevelAction.REST)
        operator = Unreachable(lab.operator, "again")
        ran = run(SHORT, tmp_path, lab, operator=operator)
    first = next(event.text for event in ran.events if isinstance(event, LogMessage))
    assert first.startswith(
        f"Nobody can answer: {Unreachable.unreachable_reason}. An abort level with the action 'ask' (stroke, "
    )
    assert "rate" not in first
    assert (ran.status, ran.verdict.outcome) == (RunStatus.FAILED, Outcome.FAILED)
    assert ran.reason.endswith(f": {operator.unreachable_reason}")
    assert not any(isinstance(e, PromptShown) and e.prompt.action == "abort-level" for e in ran.events)
    assert ran.report.ends_at_rest


@pytest.mark.one_in(100)
@pytest.mark.breaks_the_drive
@pytest.mark.parametrize("fault", ["drive-cable-off", "output-tripped", "generator-power-off"])
def test_a_drive_that_is_gone_is_reported_in_the_first_block(fault: str, tmp_path: Path) -> None:
    broken: list[float] = []

    def breaks(lab: Any) -> None:
        broken.append(lab.bench.clock.now())
        lab.control.inject(fault)

    timed: list[tuple[float, Any]] = []
    with laboratory() as lab:
        blocks = iter(range(1000))
        trigger = Trigger(
            lambda e: (
                isinstance(e, BlockStored) and any(isinstance(x, DriveStarted) for _, x in timed) and next(blocks) == 8
            ),
            lambda: breaks(lab),
        )
        ran = run(LONG, tmp_path, lab, lambda e: timed.append((lab.bench.clock.now(), e)), trigger, safe=False)
    event = exceeded(ran)[0]
    assert (event.level, event.action) == ("drive", "rest")
    (seen,) = readbacks(ran)
    assert seen.lost
    assert abs(seen.high_v) < 0.01
    assert time_of(timed, DriveReadbackChanged) <= time_of(timed, LevelExceeded)
    assert time_of(timed, LevelExceeded) - broken[0] <= REPORTED_WITHIN_S
    assert ran.status == RunStatus.UNSAFE  # the input is pulled to 0 V


@pytest.mark.breaks_the_drive
@pytest.mark.one_in(100)
@pytest.mark.parametrize("command", ["OUTP OFF", "*RST", "VOLT 0.5", "VOLT:OFFS 2.0", "FREQ 50"])
def test_a_second_hand_on_the_generator_is_reported_in_the_first_block(command: str, tmp_path: Path) -> None:
    moved: list[float] = []

    def meddle(lab: Any) -> None:
        moved.append(lab.bench.clock.now())
        link = lab.control.link()
        link.write(command)

    timed: list[tuple[float, Any]] = []
    with laboratory() as lab:
        blocks = iter(range(1000))
        trigger = Trigger(
            lambda e: (
                isinstance(e, BlockStored) and any(isinstance(x, DriveStarted) for _, x in timed) and next(blocks) == 8
            ),
            lambda: meddle(lab),
        )
        ran = run(
            LONG.model_copy(update={"peak_to_peak_v": 3.0}),
            tmp_path,
            lab,
            lambda e: timed.append((lab.bench.clock.now(), e)),
            trigger,
            safe=False,
        )
    assert exceeded(ran)[0].level == "drive", ran.reason
    assert time_of(timed, LevelExceeded) - moved[0] <= REPORTED_WITHIN_S + 0.01
    assert ran.status in (RunStatus.FAILED, RunStatus.UNSAFE)


def test_three_points_without_response_stop_the_run(tmp_path: Path) -> None:
    protocol = SineDwell(frequencies_hz=(100, 110, 120, 130, 140), record_s=0.1, min_cycles=10)
    ran, _ = run_with(tmp_path, act=lambda lab: lab.control.inject("sensor-stuck"), protocol=protocol)
    (event,) = exceeded(ran)
    assert (event.level, event.value) == ("no_response", 3.0)
    assert len(ran.points) == 4  # one good one before
    assert ran.status == RunStatus.STOPPED
    assert event.words in ran.verdict.reasons[0]


def test_three_entries_that_give_no_point_stop_the_run(tmp_path: Path) -> None:
    class Nothing(Levels):
        name: ClassVar[str] = "nothing"

        def point(self, key: Any, recordings: Any, simulated: bool) -> Any:
            raise ValueError("nothing is seen")

    ran, _ = run_with(tmp_path, protocol=Nothing())
    (event,) = exceeded(ran)
    assert (event.level, event.value) == ("no_response", 3.0)
    assert ran.status == RunStatus.STOPPED


RATE_HZ = 5000.0
VOLTS = Scale((0.0, 2e-4))


def deviation(drive: Any, volts: Any, start_s: float = 0.2, previous: Any = None) -> Any:
    """Check a block of 50 ms that begins `start_s` after the drive was started."""
    readback = DriveReadback(drive, 0, 250, RATE_HZ, 2.5, 0.1, previous)
    t = start_s + np.arange(250) / RATE_HZ
    raw = np.rint(np.broadcast_to(volts(t), t.shape) / 2e-4).astype(np.int16)
    return readback.check(round(start_s * RATE_HZ), raw, VOLTS.to_volts)


SINE, LEVEL = Sine(100, 0.5, 2.5, 1000), Hold(3.0, 5.0)
SWEEP = LinearSweep(25, 525, 20.0, 0.5, 2.5)
SQUARE = SquareWave(100, 0.5, 2.5, 0.4, 5e-4, 1000)


OFFSETS = ((0.045, True), (-0.045, True), (0.06, False), (-0.06, False))
"""Offsets of a sine that stays within the range of volts of its drive, and whether it counts as that drive."""


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("drive", "volts", "agrees"),
    [
        (SINE, SINE.volts, True),
        (SINE, lambda t: 0.02 + SINE.volts(t - 0.0123), True),
        *((SINE, lambda t, off=off: off + 0.92 * (SINE.volts(t) - 2.5) + 2.5, ok) for off, ok in OFFSETS),
        (SINE, lambda t: 0 * t, False),
        (SINE, lambda t: 2.5 + 0 * t, False),
        (SINE, lambda t: 2.5 + 0.4 * np.sin(2 * np.pi * 100 * t), False),
        (SINE, lambda t: 2.7 + 0.3 * np.sin(2 * np.pi * 100 * t), False),
        (SINE, lambda t: 2.5 + 0.5 * np.sign(np.sin(2 * np.pi * 100 * t)), False),
        (SINE, lambda t: 2.5 + 0.5 * np.sin(2 * np.pi * 140 * t), False),
        *(
            (SINE, lambda t, v=v: 2.5 + 0.47 * np.sin(200 * np.pi * t) + v * np.sin(600 * np.pi * t), v < 0.05)
            for v in (0.04, 0.1)
        ),
        (LEVEL, lambda t: 3.02 + 0 * t, True),
        (LEVEL, lambda t: 2.5 + 0 * t, False),
        (LEVEL, lambda t: 0 * t, False),
        (SWEEP, SWEEP.volts, True),
        (SWEEP, lambda t: 2.5 + 0 * t, False),
        (SWEEP, lambda t: 0 * t, False),
        (SWEEP, lambda t: 2.5 + 0.5 * (SWEEP.volts(t) - 2.5), False),
        (SQUARE, SQUARE.volts, True),
        (SQUARE, lambda t: 2.5 + 0 * t, False),
        (SQUARE, lambda t: 2.5 + 0.5 * (SQUARE.volts(t) - 2.5), False),
        (SQUARE, lambda t: 0 * t, False),
        (Sine(0.5, 2.5, 2.5, 10), lambda t: 0 * t, False),
        (Sine(0.5, 2.5, 2.5, 10), Sine(0.5, 2.5, 2.5, 10).volts, True),
    ],
)
def test_what_counts_as_the_commanded_drive(drive: Any, volts: Any, agrees: bool) -> None:
    assert (deviation(drive, volts) is None) is agrees


@pytest.mark.one_in(1)
@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("drive", [SINE, LEVEL, SWEEP, SQUARE, Sine(0.5, 2.5, 2.5, 10)], ids=lambda drive: drive.kind)
def test_a_drive_that_is_off_to_either_side_is_seen_beyond_its_limit_and_not_within(drive: Any, side: int) -> None:
    slow = drive.high_v > 4.0  # its begin is not known exactly, and single samples of it are not compared
    within_v, beyond_v = (0.17, 0.6) if slow else (0.035, 0.08)

    def off(by_v: float, scans: slice = slice(None)) -> Any:
        at = np.zeros(250)
        at[scans] = side * by_v
        return lambda t: drive.volts(t) + at

    assert deviation(drive, off(within_v), 0.475) is None
    for beyond in (off(beyond_v), *([] if slow else [off(1.5, slice(100, 101))])):
        seen = deviation(drive, beyond, 0.475)
        assert seen is not None
        assert seen.value_v > seen.limit_v


def test_the_end_of_the_previous_drive_and_the_ramp_are_no_deviation() -> None:
    before = Hold(4.0, 5.0)
    assert deviation(SINE, lambda t: np.clip(4.0 - 40 * t, 2.5, 4.0), 0.0, before) is None
    assert deviation(SINE, lambda t: 2.5 + 0 * t, 0.0) is None  # not started yet
    assert deviation(SINE, lambda t: 0 * t, 0.0) is not None
    for side in (-1, 1):  # outside of the old drive, the new one and the way between them
        assert deviation(SINE, lambda t, side=side: 2.5 + side * (0.54 - 10 * t), 0.0) is None
        assert deviation(SINE, lambda t, side=side: 2.5 + side * (0.6 - 10 * t), 0.0) is not None
    assert deviation(SINE, lambda t: 2.5 + 0 * t, SINE.duration_s + 0.1) is None  # over
    crest = lambda t: 2.9 + 0 * t  # noqa: E731 - flat away from rest: part of a slow sine, not of a fast one
    assert deviation(Sine(0.5, 0.4, 2.5, 10), crest, 0.0) is None
    assert deviation(SINE, crest, 0.0) is not None


@pytest.mark.parametrize("action", [LevelAction.OFF, LevelAction.WARNING])
def test_a_lost_drive_is_seen_until_it_is_back_or_the_source_rests_whatever_its_level_does(action: LevelAction) -> None:
    with laboratory() as lab:
        monitor = LevelMonitor(LevelSettings(drive=action), lab.bench.sensor, 2.5, VirtualClock())
    monitor.attach((VOLTS, VOLTS), RATE_HZ, 0.0)
    monitor.drive_changed(SINE)
    scan = 1000

    def found_in(volts: Any) -> list[Any]:
        nonlocal scan
        drive_v = np.broadcast_to(volts((scan + np.arange(250)) / RATE_HZ), 250)
        monitor.block_read(Block(scan, np.rint(np.stack([drive_v, 0 * drive_v]) / 2e-4).astype(np.int16)))
        scan += 250
        return [e.lost if isinstance(e, DriveReadbackChanged) else e.level for e in monitor.take_events()]

    warned = ["drive"] if action is LevelAction.WARNING else []
    assert found_in(SINE.volts) == []
    assert found_in(lambda t: 0 * t) == [True, *warned]
    assert found_in(lambda t: 0 * t) == [True]  # the first block may contain the moment of the loss
    assert found_in(lambda t: 0 * t) == []
    assert found_in(SINE.volts) == [False]
    assert found_in(lambda t: 0 * t) == [True]  # its level was reported in this entry
    monitor.drive_changed(SINE)  # nothing of the new drive is compared yet
    monitor.drive_changed(None)
    assert found_in(lambda t: 2.5 + 0 * t) == [False]
    assert found_in(lambda t: 2.5 + 0 * t) == []


@pytest.mark.parametrize("is_new", [False, True])
def test_a_deviation_is_confirmed_anew_for_every_drive_at_raised_speed(is_new: bool) -> None:
    """The drive must deviate for 125 ms at five times the speed, and not partly in the drive before."""
    clock = VirtualClock()
    clock.speed = 5.0  # type: ignore[attr-defined]
    with laboratory() as lab:
        monitor = LevelMonitor(LevelSettings(), lab.bench.sensor, 2.5, clock)
    monitor.attach((VOLTS, VOLTS), 1000.0, 0.0)
    flat = np.rint(np.stack([np.full(75, 2.5), np.zeros(75)]) / 2e-4).astype(np.int16)
    monitor.drive_changed(SINE)
    monitor.block_read(Block(150, flat))
    if is_new:
        clock.sleep(0.225)
        monitor.drive_changed(SINE)
    monitor.block_read(Block(360 if is_new else 225, flat))
    lost = [event.lost for event in monitor.take_events() if isinstance(event, DriveReadbackChanged)]
    assert lost == ([] if is_new else [True])


@pytest.mark.one_in(1)
@pytest.mark.parametrize(("anew", "between"), [(False, False), (True, False), (False, True)])
def test_scans_without_a_target_are_counted_on_from_block_to_block_of_one_drive(anew: bool, between: bool) -> None:
    """40 ms at the end of a block and at the begin of the next: beyond the 50 ms of the level, if the drive is the same.

    A block with a target between them begins the count anew.
    """
    with laboratory() as lab:
        monitor = LevelMonitor(LevelSettings(laser_lost=LevelAction.WARNING), lab.bench.sensor, 2.5, VirtualClock())
    monitor.attach((VOLTS, Scale((0.0, 3.5e-4))), RATE_HZ, 0.0)
    scans, lost = np.arange(500), []
    blocks = [scans >= 300, *([scans < 0] if between else []), scans < 200]
    for first, lost_at in zip(range(1000, 3000, 500), blocks, strict=False):
        if first == 1000 or anew:
            monitor.drive_changed(SINE)
        drive_v = SINE.volts((first + scans) / RATE_HZ)
        counts = np.rint([drive_v / 2e-4, np.where(lost_at, 11.0, 0.0) / 3.5e-4])
        monitor.block_read(Block(first, counts.astype(np.int16)))
        lost += [e.value for e in monitor.take_events() if isinstance(e, LevelExceeded) and e.level == "laser_lost"]
    assert lost == ([] if anew or between else [pytest.approx(0.08)])


def test_points_without_response_count_in_succession() -> None:
    with laboratory() as lab:
        monitor = LevelMonitor(LevelSettings(no_response=LevelAction.WARNING), lab.bench.sensor, 2.5, VirtualClock())
    monitor.attach((VOLTS, VOLTS), RATE_HZ, 0.0)
    silent, good = Quality.NO_RESPONSE, Quality.GOOD
    for qualities, reported in (((silent, silent, good, silent, silent), 0), ((silent,), 1), ((silent, silent), 0)):
        for quality in qualities:
            monitor.begin_entry()
            monitor.point_measured(quality)
        assert len(monitor.take_events()) == reported


@pytest.mark.one_in(1)
@pytest.mark.parametrize("volts", [1.49, 1.51, -1.49, -1.51])
@pytest.mark.parametrize("drive", [None, SINE])
def test_a_monitor_is_limited_on_both_sides_with_a_drive_and_without(drive: Any, volts: float) -> None:
    settings = LevelSettings(voltage=LevelAction.WARNING, voltage_v=1500.0)
    channels = (InputChannel("monitor", "ai2", "V", 1000.0, 0.0, kind="voltage-monitor"),)
    with laboratory() as lab:
        monitor = LevelMonitor(settings, lab.bench.sensor, 2.5, VirtualClock(), channels)
    monitor.attach((VOLTS, VOLTS, VOLTS), RATE_HZ, 0.0)
    monitor.drive_changed(drive)
    counts = np.rint(np.array([[2.5], [0.0], [volts]]) / 2e-4 + np.zeros(100)).astype(np.int16)
    monitor.block_read(Block(100, counts))
    found = [e.value for e in monitor.take_events() if isinstance(e, LevelExceeded) and e.level == "voltage"]
    assert found == ([pytest.approx(1510.0)] if abs(volts) > 1.5 else [])


@pytest.mark.one_in(1)
@pytest.mark.parametrize("count", [32766, 32767, -32767, -32768])
@pytest.mark.parametrize(
    ("kind", "level"), [("charge", "current"), ("current-monitor", "current"), ("voltage-monitor", "voltage")]
)
def test_an_input_at_the_end_of_its_range_exceeds_its_level_however_small_its_value(
    count: int, kind: str, level: str
) -> None:
    settings = LevelSettings(voltage=LevelAction.REST, current=LevelAction.REST)
    with laboratory() as lab:
        channels = (InputChannel("input", "ai2", "1", 1e-6, 0.0, kind=kind),)
        monitor = LevelMonitor(settings, lab.bench.sensor, 2.5, VirtualClock(), channels)
    monitor.attach((VOLTS, VOLTS, VOLTS), RATE_HZ, 0.0)
    counts = np.zeros((3, 100), np.int16)
    counts[0], counts[2, 50] = np.rint(2.5 / 2e-4), count
    monitor.block_read(Block(100, counts))
    found = [e.level for e in monitor.take_events() if isinstance(e, LevelExceeded) and e.channel == "input"]
    assert found == ([level] if count in (32767, -32768) else [])


def test_the_displacement_at_rest_is_of_samples_after_the_command() -> None:
    """The specimen still swings in the first ones, although the drive is at rest; and in some the sensor sees no target."""
    with laboratory() as lab:
        sensor = lab.bench.sensor
    lost_m = (11.0 - sensor.zero_v) * sensor.gain_m_per_v
    monitor = LevelMonitor(LevelSettings(stroke=LevelAction.WARNING, stroke_m=0.2e-3), sensor, 2.5, VirtualClock())
    monitor.attach((VOLTS, Scale((0.0, 3.5e-4))), RATE_HZ, 0.0)
    for first, drive, moved_m in (
        (0, None, 0.5e-3),
        (400, None, 0.0),
        (500, None, lost_m),
        (100, None, 0.5e-3),
        (800, SINE, 0.1e-3),
    ):
        if first in (0, 800):
            monitor.drive_changed(drive)
        drive_v = SINE.volts((first + np.arange(100)) / RATE_HZ) if drive else np.full(100, 2.5)
        sensor_v = np.full(100, sensor.zero_v + moved_m / sensor.gain_m_per_v)
        monitor.block_read(Block(first, np.rint([drive_v / 2e-4, sensor_v / 3.5e-4]).astype(np.int16)))
    assert [e.level for e in monitor.take_events() if isinstance(e, LevelExceeded)] == []


@pytest.mark.one_in(1)
@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize(("rate_m_per_s", "exceeded"), [(0.19, []), (0.21, ["rate"])])
def test_stroke_and_rate_are_limited_in_both_directions(side: int, rate_m_per_s: float, exceeded: list[str]) -> None:
    """0.38 and 0.42 mm from rest within 2 ms, where 0.2 m/s and 0.4 mm are allowed."""
    settings = LevelSettings(rate=LevelAction.WARNING, rate_m_per_s=0.2, stroke=LevelAction.WARNING, stroke_m=0.4e-3)
    with laboratory() as lab:
        sensor, clock = lab.bench.sensor, VirtualClock()
    monitor = LevelMonitor(settings, sensor, 2.5, clock)
    scale = Scale((0.0, 3.5e-4))
    monitor.attach((VOLTS, scale), RATE_HZ, 0.0)
    scans = np.arange(1000)
    for first, drive, seconds in (
        (1000, None, np.zeros(1000)),
        (2000, SINE, np.clip(scans / RATE_HZ - 0.04, 0.0, 2e-3)),
    ):
        monitor.drive_changed(drive)
        drive_v = SINE.volts((first + scans) / RATE_HZ) if drive else np.full(1000, 2.5)
        sensor_v = sensor.zero_v + side * rate_m_per_s * seconds / sensor.gain_m_per_v
        monitor.block_read(Block(first, np.rint([drive_v / 2e-4, sensor_v / 3.5e-4]).astype(np.int16)))
    found = [e.level for e in monitor.take_events() if isinstance(e, LevelExceeded) and e.level != "drive"]
    assert found == [*(["stroke"] * bool(exceeded)), *exceeded]


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("volts", "words"),
    [
        (lambda t: 2.5 + 0 * t, "it did not start, and the cable is whole"),
        (lambda t: np.minimum(SINE.volts(t), 2.7), "it is clipped"),
        (lambda t: 0 * t, "check the cable"),
    ],
)
def test_a_deviation_names_the_cause_that_fits(volts: Any, words: str) -> None:
    assert words in deviation(SINE, volts).remedy


def test_a_drive_that_is_over_is_not_seen_again() -> None:
    readback = DriveReadback(SINE, 0, 250, RATE_HZ, 2.5, 0.1)
    for start_s, compared in ((0.0, False), (0.2, True), (SINE.duration_s + 0.1, False)):
        t = start_s + np.arange(250) / RATE_HZ
        readback.check(round(start_s * RATE_HZ), np.rint(SINE.volts(t) / 2e-4).astype(np.int16), VOLTS.to_volts)
        assert readback.compared is compared


@pytest.mark.deep
def test_a_level_is_reported_within_a_tenth_of_a_second_without_a_window(tmp_path: Path) -> None:
    with connect(simulated(), None, UNATTENDED_BLOCK_S) as lab:
        lab.bench.levels = replace(lab.bench.levels, stroke_m=1e-4)
        ran = run(SHORT, tmp_path, lab)
    with Run(ran.path) as file:
        trace = file.trace
        seen = np.abs(trace.displacement_m() - trace.displacement_m(0, 100).mean())
        first_s = float(trace.time_s()[np.argmax(seen > 1e-4)])
    assert 0 <= exceeded(ran)[0].time_s - first_s <= REPORTED_WITHIN_S


FULL = {
    "mass resonance": MassResonance(masses_kg=(2.75e-3,)),
    "membrane sag": MembraneSag(),
    "membrane series": MembraneSeries(elongations_m=(0.0, 6.35e-3), frequencies_hz=(100, 130, 160, 200, 250)),
}


@pytest.mark.deep
@pytest.mark.timeout(900)
@pytest.mark.parametrize("protocol", FULL.values(), ids=FULL)
def test_the_default_levels_leave_a_protocol_of_full_length_undisturbed(protocol: Protocol, tmp_path: Path) -> None:
    with connect(simulated(), None, UNATTENDED_BLOCK_S) as lab:
        ran = run(protocol, tmp_path, lab)
    assert (ran.status, exceeded(ran)) == (RunStatus.COMPLETED, [])
    assert not any(event.lost for event in readbacks(ran))


@pytest.mark.deep
@pytest.mark.parametrize(
    "protocol",
    [SineDwell(frequencies_hz=(25.0, 250.0)), Sweep(), VoltageSteps(repeats=1)],
    ids=lambda protocol: protocol.name,
)
def test_a_sound_run_never_loses_its_drive(protocol: Protocol, tmp_path: Path) -> None:
    with laboratory() as lab:
        lab.bench.levels = replace(lab.bench.levels, drive=LevelAction.OFF)
        ran = run(protocol, tmp_path, lab)
    assert (ran.status, readbacks(ran)) == (RunStatus.COMPLETED, [])


def test_a_block_of_500_kilosamples_a_second_is_evaluated_in_a_fraction_of_its_duration() -> None:
    with laboratory() as lab:
        monitor = LevelMonitor(LevelSettings(), lab.bench.sensor, 2.5, VirtualClock())
    rate = 250_000.0
    monitor.attach((Scale((0.0, 3.2e-4, 1e-14, 1e-19)),) * 2, rate, 0.0)
    t = np.arange(12_500) / rate
    counts = np.rint(np.array([Sine(100, 2.5, 2.5, 1000).volts(t), 2 * np.sin(600 * t)]) / 3.2e-4).astype(np.int16)
    monitor.drive_changed(Sine(100, 2.5, 2.5, 100_000))
    processor_s = []
    for i in range(100):
        begin_s = time.thread_time()
        monitor.block_read(Block(125_000 + 12_500 * i, counts))
        processor_s.append(time.thread_time() - begin_s)
    assert monitor.take_events() == []
    assert min(processor_s) < 0.05 / 4, "the quickest, which other work on the computer has not delayed"


@pytest.mark.parametrize(("speed", "is_lost"), [(1.0, True), (15.0, False)])
def test_a_reply_that_is_late_at_raised_speed_does_not_make_a_drive_end_early(speed: float, is_lost: bool) -> None:
    """The drive ends 1.5 s before the end that follows from the reply; at real speed that is a lost drive."""

    class Clock(VirtualClock):
        pass

    clock, drive = Clock(), Sine(5.0, 2.5, 2.5, 20)
    clock.speed = speed  # type: ignore[attr-defined]
    with laboratory() as lab:
        monitor = LevelMonitor(LevelSettings(), lab.bench.sensor, 2.5, clock)
    monitor.attach((VOLTS, VOLTS), 1000.0, 0.0)
    clock.sleep(1.0)
    monitor.drive_commanded()
    clock.sleep(1.5)
    monitor.drive_changed(drive)
    t = np.arange(2500, 6500) / 1000.0 - 1.0
    volts = np.where(t < drive.duration_s, drive.volts(np.minimum(t, drive.duration_s)), 2.5)
    raw = np.stack([np.round(volts / VOLTS.coefficients[1]), np.zeros(t.size)]).astype(np.int16)
    for first in range(0, t.size, 500):
        monitor.block_read(Block(2500 + first, raw[:, first : first + 500]))
    lost = [event for event in monitor.take_events() if isinstance(event, DriveReadbackChanged) and event.lost]
    assert bool(lost) is is_lost


class Told:
    """Fake recorder that collects published events."""

    def __init__(self) -> None:
        self.events: list[Any] = []
        self.publish = self.notify = self.events.append


def test_every_exceeded_level_is_told_before_an_interrupt_and_the_operator_is_asked_about_the_first() -> None:
    found = [LevelExceeded(level, 0.1, "displacement", 2.0, 1.0, "m", "ask", level) for level in ("stroke", "rate")]
    ends: list[Exception] = []

    def check_interrupts() -> None:
        if ends:
            raise ends.pop()

    armed: Any = SimpleNamespace(read_block=lambda: Block(0, np.zeros((2, 10), np.int16)))
    with laboratory() as lab:
        for end in (RunCancelled("Stop"), LevelQuestion(found[0])):
            told: Any = Told()
            acquisition = RunAcquisition(lab.bench, told, check_interrupts)
            acquisition.levels.take_events = lambda: found  # type: ignore[method-assign,return-value]
            if isinstance(end, RunCancelled):
                ends.append(end)
            with pytest.raises(type(end)) as raised:
                acquisition.read_block(armed)
            acquisition.close()
            assert (told.events, str(raised.value)) == (found, str(end))
