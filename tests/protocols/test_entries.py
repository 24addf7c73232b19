"""Plan entries: pause, measuring again, resume, manual steps on the specimen, refinement."""

import threading
from collections.abc import Generator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, cast

import pytest

from drivers.bench.armed_bench import ArmedBench
from protocols import registry
from protocols.base import (
    Ask,
    BlockDiscarded,
    EntryStarted,
    PlanEntry,
    PointMeasured,
    Prompt,
    PromptAnswered,
    PromptShown,
    Quality,
    Record,
    Recording,
    Repeat,
    RunPaused,
    RunResumed,
    RunStatus,
    Step,
    WaitForDetection,
)
from protocols.rehearsal import rehearse
from protocols.runfile.reader import Run
from protocols.runner.operator_actions import OperatorActions, OperatorPrompts
from tests.helpers.level_protocol import LEVELS, Handy, Level, Levels, high_voltage
from tests.helpers.simulated_bench import Trigger, laboratory, run


@pytest.mark.one_in(2)
@pytest.mark.parametrize("moment", ["EntryBegan", "Playing", "SettleEnded", "BlockTaken"])
def test_a_pause_goes_to_measured_rest_and_measures_the_interrupted_entry_again(moment: str, tmp_path: Path) -> None:
    pause = threading.Event()
    seen: list[bool] = []
    waited = [0]

    def watch(event: Any) -> None:
        if isinstance(event, RunPaused):
            seen.append("rest" in event.words)
        waited[0] += isinstance(event, BlockDiscarded)
        if waited[0] == 5:
            pause.clear()

    with laboratory() as lab:
        begun = [0]

        def when(event: Any) -> bool:
            begun[0] += isinstance(event, EntryStarted)
            return begun[0] == 2 and event.kind == moment

        ran = run(LEVELS, tmp_path, lab, Trigger(when, pause.set), watch, pause=pause)
    assert ran.status == RunStatus.COMPLETED
    assert seen == [True]
    assert [p.level for p in ran.points] == [2.0, 2.2, 2.8, 3.0]
    assert [e.index for e in ran.events if isinstance(e, EntryStarted)] == [0, 1, 1, 2, 3]
    kinds = ran.kinds()
    assert kinds.index("Paused") < kinds.index("Resumed")


def test_a_set_up_that_was_interrupted_is_asked_for_again_even_if_it_is_the_one_before() -> None:
    """Half of the change may be done: the specimen then has neither set-up."""
    asked: list[str] = []

    class Prompts:
        def ask(self, prompt: Prompt) -> str:
            asked.append(prompt.text)
            if asked == ["light", "heavy"]:
                raise KeyboardInterrupt
            return ""

        mount = ask

    actions = OperatorActions(cast("OperatorPrompts", Prompts()), high_voltage=False)
    light, heavy = Prompt("mass", "light"), Prompt("mass", "heavy")
    armed = cast("ArmedBench", None)  # without high voltage it is not used
    for setup in (light, light, heavy, light):
        with suppress(KeyboardInterrupt):
            actions.set_up(armed, setup)
    assert asked == ["light", "heavy", "light"]


def test_a_paused_run_can_be_stopped(tmp_path: Path) -> None:
    pause, cancel = threading.Event(), threading.Event()
    with laboratory() as lab:
        hold = Trigger(lambda e: isinstance(e, EntryStarted), pause.set)
        end = Trigger(lambda e: isinstance(e, RunPaused), cancel.set)
        ran = run(LEVELS, tmp_path, lab, hold, end, cancel=cancel, pause=pause)
    assert ran.status == RunStatus.STOPPED
    assert not any(isinstance(e, RunResumed) for e in ran.events)


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
        rehearsal = rehearse(protocol, lab.bench.amplifier)
    assert ran.status == RunStatus.COMPLETED
    off, on = "disable-high-voltage", "enable-high-voltage"
    assert [p.action for p in operator.asked] == [off, on, off, "fix-mass", on, off, "fix-mass", on]
    assert states == [False, False]
    assert rehearsal.prompts == len(operator.asked)


@pytest.mark.deep
def test_an_entry_can_ask_for_itself_or_the_one_before_again(tmp_path: Path) -> None:
    asked = {1: [Repeat.THIS], 2: [Repeat.PREVIOUS]}

    class Fussy(Levels):
        name: ClassVar[str] = "fussy"

        def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, Repeat | None]:
            yield from Levels.measure(self, entry, rest_v)
            wish = asked.get(self.levels_v.index(entry.key[0]), [])
            return wish.pop() if wish else None

    with laboratory() as lab:
        ran = run(Fussy(), tmp_path, lab)
    assert ran.status == RunStatus.COMPLETED
    assert [e.index for e in ran.events if isinstance(e, EntryStarted)] == [0, 1, 1, 2, 1, 2, 3]
    with Run(ran.path) as file:
        columns = file.points()
        assert columns["entry"].tolist() == [0, 1, 1, 2, 3]
        flags = [Quality(int(q)) for q in columns["quality"]]
        assert [Quality.SUPERSEDED in flag for flag in flags] == [False, True, False, False, False]
        assert not flags[1].usable
        assert {e.name: e.value for e in file.record.estimates} == {"count": 4.0}
    replaced = [(e.index, e.replaces) for e in ran.events if isinstance(e, PointMeasured) and e.replaces is not None]
    assert replaced == [(2, 1)]


def test_a_protocol_may_ask_for_more_once_all_is_measured(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(Levels(levels_v=(2.0,), more_v=(2.1, 2.9)), tmp_path, lab)
    assert [p.level for p in ran.points] == [2.0, 2.1, 2.9]


def test_an_entry_without_a_point_is_told_and_the_run_goes_on(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(Levels(levels_v=(2.0, 2.222, 3.0)), tmp_path, lab)
    assert ran.status == RunStatus.COMPLETED
    assert ran.reason == "2 of 3 points; none from 2.222 V"
    assert [p.level for p in ran.points] == [2.0, 3.0]


def test_without_high_voltage_it_is_switched_off_and_the_drive_seen_at_rest(tmp_path: Path) -> None:
    class Shorted(Levels):
        name: ClassVar[str] = "shorted"
        high_voltage: ClassVar[bool] = False

        def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
            return (PlanEntry("weight", (), 1.0, ("weight",), Prompt("load", "Place it", hands_on=True)),)

        def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, Repeat | None]:
            yield Record(0.2)
            return None

        def point(self, key: Any, recordings: Sequence[Recording], simulated: bool) -> Level:
            return Levels.point(self, (2.5,), recordings, simulated)

    with laboratory() as lab:
        run(LEVELS, tmp_path, lab)  # leaves high voltage on
        operator = Handy(lab.operator)
        ran = run(Shorted(), tmp_path, lab, operator=operator)
        assert not high_voltage(lab)
    assert ran.status == RunStatus.COMPLETED
    assert [p.action for p in operator.asked] == ["disable-high-voltage", "load"]


class Landing:
    """Detects a step after a number of samples."""

    def __init__(self, after: int) -> None:
        self.left = after

    def feed(self, drive_v: Any, displacement_m: Any) -> bool:
        self.left -= len(displacement_m)
        return self.left <= 0


@pytest.mark.parametrize(
    ("action", "seen", "message"), [("never", True, "seen by the laser"), ("ready", False, "done")]
)
def test_a_wait_ends_by_what_the_laser_sees_or_by_the_operator(
    action: str, seen: bool, message: str, tmp_path: Path
) -> None:
    ended: list[Any] = []

    class Waiting(Levels):
        name: ClassVar[str] = "waiting"

        def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, Repeat | None]:
            ended.append((yield WaitForDetection(Prompt(action, "Place it"), Landing(2000))))
            yield Ask(Prompt("then", "Then?"))
            return (yield from Levels.measure(self, entry, rest_v))

    with laboratory() as lab:
        ran = run(Waiting(levels_v=(2.0,)), tmp_path, lab, operator=Handy(lab.operator))
    assert ran.status == RunStatus.COMPLETED
    assert ended[0].detected == seen
    ask_id = next(e.ask_id for e in ran.events if isinstance(e, PromptShown) and e.prompt.action == action)
    assert message in [e.words for e in ran.events if isinstance(e, PromptAnswered) and e.ask_id == ask_id]


@pytest.mark.parametrize("step", [Ask(Prompt("bump", "Go")), WaitForDetection(Prompt("bump", "Go"), Landing(10**9))])
def test_what_the_card_saw_before_the_answer_is_not_in_the_recording_after_it(step: Step, tmp_path: Path) -> None:
    class Late(Handy):
        """The program is two seconds behind the card when the answer comes."""

        def answer(self, ask_id: int) -> str | None:
            text = super().answer(ask_id)
            if text and self.asked[-1].action == "bump":
                lab.control.clock.sleep(2.0)
                lab.control.perform_action("bump-sensor", {"by_m": 1e-4})
            return text

    class Bumped(Levels):
        name: ClassVar[str] = "bumped"

        def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, Repeat | None]:
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
        "from protocols.measurements.sine_dwell import SineDwell\n\nclass Mine(SineDwell):\n    name = 'mine'\n    title = 'Mine'\n"
    )
    assert registry.load_protocol_file(good).name == "mine"
    assert "mine" in registry.PROTOCOLS
    for text, says in (
        ("1 / 0\n", "does not run: ZeroDivisionError"),
        ("x = 1\n", "it defines none"),
        (
            "from protocols.measurements.sine_dwell import SineDwell\n\nclass Mine(SineDwell):\n    title = 'x'\n",
            "sine-dwell' already",
        ),
        ("from protocols.base.protocol import Protocol\n\nclass Half(Protocol):\n    name = 'half'\n", "lacks title"),
    ):
        bad = tmp_path / "bad.py"
        bad.write_text(text)
        with pytest.raises(registry.ProtocolFileError, match=says):
            registry.load_protocol_file(bad)


@pytest.mark.parametrize(
    ("method", "status"),
    [
        ("plan(self, rest_v)", RunStatus.FAILED),
        ("measure(self, entry, rest_v)", RunStatus.FAILED),
        ("point(self, key, recordings, simulated)", RunStatus.FAILED),
        ("estimates(self, points)", RunStatus.COMPLETED),
    ],
)
def test_an_error_in_a_labs_own_file_names_its_line(
    method: str, status: RunStatus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(registry, "PROTOCOLS", dict(registry.PROTOCOLS))
    path = tmp_path / "wrong.py"
    path.write_text(
        "from protocols.measurements.sine_dwell import SineDwell\n\nclass Wrong(SineDwell):\n    name = 'wrong'\n"
        f"    title = 'Wrong'\n    def {method}:\n        return 1 / 0\n"
    )
    protocol = registry.load_protocol_file(path)(frequencies_hz=(200.0,), record_s=0.05)
    with laboratory() as lab:
        ran = run(protocol, tmp_path, lab)
    assert ran.status is status
    assert f"{path}, line 7: ZeroDivisionError" in ran.reason
    assert not caplog.records, "no traceback of this program"
    report = lab.control.report()
    assert report.ends_at_rest or not report.live_s
