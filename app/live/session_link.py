"""Session adapter: queues session events and samples for the window, and answers prompts."""

import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, suppress
from datetime import datetime

from app.live.feed import LiveFeed
from app.session import (
    BlockMonitored,
    ConnectedBench,
    FaultPlan,
    MonitorStarted,
    Observation,
    Observer,
    RemoteStop,
    Session,
    SessionEvent,
    SimulationSettings,
    TimedEvent,
    WindowEvent,
    practise,
)
from drivers import Bench
from protocols.base import BlockDiscarded, BlockStored, EventBus, Operator, Prompt, RunEnded, RunStarted, StreamStarted


class PromptMailbox:
    """Holds one prompt and its answer (protocols.base.Operator); a new prompt replaces the previous one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._pending_id: int | None = None
        self._answer: tuple[int, str] | None = None

    @property
    def pending_id(self) -> int | None:
        """Id of the prompt that the window must answer, or None."""
        with self._lock:
            return self._pending_id

    def show(self, ask_id: int, _prompt: Prompt) -> None:
        with self._lock:
            self._pending_id, self._answer = ask_id, None

    def answer(self, ask_id: int) -> str | None:
        with self._lock:
            if self._answer is None or self._answer[0] != ask_id:
                return None
            choice = self._answer[1]
            self._pending_id = self._answer = None
            return choice

    def reply(self, ask_id: int, choice: str = "done") -> bool:
        """Answer a prompt and return whether it was still waiting."""
        with self._lock:
            if self._pending_id != ask_id or self._answer is not None:
                return False
            self._answer = (ask_id, choice)
            return True

    def clear(self) -> None:
        """Drop the prompt after the run."""
        with self._lock:
            self._pending_id = self._answer = None


Connect = Callable[[], AbstractContextManager[ConnectedBench]]


MakeSession = Callable[[Connect, Sequence[Observer], Operator], Session]


class SessionAdapter:
    """Connects the window with one session at a time; `reconnect` makes a new one.

    Args:
        connect: opens the bench.
        make_session: session factory, for tests without a bench.
        simulation: settings of a simulated bench that the operator may change.
        remote_stop: page on which a phone can stop a run.
    """

    def __init__(
        self,
        connect: Connect,
        make_session: MakeSession = Session,
        simulation: SimulationSettings | None = None,
        remote_stop: RemoteStop | None = None,
    ) -> None:
        self.mailbox, self.feed, self.simulation = PromptMailbox(), LiveFeed(), simulation
        if simulation is not None:
            connect = practise(connect, self.mailbox, simulation)
        self.faults = FaultPlan()
        """Injects faults into a simulated bench."""
        self._connect, self._make_session = self.faults.wrap(connect), make_session
        self._remote_stop = remote_stop
        self._events: queue.SimpleQueue[TimedEvent] = queue.SimpleQueue()
        self.events = EventBus()
        """Called in the bench thread with every event except samples, before the window."""
        self._seen = Observation()
        self.commissioned: Bench | None = None
        """Bench that is commissioned with high voltage on, after the session has released it."""
        self.on_event: Callable[[], object] = lambda: None
        """Called in any thread when an event waits for the window."""
        self.session = self._new_session()

    def reconnect(self) -> bool:
        """Open the bench again; returns False while the last session still holds it."""
        if not self.session.close(0.0):
            return False
        self.session = self._new_session()
        return True

    def pending_events(self) -> Iterator[TimedEvent]:
        """Yield the events since the last call without waiting."""
        with suppress(queue.Empty):
            while True:
                yield self._events.get_nowait()

    def publish(self, events: Sequence[SessionEvent]) -> None:
        """Publish events that come from no session; from any thread."""
        for event in events:
            self.observe(event)

    def observe(self, event: SessionEvent) -> None:
        """Forward blocks to the feed and every other event to the queue; called in the bench thread."""
        self.feed.running_curve.observe(event)
        if isinstance(event, BlockStored | BlockDiscarded | BlockMonitored):
            self.feed.add_block(event.block, monitored=isinstance(event, BlockMonitored))
            if isinstance(event, BlockMonitored):  # otherwise every frame is drawn
                self.on_event()
            return
        if isinstance(event, StreamStarted | MonitorStarted) and (bench := self.session.bench) is not None:
            self.feed.start_stream(event.rate_hz, event.scales, bench.sensor, bench.channels)
        if isinstance(event, RunEnded):
            self.mailbox.clear()
        try:
            if isinstance(event, RunStarted):
                self.faults(event)
            self.events.publish(event)
        finally:
            self._events.put(self.timed(event))
            self.on_event()

    def timed(self, event: WindowEvent) -> TimedEvent:
        """Return an event with the present time."""
        return TimedEvent(event, datetime.now().astimezone(), self.feed.streamed_s, time.monotonic())

    @property
    def observation(self) -> Observation:
        """The last answers of the instruments, including answers from an earlier session."""
        bench = self.commissioned
        seen = self.session.observation if bench is None else Observation.of(bench)
        if seen.card is not None:
            self._seen = seen
        return self._seen

    def _new_session(self) -> Session:
        session = self._make_session(self._connect, [self.observe], self.mailbox)
        session.remote_stop = self._remote_stop
        session.monitor(active=True)
        self.faults.on_switched = session.inject_event
        return session
