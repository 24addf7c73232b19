"""A session with the terminal as its front end: progress, prompts, signals, exit codes."""

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType
from typing import Any

from app.cli.options import BenchOptions
from app.common.errors import ExitCode, UsageError
from app.config.bench_file import BenchConfig
from app.session.request import choose_bench
from app.session.session import Session
from protocols.base import RunStatus

EXIT_CODES = {RunStatus.COMPLETED: ExitCode.DONE, RunStatus.UNSAFE: ExitCode.UNSAFE}


@dataclass
class HeadlessSession:
    """An open session; `interrupted` is set by Ctrl-C: then no further run is started."""

    session: Session
    interrupted: threading.Event = field(default_factory=threading.Event)

    def wait(self) -> None:
        """Wait until the run has ended, or the bench failed."""
        # In slices, because an endless wait would keep Python from handling the signal.
        while not self.session.finished.wait(0.1):
            pass


def exit_code(session: Session) -> int:
    """Return the exit code for the last run of a session."""
    return ExitCode.FAILED if session.outcome is None else EXIT_CODES.get(session.outcome[0], ExitCode.FAILED)


@dataclass(frozen=True)
class SelectedBench:
    """The bench that the options choose, and its speed: None is the virtual clock."""

    name: str
    config: BenchConfig
    speed: float | None


def select_bench(options: BenchOptions) -> SelectedBench:
    """Return the bench of the options.

    Raises:
        UsageError: the bench file is wrong, or an option does not fit the bench.
    """
    return SelectedBench(options.bench, *choose_bench(options.bench, options.speed, options.seed, option="--"))


@contextmanager
def headless_session(
    bench: SelectedBench,
    as_json: bool,
    observers: Sequence[Callable[[Any], None]] = (),
    planned_faults: Sequence[str] = (),
) -> Iterator[HeadlessSession]:
    """Open a bench as a session with the terminal as its front end; at the end it is closed at rest.

    Raises:
        UsageError: faults were planned for a real bench.
    """
    if planned_faults and not bench.config.simulated:
        raise UsageError(f"--fault is for a simulated bench; {bench.name} is a real one")
    from app.cli.console import ConsoleObserver, JsonObserver, StderrConsole
    from app.cli.prompts import KEY_HELP, ConsoleOperator, can_poll_keyboard
    from app.session.connect import UNATTENDED_BLOCK_S, connect
    from app.session.fault_injection import FaultPlan, parse_planned_fault

    plan = FaultPlan([parse_planned_fault(text) for text in planned_faults])
    operator = ConsoleOperator()
    keys = KEY_HELP if can_poll_keyboard() else ""
    observer = JsonObserver() if as_json else ConsoleObserver(StderrConsole(), keys)
    with observer:
        opener = plan.wrap(lambda: connect(bench.config, bench.speed, UNATTENDED_BLOCK_S))
        front = HeadlessSession(Session(opener, [observer, operator, plan, *observers], operator))
        plan.on_switched = front.session.inject_event
        with _stop_on_signal(front), operator.listening(front.session):
            front.session.start()
            try:
                yield front
            finally:
                front.session.close()


@contextmanager
def _stop_on_signal(headless: HeadlessSession) -> Iterator[None]:
    """Stop the run at Ctrl-C or SIGTERM; a second signal changes nothing, because rest comes first."""

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
