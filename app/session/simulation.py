"""A simulated bench in a session: its speed, who answers its prompts, its planned faults, and the sheet that its laboratory writes.

`practise` and `FaultPlan.wrap` wrap the connection between composition root and session; a `FaultPlan` is also an observer.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from enum import StrEnum
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.common import UsageError, format_duration
from app.session.session import ConnectedBench, SessionEvent
from drivers import open_regular
from protocols.base import (
    InjectedFaultChanged,
    Operator,
    Prompt,
    RunStarted,
    SpecimenMounted,
    parse_toml,
    write_atomic,
)
from protocols.runfile import sheet_path
from sim_hardware.plant import FAULT_DESCRIPTIONS

if TYPE_CHECKING:
    from drivers import Bench
    from sim_hardware import BenchControls, SimulatedOperator

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

    def clear_specimen(self, mountings: Sequence[SpecimenMounted] = (), cycles: float | None = None) -> None:
        """Remove what a stopped run left on the specimen, which stays as it was mounted."""
        self._pending.clear()
        self._simulated.clear_specimen(mountings, cycles)

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


@dataclass(frozen=True, slots=True)
class PlannedFault:
    """A fault and its time after the start of the run, in bench seconds."""

    name: str
    after_s: float = 0.0


def parse_planned_fault(text: str) -> PlannedFault:
    """Parse `NAME` or `NAME@SECONDS`.

    Raises:
        UsageError: there is no such fault, or the seconds are not a number from 0 on.
    """
    name, at, seconds = text.partition("@")
    if name not in FAULT_DESCRIPTIONS:
        raise UsageError(
            f"there is no fault '{name}'; 'tactor-bench faults' lists them: {', '.join(FAULT_DESCRIPTIONS)}"
        )
    try:
        after_s = float(seconds) if at else 0.0
    except ValueError:
        after_s = -1.0
    if not 0 <= after_s < 1e6:
        raise UsageError(f"--fault {text}: write NAME@SECONDS, for example {name}@5, in seconds of bench time")
    return PlannedFault(name, after_s)


class FaultPlan:
    """Injects each fault once, at the first event after it is due. Blocks are events, so that is within a block."""

    def __init__(self, faults: Sequence[PlannedFault] = ()) -> None:
        self._pending = sorted(faults, key=lambda fault: fault.after_s)
        self._connection: ConnectedBench | None = None
        self._begin_s: float | None = None
        self.on_switched: Callable[[InjectedFaultChanged], object] = lambda _: None
        """Called when a fault was injected or cleared, in that thread; usually `Session.inject_event`."""

    def wrap(self, connect: Connect) -> Connect:
        """Return `connect` wrapped so that this plan gets the connected bench."""

        @contextmanager
        def connected() -> Iterator[ConnectedBench]:
            with connect() as connection:
                self._connection = connection
                try:
                    yield connection
                finally:
                    self._connection = None

        return connected

    def inject(self, name: str) -> None:
        """Inject a fault now; waits for the bench's reply.

        Raises:
            UsageError: the bench is not open, or is real.
            BenchError: the simulated bench has died.
        """
        controls = self._controls()
        before = controls.active_faults()
        controls.inject(name)
        if name not in before:
            self._report_switched(name, active=True)

    def clear(self, name: str | None = None) -> None:
        """Clear one fault, or all; raises as `inject`."""
        controls = self._controls()
        before = controls.active_faults()
        controls.clear(name)
        for each in before:
            if name in (None, each):
                self._report_switched(each, active=False)

    def move_target(self, by_m: float) -> None:
        """Move the target under the sensor of a simulated bench, as a micrometer would; raises as `inject`."""
        self._controls().perform_action("bump-sensor", {"by_m": by_m})

    def active_faults(self) -> tuple[str, ...]:
        """Return the active faults reported by the bench; empty if none is open."""
        return () if self._connection is None else self._controls().active_faults()

    def __call__(self, event: SessionEvent) -> None:
        if self._connection is None:
            return
        now_s = self._connection.bench.clock.now()
        if isinstance(event, RunStarted):
            if self._begin_s is None:
                self._begin_s = now_s
            for name in self.active_faults() if self._connection.control is not None else ():
                self._report_switched(name, active=True)  # recorded in this run's file, too
        while self._begin_s is not None and self._pending and now_s - self._begin_s >= self._pending[0].after_s:
            self.inject(self._pending.pop(0).name)

    def _report_switched(self, name: str, active: bool) -> None:
        self.on_switched(InjectedFaultChanged(name, FAULT_DESCRIPTIONS[name], active))

    def _controls(self) -> "BenchControls":
        if self._connection is None or self._connection.control is None:
            raise UsageError("faults can be injected into an open simulated bench only")
        return self._connection.control


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
            with open_regular(path) as file:
                described = parse_toml(file.read().decode())
            if source or not described.get("simulated"):
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
