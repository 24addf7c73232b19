"""Entries of a plan: pausing, measuring again, going on after an interruption, hands on the specimen, more on demand."""

import threading
from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import h5py
import numpy as np
import pytest
from annotated_types import Unit

from app.session import header
from drivers.drive import Drive, Hold
from protocols import registry
from protocols.continuation import earlier
from protocols.events import Answered, Asked, BlockSeen, EntryBegan, Noted, Paused, PointMeasured, Resumed, Status
from protocols.protocol import Protocol
from protocols.quality import Quality
from protocols.rehearsal import rehearse
from protocols.runfile import RunFile
from protocols.runner import Runner
from protocols.runreader import Run, RunError
from protocols.steps import Ask, Await, Play, Prompt, Record, Redo, Step
from protocols.values import Estimate, Planned, Recording
from sim_hardware.contract.volts import volts_are_safe
from tests.support import Ran, Trigger, laboratory, run, simulated


@dataclass(frozen=True, slots=True)
class Level:
    """What was seen at one level."""

    level: Annotated[float, Unit("V"), "level commanded"]
    displacement: Annotated[float, Unit("m"), "mean displacement"]
    displacement_errors: Annotated[float, Unit("m"), "standard uncertainty"]
    quality: Annotated[int, Unit("1"), "flags"]


class Levels(Protocol):
    """Levels one after the other; what else happens is told by the flags."""

    name: ClassVar[str] = "levels"
    title: ClassVar[str] = "Levels"
    point_type: ClassVar[type] = Level
    axes: ClassVar[tuple[str, str]] = ("level", "displacement")
    levels_v: tuple[float, ...] = (2.0, 2.2, 2.8, 3.0)
    setups: tuple[int, ...] = ()
    more_v: tuple[float, ...] = ()
    sample_rate_hz: float = 5000.0
    script: ClassVar[dict[int, list[Any]]] = {}

    def plan(self, rest_v: float) -> tuple[Planned, ...]:
        setups = self.setups or (0,) * len(self.levels_v)
        return tuple(self._entry(v, s) for v, s in zip(self.levels_v, setups, strict=True))

    def _entry(self, level_v: float, setup: int) -> Planned:
        prompt = Prompt("fix-mass", f"Fix mass {setup}", {"mass_kg": float(setup)}, hands_on=True) if setup else None
        return Planned(f"{level_v:g} V", (Hold(level_v, 10.0),), 0.6, (level_v,), prompt)

    def more(self, points: Sequence[Any], rest_v: float) -> tuple[Planned, ...]:
        have = [point.level for point in points]
        return tuple(self._entry(v, 0) for v in self.more_v if v not in have)

    def measure(self, entry: Planned, rest_v: float) -> Generator[Step, Any, Redo | None]:
        drive: Drive = entry.drives[0]
        yield Play(drive, 0.3)
        yield Record(0.2)
        return None

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> Level:
        moved = recordings[-1].displacement_m
        if key[0] == 2.222:
            raise ValueError("this level gives nothing")
        quality = recordings[-1].quality | (Quality.SIMULATED if simulated else Quality.GOOD)
        return Level(float(key[0]), float(moved.mean()), float(moved.std() / np.sqrt(len(moved))), int(quality))

    def estimates(self, points: Iterable[Any]) -> tuple[Estimate, ...]:
        return (Estimate("count", float(len(list(points))), 0.0, "1", "here"),)


LEVELS = Levels()


class Handy:
    """A simulated operator that also does what tests ask, and remembers every prompt."""

    def __init__(self, hands: Any) -> None:
        self.hands, self.asked = hands, []
        self.answers: dict[int, str] = {}

    def show(self, ask_id: int, prompt: Prompt) -> None:
        self.asked.append(prompt)
        if prompt.action in ("disable-high-voltage", "enable-high-voltage"):
            self.hands.show(ask_id, prompt)
            self.answers[ask_id] = "done"
        elif prompt.action != "never":
            self.answers[ask_id] = prompt.choices[0]

    def answer(self, ask_id: int) -> str | None:
        return self.answers.pop(ask_id, None)


def resumed(path: Path, folder: Path, lab: Any, again: Sequence[int] = (), operator: Any = None) -> Ran:
    """Go on with a run, as a session does."""
    before = earlier(path, again)
    events: list[Any] = []
    store = RunFile.new(folder, header(before.protocol, lab.bench, before.specimen, before.path))
    runner = Runner(
        before.protocol, lab.bench, store, operator or lab.operator, [events.append], continuation=before.continuation
    )
    status, reason = runner.run()
    report = lab.control.report()
    volts_are_safe(report)
    return Ran(status, reason, store.path, events, report, lab)


def high_voltage(lab: Any) -> bool:
    """Whether it is on at this moment, as the simulated world has it."""
    _, on = lab.control.history.read(np.array([lab.bench.clock.now()]))
    return bool(on[0])


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(registry.PROTOCOLS, "levels", Levels)


@pytest.mark.parametrize("moment", ["EntryBegan", "Playing", "SettleEnded", "BlockTaken"])
def test_a_pause_goes_to_measured_rest_and_measures_the_interrupted_entry_again(moment: str, tmp_path: Path) -> None:
    pause = threading.Event()
    seen: list[bool] = []
    waited = [0]

    def watch(event: Any) -> None:
        if isinstance(event, Paused):
            seen.append("rest" in event.words)
        waited[0] += isinstance(event, BlockSeen)
        if waited[0] == 5:
            pause.clear()

    with laboratory() as lab:
        begun = [0]

        def when(event: Any) -> bool:
            begun[0] += isinstance(event, EntryBegan)
            return begun[0] == 2 and type(event).__name__ == moment

        ran = run(LEVELS, tmp_path, lab, Trigger(when, pause.set), watch, pause=pause)
    assert ran.status == Status.COMPLETED
    assert seen == [True]
    assert [p.level for p in ran.points] == [2.0, 2.2, 2.8, 3.0]
    assert [e.index for e in ran.events if isinstance(e, EntryBegan)] == [0, 1, 1, 2, 3]
    kinds = ran.kinds()
    assert kinds.index("Paused") < kinds.index("Resumed")


def test_a_paused_run_can_be_stopped(tmp_path: Path) -> None:
    pause, cancel = threading.Event(), threading.Event()
    with laboratory() as lab:
        hold = Trigger(lambda e: isinstance(e, EntryBegan), pause.set)
        end = Trigger(lambda e: isinstance(e, Paused), cancel.set)
        ran = run(LEVELS, tmp_path, lab, hold, end, cancel=cancel, pause=pause)
    assert ran.status == Status.STOPPED
    assert not any(isinstance(e, Resumed) for e in ran.events)


def test_hands_reach_the_specimen_only_at_measured_rest_with_high_voltage_off(tmp_path: Path) -> None:
    protocol = Levels(setups=(1, 1, 2, 2))
    with laboratory() as lab:
        operator = Handy(lab.operator)
        states: list[bool] = []
        show = operator.show

        def watching(ask_id: int, prompt: Prompt) -> None:
            if prompt.action == "fix-mass":
                states.append(high_voltage(lab))
            show(ask_id, prompt)

        operator.show = watching  # type: ignore[method-assign]
        ran = run(protocol, tmp_path, lab, operator=operator)
        told = rehearse(protocol, lab.bench.amplifier)
    assert ran.status == Status.COMPLETED
    off, on = "disable-high-voltage", "enable-high-voltage"
    assert [p.action for p in operator.asked] == [off, on, off, "fix-mass", on, off, "fix-mass", on]
    assert states == [False, False]
    assert told.prompts == len(operator.asked)


def test_an_entry_can_ask_for_itself_or_the_one_before_again(tmp_path: Path) -> None:
    asked = {1: [Redo.THIS], 2: [Redo.PREVIOUS]}

    class Fussy(Levels):
        name: ClassVar[str] = "fussy"

        def measure(self, entry: Planned, rest_v: float) -> Generator[Step, Any, Redo | None]:
            yield from Levels.measure(self, entry, rest_v)
            wish = asked.get(self.levels_v.index(entry.key[0]), [])
            return wish.pop() if wish else None

    with laboratory() as lab:
        ran = run(Fussy(), tmp_path, lab)
    assert ran.status == Status.COMPLETED
    assert [e.index for e in ran.events if isinstance(e, EntryBegan)] == [0, 1, 1, 2, 1, 2, 3]
    with Run(ran.path) as file:
        columns = file.points()
        assert columns["entry"].tolist() == [0, 1, 1, 2, 3]
        flags = [Quality(int(q)) for q in columns["quality"]]
        assert [Quality.SUPERSEDED in flag for flag in flags] == [False, True, False, False, False]
        assert not flags[1].usable
        assert {e.name: e.value for e in file.estimates()} == {"count": 4.0}
    replaced = [(e.index, e.replaces) for e in ran.events if isinstance(e, PointMeasured) and e.replaces is not None]
    assert replaced == [(2, 1)]


def test_a_protocol_may_ask_for_more_once_all_is_measured(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(Levels(levels_v=(2.0,), more_v=(2.1, 2.9)), tmp_path, lab)
    assert [p.level for p in ran.points] == [2.0, 2.1, 2.9]


def test_an_entry_without_a_point_is_told_and_the_run_goes_on(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(Levels(levels_v=(2.0, 2.222, 3.0)), tmp_path, lab)
    assert ran.status == Status.COMPLETED
    assert ran.reason == "2 of 3 points; none from 2.222 V"
    assert [p.level for p in ran.points] == [2.0, 3.0]


def test_what_was_stopped_goes_on_as_one_run(known: None, tmp_path: Path) -> None:
    cancel = threading.Event()
    with laboratory() as lab:
        second = Trigger(lambda e: isinstance(e, PointMeasured) and e.index == 1, cancel.set)
        first = run(LEVELS, tmp_path, lab, second, cancel=cancel)
        assert first.status == Status.STOPPED
        ran = resumed(first.path, tmp_path, lab)
    assert ran.status == Status.COMPLETED
    assert any("Drift check at 2.2 V" in e.text for e in ran.events if isinstance(e, Noted))
    with Run(ran.path) as file:
        columns = file.points()
        good = [Quality(int(q)).usable for q in columns["quality"]]
        assert columns["level"][good].tolist() == [2.0, 2.2, 2.8, 3.0]
        assert file.continues == first.path
        assert [r.entry for r in file.recordings()] == [0, 1, 1, 2, 3]
        again = {r.entry: LEVELS.point((LEVELS.levels_v[r.entry],), [r], file.simulated) for r in file.recordings()}
        for level, moved, entry, usable in zip(
            columns["level"], columns["displacement"], columns["entry"], good, strict=True
        ):
            if usable:
                assert (again[entry].level, again[entry].displacement) == (level, moved)
    with h5py.File(ran.path) as plain:  # what anybody's reader sees
        assert plain["entry/earlier/trace/drive"].shape[0] > 0


def test_points_can_be_measured_again_into_a_continuation(known: None, tmp_path: Path) -> None:
    with laboratory() as lab:
        first = run(LEVELS, tmp_path, lab)
        ran = resumed(first.path, tmp_path, lab, again=(2,))
    assert [e.index for e in ran.events if isinstance(e, EntryBegan)] == [2]
    with Run(ran.path) as file:
        flags = [Quality(int(q)) for q in file.points()["quality"]]
        assert [Quality.SUPERSEDED in flag for flag in flags] == [False, False, True, False, False]


def test_a_moved_sensor_is_noticed_before_a_run_goes_on(known: None, tmp_path: Path) -> None:
    cancel = threading.Event()
    with laboratory() as lab:
        second = Trigger(lambda e: isinstance(e, PointMeasured) and e.index == 1, cancel.set)
        first = run(LEVELS, tmp_path, lab, second, cancel=cancel)
    with laboratory(simulated(sensor={"zero_v": 0.5})) as lab:
        operator = Handy(lab.operator)
        ran = resumed(first.path, tmp_path, lab, operator=operator)
    question = operator.asked[-1]
    assert question.action == "drifted"
    assert question.choices == ("go on", "stop")
    assert ran.status == Status.COMPLETED


def test_what_cannot_be_gone_on_with_is_a_sentence(known: None, tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(Levels(levels_v=(2.0,)), tmp_path, lab)
    with pytest.raises(RunError, match="is complete: there is nothing to resume"):
        earlier(ran.path)
    with pytest.raises(RunError, match="has no point of entry 7"):
        earlier(ran.path, again=(7,))


def test_without_high_voltage_it_is_switched_off_and_the_drive_seen_at_rest(tmp_path: Path) -> None:
    class Shorted(Levels):
        name: ClassVar[str] = "shorted"
        high_voltage: ClassVar[bool] = False

        def plan(self, rest_v: float) -> tuple[Planned, ...]:
            return (Planned("weight", (), 1.0, ("weight",), Prompt("load", "Place it", hands_on=True)),)

        def measure(self, entry: Planned, rest_v: float) -> Generator[Step, Any, Redo | None]:
            yield Record(0.2)
            return None

        def point(self, key: Any, recordings: Sequence[Recording], simulated: bool) -> Level:
            return Levels.point(self, (2.5,), recordings, simulated)

    with laboratory() as lab:
        run(LEVELS, tmp_path, lab)  # leaves high voltage on
        operator = Handy(lab.operator)
        ran = run(Shorted(), tmp_path, lab, operator=operator)
        assert not high_voltage(lab)
    assert ran.status == Status.COMPLETED
    assert [p.action for p in operator.asked] == ["disable-high-voltage", "load"]


class Landing:
    """Sees something after some samples."""

    def __init__(self, after: int) -> None:
        self.left = after

    def feed(self, drive_v: Any, displacement_m: Any) -> bool:
        self.left -= len(displacement_m)
        return self.left <= 0


@pytest.mark.parametrize(("action", "seen", "words"), [("never", True, "seen by the laser"), ("ready", False, "done")])
def test_a_wait_ends_by_what_the_laser_sees_or_by_the_operator(
    action: str, seen: bool, words: str, tmp_path: Path
) -> None:
    ended: list[Any] = []

    class Waiting(Levels):
        name: ClassVar[str] = "waiting"

        def measure(self, entry: Planned, rest_v: float) -> Generator[Step, Any, Redo | None]:
            ended.append((yield Await(Prompt(action, "Place it"), Landing(2000))))
            yield Ask(Prompt("then", "Then?"))
            return (yield from Levels.measure(self, entry, rest_v))

    with laboratory() as lab:
        ran = run(Waiting(levels_v=(2.0,)), tmp_path, lab, operator=Handy(lab.operator))
    assert ran.status == Status.COMPLETED
    assert ended[0].seen == seen
    asked = next(e.ask_id for e in ran.events if isinstance(e, Asked) and e.prompt.action == action)
    assert words in [e.words for e in ran.events if isinstance(e, Answered) and e.ask_id == asked]


@pytest.mark.parametrize("step", [Ask(Prompt("bump", "Go")), Await(Prompt("bump", "Go"), Landing(10**9))])
def test_what_the_card_saw_before_the_answer_is_not_in_the_recording_after_it(step: Step, tmp_path: Path) -> None:
    class Late(Handy):
        """The program is two seconds behind the card when the answer comes."""

        def answer(self, ask_id: int) -> str | None:
            words = super().answer(ask_id)
            if words and self.asked[-1].action == "bump":
                lab.control.clock.sleep(2.0)
                lab.control.hands("bump-sensor", {"by_m": 1e-4})
            return words

    class Bumped(Levels):
        name: ClassVar[str] = "bumped"

        def measure(self, entry: Planned, rest_v: float) -> Generator[Step, Any, Redo | None]:
            yield step
            lowest.append(float((yield Record(0.2)).displacement_m.min()))
            return None

    lowest: list[float] = []
    with laboratory() as lab:
        run(Bumped(levels_v=(2.0,)), tmp_path, lab, operator=Late(lab.operator))
    assert lowest[0] > 9e-5


def test_a_labs_own_file_is_a_protocol_and_a_broken_one_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "PROTOCOLS", dict(registry.PROTOCOLS))
    good = tmp_path / "mine.py"
    good.write_text(
        "from protocols.sine_dwell import SineDwell\n\nclass Mine(SineDwell):\n    name = 'mine'\n    title = 'Mine'\n"
    )
    assert registry.load_file(good).name == "mine"
    assert "mine" in registry.PROTOCOLS
    for text, says in (
        ("1 / 0\n", "does not run: ZeroDivisionError"),
        ("x = 1\n", "it defines none"),
        (
            "from protocols.sine_dwell import SineDwell\n\nclass Mine(SineDwell):\n    title = 'x'\n",
            "sine-dwell' already",
        ),
        ("from protocols.protocol import Protocol\n\nclass Half(Protocol):\n    name = 'half'\n", "lacks title"),
    ):
        bad = tmp_path / "bad.py"
        bad.write_text(text)
        with pytest.raises(registry.ProtocolFileError, match=says):
            registry.load_file(bad)
