"""Protocol of levels, an operator that answers prompts, and a resumed run, for tests."""

from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Unit

from drivers.drive_shapes import Drive, Hold
from protocols.base import (
    EstimatedQuantity,
    EventBus,
    PlanEntry,
    Play,
    Prompt,
    Protocol,
    Quality,
    Record,
    Recording,
    Repeat,
    Step,
)
from protocols.runner.request import RunRequest
from protocols.runner.runner import Runner
from sim_hardware.testing.safe_volts import assert_safe_voltage
from tests.helpers.simulated_bench import Ran


@dataclass(frozen=True, slots=True)
class Level:
    """What was seen at one level."""

    level: Annotated[float, Unit("V"), "level commanded"]
    displacement: Annotated[float, Unit("m"), "mean displacement"]
    displacement_errors: Annotated[float, Unit("m"), "standard uncertainty"]
    quality: Annotated[int, Unit("1"), "flags"]


class Levels(Protocol):
    """Holds levels one after the other; flags select further steps."""

    name: ClassVar[str] = "levels"
    rest_record_s: ClassVar[float] = 0.0
    title: ClassVar[str] = "Levels"
    point_type: ClassVar[type] = Level
    axes: ClassVar[tuple[str, str]] = ("level", "displacement")
    levels_v: tuple[float, ...] = (2.0, 2.2, 2.8, 3.0)
    setups: tuple[int, ...] = ()
    more_v: tuple[float, ...] = ()
    sample_rate_hz: float = 5000.0
    script: ClassVar[dict[int, list[Any]]] = {}

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        setups = self.setups or (0,) * len(self.levels_v)
        return tuple(self._entry(v, s) for v, s in zip(self.levels_v, setups, strict=True))

    def _entry(self, level_v: float, setup: int) -> PlanEntry:
        prompt = Prompt("fix-mass", f"Fix mass {setup}", {"mass_kg": float(setup)}, hands_on=True) if setup else None
        return PlanEntry(f"{level_v:g} V", (Hold(level_v, 10.0),), 0.6, (level_v,), prompt)

    def refine(self, points: Sequence[Any], rest_v: float) -> tuple[PlanEntry, ...]:
        have = [point.level for point in points]
        return tuple(self._entry(v, 0) for v in self.more_v if v not in have)

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, Repeat | None]:
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

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        return (EstimatedQuantity("count", float(len(list(points))), 0.0, "1", "here"),)


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
    """Resume a run, as a session does."""
    events: list[Any] = []
    request = RunRequest.resuming(path, folder, again)
    runner = Runner(request, lab.bench, operator or lab.operator, EventBus(events.append))
    ended = runner.run()
    report = lab.control.report()
    assert_safe_voltage(report)
    return Ran(ended.status, ended.reason, runner.path, events, report, lab, ended.verdict)


def high_voltage(lab: Any) -> bool:
    """Whether it is on at this moment, as the simulated world has it."""
    _, on = lab.control.history.read(np.array([lab.bench.clock.now()]))
    return bool(on[0])
