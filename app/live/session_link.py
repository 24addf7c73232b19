"""The window's wire to the session: events come through a queue, samples through the feed, wishes go out. No Qt.

Prompts that the window answers: the runner polls in the bench thread, the window replies by id. No Qt.
"""

import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from app.live.feed import LiveFeed
from app.session.fault_injection import FaultPlan
from app.session.session import Connected, Observer, Session, SessionEvent
from app.session.state import Heard
from drivers.bench.bench import Bench
from protocols.base.events import BlockSeen, BlockTaken, Event, RunEnded, RunStarted, StreamStarted
from protocols.base.operator import Operator
from protocols.base.protocol import Protocol as Measurement
from protocols.base.steps import Prompt

if TYPE_CHECKING:
    from protocols.resume import Earlier


class MailboxOperator:
    """Holds one prompt and its answer (protocols.base.operator.Operator); a new prompt throws away whatever was there."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: int | None = None
        self._answer: tuple[int, str] | None = None

    @property
    def waiting(self) -> int | None:
        """The id of the prompt that this operator must answer, None where nothing is asked of it."""
        with self._lock:
            return self._waiting

    def show(self, ask_id: int, _prompt: Prompt) -> None:
        with self._lock:
            self._waiting, self._answer = ask_id, None

    def answer(self, ask_id: int) -> str | None:
        with self._lock:
            if self._answer is None or self._answer[0] != ask_id:
                return None
            words = self._answer[1]
            self._waiting, self._answer = None, None
            return words

    def reply(self, ask_id: int, words: str = "done") -> bool:
        """Answer a prompt; whether it was still waiting."""
        with self._lock:
            if self._waiting != ask_id or self._answer is not None:
                return False
            self._answer = (ask_id, words)
            return True

    def forget(self) -> None:
        """The run is over; nothing is asked any more."""
        with self._lock:
            self._waiting, self._answer = None, None


Connect = Callable[[], AbstractContextManager[Connected]]


class SessionLike(Protocol):
    """What the window needs of a session."""

    bench: Bench | None

    def start(self) -> None: ...

    def run(
        self,
        protocol: Measurement,
        folder: Path,
        specimen: str,
        earlier: "Earlier | None" = None,
        prepare: Sequence[Prompt] = (),
    ) -> None: ...

    def measure_again(self, path: Path, entries: Sequence[int], folder: Path) -> None: ...

    def pause(self) -> None: ...

    def resume(self) -> None: ...

    def stop(self) -> None: ...

    def happened(self, event: Event) -> None: ...

    def close(self, timeout_s: float | None = None) -> bool: ...


MakeSession = Callable[[Connect, Sequence[Observer], Operator], SessionLike]


class Link:
    """One session at a time; a bench that could not be opened may be opened again."""

    def __init__(self, connect: Connect, make_session: MakeSession = Session) -> None:
        self.mailbox, self.feed = MailboxOperator(), LiveFeed()
        self.faults = FaultPlan()
        """Hands that break and mend a simulated bench."""
        self._connect, self._make_session = self.faults.around(connect), make_session
        self._heard: queue.SimpleQueue[Heard] = queue.SimpleQueue()
        self.listeners: list[Observer] = []
        """Told every event but the samples, in the bench thread, before the window hears it."""
        self.session = self._begin()

    def reconnect(self) -> bool:
        """Open the bench again; whether the last session had let go of it."""
        if not self.session.close(0.0):
            return False
        self.session = self._begin()
        return True

    def heard(self) -> Iterator[Heard]:
        """What happened since this was last asked; never waits."""
        while True:
            try:
                yield self._heard.get_nowait()
            except queue.Empty:
                return

    def tell(self, events: Sequence[SessionEvent]) -> None:
        """Tell what no session has told; from any thread."""
        for event in events:
            self.observe(event)

    def observe(self, event: SessionEvent) -> None:
        """Called in the bench thread: blocks go to the feed, everything else into the queue."""
        if isinstance(event, BlockTaken | BlockSeen):
            self.feed.take(event.block)
            return
        if isinstance(event, StreamStarted) and self.session.bench is not None:
            self.feed.begin(event.rate_hz, event.scales, self.session.bench.sensor)
        elif isinstance(event, RunEnded):
            self.mailbox.forget()
        try:
            if isinstance(event, RunStarted):
                self.faults(event)
            for listener in self.listeners:
                listener(event)
        finally:
            self._heard.put(Heard(event, datetime.now().astimezone(), self.feed.streamed_s))

    def _begin(self) -> SessionLike:
        session = self._make_session(self._connect, [self.observe], self.mailbox)
        self.faults.tell = session.happened
        return session
