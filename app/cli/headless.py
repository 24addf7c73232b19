"""A session with the terminal as its front end: progress, prompts, signals, exit codes."""

import argparse
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType
from typing import Any

from app.common.errors import ExitCode, UsageError
from app.config.bench_file import BenchConfig
from app.session.session import Session
from protocols.base.events import RunStatus

EXIT_CODES = {RunStatus.COMPLETED: ExitCode.DONE, RunStatus.UNSAFE: ExitCode.UNSAFE}


@dataclass
class HeadlessSession:
    """A session that is open; `stopped` is set when somebody pressed Ctrl-C: then nothing new is begun."""

    session: Session
    interrupted: threading.Event = field(default_factory=threading.Event)

    def wait(self) -> None:
        """Until the run that was asked for has ended, or there is no bench."""
        # In slices, because a wait without end would keep Python from seeing the signal.
        while not self.session.finished.wait(0.1):
            pass


def exit_code(session: Session) -> int:
    """What the last run of a session tells the caller of the program."""
    return ExitCode.FAILED if session.outcome is None else EXIT_CODES.get(session.outcome[0], ExitCode.FAILED)


@contextmanager
def headless_session(
    config: BenchConfig,
    speed: float | None,
    options: argparse.Namespace,
    observers: Sequence[Callable[[Any], None]] = (),
    planned_faults: Sequence[str] = (),
) -> Iterator[HeadlessSession]:
    """A bench that is being opened; let go of at the end, at rest.

    Raises:
        UsageError: faults were planned for a real bench.
    """
    if planned_faults and not config.simulated:
        raise UsageError(f"--fault is for a simulated bench; {options.bench} is a real one")
    from app.cli.console import ConsoleObserver, JsonObserver, StderrConsole
    from app.cli.prompts import KEY_HELP, ConsoleOperator, can_poll_keyboard
    from app.session.connect import UNATTENDED_BLOCK_S, connect
    from app.session.fault_injection import FaultPlan, parse_planned_fault

    plan = FaultPlan([parse_planned_fault(text) for text in planned_faults])
    operator = ConsoleOperator()
    keys = KEY_HELP if can_poll_keyboard() else ""
    observer = JsonObserver() if options.json else ConsoleObserver(StderrConsole(), keys)
    with observer:
        way = plan.wrap(lambda: connect(config, speed, UNATTENDED_BLOCK_S))
        front = HeadlessSession(Session(way, [observer, operator, plan, *observers], operator))
        plan.on_switched = front.session.inject_event
        with _stop_on_signal(front), operator.listening(front.session):
            front.session.start()
            try:
                yield front
            finally:
                front.session.close()


@contextmanager
def _stop_on_signal(headless: HeadlessSession) -> Iterator[None]:
    """Ctrl-C and SIGTERM ask the run to go to rest; asking again changes nothing, because rest comes first."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        headless.interrupted.set()
        headless.session.stop()

    numbers = [signal.SIGINT, signal.SIGTERM] + ([signal.SIGHUP] if hasattr(signal, "SIGHUP") else [])
    before = {number: signal.signal(number, stop) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
