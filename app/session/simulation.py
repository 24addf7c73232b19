"""Speed of a simulated bench, who answers its prompts, and the specimen sheet that its laboratory writes beside the first run."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from enum import StrEnum
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.common import format_duration, parse_toml
from app.session.session import ConnectedBench
from protocols.base import Operator, Prompt, SpecimenMounted, write_atomic
from protocols.runfile import sheet_path

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
    """Prompts a person by the settings, and performs the confirmed actions on the simulated bench.

    Args:
        user: the window or terminal.
        simulated: operator of the simulated bench.
        settings: read at every prompt.
    """

    def __init__(self, user: Operator, simulated: "SimulatedOperator", settings: SimulationSettings) -> None:
        self._user, self._simulated, self._settings = user, simulated, settings
        self._pending: dict[int, Prompt] = {}

    def clear_specimen(self, mountings: Sequence[SpecimenMounted] = ()) -> None:
        """Remove what a stopped run left on the specimen, which stays as it was mounted."""
        self._pending.clear()
        self._simulated.clear_specimen(mountings)

    def show(self, ask_id: int, prompt: Prompt) -> None:
        if self._settings.asks_user:
            self._pending[ask_id] = prompt
            self._user.show(ask_id, prompt)
        else:
            self._simulated.show(ask_id, prompt)

    def answer(self, ask_id: int) -> str | None:
        """Return the answer; the confirmation of an action is returned after the action."""
        if (prompt := self._pending.get(ask_id)) is not None:
            choice = self._user.answer(ask_id)
            if choice is None:
                return None
            del self._pending[ask_id]
            if choice != prompt.choices[0]:
                return choice
            self._simulated.show(ask_id, prompt, patience_s=0.0)
        return self._simulated.answer(ask_id)


def practise(connect: Connect, user: Operator, settings: SimulationSettings) -> Connect:
    """Return `connect` with an operator that answers prompts by the settings."""

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


SHEET_HEAD = """# Specimen sheet of a simulated specimen: measurements of its laboratory, with errors within the stated uncertainty.
# Uncertainties are standard uncertainties (k = 1). Values not listed here are the paper's Table I, with the uncertainty of ruler, caliper or scale.
# Another bench's specimen needs another name.

"""


def provide_sheet(configuration: Mapping[str, Any], folder: Path, specimen: str) -> str:
    """Write the sheet of a simulated bench's specimen beside its runs if there is none; return a message, or an empty text.

    A sheet that was written for another bench is left as it is, and the message names it.

    Args:
        configuration: of the bench, as a run file stores it; `sheet` of its table `simulation` names the file.
        folder: of the runs.
        specimen: the name under which the specimen is measured.
    """
    source = str((configuration.get("simulation") or {}).get("sheet", ""))
    if not specimen:
        return ""
    path = sheet_path(folder, specimen)
    try:
        if path.exists():
            if source or not parse_toml(path.read_text("utf-8")).get("simulated"):
                return ""
            return f"{path.name} describes the specimen of another, simulated bench; give this one another name, or delete that file"
        if not source:
            return ""
        text = resources.files("sim_hardware").joinpath(Path(source).name).read_text("utf-8")
        _, key, rest = text.partition("specimen = ")
        entries = rest.partition("\n")[2]
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, f"{SHEET_HEAD}{key}{json.dumps(specimen, ensure_ascii=False)}\n{entries}")
    except (OSError, ValueError):  # the run reports a folder without access; the fits report a damaged sheet
        return ""
    return f"Wrote {path.name}: dimensions and masses of the simulated specimen with their uncertainties, which every fit of its runs uses"
