"""Fault injection: switches faults of a simulated bench when they are due.

`FaultPlan.wrap` wraps the connection between composition root and session; the plan itself is an observer of the session.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.common import UsageError
from app.session.session import ConnectedBench, SessionEvent
from protocols.base import InjectedFaultChanged, RunStarted
from sim_hardware.plant import FAULT_DESCRIPTIONS

if TYPE_CHECKING:
    from sim_hardware import BenchControls

Connect = Callable[[], AbstractContextManager[ConnectedBench]]


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
