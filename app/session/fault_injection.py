"""Faults of a simulated bench, broken when they are due: for `run --fault`, for the window, for a lesson.

A plan is put between the composition root and the session (`around`) and among the session's observers (itself).
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Protocol

from app.common.errors import UsageError
from app.session.session import Connected, SessionEvent
from protocols.base.events import FaultSwitched, RunStarted
from sim_hardware.plant.faults import FAULTS

Connect = Callable[[], AbstractContextManager[Connected]]


@dataclass(frozen=True, slots=True)
class PlannedFault:
    """What breaks, and how long after the run has begun, in bench seconds."""

    name: str
    after_s: float = 0.0


def planned_fault(text: str) -> PlannedFault:
    """The fault that `NAME` or `NAME@SECONDS` means.

    Raises:
        UsageError: there is no such fault, or the seconds are no number from 0 on.
    """
    name, at, seconds = text.partition("@")
    if name not in FAULTS:
        raise UsageError(f"there is no fault '{name}'; 'tactor-bench faults' lists them: {', '.join(FAULTS)}")
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
        self._due = sorted(faults, key=lambda fault: fault.after_s)
        self._laboratory: Connected | None = None
        self._begin_s: float | None = None
        self.tell: Callable[[FaultSwitched], object] = lambda _: None
        """Told what was broken or mended, in the thread that did it: `Session.happened`, for the run's file and the log."""

    def around(self, connect: Connect) -> Connect:
        """The same way to a bench, known to this plan from then on."""

        @contextmanager
        def connected() -> Iterator[Connected]:
            with connect() as laboratory:
                self._laboratory = laboratory
                try:
                    yield laboratory
                finally:
                    self._laboratory = None

        return connected

    def inject(self, name: str) -> None:
        """Break something now; it may take as long as the bench takes to answer.

        Raises:
            UsageError: the bench is not open, or is a real one.
            BenchError: the simulated bench has died.
        """
        hands = self._hands()
        before = hands.broken()
        hands.inject(name)
        if name not in before:
            self._switched(name, broken=True)

    def clear(self, name: str | None = None) -> None:
        """Mend one fault, or all. As `inject`."""
        hands = self._hands()
        before = hands.broken()
        hands.clear(name)
        for each in before:
            if name in (None, each):
                self._switched(each, broken=False)

    def broken(self) -> tuple[str, ...]:
        """What is broken now, as the bench itself says; nothing where none is open."""
        return () if self._laboratory is None else tuple(self._hands().broken())

    def __call__(self, event: SessionEvent) -> None:
        if self._laboratory is None:
            return
        now_s = self._laboratory.bench.clock.now()
        if isinstance(event, RunStarted):
            if self._begin_s is None:
                self._begin_s = now_s
            for name in self.broken() if self._laboratory.control is not None else ():
                self._switched(name, broken=True)  # this run, too, is told what is broken
        while self._begin_s is not None and self._due and now_s - self._begin_s >= self._due[0].after_s:
            self.inject(self._due.pop(0).name)

    def _switched(self, name: str, broken: bool) -> None:
        self.tell(FaultSwitched(name, FAULTS[name], broken))

    def _hands(self) -> "Hands":
        if self._laboratory is None or self._laboratory.control is None:
            raise UsageError("only an open simulated bench can be broken on purpose")
        hands: Hands = self._laboratory.control
        return hands


class Hands(Protocol):
    """What reaches into a simulated bench: `sim_hardware.bench.VirtualBench`, or the process that serves one."""

    def inject(self, fault: str) -> None: ...

    def clear(self, fault: str | None = None) -> None: ...

    def broken(self) -> Sequence[str]: ...
