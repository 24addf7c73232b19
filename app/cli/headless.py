"""A session with the terminal as its front end: progress, prompts, signals, exit codes."""

import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from app.cli.options import BenchOptions, BenchSelection, split_setting
from app.common import (
    ExitCode,
    UsageError,
    current_conditions,
    exit_code_of,
    print_message,
    remember_conditions,
    remember_typed_conditions,
    remembered_conditions,
)
from app.config import BenchConfig
from app.identification import reference_model
from app.services import operator_reachable, refuse_without_operator
from app.session import Session, build_protocol, choose_bench, load_protocol_class
from protocols import load_plug_ins
from protocols.base import UNNAMED, Prompt, Protocol
from protocols.runner import RunRequest


@dataclass
class HeadlessSession:
    """An open session; `interrupted` is set by Ctrl-C: then no further run is started."""

    session: Session
    interrupted: threading.Event = field(default_factory=threading.Event)

    def stop(self, _number: int, _frame: FrameType | None) -> None:
        """Stop the run (signal handler); a second signal changes nothing, because rest comes first."""
        self.interrupted.set()
        self.session.stop()

    def wait(self) -> None:
        """Wait until the run has ended, or the bench failed."""
        # In slices, because an endless wait would keep Python from handling the signal.
        while not self.session.finished.wait(0.1):
            pass

    @property
    def exit_code(self) -> int:
        """Exit code for the last run."""
        if self.session.unsafe:
            return ExitCode.UNSAFE
        outcome = self.session.outcome
        return exit_code_of(outcome.verdict.outcome) if outcome else ExitCode.FAILED


@dataclass(frozen=True)
class SelectedBench:
    """The bench that the options choose, and its speed: None is the virtual clock."""

    name: str
    config: BenchConfig
    speed: float | None
    without_commissioning: str = ""
    after_run: str = ""


def select_bench(options: BenchSelection) -> SelectedBench:
    """Return the bench of the options.

    Raises:
        UsageError: the bench file is wrong, or an option does not fit the bench.
    """
    config, speed = choose_bench(options.bench, options.speed, options.seed, option="--")
    if isinstance(options, BenchOptions):
        remember_typed_conditions(options.operator, options.temperature, options.humidity)
    reason = getattr(options, "without_commissioning", None)
    after_run = options.after_run if isinstance(options, BenchOptions) else ""
    return SelectedBench(options.bench, config, speed, check_reason(reason, config), after_run)


def check_reason(reason: str | None, config: BenchConfig) -> str:
    """Return the reason for high voltage without commissioning; empty if none was given.

    Raises:
        UsageError: it is blank, or the bench is simulated.
    """
    if reason is None:
        return ""
    if config.simulated:
        raise UsageError("--without-commissioning is for a real bench; the simulated bench needs no commissioning")
    if not reason.strip():
        raise UsageError("--without-commissioning needs a reason in words; it is stored in every run")
    return reason.strip()


def make_protocol(name: str, settings: Sequence[str]) -> Protocol:
    """Return the protocol `name` with `NAME=VALUE` settings.

    Raises:
        UsageError: an unknown protocol or parameter, or a value out of range; every error is listed.
    """
    kind = load_protocol_class(name, print_message)
    return build_protocol(kind, dict(split_setting(text, "--set", "peak_to_peak_v=4") for text in settings))


def load_all_protocols() -> None:
    """Load the protocols of installed packages, with a warning for each broken one."""
    for problem in load_plug_ins():
        print_message(problem)


def run_request(options: BenchOptions, protocol: Protocol) -> RunRequest:
    """Return the request to run a protocol with the folder and the specimen of the options."""
    folder, specimen = options.out or Path("runs"), options.specimen or UNNAMED
    return RunRequest(protocol, folder, specimen, reference=reference_model(folder, specimen))


def run_headless(
    bench: SelectedBench,
    request: RunRequest,
    as_json: bool = False,
    observers: Sequence[Callable[[Any], None]] = (),
    planned_faults: Sequence[str] = (),
) -> tuple[int, Path | None]:
    """Run a protocol with the terminal as front end; return the exit code and the run file.

    The `observers` receive every event besides the terminal; `planned_faults` are faults of a simulated bench,
    `NAME@SECONDS`.
    """
    check_planned_faults(bench, planned_faults)
    refuse_unreachable_operator(bench, request.protocol, request.prepare)
    with headless_session(bench, as_json, observers, planned_faults, request.folder) as session:
        session.session.run(request)
        session.wait()
    return session.exit_code, session.session.path if session.session.outcome else None


def _ask_operator(bench: SelectedBench) -> None:
    """Ask at the terminal who measures, once a day and on a real bench; Enter alone is the login of the computer."""
    if bench.config.simulated or not operator_reachable() or remembered_conditions().operator:
        return
    print_message(
        f"Name of today's operator? Type it and press Enter; Enter alone: {current_conditions().operator or 'nobody'}"
    )
    remember_conditions(sys.stdin.readline().strip() or current_conditions().operator)


def check_planned_faults(bench: SelectedBench, planned_faults: Sequence[str]) -> None:
    """Raise UsageError if faults are planned for a real bench."""
    if planned_faults and not bench.config.simulated:
        raise UsageError(f"--fault is for a simulated bench; {bench.name} is a real one")


def refuse_unreachable_operator(bench: SelectedBench, protocol: Protocol, prepare: Sequence[Prompt] = ()) -> None:
    """Reject a run whose prompts cannot be answered, before anything moves.

    Raises:
        UsageError: standard input is not a terminal, the bench is real, and the run has prompts; they are named.
    """
    if bench.config.simulated or operator_reachable():
        return
    refuse_without_operator(bench.config, protocol, prepare)


@contextmanager
def headless_session(
    bench: SelectedBench,
    as_json: bool,
    observers: Sequence[Callable[[Any], None]] = (),
    planned_faults: Sequence[str] = (),
    folder: Path | None = None,
) -> Iterator[HeadlessSession]:
    """Open a bench as a session with the terminal as its front end; at the end it is closed at rest.

    New lines of the watchdog's log in `folder` are printed first.

    Raises:
        UsageError: faults were planned for a real bench.
    """
    check_planned_faults(bench, planned_faults)
    from app.archive import AfterRun
    from app.remote import PhoneStop
    from app.services import (
        KEY_HELP,
        ConsoleObserver,
        ConsoleOperator,
        JsonObserver,
        StderrConsole,
        can_poll_keyboard,
        handling_stop_signals,
    )
    from app.session import UNATTENDED_BLOCK_S, BenchFollower, FaultPlan, connect, parse_planned_fault

    _ask_operator(bench)
    plan = FaultPlan([parse_planned_fault(text) for text in planned_faults])
    operator, follower = ConsoleOperator(), BenchFollower(bench.config.amplifier.amplifier_map)
    keys = KEY_HELP if can_poll_keyboard() else ""
    observer = JsonObserver(follower) if as_json else ConsoleObserver(StderrConsole(), keys, follower=follower)
    with observer:
        opener = plan.wrap(
            lambda: connect(
                bench.config,
                bench.speed,
                UNATTENDED_BLOCK_S,
                without_commissioning=bench.without_commissioning,
                notice=bench.after_run,
            )
        )
        after_run, phone_stop = AfterRun(observer, bench.config, bench.after_run), PhoneStop()
        watching = [observer, operator, plan, *observers, after_run.observe, phone_stop.observe]
        session = HeadlessSession(Session(opener, watching, operator, folder, ends_at_stop=True))
        session.session.remote_stop = phone_stop
        plan.on_switched = session.session.inject_event
        follower.observe = lambda: session.session.observation
        with (
            closing(after_run),
            closing(phone_stop),
            handling_stop_signals(session.stop),
            operator.listening(session.session),
        ):
            session.session.start()
            try:
                yield session
            finally:
                session.session.close()
