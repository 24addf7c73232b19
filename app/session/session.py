"""A session with one bench: a thread that owns the instruments, connects, runs what it is told, and lets go.

Front ends (window, command line, tests) start it, ask for runs, stop them, and observe. Nothing here knows who asks.

A run that a session was asked for, and what its file says before it begins.
"""

import logging
import queue
import threading
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol

from drivers.bench.bench import Bench
from drivers.errors import BenchError
from drivers.watchdog.log import take_unreported_lines
from protocols.base.events import Event, LogMessage, RunEnded, RunStatus
from protocols.base.operator import Operator
from protocols.base.protocol import Protocol as Measurement
from protocols.base.steps import Prompt

if TYPE_CHECKING:
    from protocols.resume import ResumableRun
    from protocols.runfile.writer import RunMetadata
    from sim_hardware.operator import BenchControls


@dataclass(frozen=True, slots=True)
class RunRequest:
    """A run with its protocol, and the run it goes on with."""

    protocol: Measurement
    folder: Path
    specimen: str
    resume: "ResumableRun | None" = None
    prepare: tuple[Prompt, ...] = ()


@dataclass(frozen=True, slots=True)
class RepeatRequest:
    """A run that goes on with another one, which is read when its turn comes."""

    path: Path
    entries: tuple[int, ...]
    folder: Path

    def load(self) -> RunRequest:
        """The job that goes on with that run.

        Raises:
            RunError: there is no such run to go on with.
        """
        from protocols.resume import load_resumable

        before = load_resumable(self.path, self.entries)
        return RunRequest(before.protocol, self.folder, before.specimen, before)


def run_metadata(protocol: Measurement, bench: Bench, specimen: str, continues: Path | None = None) -> "RunMetadata":
    """What the run file says about a run before it begins."""
    from protocols.runfile.writer import RunMetadata

    return RunMetadata(
        protocol=protocol.name,
        title=protocol.title,
        parameters=protocol.model_dump(mode="json"),
        point_type=protocol.point_type,
        axes=protocol.axes,
        sensor=bench.sensor,
        bench=bench.configuration,
        simulated=bench.simulated,
        specimen=specimen,
        resumed_from=continues,
    )


log = logging.getLogger(__name__)


class SessionState(StrEnum):
    """What the session is doing, in a word a person understands."""

    CONNECTING = "connecting"
    IDLE = "at rest"
    RUNNING = "running"
    NO_BENCH = "no bench"
    CLOSED = "closed"


@dataclass(frozen=True, slots=True)
class BenchOpened:
    """The instruments answer; `identities` by role."""

    kind: ClassVar[str] = "BenchOpened"
    name: str
    simulated: bool
    identities: dict[str, str]


@dataclass(frozen=True, slots=True)
class BenchFailed:
    """The bench cannot be used; the sentence says why and what to do."""

    kind: ClassVar[str] = "BenchFailed"
    words: str


@dataclass(frozen=True, slots=True)
class RunRejected:
    """A run was not even begun: its file could not be created, or the one it goes on with not be read."""

    kind: ClassVar[str] = "Refused"
    words: str


SessionEvent = Event | BenchOpened | BenchFailed | RunRejected
Observer = Callable[[SessionEvent], None]


class BuiltInOperator(Operator, Protocol):
    """An operator that the bench brings along."""

    def clear_specimen(self) -> None:
        """Take off what a run that was stopped left on the specimen. Raises BenchError where the bench is gone."""


class ConnectedBench(Protocol):
    """What the composition root hands over."""

    @property
    def bench(self) -> Bench: ...

    @property
    def operator(self) -> BuiltInOperator | None:
        """Answers prompts by itself (a simulated operator), or None where a person must."""

    @property
    def control(self) -> "BenchControls | None":
        """Controls of a simulated bench: injects and clears faults; None for a real one."""


class Session:
    """One bench, one thread, any number of runs one after the other.

    Args:
        connect: opens the bench; a context manager that also closes it.
        observers: told every event, in the session's thread.
        operator: answers prompts where the bench brings no operator of its own.
    """

    def __init__(
        self,
        connect: Callable[[], AbstractContextManager[ConnectedBench]],
        observers: Sequence[Observer],
        operator: Operator,
    ) -> None:
        self._connect, self._observers, self._operator = connect, tuple(observers), operator
        self._injected_events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._requests: queue.SimpleQueue[RunRequest | RepeatRequest | None] = queue.SimpleQueue()
        self._cancel, self._pause = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._work, name="bench", daemon=False)
        self.state = SessionState.CONNECTING
        self.outcome: tuple[RunStatus, str] | None = None
        self.path: Path | None = None
        self.finished = threading.Event()
        """Set when the run that was asked for has ended, or will never begin because there is no bench."""
        self.bench: Bench | None = None

    def start(self) -> None:
        """Begin to connect; returns at once."""
        self._thread.start()

    def run(
        self,
        protocol: Measurement,
        folder: Path,
        specimen: str,
        resume: "ResumableRun | None" = None,
        prepare: Sequence[Prompt] = (),
    ) -> None:
        """Queue a run, or one that goes on with an earlier one; `prepare` is asked for first. Returns at once."""
        self._enqueue(RunRequest(protocol, folder, specimen, resume, tuple(prepare)))

    def repeat_entries(self, path: Path, entries: Sequence[int], folder: Path) -> None:
        """Queue a run that measures some entries of the run `path` again. Returns at once; it is read in our thread."""
        self._enqueue(RepeatRequest(path, tuple(entries), folder))

    def _enqueue(self, request: RunRequest | RepeatRequest) -> None:
        self._cancel.clear()
        self._pause.clear()
        self.outcome = None
        self.finished.clear()
        self._requests.put(request)
        if self.state in (SessionState.NO_BENCH, SessionState.CLOSED):
            self.finished.set()

    @property
    def pause_requested(self) -> bool:
        """Whether the present run shall be at rest and wait."""
        return self._pause.is_set()

    def stop(self) -> None:
        """Ask the present run to go to rest and end; returns at once."""
        self._cancel.set()

    def pause(self) -> None:
        """Ask the present run to go to rest and wait there; returns at once."""
        self._pause.set()

    def resume(self) -> None:
        """Let a paused run go on; returns at once."""
        self._pause.clear()

    def inject_event(self, event: Event) -> None:
        """Something happened to the bench from outside: into the file of the run that goes on, and told. From any thread."""
        self._injected_events.put(event)
        if self.state is not SessionState.RUNNING:
            self._forward_injected()

    def close(self, timeout_s: float | None = None) -> bool:
        """Stop, go to rest, let go of the bench; whether the thread has ended within `timeout_s`."""
        self.stop()
        self._requests.put(None)
        if self._thread.is_alive():
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _work(self) -> None:
        try:
            with self._connect() as connected:
                self.bench = connected.bench
                identities = dict(connected.bench.configuration.get("identities", {}))
                self._set_state(SessionState.IDLE)
                self._notify(BenchOpened(connected.bench.name, connected.bench.simulated, identities))
                while (job := self._requests.get()) is not None:
                    self._run(connected, job)
        except BenchError as error:
            self._fail(str(error))
        except Exception as error:
            log.exception("the session failed by an error of this program")
            self._fail(f"an error of this program: {type(error).__name__}: {error}")
        finally:
            self.bench = None
            if self.state is not SessionState.NO_BENCH:
                self._set_state(SessionState.CLOSED)
            self.finished.set()

    def _run(self, connection: ConnectedBench, request: RunRequest | RepeatRequest) -> None:
        # HDF5 and what comes with it: not before the window is painted, and not in its thread.
        from protocols.runfile.errors import StorageError
        from protocols.runfile.open import RunReadError
        from protocols.runfile.writer import RunFileWriter
        from protocols.runner.runner import Runner

        self._set_state(SessionState.RUNNING)
        self._forward_injected()
        try:
            job = request.load() if isinstance(request, RepeatRequest) else request
            if isinstance(request, RepeatRequest) and self._cancel.is_set():
                raise RunReadError(
                    f"Stopped before the run began; nothing was measured. {request.path.name} is as it was."
                )
        except RunReadError as error:
            self._reject(str(error))
            return
        for note in unreported_watchdog_messages(job.folder):
            self._notify(note)
        connection.bench.watchdog.set_log_folder(job.folder)
        try:
            continues = job.resume.path if job.resume else None
            store = RunFileWriter.new(job.folder, run_metadata(job.protocol, connection.bench, job.specimen, continues))
        except StorageError as error:
            self._reject(str(error))
        else:
            self.path = store.path
            operator = connection.operator or self._operator
            if connection.operator is not None:
                with suppress(BenchError):  # the run will say it better
                    connection.operator.clear_specimen()
            continuation = job.resume.resume_state if job.resume else None
            runner = Runner(
                job.protocol,
                connection.bench,
                store,
                operator,
                [self._forward],
                self._cancel,
                self._pause,
                continuation,
                job.prepare,
                self._injected_events,
            )
            self.outcome = runner.run()
            self.finished.set()

    def _reject(self, reason: str) -> None:
        self.outcome = (RunStatus.FAILED, reason)
        self._set_state(SessionState.IDLE)
        self._notify(RunRejected(reason))
        self.finished.set()

    def _forward(self, event: Event) -> None:
        if isinstance(event, RunEnded):
            self._set_state(
                SessionState.IDLE
            )  # before observers hear, so that they see a session ready for the next run
            self._forward_injected()
        self._notify(event)

    def _forward_injected(self) -> None:
        with suppress(queue.Empty):
            while True:
                self._notify(self._injected_events.get_nowait())

    def _fail(self, reason: str) -> None:
        self._set_state(SessionState.NO_BENCH)
        self._notify(BenchFailed(reason))

    def _set_state(self, state: SessionState) -> None:
        self.state = state

    def _notify(self, event: SessionEvent) -> None:
        for observer in self._observers:
            try:
                observer(event)
            except Exception:
                log.exception("an observer failed on %s", event.kind)


def unreported_watchdog_messages(folder: Path) -> list[LogMessage]:
    """What the watchdog of an earlier program left to be told beside these runs; told once."""
    return [LogMessage(f"Since the last start the watchdog wrote: {line}") for line in take_unreported_lines(folder)]
