"""What happens in a run is stored first and then told: nobody hears of what the file does not hold."""

import logging
from collections.abc import Callable, Sequence
from queue import SimpleQueue

from drivers.clock import Clock
from drivers.interfaces import Block
from protocols.base.events import BlockTaken, Event
from protocols.runfile.errors import StoreError
from protocols.runfile.writer import RunFile

log = logging.getLogger(__name__)

Observer = Callable[[Event], None]


class Publisher:
    """The way of every event and block of a run: into its file, then to the observers.

    A store error fails the run; an observer's error is logged and never does. Times are seconds since this was made.
    Other threads put what happens to the bench from outside into `outside`.
    """

    def __init__(
        self, store: RunFile, observers: Sequence[Observer], clock: Clock, outside: SimpleQueue[Event] | None = None
    ) -> None:
        self._store, self._observers, self._clock = store, tuple(observers), clock
        self._begin_s = clock.now()
        self._outside: SimpleQueue[Event] = SimpleQueue() if outside is None else outside
        self._broken = False

    def publish(self, event: Event) -> None:
        """Store an event, then tell it. After the store failed once, only tell.

        Raises:
            StoreError: the file cannot be written; nobody was told.
        """
        if not self._broken:
            try:
                self._store.event(event, self._now())
            except StoreError:
                self._broken = True
                raise
        self.tell(event)

    def publish_outside(self) -> None:
        """Store and tell what happened from outside meanwhile.

        Raises:
            StoreError: the file cannot be written; it was told all the same.
        """
        while not self._outside.empty():
            event = self._outside.get()
            try:
                self.publish(event)
            except StoreError:
                self.tell(event)
                raise

    def take(self, block: Block) -> None:
        """Append a block of samples, then tell it: the sink of an armed bench.

        Raises:
            StoreError: the file cannot be written; nobody was told.
        """
        row = self._store.block(block, self._now())
        self.tell(BlockTaken(block, row))

    def tell(self, event: Event) -> None:
        """Tell what need not be kept, or cannot."""
        for observer in self._observers:
            try:
                observer(event)
            except Exception:
                log.exception("an observer failed on %s", event.kind)

    def _now(self) -> float:
        return self._clock.now() - self._begin_s
