"""The runner: whatever ends a run, the source is at rest, measured, and the file says what happened."""

import subprocess
import sys
import threading
import tracemalloc
from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import pytest
from annotated_types import Unit
from pydantic import Field

from drivers.drive import Sine
from protocols.events import (
    Answered,
    Armed,
    Asked,
    AtRest,
    BlockSeen,
    BlockTaken,
    Playing,
    PointMeasured,
    Progressed,
    Recorded,
    RunEnded,
    RunStarted,
    SettleEnded,
    Status,
    StreamStarted,
)
from protocols.protocol import Protocol
from protocols.runfile import RunFile
from protocols.runreader import Run
from protocols.sine_dwell import SineDwell
from protocols.steps import Ask, Note, Prompt, Read, Record, Settle, Step
from protocols.values import Estimate, Planned, Recording
from tests.support import Trigger, laboratory, run, simulated

SHORT = SineDwell(frequencies_hz=(100, 160), record_s=0.1, min_cycles=10)


@dataclass(frozen=True, slots=True)
class Spot:
    """A point of the test protocol."""

    frequency: Annotated[float, Unit("Hz"), "frequency"]
    mean: Annotated[float, Unit("m"), "mean displacement"]


class Scripted(Protocol):
    """Yields the steps it was given."""

    name: ClassVar[str] = "scripted"
    title: ClassVar[str] = "Scripted"
    point_type: ClassVar[type] = Spot
    axes: ClassVar[tuple[str, str]] = ("frequency", "mean")
    script: Any = Field(default=(), exclude=True)
    sample_rate_hz: float = 5000.0

    def plan(self, rest_v: float) -> tuple[Planned, ...]:
        return (Planned("only", (Sine(100, 1, rest_v, 300),), 1.0),)

    def measure(self, entry: Planned, rest_v: float) -> Generator[Step, Any, None]:
        for step in self.script:
            answer = yield step() if callable(step) else step
            self.__dict__.setdefault("answers", []).append(answer)

    def point(self, key: Any, recordings: Sequence[Recording], simulated: bool) -> Spot:
        if not recordings:
            raise ValueError("nothing was recorded")
        return Spot(100.0, float(recordings[-1].displacement_m.mean()))

    def estimates(self, points: Iterable[Any]) -> tuple[Estimate, ...]:
        return ()


SETTLE = Settle(Sine(100, 1, 2.5, 300), 0.02, 0.01, 1.0)


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
        *point,
        *point,
        "GoingToRest",
        "AtRest",
        "RunEnded",
    ]
    with Run(ran.path) as file:
        stored = [event.kind for event in file.events()]
        assert stored == [kind for kind in kinds if kind not in ("GoingToRest", "RunEnded")]
        assert (file.status, file.reason) == (Status.COMPLETED, "all points measured")


def test_the_bench_is_silent_until_rest_was_measured_and_high_voltage_enabled(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(SHORT, tmp_path, lab)
    prompts = [event.prompt.action for event in ran.events if isinstance(event, Asked)]
    assert prompts == ["disable-high-voltage", "enable-high-voltage"]
    first_play = next(i for i, e in enumerate(ran.events) if isinstance(e, Playing))
    assert any(isinstance(e, Armed) for e in ran.events[:first_play])


def test_every_run_asks_before_its_first_drive_even_if_the_source_rests(tmp_path: Path) -> None:
    with laboratory() as lab:
        run(SHORT, tmp_path, lab)
        ran = run(SHORT, tmp_path, lab)
    prompts = [event.prompt.action for event in ran.events if isinstance(event, Asked)]
    assert prompts == ["enable-high-voltage"]
    assert ran.status == Status.COMPLETED


@pytest.mark.breaks_the_drive
def test_a_generator_lost_between_two_runs_with_high_voltage_on_is_unsafe(tmp_path: Path) -> None:
    with laboratory() as lab:
        run(SHORT, tmp_path, lab)
        lab.control.inject("generator-power-off")
        ran = run(SHORT, tmp_path, lab, safe=False)
    assert ran.status == Status.UNSAFE
    assert "switch the high voltage OFF at the amplifier itself" in ran.reason


MOMENTS = [
    RunStarted,
    StreamStarted,
    Asked,
    Answered,
    Armed,
    Playing,
    BlockTaken,
    SettleEnded,
    PointMeasured,
    Progressed,
]


@pytest.mark.parametrize("moment", MOMENTS)
def test_stop_at_any_moment_goes_to_rest_and_keeps_what_was_measured(moment: type, tmp_path: Path) -> None:
    cancel = threading.Event()
    with laboratory() as lab:
        ran = run(SHORT, tmp_path, lab, Trigger(lambda e: isinstance(e, moment), cancel.set), cancel=cancel)
    assert ran.status == Status.STOPPED
    assert "stopped by the operator" in ran.reason
    with Run(ran.path) as file:
        assert file.status == Status.STOPPED
        assert len(file.points()["frequency"]) == len(ran.points)


@pytest.mark.parametrize("error", [RuntimeError("boom"), KeyboardInterrupt(), ZeroDivisionError("1/0")])
def test_an_exception_in_a_protocol_goes_to_rest_and_is_told(error: BaseException, tmp_path: Path, caplog: Any) -> None:
    def explode() -> Step:
        raise error

    with laboratory() as lab:
        ran = run(Scripted(script=(SETTLE, explode)), tmp_path, lab)
    assert ran.status == (Status.STOPPED if isinstance(error, KeyboardInterrupt) else Status.FAILED)
    assert any(isinstance(e, AtRest) and e.confirmed for e in ran.events)
    assert isinstance(ran.events[-1], RunEnded)


def test_an_observer_that_fails_does_not_hurt_the_run(tmp_path: Path, caplog: Any) -> None:
    def broken(event: object) -> None:
        raise ValueError("I am a broken plot")

    with laboratory() as lab:
        ran = run(SHORT, tmp_path, lab, broken)
    assert ran.status == Status.COMPLETED
    assert "I am a broken plot" in caplog.text


def test_a_file_that_cannot_be_written_fails_the_run_at_rest(tmp_path: Path, monkeypatch: Any) -> None:
    block = RunFile.block
    taken = []

    def full(self: RunFile, *arguments: Any) -> int:
        taken.append(1)
        if len(taken) > 12:
            self._file.close()  # what a vanished disk looks like to the next write
        return block(self, *arguments)

    monkeypatch.setattr(RunFile, "block", full)
    with laboratory() as lab:
        ran = run(SHORT, tmp_path, lab)
    assert ran.status == Status.FAILED
    assert "cannot be written" in ran.reason
    assert isinstance(ran.events[-1], RunEnded)
    assert any(isinstance(e, AtRest) and e.confirmed for e in ran.events)


def test_an_inadmissible_drive_is_refused_before_anything_moves(tmp_path: Path) -> None:
    script = (Settle(Sine(100, 3.0, 2.5, 300), 0.02, 0.01, 1.0),)
    with laboratory() as lab:
        ran = run(Scripted(script=script), tmp_path, lab)
        assert ran.report.outside_rest_s == 0
    assert ran.status == Status.FAILED
    assert "Sine refused: it reaches -0.5 V" in ran.reason


def test_prompts_notes_and_recordings_are_answered(tmp_path: Path) -> None:
    prompt = Prompt("enable-high-voltage", "Press when ready.")
    protocol = Scripted(script=(Note("hello"), Ask(prompt), SETTLE, Record(0.05)))
    with laboratory() as lab:
        ran = run(protocol, tmp_path, lab)
    assert ran.status == Status.COMPLETED
    assert protocol.__dict__["answers"][1] == "done"
    recording = protocol.__dict__["answers"][3]
    assert recording.drive_v.shape == recording.displacement_m.shape == (250,)
    with Run(ran.path) as file:
        assert file.points()["mean"].tolist() == [recording.displacement_m.mean()]
        assert next(file.recordings()).drive_v.tolist() == recording.drive_v.tolist()


class Hesitant:
    """Answers the run's prompts late, as a person does; the card goes on sampling meanwhile."""

    def __init__(self, hands: Any, polls: int) -> None:
        self.hands, self.polls = hands, polls

    def show(self, ask_id: int, prompt: Prompt) -> None:
        self.left = self.polls
        self.hands.show(ask_id, prompt)

    def answer(self, ask_id: int) -> str | None:
        self.left -= 1
        return self.hands.answer(ask_id) if self.left <= 0 else None


def test_a_person_may_take_a_minute_to_answer_without_losing_the_card(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(SHORT, tmp_path, lab, operator=Hesitant(lab.operator, 1200))
        assert lab.bench.clock.now() > 60
        assert ran.status == Status.COMPLETED
    with Run(ran.path) as file:
        assert file.trace.samples < 10 * 5000  # the wait itself is no measurement


@pytest.mark.parametrize(
    ("script", "says"),
    [
        ((Read("scale"),), "this bench has no meter 'scale' .it has: none."),
    ],
)
def test_what_the_bench_cannot_do_is_a_sentence(script: tuple, says: str, tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(Scripted(script=script), tmp_path, lab)
    assert ran.status == Status.FAILED
    import re

    assert re.search(says, ran.reason)


@pytest.mark.breaks_the_drive
def test_no_drive_on_the_cards_channel_is_noticed(tmp_path: Path) -> None:
    with laboratory() as lab:
        pull = Trigger(lambda e: isinstance(e, Armed), lambda: lab.control.inject("drive-cable-off"))
        ran = run(SHORT, tmp_path, lab, pull, safe=False)
    assert ran.status == Status.UNSAFE  # the amplifier's input is pulled to 0 V: -500 V on the specimen
    assert "switch the high voltage OFF at the amplifier itself" in ran.reason
    assert "check the cable from the generator to the card" in ran.reason
    with Run(ran.path) as file:
        assert file.status == Status.UNSAFE


def test_simulated_truth_is_in_the_file(tmp_path: Path) -> None:
    with laboratory(simulated(tactor={"k2": 7.5e-3})) as lab:
        ran = run(SHORT, tmp_path, lab)
    with Run(ran.path) as file:
        assert file.configuration["simulation"]["tactor"]["k2"] == 7.5e-3
        assert file.simulated


def test_long_recordings_stay_in_the_file_and_are_read_from_there(tmp_path: Path) -> None:
    """However many and however long: memory is flat. What a protocol gets is what anybody reads from the file later."""
    kept: list[int] = []

    def weigh(event: Any) -> None:
        if isinstance(event, SettleEnded):
            tracemalloc.start()
        elif isinstance(event, Recorded):
            kept.append(tracemalloc.get_traced_memory()[0])

    protocol = Scripted(script=(SETTLE, Record(0.5), *[Record(2.5)] * 3), sample_rate_hz=20_000)
    seen: list[tuple[Any, Any]] = []
    with laboratory() as lab:
        observed = Trigger(
            lambda e: isinstance(e, PointMeasured),
            lambda: seen.extend((r.drive_v, r.displacement_m) for r in protocol.__dict__["answers"][1:]),
        )
        ran = run(protocol, tmp_path, lab, weigh, observed)
        tracemalloc.stop()
    assert ran.status == Status.COMPLETED
    # One of them is 50 000 scans: 0.2 MB in the blocks that this test keeps, 0.8 MB in volts and metres.
    assert max(np.diff(kept)) < 0.4e6
    with Run(ran.path) as file:
        stored = list(file.recordings())
    assert [r.drive_v.size for r in stored] == [10_000, 50_000, 50_000, 50_000]
    for recording, (drive_v, displacement_m) in zip(stored, seen, strict=True):
        assert (recording.drive_v == drive_v).all()
        assert (recording.displacement_m == displacement_m).all()


def test_a_step_that_records_longer_than_memory_holds_fails_in_a_sentence(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(Scripted(script=(SETTLE, Record(100_000.0))), tmp_path, lab)
    assert ran.status == Status.FAILED
    assert "a recording of 500 million scans does not fit into memory (limit 50 million)" in ran.reason


def test_the_card_is_emptied_while_a_point_is_worked_out(tmp_path: Path) -> None:
    """At raised speed a second of thinking is longer than the card holds its scans for us: 10 s here, 15 s are needed."""
    emptied = threading.Semaphore(0)

    class Slow(Scripted):
        def point(self, key: Any, recordings: Sequence[Recording], simulated: bool) -> Spot:
            for _ in range(15):
                lab.bench.clock.sleep(1.0)
                if not all(emptied.acquire(timeout=5) for _ in range(15)):
                    raise ValueError("nobody looked after the card")
            return super().point(key, recordings, simulated)

    with laboratory() as lab:
        looked = [lambda event: emptied.release() if isinstance(event, BlockSeen) else None]
        ran = run(Slow(script=(SETTLE, Record(0.1))), tmp_path, lab, *looked)
    assert (ran.status, ran.reason) == (Status.COMPLETED, "all points measured")


IMPORTED = """
import sys, tempfile, pathlib
from protocols.sweep import Sweep
from tests.support import laboratory, run

def watch(event):
    seen.append((type(event).__name__, {name for name in sys.modules if name.startswith("scipy.")}))

seen = []
with tempfile.TemporaryDirectory() as folder, laboratory() as lab:
    assert run(Sweep(sweep_s=0.1, periods=2), pathlib.Path(folder), lab, watch).points
before = next(modules for name, modules in seen if name == "StreamStarted")
print(*sorted(seen[-1][1] - before))
"""


def test_no_part_of_scipy_is_imported_while_the_card_runs() -> None:
    """It would hold everything up for a second or two: samples, Stop, the window."""
    told = subprocess.run([sys.executable, "-c", IMPORTED], capture_output=True, text=True, check=True)
    assert told.stdout.split() == []
