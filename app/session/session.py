"""Bench session: thread that owns the instruments, runs requests in turn and publishes events.

Independent of the front end (window, command line, Python API, tests).
"""

import ctypes
import logging
import math
import queue
import re
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol, Self

from app.common import current_conditions, record_audit
from app.session.supervisor import Rescue, Signs, Supervisor
from drivers import (
    MEMORY_SHORT,
    AbandonableThread,
    Bench,
    BenchError,
    Block,
    CardReading,
    Deadline,
    Drive,
    Scale,
    ScansLostError,
    UnsafeError,
    is_memory_short,
    overdue,
    threads_left_behind,
)
from drivers.watchdog import take_unreported_lines
from protocols.base import (
    Event,
    EventBus,
    LogMessage,
    Operator,
    Prompt,
    PromptAnswered,
    PromptShown,
    RunEnded,
    RunStatus,
    SpecimenMounted,
    StopRequested,
    last_mountings,
)
from protocols.runner import RunControl, RunRequest

if TYPE_CHECKING:
    from protocols.runner import Runner
    from sim_hardware import BenchControls


log = logging.getLogger(__name__)

CLOSING_POLL_S = 0.1

MONITOR_RATE_HZ, MONITOR_BLOCK_S = 10e3, 0.2
"""Scans per second, and duration of a block, while the card is watched between runs."""

MONITOR_RETRY_S = 2.0
"""Real seconds until a card that could not be watched is tried again."""

NO_LIVE_VALUES = "There are no live values"


@dataclass(frozen=True, slots=True)
class Observation:
    """What the instruments answered last.

    Attributes:
        card: the card's reading.
        answered_s: by role, the time (time.monotonic) of the last reply.
        commanded: the drive that was commanded last; it has not begun while the source comes to rest before it.
    """

    card: CardReading | None = None
    answered_s: Mapping[str, float] = field(default_factory=dict)
    commanded: Drive | None = None

    @classmethod
    def of(cls, bench: Bench) -> Self:
        """Return the last answers of a bench, from any thread."""
        return cls(bench.reading, bench.answered_s, bench.amplifier.commanded)


UNSEEN = Observation()
"""Before anything was answered."""


class SessionState(StrEnum):
    """State of the session, as shown to the operator."""

    CONNECTING = "connecting"
    IDLE = "at rest"
    RUNNING = "running"
    NO_BENCH = "no bench"
    CLOSED = "closed"


@dataclass(frozen=True, slots=True)
class InstrumentAwaited:
    """An instrument is being opened; the bench is open when all have answered."""

    kind: ClassVar[str] = "InstrumentAwaited"
    role: str


announcer: ContextVar[Callable[[InstrumentAwaited], object]] = ContextVar("announcer", default=lambda _: None)
"""Callback for each instrument about to be opened, set in the thread of a connecting session."""


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


ConnectionEvent = InstrumentAwaited | BenchOpened | BenchFailed
SessionEvent = Event | ConnectionEvent | RunRejected | MonitorStarted | BlockMonitored | MonitorFailed
Observer = Callable[[SessionEvent], object]


class BuiltInOperator(Operator, Protocol):
    """Operator that belongs to the bench, such as the simulated one."""

    def clear_specimen(self, mountings: Sequence[SpecimenMounted] = (), cycles: float | None = None) -> None:
        """Remove weights and masses of a stopped run from the specimen, which stays as it was mounted. Raises BenchError without a bench."""


class RemoteStop(Protocol):
    """Page on which a phone can stop one run."""

    def open(self, stop: Callable[[str], None]) -> str:
        """Open the page for a new run and return its address; `stop` takes who asked. Raises BenchError."""


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
        ends_at_stop: whether the program ends with a stop, so that what is not armed yet is given up at once if it does not answer.
    """

    def __init__(
        self,
        connect: Callable[[], AbstractContextManager[ConnectedBench]],
        observers: Sequence[Observer],
        operator: Operator,
        folder: Path | None = None,
        *,
        ends_at_stop: bool = False,
    ) -> None:
        self._connect, self._operator, self._folder = connect, operator, folder
        self._events = EventBus(self._on_event, *observers)
        self._restore: Prompt | None = None
        """Set-up that the next run of another protocol prompts for; None if the tactor is under the sensor."""
        self._restore_id: int | None = None
        self._mounted: Callable[[SpecimenMounted], Path]
        """Adds a mounting to the file of the specimen of the present run, and returns its path."""
        self._control = RunControl()
        self._requests: queue.SimpleQueue[Callable[[ConnectedBench], None] | None] = queue.SimpleQueue()
        self._monitoring, self._monitor_failed = threading.Event(), False
        self._watches_card = False
        self._seen = UNSEEN
        self.runner: Runner | None = None
        """Runner of the present run."""
        self._thread = AbandonableThread(target=self._work, name="bench", daemon=False)
        self._rescue: Rescue | None = None
        self._supervisor = Supervisor(self, Deadline.STOP_ANSWER if ends_at_stop else Deadline.EARLY_STOP)
        self.state = SessionState.CONNECTING
        self.outcome: RunEnded | None = None
        self.path: Path | None = None
        self.finished = threading.Event()
        """Set when the requested run has ended, or cannot start because there is no bench."""
        self.bench: Bench | None = None
        self.remote_stop: RemoteStop | None = None
        """Page on which a phone can stop a run; None if the program has no such page."""
        self.unsafe = False
        """Whether the bench could not be opened and was left live by an earlier program."""
        self._stop_requested_s = self._closing_s = math.inf
        self._last_event_s = time.monotonic()

    @property
    def abandoned(self) -> bool:
        """Whether the thread hangs and is no longer waited for; the process must then be ended."""
        return self._thread.given_up

    def start(self) -> None:
        """Start connecting; returns immediately."""
        self._last_event_s = time.monotonic()
        self._rescue = Rescue()
        self._supervisor.start()
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
        self._stop_requested_s = math.inf
        self.finished.clear()
        self._requests.put(partial(self._run, load=load))
        if self.state in (SessionState.NO_BENCH, SessionState.CLOSED):
            self._reject_requests()

    def monitor(self, active: bool) -> None:
        """Watch the card whenever no run is in progress, or stop watching; returns immediately."""
        if active:
            self._monitoring.set()
            self._requests.put(lambda _: None)
        else:
            self._monitoring.clear()

    @property
    def observation(self) -> Observation:
        """What the instruments answered last, from any thread; kept when the bench is closed."""
        if (bench := self.bench) is not None:
            self._seen = Observation.of(bench)
        return self._seen

    @property
    def pause_requested(self) -> bool:
        """Whether a pause is requested."""
        return self._control.pause.is_set()

    def stop(self, by: str = "") -> None:
        """Request the current run to go to rest and end; returns immediately. `by` says who does, if not the operator."""
        if by and not self._control.cancel.is_set():
            self._control.external_events.put(StopRequested(by))
        self._stop_requested_s = min(self._stop_requested_s, time.monotonic())
        self._control.cancel.set()

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
        """Stop, go to rest and release the bench; return whether the thread ended within `timeout_s`, None: within its deadlines."""
        self._closing_s = min(self._closing_s, time.monotonic())
        self.stop()
        self._requests.put(None)
        while self._thread.is_alive() and not self.abandoned:
            self._thread.join(CLOSING_POLL_S if timeout_s is None else timeout_s)
            if timeout_s is not None:
                break
        return not self._thread.is_alive()

    def _work(self) -> None:
        try:
            if self._folder is not None:
                for note in unreported_watchdog_messages(self._folder):
                    self._events.publish(note)
            announcer.set(self._events.publish)
            with self._connect() as connected:
                self.bench = connected.bench
                identities = dict(connected.bench.configuration.get("identities", {}))
                self.state = SessionState.IDLE
                gain = connected.bench.sensor.gain_relative_uncertainty
                self._events.publish(BenchOpened(connected.bench.name, connected.bench.simulated, identities, gain))
                while (request := self._next_request(connected)) is not None:
                    request(connected)
                    _release_memory()
        except BenchError as error:
            self.unsafe = isinstance(error, UnsafeError)
            self._fail(str(error))
        except Exception as error:
            if is_memory_short(error):
                self._fail(MEMORY_SHORT)
            else:
                log.exception("the session failed by an error of this program")
                self._fail(f"an error of this program: {type(error).__name__}: {error}")
        finally:
            _ = self.observation
            self._supervisor.ended.set()
            if self._rescue is not None:
                self._rescue.close()
            self.bench = None
            if self.state is not SessionState.NO_BENCH:
                self.state = SessionState.CLOSED
            self._reject_requests()

    def _reject_requests(self) -> None:
        """Reject the runs that were requested of a closed bench; a failed bench has already reported the reason."""
        with suppress(queue.Empty):
            while True:
                if isinstance(self._requests.get_nowait(), partial) and self.state is SessionState.CLOSED:
                    self._events.publish(RunRejected("the bench was closed before the run began; nothing was measured"))
        self.finished.set()

    def _run(self, connection: ConnectedBench, load: Callable[[], RunRequest]) -> None:
        # HDF5 is slow to import: neither before the window is painted nor in its thread.
        from app.session.simulation import provide_sheet
        from protocols.runfile import (
            NotesError,
            RunReadError,
            StorageError,
            add_mounting,
            notes_path,
            read_mountings,
            repair_folder,
        )
        from protocols.runner import Runner

        self.state, self.runner = SessionState.RUNNING, None
        self._forward_injected()
        try:
            request = load()
            for note in unreported_watchdog_messages(request.folder):
                self._events.publish(note)
            for sentence in repair_folder(request.folder, _complete_results):
                self._events.publish(LogMessage(sentence))
            connection.bench.watchdog.set_log_folder(request.folder)
            mountings = read_mountings(request.folder, request.specimen)
            if connection.operator is not None:
                with suppress(BenchError):  # the run reports it better
                    connection.operator.clear_specimen(mountings, _simulated_cycles(request, connection.bench))
            operator = connection.operator or self._operator
            if message := provide_sheet(connection.bench.configuration, request.folder, request.specimen):
                self._events.publish(LogMessage(message))
            left = request.protocol.restore
            self._restore = self._restore or _left_in(request.folder)
            if self._restore is not None and self._restore != left:
                request = replace(request, prepare=(self._restore, *request.prepare))
            self._restore = left or self._restore
            request = replace(_with_conditions(request, connection.bench), mountings=last_mountings(mountings))
            self._mounted = partial(add_mounting, request.folder, request.specimen)
            control = replace(self._control, offer_stop=_bound(self.remote_stop, self.stop))
            self.runner = runner = Runner(request, connection.bench, operator, self._events, control)
        except (RunReadError, StorageError, NotesError, OSError) as error:
            reason = str(error)
            if isinstance(error, OSError):
                reason = f"the folder of the runs cannot be used ({error}); choose another, or check its disk"
            self.outcome = RunEnded(RunStatus.FAILED, reason, "")
            self.state = SessionState.IDLE
            self._events.publish(RunRejected(reason))
        else:
            self.path = runner.path
            self.outcome = runner.run()
            self.path = runner.path
            if not threads_left_behind():  # else the disk of the file may not answer
                record_audit(
                    "run",
                    self.path,
                    notes_path(self.path),
                    subject=request.specimen,
                    verdict=str(self.outcome.verdict.outcome),
                    reason=self.outcome.reason,
                )
        self.finished.set()

    def _next_request(self, connection: ConnectedBench) -> Callable[[ConnectedBench], None] | None:
        """Return the next request; watches the card until then, where that is wanted, and tries again where it fails."""
        while True:
            if self._monitoring.is_set() and self._requests.empty():
                self._monitor(connection)
            with suppress(queue.Empty):
                return self._requests.get(timeout=MONITOR_RETRY_S if self._monitoring.is_set() else None)

    def _monitor(self, connection: ConnectedBench) -> None:
        """Publish blocks of the card until a request arrives; nothing is commanded."""
        bench = connection.bench
        self._last_event_s, self._watches_card = time.monotonic(), True
        waits = not isinstance(bench.configuration.get("speed", 1.0), int | float)  # the virtual clock does not
        try:
            with bench.open_stream(MONITOR_RATE_HZ, MONITOR_BLOCK_S) as stream:
                self._monitor_failed = False
                self._events.publish(MonitorStarted(stream.rate_hz, stream.scales))
                while self._monitoring.is_set() and self._requests.empty():
                    with suppress(ScansLostError):
                        self._events.publish(BlockMonitored(stream.read()))
                    if waits:
                        time.sleep(MONITOR_BLOCK_S)
        except BenchError as error:
            if not self._monitor_failed:
                self._events.publish(MonitorFailed(f"{NO_LIVE_VALUES}: {error}"))
            self._monitor_failed = True
        finally:
            self._watches_card = False

    def _on_event(self, event: SessionEvent) -> None:
        self._last_event_s = time.monotonic()
        match event:
            case RunEnded():
                self.outcome = event
                self.state = SessionState.IDLE  # before the observers, which may start the next run
                self._forward_injected()
            case SpecimenMounted():
                path = self._mounted(event)  # an error is logged by the bus; the run file has the mounting
                record_audit("mounting", path, subject=path.name, part=event.part, by=event.who)
            case PromptShown(ask_id, prompt) if prompt == self._restore:
                self._restore_id = ask_id
            case PromptAnswered(ask_id) if ask_id == self._restore_id:
                self._restore = self._restore_id = None

    def _forward_injected(self) -> None:
        with suppress(queue.Empty):
            while True:
                self._events.publish(self._control.external_events.get_nowait())

    def signs(self) -> Signs:
        """Return the signs of life of the session's thread, from another thread."""
        now_s, bench, runner, ended = time.monotonic(), self.bench, self.runner, self.outcome
        call, call_overdue_s = overdue(self._thread)
        return Signs(
            connecting=self.state is SessionState.CONNECTING,
            running=self.state is SessionState.RUNNING,
            watching_card=self._watches_card,
            may_be_live=runner is not None and runner.may_be_live,
            at_end=runner is not None and runner.at_end,
            told_unsafe=ended is not None and ended.status is RunStatus.UNSAFE and not self.finished.is_set(),
            closing_s=-math.inf
            if self.state in (SessionState.CONNECTING, SessionState.RUNNING)
            else now_s - self._closing_s,
            quiet_s=now_s - self._last_event_s,
            stopped_s=now_s - self._stop_requested_s,
            call=call,
            call_overdue_s=call_overdue_s,
            silent_s=bench.watchdog.overdue_s if bench is not None else -math.inf,
            watchdog_acts=bench is not None and bool(bench.watchdog.takeover_reason or bench.watchdog.inactive_reason),
        )

    def say(self, event: Event) -> None:
        """Publish an event of the supervisor; it is no sign of life."""
        quiet_since_s = self._last_event_s
        self._events.publish(event)
        self._last_event_s = quiet_since_s

    def give_up(self, hangs: str) -> None:
        """Report the session as ended whose thread does not return; the source is brought to rest if it may be live.

        Who waits for `finished` finds state and reason already published.
        """
        self._thread.given_up = True  # before the events below: their observers ask for it
        if self.runner and self.bench and self._rescue and self.state is SessionState.RUNNING:
            status = RunStatus.STOPPED if self._control.cancel.is_set() else RunStatus.FAILED
            self.outcome = self._rescue.end_run(self.runner, self.bench, status, hangs)
            self.path = self.runner.path
            if self.state is SessionState.RUNNING:  # the run could not be concluded
                self._events.publish(self.outcome)
        self._fail(f"{hangs}; end this program and start it again")
        self.finished.set()

    def _fail(self, reason: str) -> None:
        self.state = SessionState.NO_BENCH
        self._events.publish(BenchFailed(reason))


def _bound(page: RemoteStop | None, stop: Callable[[str], None]) -> Callable[[], str] | None:
    """Return what opens a page on which a phone can stop a run; None without a page."""
    return partial(page.open, stop) if page is not None else None


def _with_conditions(request: RunRequest, bench: Bench) -> RunRequest:
    """Return the request with operator, typed temperature and humidity, and warnings of calibrations that are due."""
    from app.config import bench_warnings

    conditions = request.conditions or current_conditions()
    expired, notes = bench_warnings(request.folder, bench.configuration, request.protocol.name)
    return replace(request, conditions=conditions, calibration_warning=expired, notes=(*request.notes, *notes))


def _simulated_cycles(request: RunRequest, bench: Bench) -> float | None:
    """Return the cycles of a specimen by its runs, for a simulated one that ages with them; None for one that does not."""
    if not (bench.configuration.get("simulation") or {}).get("ageing"):
        return None
    from protocols import counted_cycles

    return counted_cycles(request.folder, request.specimen)


def _left_in(folder: Path) -> Prompt | None:
    """Return the prompt by which the set-up of the newest run in a folder, perhaps of another program, is restored."""
    from protocols import PROTOCOLS

    newest = max((path.stem for path in folder.glob("*.h5")), default="")
    protocol = PROTOCOLS.get(re.sub(r"-\d+$", "", newest.rpartition("_")[2])) if newest else None
    return None if protocol is None else protocol.restore


def _complete_results(path: Path) -> str:
    """Complete the results of a run that a killed program left; the modules that read runs are imported then only."""
    from protocols import complete_results

    return complete_results(path)


def unreported_watchdog_messages(folder: Path) -> list[LogMessage]:
    """Return log messages that the watchdog of an earlier program left in `folder`, once."""
    return [LogMessage(f"Since the last start the watchdog wrote: {line}") for line in take_unreported_lines(folder)]


def _release_memory() -> None:
    """Return the memory that a run has freed to the system: glibc keeps it, in pieces that grow from run to run."""
    with suppress(AttributeError, OSError, TypeError):  # other C libraries
        ctypes.CDLL(None).malloc_trim(0)
