"""Event bus: delivers the events of a run or a session to its observers."""

import logging
from collections.abc import Callable
from typing import Any

log = logging.getLogger(__name__)

Observer = Callable[[Any], object]


class EventBus:
    """Delivers each event to all observers, in the order they subscribed.

    An observer's exception is logged and reaches neither the publisher nor the other observers.
    """

    def __init__(self, *observers: Observer) -> None:
        self._observers = list(observers)

    def subscribe(self, observer: Observer) -> None:
        """Add an observer; it is called in the publisher's thread."""
        self._observers.append(observer)

    def publish(self, event: Any) -> None:
        """Deliver an event."""
        for observer in self._observers:
            try:
                observer(event)
            except Exception:
                log.exception("an observer failed on %s", event.kind)
