"""What happens in a run is stored first and then told: nobody hears of what the file does not hold."""

import logging
from collections.abc import Callable, Sequence
from queue import SimpleQueue

from drivers.clock import Clock
from drivers.interfaces import Block
from protocols.base.events import BlockStored, Event
from protocols.runfile.errors import StorageError
from protocols.runfile.writer import RunFileWriter

log = logging.getLogger(__name__)

Observer = Callable[[Event], None]


class RunRecorder:
    """The way of every event and block of a run: into its file, then to the observers.

    A store error fails the run; an observer's error is logged and never does. Times are seconds since this was made.
    Other threads put what happens to the bench from outside into `outside`.
    """

    def __init__(
        self,
        run_file: RunFileWriter,
        observers: Sequence[Observer],
        clock: Clock,
        external_events: SimpleQueue[Event] | None = None,
    ) -> None:
        self._run_file, self._observers, self._clock = run_file, tuple(observers), clock
        self._start_s = clock.now()
        self._external_events: SimpleQueue[Event] = SimpleQueue() if external_events is None else external_events
        self._store_failed = False

    def publish(self, event: Event) -> None:
        """Store an event, then tell it. After the store failed once, only tell.

        Raises:
            StoreError: the file cannot be written; nobody was told.
        """
        if not self._store_failed:
            try:
                self._run_file.append_event(event, self._elapsed_s())
            except StorageError:
                self._store_failed = True
                raise
        self.notify(event)

    def publish_external(self) -> None:
        """Store and tell what happened from outside meanwhile.

        Raises:
            StoreError: the file cannot be written; it was told all the same.
        """
        while not self._external_events.empty():
            event = self._external_events.get()
            try:
                self.publish(event)
            except StorageError:
                self.notify(event)
                raise

    def store_block(self, block: Block) -> None:
        """Append a block of samples, then tell it: the sink of an armed bench.

        Raises:
            StoreError: the file cannot be written; nobody was told.
        """
        row = self._run_file.append_block(block, self._elapsed_s())
        self.notify(BlockStored(block, row))

    def notify(self, event: Event) -> None:
        """Tell what need not be kept, or cannot."""
        for observer in self._observers:
            try:
                observer(event)
            except Exception:
                log.exception("an observer failed on %s", event.kind)

    def _elapsed_s(self) -> float:
        return self._clock.now() - self._start_s
