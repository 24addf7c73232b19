"""A session with the terminal as its front end: progress, prompts, signals, exit codes."""

import argparse
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType
from typing import Any

from app.common.errors import DONE, FAILED, UNSAFE, UsageError
from app.config.bench_file import BenchConfig
from app.session.session import Session
from protocols.base.events import Status

EXIT_CODES = {Status.COMPLETED: DONE, Status.UNSAFE: UNSAFE}


@dataclass
class Headless:
    """A session that is open; `stopped` is set when somebody pressed Ctrl-C: then nothing new is begun."""

    session: Session
    stopped: threading.Event = field(default_factory=threading.Event)

    def wait(self) -> None:
        """Until the run that was asked for has ended, or there is no bench."""
        # In slices, because a wait without end would keep Python from seeing the signal.
        while not self.session.finished.wait(0.1):
            pass


def exit_code(session: Session) -> int:
    """What the last run of a session tells the caller of the program."""
    return FAILED if session.outcome is None else EXIT_CODES.get(session.outcome[0], FAILED)


@contextmanager
def headless(
    config: BenchConfig,
    speed: float | None,
    options: argparse.Namespace,
    listeners: Sequence[Callable[[Any], None]] = (),
    planned: Sequence[str] = (),
) -> Iterator[Headless]:
    """A bench that is being opened; let go of at the end, at rest.

    Raises:
        UsageError: faults were planned for a real bench.
    """
    if planned and not config.simulated:
        raise UsageError(f"--fault is for a simulated bench; {options.bench} is a real one")
    from app.cli.console import ConsoleObserver, JsonObserver, Terminal
    from app.cli.prompts import KEYS, ConsoleOperator, can_listen
    from app.session.connect import HASTY_BLOCK_S, connect
    from app.session.fault_injection import FaultPlan, planned_fault

    plan = FaultPlan([planned_fault(text) for text in planned])
    operator = ConsoleOperator()
    keys = KEYS if can_listen() else ""
    observer = JsonObserver() if options.json else ConsoleObserver(Terminal(), keys)
    with observer:
        way = plan.around(lambda: connect(config, speed, HASTY_BLOCK_S))
        front = Headless(Session(way, [observer, operator, plan, *listeners], operator))
        plan.tell = front.session.happened
        with _stop_on_signal(front), operator.listening(front.session):
            front.session.start()
            try:
                yield front
            finally:
                front.session.close()


@contextmanager
def _stop_on_signal(front: Headless) -> Iterator[None]:
    """Ctrl-C and SIGTERM ask the run to go to rest; asking again changes nothing, because rest comes first."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        front.stopped.set()
        front.session.stop()

    numbers = [signal.SIGINT, signal.SIGTERM] + ([signal.SIGHUP] if hasattr(signal, "SIGHUP") else [])
    before = {number: signal.signal(number, stop) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
