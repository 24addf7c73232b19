"""Observed link: an instrument's connection whose messages and replies are reported."""

from collections.abc import Callable
from typing import Any

from drivers.transport.scpi import Link


class ObservedLink:
    """A link that calls `on_message` with each message before it is sent; all other behaviour is the original link's.

    Args:
        link: the connection.
        on_message: callback that may sleep, to separate messages in time.
        on_reply: callback after each reply.
        confirms_steps: whether a driver must wait for the reply to each step of a ramp, because its effect is observed.
    """

    def __init__(
        self,
        link: Link,
        on_message: Callable[[str], None],
        on_reply: Callable[[], None] = lambda: None,
        confirms_steps: Callable[[], bool] = lambda: False,
    ) -> None:
        self._link, self._on_message, self._on_reply = link, on_message, on_reply
        self._confirms_steps = confirms_steps
        self.name = link.name

    @property
    def confirms_steps(self) -> bool:
        return self._confirms_steps()

    def write(self, message: str) -> None:
        """Send a message. Raises LinkError if the connection failed."""
        self._on_message(message)
        self._link.write(message)

    def read(self) -> str:
        """Return the next reply. Raises LinkError if none arrives within the timeout."""
        reply = self._link.read()
        self._on_reply()
        return reply

    def clear(self) -> None:
        """Discard pending replies."""
        self._link.clear()

    def reopen(self) -> None:
        """Close and open again. Raises LinkError if nothing answers."""
        self._link.reopen()

    def close(self) -> None:
        """Close the connection."""
        self._link.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)
