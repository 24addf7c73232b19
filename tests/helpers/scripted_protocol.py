"""Scripted protocol for tests: yields given steps and records their results."""

from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from annotated_types import Unit
from pydantic import Field

from drivers.drive_shapes import Sine
from protocols.base import EstimatedQuantity, PlanEntry, Prompt, Protocol, Recording, Settle, Step
from protocols.measurements.sine_dwell import SineDwell

SHORT = SineDwell(frequencies_hz=(100, 160), record_s=0.1, min_cycles=10)


@dataclass(frozen=True, slots=True)
class Spot:
    """A point of the test protocol."""

    frequency: Annotated[float, Unit("Hz"), "frequency"]
    mean: Annotated[float, Unit("m"), "mean displacement"]


class Scripted(Protocol):
    """Yields the steps it was given."""

    name: ClassVar[str] = "scripted"
    rest_record_s: ClassVar[float] = 0.0
    title: ClassVar[str] = "Scripted"
    point_type: ClassVar[type] = Spot
    axes: ClassVar[tuple[str, str]] = ("frequency", "mean")
    script: Any = Field(default=(), exclude=True)
    sample_rate_hz: float = 5000.0

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        return (PlanEntry("only", (Sine(100, 1, rest_v, 300),), 1.0),)

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, None]:
        for step in self.script:
            answer = yield step() if callable(step) else step
            self.__dict__.setdefault("answers", []).append(answer)

    def point(self, key: Any, recordings: Sequence[Recording], simulated: bool) -> Spot:
        if not recordings:
            raise ValueError("nothing was recorded")
        return Spot(100.0, float(recordings[-1].displacement_m.mean()))

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        return ()


SETTLE = Settle(Sine(100, 1, 2.5, 300), 0.02, 0.01, 1.0)


class Hesitant:
    """Answers the run's prompts late, as an operator does; the card continues sampling meanwhile."""

    def __init__(self, hands: Any, polls: int) -> None:
        self.hands, self.polls = hands, polls

    def show(self, ask_id: int, prompt: Prompt) -> None:
        self.left = self.polls
        self.hands.show(ask_id, prompt)

    def answer(self, ask_id: int) -> str | None:
        self.left -= 1
        return self.hands.answer(ask_id) if self.left <= 0 else None
