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
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from drivers.bench.bench import Bench
from drivers.errors import BenchError
from drivers.watchdog.log import untold
from protocols.base.events import Event, Noted, RunEnded, Status
from protocols.base.operator import Operator
from protocols.base.protocol import Protocol as Measurement
from protocols.base.steps import Prompt

if TYPE_CHECKING:
    from protocols.resume import Earlier
    from protocols.runfile.writer import Header


@dataclass(frozen=True, slots=True)
class Job:
    """A run with its protocol, and the run it goes on with."""

    protocol: Measurement
    folder: Path
    specimen: str
    earlier: "Earlier | None" = None
    prepare: tuple[Prompt, ...] = ()


@dataclass(frozen=True, slots=True)
class Again:
    """A run that goes on with another one, which is read when its turn comes."""

    path: Path
    entries: tuple[int, ...]
    folder: Path

    def read(self) -> Job:
        """The job that goes on with that run.

        Raises:
            RunError: there is no such run to go on with.
        """
        from protocols.resume import earlier

        before = earlier(self.path, self.entries)
        return Job(before.protocol, self.folder, before.specimen, before)


def header(protocol: Measurement, bench: Bench, specimen: str, continues: Path | None = None) -> "Header":
    """What the run file says about a run before it begins."""
    from protocols.runfile.writer import Header

    return Header(
        protocol=protocol.name,
        title=protocol.title,
        parameters=protocol.model_dump(mode="json"),
        point_type=protocol.point_type,
        axes=protocol.axes,
        sensor=bench.sensor,
        bench=bench.record,
        simulated=bench.simulated,
        specimen=specimen,
        continues=continues,
    )


log = logging.getLogger(__name__)


class State(StrEnum):
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
class Refused:
    """A run was not even begun: its file could not be created, or the one it goes on with not be read."""

    kind: ClassVar[str] = "Refused"
    words: str


SessionEvent = Event | BenchOpened | BenchFailed | Refused
Observer = Callable[[SessionEvent], None]


class OwnOperator(Operator, Protocol):
    """An operator that the bench brings along."""

    def tidy(self) -> None:
        """Take off what a run that was stopped left on the specimen. Raises BenchError where the bench is gone."""


class Connected(Protocol):
    """What the composition root hands over."""

    @property
    def bench(self) -> Bench: ...

    @property
    def operator(self) -> OwnOperator | None:
        """Answers prompts by itself (a simulated operator), or None where a person must."""

    @property
    def control(self) -> Any:
        """Reaches into a simulated bench, to break and mend it; None for a real one."""


class Session:
    """One bench, one thread, any number of runs one after the other.

    Args:
        connect: opens the bench; a context manager that also closes it.
        observers: told every event, in the session's thread.
        operator: answers prompts where the bench brings no operator of its own.
    """

    def __init__(
        self,
        connect: Callable[[], AbstractContextManager[Connected]],
        observers: Sequence[Observer],
        operator: Operator,
    ) -> None:
        self._connect, self._observers, self._operator = connect, tuple(observers), operator
        self._outside: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._jobs: queue.SimpleQueue[Job | Again | None] = queue.SimpleQueue()
        self._cancel, self._pause = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._work, name="bench", daemon=False)
        self.state = State.CONNECTING
        self.outcome: tuple[Status, str] | None = None
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
        earlier: "Earlier | None" = None,
        prepare: Sequence[Prompt] = (),
    ) -> None:
        """Queue a run, or one that goes on with an earlier one; `prepare` is asked for first. Returns at once."""
        self._queue(Job(protocol, folder, specimen, earlier, tuple(prepare)))

    def measure_again(self, path: Path, entries: Sequence[int], folder: Path) -> None:
        """Queue a run that measures some entries of the run `path` again. Returns at once; it is read in our thread."""
        self._queue(Again(path, tuple(entries), folder))

    def _queue(self, job: Job | Again) -> None:
        self._cancel.clear()
        self._pause.clear()
        self.outcome = None
        self.finished.clear()
        self._jobs.put(job)
        if self.state in (State.NO_BENCH, State.CLOSED):
            self.finished.set()

    @property
    def pausing(self) -> bool:
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

    def happened(self, event: Event) -> None:
        """Something happened to the bench from outside: into the file of the run that goes on, and told. From any thread."""
        self._outside.put(event)
        if self.state is not State.RUNNING:
            self._tell_outside()

    def close(self, timeout_s: float | None = None) -> bool:
        """Stop, go to rest, let go of the bench; whether the thread has ended within `timeout_s`."""
        self.stop()
        self._jobs.put(None)
        if self._thread.is_alive():
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _work(self) -> None:
        try:
            with self._connect() as connected:
                self.bench = connected.bench
                identities = dict(connected.bench.record.get("identities", {}))
                self._become(State.IDLE)
                self._tell(BenchOpened(connected.bench.name, connected.bench.simulated, identities))
                while (job := self._jobs.get()) is not None:
                    self._run(connected, job)
        except BenchError as error:
            self._lose(str(error))
        except Exception as error:
            log.exception("the session failed by an error of this program")
            self._lose(f"an error of this program: {type(error).__name__}: {error}")
        finally:
            self.bench = None
            if self.state is not State.NO_BENCH:
                self._become(State.CLOSED)
            self.finished.set()

    def _run(self, connected: Connected, asked: Job | Again) -> None:
        # HDF5 and what comes with it: not before the window is painted, and not in its thread.
        from protocols.runfile.errors import StoreError
        from protocols.runfile.open import RunError
        from protocols.runfile.writer import RunFile
        from protocols.runner.runner import Runner

        self._become(State.RUNNING)
        self._tell_outside()
        try:
            job = asked.read() if isinstance(asked, Again) else asked
            if isinstance(asked, Again) and self._cancel.is_set():
                raise RunError(f"Stopped before the run began; nothing was measured. {asked.path.name} is as it was.")
        except RunError as error:
            self._refuse(str(error))
            return
        for note in watchdog_notes(job.folder):
            self._tell(note)
        connected.bench.watchdog.log_to(job.folder)
        try:
            continues = job.earlier.path if job.earlier else None
            store = RunFile.new(job.folder, header(job.protocol, connected.bench, job.specimen, continues))
        except StoreError as error:
            self._refuse(str(error))
        else:
            self.path = store.path
            operator = connected.operator or self._operator
            if connected.operator is not None:
                with suppress(BenchError):  # the run will say it better
                    connected.operator.tidy()
            continuation = job.earlier.continuation if job.earlier else None
            runner = Runner(
                job.protocol,
                connected.bench,
                store,
                operator,
                [self._pass_on],
                self._cancel,
                self._pause,
                continuation,
                job.prepare,
                self._outside,
            )
            self.outcome = runner.run()
            self.finished.set()

    def _refuse(self, words: str) -> None:
        self.outcome = (Status.FAILED, words)
        self._become(State.IDLE)
        self._tell(Refused(words))
        self.finished.set()

    def _pass_on(self, event: Event) -> None:
        if isinstance(event, RunEnded):
            self._become(State.IDLE)  # before observers hear, so that they see a session ready for the next run
            self._tell_outside()
        self._tell(event)

    def _tell_outside(self) -> None:
        with suppress(queue.Empty):
            while True:
                self._tell(self._outside.get_nowait())

    def _lose(self, words: str) -> None:
        self._become(State.NO_BENCH)
        self._tell(BenchFailed(words))

    def _become(self, state: State) -> None:
        self.state = state

    def _tell(self, event: SessionEvent) -> None:
        for observer in self._observers:
            try:
                observer(event)
            except Exception:
                log.exception("an observer failed on %s", event.kind)


def watchdog_notes(folder: Path) -> list[Noted]:
    """What the watchdog of an earlier program left to be told beside these runs; told once."""
    return [Noted(f"Since the last start the watchdog wrote: {line}") for line in untold(folder)]
