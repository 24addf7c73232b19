"""Runner: however a run ends, the source is at measured rest, and the file has the events."""

import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from drivers.bench.bench import ArmedBench, LevelAction
from drivers.bench.rest import LiveWarning
from drivers.drive_shapes import Hold, Sine
from drivers.errors import MANUAL_SHUTDOWN_INSTRUCTIONS, BenchError
from protocols.base import (
    BenchArmed,
    BlockStored,
    Cycle,
    CyclesInterrupted,
    CycleStatistics,
    DriveStarted,
    Event,
    EventBus,
    LevelExceeded,
    Play,
    PointMeasured,
    ProgressUpdated,
    PromptAnswered,
    PromptShown,
    Protocol,
    Quality,
    Record,
    RestMeasured,
    RunEnded,
    RunStarted,
    RunStatus,
    Settle,
    SettlingFinished,
    ShutdownStarted,
    SpecimenMayBeLive,
    Step,
    StreamStarted,
)
from protocols.measurements.endurance import Endurance
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.wiring_check import WiringCheck
from protocols.runfile.errors import StorageError
from protocols.runfile.reader import Run
from protocols.runfile.writer import RunFileWriter
from protocols.runner.cycle_tally import CycleTally
from protocols.runner.publisher import RunCancelled
from protocols.runner.request import RunRequest
from protocols.runner.runner import Runner
from tests.helpers.messages import assert_names
from tests.helpers.scripted_protocol import SETTLE, SHORT, Scripted
from tests.helpers.simulated_bench import Trigger, assert_safe_voltage, laboratory, run, simulated


def test_events_come_in_order_and_the_file_has_them_too(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(SHORT, tmp_path, lab)
    kinds = [kind for kind in ran.kinds() if kind not in ("BlockTaken", "BlockSeen")]
    point = ["EntryBegan", "Playing", "SettleEnded", "Recorded", "PointMeasured", "Progressed"]
    prompts = ["Asked", "Answered"] * 2
    assert kinds == [
        "RunStarted",
        "StreamStarted",
        *prompts,
        "Armed",
        "Progressed",
        "InterferenceMeasured",
        *point,
        *point,
        "GoingToRest",
        "AtRest",
        "RunEnded",
    ]
    with Run(ran.path) as file:
        stored = [event.kind for event in file.events()]
        assert stored == [kind for kind in kinds if kind not in ("GoingToRest", "RunEnded")]
        assert (file.record.status, file.record.reason) == (RunStatus.COMPLETED, "all points measured")


def test_the_bench_is_silent_until_rest_was_measured_and_high_voltage_enabled(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(SHORT, tmp_path, lab)
    prompts = [event.prompt.action for event in ran.events if isinstance(event, PromptShown)]
    assert prompts == ["disable-high-voltage", "enable-high-voltage"]
    first_play = next(i for i, e in enumerate(ran.events) if isinstance(e, DriveStarted))
    assert any(isinstance(e, BenchArmed) for e in ran.events[:first_play])


def test_every_run_asks_before_its_first_drive_even_if_the_source_rests(tmp_path: Path) -> None:
    with laboratory() as lab:
        run(SHORT, tmp_path, lab)
        ran = run(SHORT, tmp_path, lab)
    prompts = [event.prompt.action for event in ran.events if isinstance(event, PromptShown)]
    assert prompts == ["enable-high-voltage"]
    assert ran.status == RunStatus.COMPLETED


@pytest.mark.deep
@pytest.mark.breaks_the_drive
def test_a_generator_lost_between_two_runs_with_high_voltage_on_is_unsafe(tmp_path: Path) -> None:
    with laboratory() as lab:
        run(SHORT, tmp_path, lab)
        lab.control.inject("generator-power-off")
        ran = run(SHORT, tmp_path, lab, safe=False)
    assert ran.status == RunStatus.UNSAFE
    assert ran.reason.startswith(MANUAL_SHUTDOWN_INSTRUCTIONS)


MOMENTS = [
    RunStarted,
    StreamStarted,
    PromptShown,
    PromptAnswered,
    BenchArmed,
    DriveStarted,
    BlockStored,
    SettlingFinished,
    PointMeasured,
    ProgressUpdated,
]


@pytest.mark.one_in(3)
@pytest.mark.parametrize("moment", MOMENTS)
def test_stop_at_any_moment_goes_to_rest_and_keeps_what_was_measured(moment: type, tmp_path: Path) -> None:
    cancel = threading.Event()
    with laboratory() as lab:
        ran = run(SHORT, tmp_path, lab, Trigger(lambda e: isinstance(e, moment), cancel.set), cancel=cancel)
    assert ran.status == RunStatus.STOPPED
    assert_names(ran.reason, "operator", len(ran.points), len(SHORT.frequencies_hz))
    with Run(ran.path) as file:
        assert file.record.status == RunStatus.STOPPED
        assert len(file.points()["frequency"]) == len(ran.points)


def test_stop_is_obeyed_at_the_next_block_of_a_recording(tmp_path: Path) -> None:
    cancel, seen = threading.Event(), list[type]()

    def third_block_of_the_recording(event: object) -> bool:
        seen.append(type(event))
        return SettlingFinished in seen and seen[seen.index(SettlingFinished) :].count(BlockStored) == 3

    with laboratory() as lab:
        stop = Trigger(third_block_of_the_recording, cancel.set)
        long = SineDwell(frequencies_hz=(100,), record_s=2.0)
        run(long, tmp_path, lab, stop, lambda e: stop.done and seen.append(type(e)), cancel=cancel)
    recorded = seen[seen.index(SettlingFinished) : seen.index(ShutdownStarted)]
    assert recorded.count(BlockStored) <= 5, "of the forty of the recording"


@pytest.mark.parametrize("error", [RuntimeError("boom"), KeyboardInterrupt(), SystemExit(1)])
def test_an_exception_in_a_protocol_goes_to_rest_and_is_told(error: BaseException, tmp_path: Path, caplog: Any) -> None:
    def explode() -> Step:
        raise error

    with laboratory() as lab:
        ran = run(Scripted(script=(SETTLE, explode)), tmp_path, lab)
    assert ran.status == (RunStatus.STOPPED if isinstance(error, KeyboardInterrupt) else RunStatus.FAILED)
    assert any(isinstance(e, RestMeasured) and e.confirmed for e in ran.events)
    assert isinstance(ran.events[-1], RunEnded)


@pytest.mark.parametrize("method", ["start_drive", "stop"])
def test_a_driver_that_ends_the_interpreter_ends_the_run_at_measured_rest(
    method: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: Any
) -> None:
    with laboratory() as lab:
        source = lab.bench.amplifier._source

        call = getattr(source, method)

        def leave(*arguments: object) -> object:
            if not lab.bench.high_voltage_enabled:
                return call(*arguments)
            monkeypatch.undo()
            raise SystemExit(1)

        monkeypatch.setattr(source, method, leave)
        ran = run(SHORT, tmp_path, lab)
    assert ran.status == RunStatus.FAILED
    assert "SystemExit" in ran.reason
    assert any(isinstance(e, RestMeasured) and e.confirmed for e in ran.events)
    assert isinstance(ran.events[-1], RunEnded)
    with Run(ran.path) as file:
        assert file.record.status == RunStatus.FAILED


@pytest.mark.breaks_the_drive
def test_a_way_to_rest_that_is_interrupted_is_unsafe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("drivers.bench.rest.SafeShutdown.run", interrupted)
    with laboratory() as lab:
        ran = run(SHORT, tmp_path, lab, safe=False)
    assert ran.status == RunStatus.UNSAFE
    assert ran.reason.startswith(f"{MANUAL_SHUTDOWN_INSTRUCTIONS}.")
    assert [e.confirmed for e in ran.events if isinstance(e, RestMeasured)] == [False]


@pytest.mark.deep
def test_an_observer_that_fails_does_not_hurt_the_run(tmp_path: Path, caplog: Any) -> None:
    def broken(event: object) -> None:
        raise ValueError("I am a broken plot")

    with laboratory() as lab:
        ran = run(SHORT, tmp_path, lab, broken)
    assert ran.status == RunStatus.COMPLETED
    assert "I am a broken plot" in caplog.text


def test_a_file_that_cannot_be_written_fails_the_run_at_rest(tmp_path: Path, monkeypatch: Any) -> None:
    block = RunFileWriter.append_block
    taken = []

    def full(self: RunFileWriter, *arguments: Any) -> int:
        taken.append(1) if lab.bench.high_voltage_enabled else None
        if len(taken) > 12:
            self._file.close()  # what a vanished disk looks like to the next write
        return block(self, *arguments)

    monkeypatch.setattr(RunFileWriter, "append_block", full)
    with laboratory() as lab:
        ran = run(SHORT, tmp_path, lab)
    assert ran.status == RunStatus.FAILED
    assert re.search(rf" {re.escape(str(ran.path))} .*written", ran.reason)
    assert isinstance(ran.events[-1], RunEnded)
    assert any(isinstance(e, RestMeasured) and e.confirmed for e in ran.events)


def test_an_inadmissible_drive_is_refused_before_anything_moves(tmp_path: Path) -> None:
    script = (Settle(Sine(100, 3.0, 2.5, 300), 0.02, 0.01, 1.0),)
    with laboratory() as lab:
        ran = run(Scripted(script=script), tmp_path, lab)
        assert ran.report.outside_rest_s == 0
    assert ran.status == RunStatus.FAILED
    assert "Sine refused: it reaches -0.5 V" in ran.reason


@pytest.mark.deep
@pytest.mark.breaks_the_drive
def test_no_drive_on_the_cards_channel_is_noticed(tmp_path: Path) -> None:
    with laboratory() as lab:
        pull = Trigger(lambda e: isinstance(e, BenchArmed), lambda: lab.control.inject("drive-cable-off"))
        ran = run(SHORT, tmp_path, lab, pull, safe=False)
    assert ran.status == RunStatus.UNSAFE  # the amplifier's input is pulled to 0 V: -500 V on the specimen
    assert ran.reason.startswith(MANUAL_SHUTDOWN_INSTRUCTIONS)
    (event,) = (event for event in ran.events if isinstance(event, LevelExceeded))
    assert event.level == "drive"
    assert event.words in ran.reason
    assert_names(event.words, "cable")
    with Run(ran.path) as file:
        assert file.record.status == RunStatus.UNSAFE


@pytest.mark.deep
def test_simulated_truth_is_in_the_file(tmp_path: Path) -> None:
    with laboratory(simulated(tactor={"k2": 7.5e-3})) as lab:
        ran = run(SHORT, tmp_path, lab)
    with Run(ran.path) as file:
        assert file.record.configuration["simulation"]["tactor"]["k2"] == 7.5e-3
        assert file.record.simulated


IMPORTED = """
import sys, tempfile, pathlib
from protocols.measurements.sweep import Sweep
from tests.helpers.simulated_bench import laboratory, run

def watch(event):
    seen.append((event.kind, {name for name in sys.modules if name.startswith("scipy.")}))

seen = []
with tempfile.TemporaryDirectory() as folder, laboratory() as lab:
    assert run(Sweep(sweep_s=0.1, periods=2), pathlib.Path(folder), lab, watch).points
before = next(modules for name, modules in seen if name == "StreamStarted")
print(*sorted(seen[-1][1] - before))
"""


@pytest.mark.parametrize("off_v", [-0.4, 0.4])
def test_a_held_level_that_does_not_reach_the_card_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, off_v: float
) -> None:
    start = ArmedBench.start_drive
    monkeypatch.setattr(
        ArmedBench, "start_drive", lambda armed, drive: start(armed, replace(drive, level_v=drive.level_v + off_v))
    )
    with laboratory() as lab:
        ran = run(Scripted(script=(Play(Hold(3.5, 5.0), 0.2), Record(0.05))), tmp_path, lab)
        assert_safe_voltage(lab.control.report())
    assert (ran.status, ran.points) == (RunStatus.FAILED, [])
    assert f"{3.5 + off_v:.3f} V" in ran.reason


@pytest.mark.deep
def test_no_part_of_scipy_is_imported_while_the_card_runs() -> None:
    """It would hold everything up for a second or two: samples, Stop, the window."""
    told = subprocess.run([sys.executable, "-c", IMPORTED], capture_output=True, text=True, check=True)
    assert told.stdout.split() == []


@pytest.mark.breaks_the_drive
def test_the_way_to_rest_and_the_warning_state_what_a_front_end_needs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.bench.armed_bench.CATCH_UP_S", 60.0)  # a busy computer is no card that is not read
    with laboratory() as lab:
        silent = Trigger(lambda event: isinstance(event, PointMeasured), lambda: lab.control.inject("scpi-silent"))
        ran = run(SHORT, tmp_path, lab, silent, safe=False)
    (armed,) = (event for event in ran.events if isinstance(event, BenchArmed))
    (going,) = (event for event in ran.events if isinstance(event, ShutdownStarted))
    assert going.wait_s == pytest.approx(armed.way_to_rest_s - 0.5)
    (warning,) = (event for event in ran.events if isinstance(event, SpecimenMayBeLive))
    assert warning.part == "generator"
    assert 0 <= warning.age_s < 0.3


@pytest.fixture
def runner(tmp_path: Path) -> Iterator[tuple[Runner, list[Event]]]:
    """A run that has not begun, and what observers see of it."""
    with laboratory() as lab:
        seen: list[Event] = []
        made = Runner(RunRequest(SHORT, tmp_path, "T1"), lab.bench, lab.operator, EventBus(seen.append))
        yield made, seen
        made.give_up(RunStatus.FAILED, "it was not begun")


def test_a_warning_that_the_disk_does_not_take_is_told_all_the_same(
    runner: tuple[Runner, list[Event]], monkeypatch: pytest.MonkeyPatch
) -> None:
    made, seen = runner
    monkeypatch.setattr(made._run_file, "append_event", mock.Mock(side_effect=StorageError("full")))
    made._warn_of_live_specimen(LiveWarning("", 2.0, 3.0, 0.1, "card"))
    assert seen == [SpecimenMayBeLive(2.0, 3.0, "", "card", 0.1)]


def test_a_run_that_was_given_up_tells_nothing_afterwards(runner: tuple[Runner, list[Event]]) -> None:
    made, seen = runner
    ended = made.give_up(RunStatus.FAILED, "its thread hangs")
    told = list(seen)
    assert ended.status is RunStatus.FAILED
    made._warn_of_live_specimen(LiveWarning(""))
    assert (seen, made.give_up(RunStatus.STOPPED, "")) == (told, ended)


def test_an_unattended_run_ends_at_its_longest_duration_and_not_before(tmp_path: Path) -> None:
    with laboratory() as lab:
        protocol = Endurance(unattended=True, responsible="Anna", longest_s=100.0)
        made = Runner(RunRequest(protocol, tmp_path, "T1"), lab.bench, lab.operator)
        made._limit_duration()
        lab.bench.clock.sleep(99.0)
        made._interrupts.check()
        lab.bench.clock.sleep(2.0)
        with pytest.raises(BenchError, match="100 s"):
            made._interrupts.check()
        made.give_up(RunStatus.FAILED, "")


@pytest.mark.parametrize(("protocol", "action"), [(WiringCheck(), "warning"), (SHORT, "rest")])
def test_a_level_that_a_protocol_diagnoses_by_itself_is_a_warning_in_its_runs(
    protocol: Protocol, action: str, tmp_path: Path
) -> None:
    with laboratory() as lab:
        lab.bench.levels = replace(lab.bench.levels, no_response=LevelAction.REST)
        made = Runner(RunRequest(protocol, tmp_path, "T1"), lab.bench, lab.operator)
        levels = made._acquisition.levels
        levels.attach((), 1000.0, 0.0)
        for _ in range(lab.bench.levels.no_response_points):
            levels.point_measured(Quality.NO_RESPONSE)
        assert [event.action for event in levels.take_events() if isinstance(event, LevelExceeded)] == [action]
        made.give_up(RunStatus.FAILED, "")


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("driven", "played", "counted"), [(0, 9.5, 11), (40, 9.5, 51), (40, 59.5, 100), (40, 70.0, 100)]
)
def test_cycles_of_a_block_are_counted_through_every_interruption(
    driven: int, played: float, counted: int, runner: tuple[Runner, list[Event]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stop counts the cycle that was begun, and one for the way to rest, and never more than there are."""
    made, seen = runner
    drives: list[Sine] = []

    def interrupted(*_: object) -> None:
        made._bench.clock.sleep(played / 100.0)
        raise RunCancelled

    monkeypatch.setattr(CycleTally, "read", interrupted)
    monkeypatch.setattr(made._executor, "_start_drive", lambda _, drive: drives.append(drive))
    made._executor.driven[3] = CycleStatistics(cycles=driven)
    armed: Any = None
    with pytest.raises(RunCancelled):
        made._executor._cycle(armed, Cycle(Sine(100.0, 1.0, 2.5, 100), 0.1), 3)
    assert [drive.cycles for drive in drives] == [100 - driven]
    assert made._executor.driven[3].cycles == counted
    assert [event.driven.cycles for event in seen if isinstance(event, CyclesInterrupted)] == [counted]
