"""Recorder of a run, which stores events and blocks in the run file and then publishes them; interrupts by Stop and Pause."""

from collections.abc import Callable
from queue import SimpleQueue

from drivers import BenchError, Block, Clock
from protocols.base import BlockStored, Event, EventBus, StopRequested
from protocols.runfile import FileLostError, RunFileWriter, StorageError
from protocols.runner.request import RunControl


class RunRecorder:
    """Stores every event and block of a run in its file, then publishes it: observers see only stored data.

    A storage error fails the run. Times in the file are seconds since the creation of the recorder.

    Args:
        external_events: events of other threads, such as faults injected into a simulated bench.
    """

    def __init__(
        self, run_file: RunFileWriter, events: EventBus, clock: Clock, external_events: SimpleQueue[Event]
    ) -> None:
        self._run_file, self._clock, self._external_events = run_file, clock, external_events
        self._start_s = clock.now()
        self._store_failed = False
        self.notify = events.publish
        """Publishes an event without storing it."""
        self.stopped_by = "the operator"
        """Who requests the end of the run, if somebody does."""

    def publish(self, event: Event) -> None:
        """Store an event, then publish it; after a storage error, only publish.

        Raises:
            StorageError: the file cannot be written; the event was not published.
        """
        if not self._store_failed:
            try:
                self._run_file.append_event(event, self.elapsed_s())
            except FileLostError:  # later events can still be saved
                raise
            except StorageError:
                self._store_failed = True
                raise
        self.notify(event)

    def publish_always(self, event: Event) -> None:
        """Store and publish an event; if it cannot be stored, only publish it, because safety must be reported."""
        try:
            self.publish(event)
        except StorageError:
            self.notify(event)

    def publish_external(self) -> None:
        """Store and publish the external events received.

        Raises:
            StorageError: the file cannot be written; the event was published.
        """
        while not self._external_events.empty():
            event = self._external_events.get()
            if isinstance(event, StopRequested):
                self.stopped_by = event.by
            try:
                self.publish(event)
            except StorageError:
                self.notify(event)
                raise

    def store_block(self, block: Block) -> None:
        """Append a block of samples, then publish it: the sink of an armed bench.

        Raises:
            StorageError: the file cannot be written; the block was not published.
        """
        row = self._run_file.append_block(block, self.elapsed_s())
        self.notify(BlockStored(block, row))

    def elapsed_s(self) -> float:
        """Return the time since the stream began, s."""
        return self._clock.now() - self._start_s


class RunCancelled(Exception):
    """Stop was requested."""


class PauseInterrupt(Exception):
    """Pause was requested."""


class InterruptCheck:
    """Raises the requested interrupts, and publishes the events of other threads."""

    def __init__(self, control: RunControl, recorder: RunRecorder) -> None:
        self._control, self._recorder = control, recorder
        self.pausable = False
        """Whether a pause may interrupt the run now."""
        self.overtime: Callable[[], str] = lambda: ""
        """Reason why the run has lasted too long; empty while it has not."""

    @property
    def is_pause_requested(self) -> bool:
        return self._control.pause.is_set()

    def check(self) -> None:
        """Publish external events and raise a requested interrupt.

        Raises:
            RunCancelled: Stop was requested.
            PauseInterrupt: Pause was requested, and the run is pausable.
            BenchError: the run has lasted too long.
            StorageError: an event cannot be stored.
        """
        cancelled = self._control.cancel.is_set()  # before the events are taken: who requested it is put there first
        self._recorder.publish_external()
        if cancelled:
            raise RunCancelled
        if reason := self.overtime():
            raise BenchError(reason)
        if self.pausable and self.is_pause_requested:
            raise PauseInterrupt
