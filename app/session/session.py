"""Bench session: thread that owns the instruments, runs requests in turn and publishes events.

Independent of the front end (window, command line, Python API, tests).
"""

import logging
import math
import queue
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol

from app.common import current_conditions, record_audit, with_sensor
from drivers import MANUAL_SHUTDOWN_INSTRUCTIONS, Bench, BenchError, Block, Scale, UnsafeError
from drivers.watchdog import take_unreported_lines
from protocols.base import (
    Event,
    EventBus,
    LogMessage,
    Operator,
    Prompt,
    PromptAnswered,
    PromptShown,
    RestMeasured,
    RunEnded,
    RunStatus,
    Verdict,
)
from protocols.runner import RunControl, RunRequest

if TYPE_CHECKING:
    from sim_hardware import BenchControls


log = logging.getLogger(__name__)

HUNG_AFTER_TAKEOVER_S = 10.0
"""A stopped run that reports nothing for this time after the watchdog took the source over hangs in a driver."""

HUNG_S = 60.0
"""The same where the watchdog did not act: longer than any way to rest with a silent instrument."""

HUNG_CONNECTING_S = 10.0

MONITOR_RATE_HZ = 10e3
"""Scans per second while the card is watched between runs."""


class SessionState(StrEnum):
    """State of the session, as shown to the operator."""

    CONNECTING = "connecting"
    IDLE = "at rest"
    RUNNING = "running"
    NO_BENCH = "no bench"
    CLOSED = "closed"


@dataclass(frozen=True, slots=True)
class BenchOpened:
    """The bench is open; `identities` by role."""

    kind: ClassVar[str] = "BenchOpened"
    name: str
    simulated: bool
    identities: dict[str, str]
    gain_uncertainty: float = 0.0
    """Relative standard uncertainty of the displacement sensor's gain."""


@dataclass(frozen=True, slots=True)
class BenchFailed:
    """The bench cannot be used; `words` is the reason and the remedy."""

    kind: ClassVar[str] = "BenchFailed"
    words: str


@dataclass(frozen=True, slots=True)
class RunRejected:
    """A run was not started: its file cannot be created, or the run to resume cannot be read."""

    kind: ClassVar[str] = "Refused"
    words: str


@dataclass(frozen=True, slots=True)
class MonitorStarted:
    """The card runs between runs, to be watched; nothing is driven and nothing stored."""

    kind: ClassVar[str] = "MonitorStarted"
    rate_hz: float
    scales: tuple[Scale, ...]


@dataclass(frozen=True, slots=True)
class BlockMonitored:
    """A block of the card between runs."""

    kind: ClassVar[str] = "BlockMonitored"
    block: Block


@dataclass(frozen=True, slots=True)
class MonitorFailed:
    """The card cannot be watched between runs; `words` is the reason and the remedy."""

    kind: ClassVar[str] = "MonitorFailed"
    words: str


SessionEvent = Event | BenchOpened | BenchFailed | RunRejected | MonitorStarted | BlockMonitored | MonitorFailed
Observer = Callable[[SessionEvent], object]


class BuiltInOperator(Operator, Protocol):
    """Operator that belongs to the bench, such as the simulated one."""

    def clear_specimen(self) -> None:
        """Remove weights and masses of a stopped run from the specimen. Raises BenchError without a bench."""


class ConnectedBench(Protocol):
    """Open bench as the composition root provides it."""

    @property
    def bench(self) -> Bench: ...

    @property
    def operator(self) -> BuiltInOperator | None:
        """The simulated operator; None if a person answers prompts."""

    @property
    def control(self) -> "BenchControls | None":
        """Controls of a simulated bench: injects and clears faults; None for a real one."""


class Session:
    """One bench, one thread, any number of runs one after the other.

    Args:
        connect: opens the bench; a context manager that also closes it.
        observers: called with every event, in the session's thread.
        operator: answers prompts if the bench has no operator of its own.
        folder: whose watchdog log is reported before the bench is opened, which may fail; None to report it with a run.
    """

    def __init__(
        self,
        connect: Callable[[], AbstractContextManager[ConnectedBench]],
        observers: Sequence[Observer],
        operator: Operator,
        folder: Path | None = None,
    ) -> None:
        self._connect, self._operator, self._folder = connect, operator, folder
        self._events = EventBus(self._on_event, *observers)
        self._restore: Prompt | None = None
        """Set-up that the next run of another protocol prompts for; None if the tactor is under the sensor."""
        self._restore_id: int | None = None
        self._control = RunControl()
        self._requests: queue.SimpleQueue[Callable[[ConnectedBench], None] | None] = queue.SimpleQueue()
        self._monitoring = threading.Event()
        self._watches_card = False
        self._thread = threading.Thread(target=self._work, name="bench", daemon=False)
        self.state = SessionState.CONNECTING
        self.outcome: RunEnded | None = None
        self.path: Path | None = None
        self.finished = threading.Event()
        """Set when the requested run has ended, or cannot start because there is no bench."""
        self.bench: Bench | None = None
        self.unsafe = False
        """Whether the bench could not be opened and was left live by an earlier program."""
        self.abandoned = False
        """Whether the thread hangs in a driver and is no longer waited for; the process must then be ended."""
        self._stop_requested_s = self._last_event_s = math.inf
        self._takeover_seen_s = math.inf

    def start(self) -> None:
        """Start connecting; returns immediately."""
        self._thread.start()

    def run(self, request: RunRequest) -> None:
        """Queue a run; returns immediately."""
        self._enqueue(lambda: request)

    def repeat_entries(self, path: Path, entries: Sequence[int], folder: Path) -> None:
        """Queue a run that measures some entries of the run `path` again; the file is read in the session's thread."""

        def load() -> RunRequest:
            from protocols.runfile import RunReadError

            request = RunRequest.resuming(path, folder, entries)
            if self._control.cancel.is_set():
                raise RunReadError(f"Stopped before the run began; nothing was measured. {path.name} is as it was.")
            return request

        self._enqueue(load)

    def _enqueue(self, load: Callable[[], RunRequest]) -> None:
        self._control.cancel.clear()
        self._control.pause.clear()
        self.outcome = None
        self._stop_requested_s = self._takeover_seen_s = math.inf
        self.finished.clear()
        self._requests.put(lambda connected: self._run(connected, load))
        if self.state in (SessionState.NO_BENCH, SessionState.CLOSED):
            self.finished.set()

    def monitor(self, active: bool) -> None:
        """Watch the card between runs, or stop watching; returns immediately. A run ends it, and it is requested again after it."""
        if not active:
            self._monitoring.clear()
        elif not self._monitoring.is_set():
            self._monitoring.set()
            self._requests.put(self._monitor)

    @property
    def pause_requested(self) -> bool:
        """Whether a pause is requested."""
        return self._control.pause.is_set()

    def stop(self) -> None:
        """Request the current run to go to rest and end; returns immediately."""
        self._stop_requested_s = min(self._stop_requested_s, time.monotonic())
        self._control.cancel.set()

    def abandon_if_hung(self) -> None:
        """Report a stopped session as ended whose thread hangs in a driver's code; called by a front end that waits.

        The watchdog has brought the source to rest by then, or does so when the process ends.
        """
        now_s, bench = time.monotonic(), self.bench
        quiet_s = now_s - max(self._stop_requested_s, self._last_event_s if math.isfinite(self._last_event_s) else 0.0)
        if not self.abandoned and self._watches_card and quiet_s > HUNG_CONNECTING_S and now_s > self._stop_requested_s:
            self._abandon(
                "the card's driver hangs between runs; end this program and start it again. Nothing was driven"
            )
        if self.abandoned or now_s < self._stop_requested_s or self.finished.is_set():
            return
        if self.state is SessionState.CONNECTING and quiet_s > HUNG_CONNECTING_S:
            self._abandon("an instrument's driver hangs while the bench connects; nothing was driven")
        if self.state is not SessionState.RUNNING or bench is None:
            return
        outcome = bench.watchdog.takeover_outcome
        if outcome:
            self._takeover_seen_s = min(self._takeover_seen_s, now_s)
        after_takeover_s = min(quiet_s, now_s - self._takeover_seen_s)
        if quiet_s <= HUNG_S and after_takeover_s <= HUNG_AFTER_TAKEOVER_S:
            return
        self.abandoned = True  # before the following events, whose observers read it
        hangs = f"an instrument's driver hangs, and the run was given up {quiet_s:.0f} s after it was to stop"
        watchdog_report = f" The watchdog reports: {outcome}." if outcome else ""
        bench.watchdog.log(f"the program could not measure rest: {hangs}.{watchdog_report}")
        reason = f"{MANUAL_SHUTDOWN_INSTRUCTIONS}. {hangs[:1].upper()}{hangs[1:]}.{watchdog_report}"
        verdict = Verdict.of_status(RunStatus.UNSAFE, reason)
        self.outcome = RunEnded(RunStatus.UNSAFE, reason, str(self.path or ""), (), verdict)
        self._events.publish(RestMeasured(False, math.nan, f"rest was not measured: {hangs}"))
        self._events.publish(self.outcome)
        self._abandon(f"{hangs[:1].upper()}{hangs[1:]}; end this program and start it again")

    def pause(self) -> None:
        """Request the current run to go to rest and wait; returns immediately."""
        self._control.pause.set()

    def resume(self) -> None:
        """Resume a paused run; returns immediately."""
        self._control.pause.clear()

    def inject_event(self, event: Event) -> None:
        """Publish an external event, and store it in the file of the current run. Callable from any thread."""
        self._control.external_events.put(event)
        if self.state is not SessionState.RUNNING:
            self._forward_injected()

    def close(self, timeout_s: float | None = None) -> bool:
        """Stop, go to rest and release the bench; return whether the thread ended within `timeout_s`."""
        self.stop()
        self._requests.put(None)
        if self._thread.is_alive() and not self.abandoned:
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _work(self) -> None:
        try:
            if self._folder is not None:
                self._report_watchdog_log(self._folder)
            with self._connect() as connected:
                self.bench = connected.bench
                identities = dict(connected.bench.configuration.get("identities", {}))
                self.state = SessionState.IDLE
                gain = connected.bench.sensor.gain_relative_uncertainty
                self._events.publish(BenchOpened(connected.bench.name, connected.bench.simulated, identities, gain))
                while (request := self._requests.get()) is not None:
                    request(connected)
        except BenchError as error:
            self.unsafe = isinstance(error, UnsafeError)
            self._fail(str(error))
        except Exception as error:
            log.exception("the session failed by an error of this program")
            self._fail(f"an error of this program: {type(error).__name__}: {error}")
        finally:
            self.bench = None
            if self.state is not SessionState.NO_BENCH:
                self.state = SessionState.CLOSED
            self.finished.set()

    @staticmethod
    def _with_conditions(request: RunRequest, bench: Bench) -> RunRequest:
        """Return the request with operator, temperature, humidity, and warnings of calibrations that are due."""
        from app.config import bench_warnings

        conditions = with_sensor(request.conditions or current_conditions(), bench.environment)
        expired, notes = bench_warnings(request.folder, bench.configuration, request.protocol.name)
        return replace(request, conditions=conditions, calibration_warning=expired, notes=(*request.notes, *notes))

    def _run(self, connection: ConnectedBench, load: Callable[[], RunRequest]) -> None:
        # HDF5 is slow to import: neither before the window is painted nor in its thread.
        from app.session.simulation import provide_sheet
        from protocols.runfile import RunReadError, StorageError, notes_path, repair_folder
        from protocols.runner import Runner

        self.state = SessionState.RUNNING
        self._forward_injected()
        try:
            request = load()
            self._report_watchdog_log(request.folder)
            for sentence in repair_folder(request.folder, _complete_results):
                self._events.publish(LogMessage(sentence))
            connection.bench.watchdog.set_log_folder(request.folder)
            if connection.operator is not None:
                with suppress(BenchError):  # the run reports it better
                    connection.operator.clear_specimen()
            operator = connection.operator or self._operator
            if message := provide_sheet(connection.bench.configuration, request.folder, request.specimen):
                self._events.publish(LogMessage(message))
            request = self._with_conditions(self._with_restored_setup(request), connection.bench)
            runner = Runner(request, connection.bench, operator, self._events, self._control)
        except (RunReadError, StorageError) as error:
            self.outcome = RunEnded(RunStatus.FAILED, str(error), "")
            self.state = SessionState.IDLE
            self._events.publish(RunRejected(str(error)))
        else:
            self.path = runner.path
            self.outcome = runner.run()
            self.path = runner.path
            record_audit(
                "run",
                self.path,
                notes_path(self.path),
                subject=request.specimen,
                verdict=str(self.outcome.verdict.outcome),
                reason=self.outcome.reason,
            )
        self.finished.set()

    def _monitor(self, connection: ConnectedBench) -> None:
        """Publish blocks of the card until another request arrives; nothing is commanded."""
        bench = connection.bench
        self._last_event_s, self._watches_card = time.monotonic(), True
        waits = not isinstance(bench.configuration.get("speed", 1.0), int | float)  # the virtual clock does not
        try:
            with bench.open_stream(MONITOR_RATE_HZ) as stream:
                self._events.publish(MonitorStarted(stream.rate_hz, stream.scales))
                while self._monitoring.is_set() and self._requests.empty():
                    self._events.publish(BlockMonitored(stream.read()))
                    if waits:
                        time.sleep(bench.block_s)
        except BenchError as error:
            self._events.publish(
                MonitorFailed(f"There are no live values: {error}. Then connect again on the page Bench")
            )
        finally:
            self._monitoring.clear()
            self._watches_card = False

    def _report_watchdog_log(self, folder: Path) -> None:
        for note in unreported_watchdog_messages(folder):
            self._events.publish(note)

    def _with_restored_setup(self, request: RunRequest) -> RunRequest:
        """Return the request with a prompt that undoes the set-up of the last run, and note the set-up left by this one."""
        left = request.protocol.restore
        if self._restore is not None and self._restore != left:
            request = replace(request, prepare=(self._restore, *request.prepare))
        self._restore = left or self._restore
        return request

    def _on_event(self, event: SessionEvent) -> None:
        self._last_event_s = time.monotonic()
        match event:
            case RunEnded():
                self.state = SessionState.IDLE  # before the observers, which may start the next run
                self._forward_injected()
            case PromptShown(ask_id, prompt) if prompt == self._restore:
                self._restore_id = ask_id
            case PromptAnswered(ask_id) if ask_id == self._restore_id:
                self._restore = self._restore_id = None

    def _forward_injected(self) -> None:
        with suppress(queue.Empty):
            while True:
                self._events.publish(self._control.external_events.get_nowait())

    def _abandon(self, reason: str) -> None:
        """Give the bench up: who waits for `finished` finds the state and the reason already published."""
        self.abandoned = True
        self._fail(reason)
        self.finished.set()

    def _fail(self, reason: str) -> None:
        self.state = SessionState.NO_BENCH
        self._events.publish(BenchFailed(reason))


def _complete_results(path: Path) -> str:
    """Complete the results of a run that a killed program left; the modules that read runs are imported then only."""
    from protocols import complete_results

    return complete_results(path)


def unreported_watchdog_messages(folder: Path) -> list[LogMessage]:
    """Return log messages that the watchdog of an earlier program left in `folder`, once."""
    return [LogMessage(f"Since the last start the watchdog wrote: {line}") for line in take_unreported_lines(folder)]
