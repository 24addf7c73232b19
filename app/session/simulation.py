"""Speed of a simulated bench, and who answers its prompts; both are chosen by the operator."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from app.common import format_duration
from app.session.session import ConnectedBench
from protocols.base import Operator, Prompt

if TYPE_CHECKING:
    from drivers import Bench
    from sim_hardware import SimulatedOperator

Connect = Callable[[], AbstractContextManager[ConnectedBench]]


class AnsweredBy(StrEnum):
    """Who answers the prompts of a simulated bench."""

    USER_IN_CAMPAIGN = "me, in a campaign"
    USER = "me"
    SIMULATION = "the simulation"


@dataclass(slots=True)
class SimulationSettings:
    """Settings of a simulated bench that the operator changes in the window.

    Args:
        speed: bench seconds per second; None is the virtual clock. A change needs a new connection.
        answered_by: who answers prompts; the virtual clock does not wait for a person.
    """

    speed: float | None
    answered_by: AnsweredBy = AnsweredBy.USER_IN_CAMPAIGN
    in_campaign: bool = False
    """Whether the present run belongs to a campaign."""

    @property
    def asks_user(self) -> bool:
        """Whether the next prompt waits for the user."""
        if self.speed is None or self.answered_by is AnsweredBy.SIMULATION:
            return False
        return self.in_campaign or self.answered_by is AnsweredBy.USER


class PractisingOperator:
    """Asks a person where the settings say so, and does on the simulated bench what the person confirms.

    Args:
        user: the window or terminal.
        simulated: acts on the simulated bench.
        settings: read at every prompt.
    """

    def __init__(self, user: Operator, simulated: "SimulatedOperator", settings: SimulationSettings) -> None:
        self._user, self._simulated, self._settings = user, simulated, settings
        self._asked: dict[int, Prompt] = {}

    def clear_specimen(self) -> None:
        """Remove what a stopped run left on the specimen."""
        self._asked.clear()
        self._simulated.clear_specimen()

    def show(self, ask_id: int, prompt: Prompt) -> None:
        if self._settings.asks_user:
            self._asked[ask_id] = prompt
            self._user.show(ask_id, prompt)
        else:
            self._simulated.show(ask_id, prompt)

    def answer(self, ask_id: int) -> str | None:
        """Return the answer; one that confirms an action is returned when the action is done."""
        if (prompt := self._asked.get(ask_id)) is not None:
            choice = self._user.answer(ask_id)
            if choice is None:
                return None
            del self._asked[ask_id]
            if choice != prompt.choices[0]:
                return choice
            self._simulated.show(ask_id, prompt, patience_s=0.0)
        return self._simulated.answer(ask_id)


def practise(connect: Connect, user: Operator, settings: SimulationSettings) -> Connect:
    """Return `connect` with an operator that answers prompts as the settings say."""

    @contextmanager
    def connected() -> Iterator[ConnectedBench]:
        from app.session.bench_connection import BenchConnection
        from sim_hardware import SimulatedOperator

        with connect() as connection:
            if isinstance(connection.operator, SimulatedOperator):
                operator = PractisingOperator(user, connection.operator, settings)
                yield BenchConnection(connection.bench, operator, connection.control)
            else:
                yield connection

    return connected


def real_duration_s(seconds: float, bench: "Bench | None") -> float:
    """Return how long bench time takes at the bench's speed; bench time itself on the virtual clock."""
    speed = 1.0 if bench is None else bench.configuration.get("speed", 1.0)
    return seconds / speed if isinstance(speed, int | float) else seconds


def format_bench_duration(seconds: float, bench: "Bench | None") -> str:
    """Return how long bench time takes, with the speed of a simulated bench that is not real time."""
    duration = format_duration(real_duration_s(seconds, bench))
    speed = 1.0 if bench is None else bench.configuration.get("speed", 1.0)
    if not isinstance(speed, int | float):
        return f"{duration} of bench time"
    return duration if speed == 1.0 else f"{duration} at {speed:g} times real speed"
