"""Faults of a simulated bench, broken when they are due: for `run --fault`, for the window, for a lesson.

A plan is put between the composition root and the session (`wrap`) and among the session's observers (itself).
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.common.errors import UsageError
from app.session.session import ConnectedBench, SessionEvent
from protocols.base import InjectedFaultChanged, RunStarted
from sim_hardware.plant.faults import FAULT_DESCRIPTIONS

if TYPE_CHECKING:
    from sim_hardware.operator import BenchControls

Connect = Callable[[], AbstractContextManager[ConnectedBench]]


@dataclass(frozen=True, slots=True)
class PlannedFault:
    """What breaks, and how long after the run has begun, in bench seconds."""

    name: str
    after_s: float = 0.0


def parse_planned_fault(text: str) -> PlannedFault:
    """The fault that `NAME` or `NAME@SECONDS` means.

    Raises:
        UsageError: there is no such fault, or the seconds are no number from 0 on.
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
    """Breaks each fault once, at the first event after it is due. Blocks are events, so that is within a block."""

    def __init__(self, faults: Sequence[PlannedFault] = ()) -> None:
        self._pending = sorted(faults, key=lambda fault: fault.after_s)
        self._connection: ConnectedBench | None = None
        self._begin_s: float | None = None
        self.on_switched: Callable[[InjectedFaultChanged], object] = lambda _: None
        """Told what was broken or mended, in the thread that did it: `Session.inject_event`, for the run's file and the log."""

    def wrap(self, connect: Connect) -> Connect:
        """The same way to a bench, known to this plan from then on."""

        @contextmanager
        def connected() -> Iterator[ConnectedBench]:
            with connect() as laboratory:
                self._connection = laboratory
                try:
                    yield laboratory
                finally:
                    self._connection = None

        return connected

    def inject(self, name: str) -> None:
        """Break something now; it may take as long as the bench takes to answer.

        Raises:
            UsageError: the bench is not open, or is a real one.
            BenchError: the simulated bench has died.
        """
        controls = self._controls()
        before = controls.active_faults()
        controls.inject(name)
        if name not in before:
            self._report_switched(name, active=True)

    def clear(self, name: str | None = None) -> None:
        """Mend one fault, or all. As `inject`."""
        controls = self._controls()
        before = controls.active_faults()
        controls.clear(name)
        for each in before:
            if name in (None, each):
                self._report_switched(each, active=False)

    def active_faults(self) -> tuple[str, ...]:
        """What is broken now, as the bench itself says; nothing where none is open."""
        return () if self._connection is None else self._controls().active_faults()

    def __call__(self, event: SessionEvent) -> None:
        if self._connection is None:
            return
        now_s = self._connection.bench.clock.now()
        if isinstance(event, RunStarted):
            if self._begin_s is None:
                self._begin_s = now_s
            for name in self.active_faults() if self._connection.control is not None else ():
                self._report_switched(name, active=True)  # this run, too, is told what is broken
        while self._begin_s is not None and self._pending and now_s - self._begin_s >= self._pending[0].after_s:
            self.inject(self._pending.pop(0).name)

    def _report_switched(self, name: str, active: bool) -> None:
        self.on_switched(InjectedFaultChanged(name, FAULT_DESCRIPTIONS[name], active))

    def _controls(self) -> "BenchControls":
        if self._connection is None or self._connection.control is None:
            raise UsageError("only an open simulated bench can be broken on purpose")
        return self._connection.control
