"""A way down that nothing keeps from going on: neither a refused step nor an answer that cannot be read."""

from collections.abc import Callable
from typing import TypeVar

from drivers.errors import InstrumentError, LinkError
from drivers.transport.scpi import Link

T = TypeVar("T")


class Descent:
    """Sends the steps of one way and keeps what went wrong on it, to tell it when the way is over.

    A step is confirmed by the box as long as its answers can be read. From the first unreadable one on nothing more is
    asked, and the rest of the way is sent blind: every box obeys what it hears, whether or not we understand its answer.

    Args:
        link: the box's wire.
        stubborn: whether to go on; a way that does not lead to rest ends at its first error instead.
    """

    def __init__(self, link: Link, *, stubborn: bool = True) -> None:
        self._link, self._stubborn = link, stubborn
        self._troubles: list[InstrumentError] = []
        self.deaf = False

    def ask(self, action: Callable[[], T]) -> T | None:
        """What the action returns; None where it failed, or where nothing is asked any more."""
        if self.deaf:
            return None
        try:
            return action()
        except InstrumentError as error:
            self._met(error)
            return None

    def step(self, words: str, confirmed: Callable[[], object]) -> None:
        """One step: `confirmed` sends and confirms it, `words` are what is sent where nothing can be confirmed.

        Raises:
            LinkError: the wire is gone, nothing can be sent at all.
        """
        if not self.deaf:
            try:
                confirmed()
            except InstrumentError as error:
                self._met(error)
        if self.deaf:
            self._link.write(words)

    def end(self) -> None:
        """Tell what went wrong.

        Raises:
            InstrumentError: something did; LinkError where answers could not be read.
        """
        if not self._troubles:
            return
        first = self._troubles[0]
        how = (
            "its answers could not be read, and the way to rest was sent blind"
            if self.deaf
            else "it was sent all the same"
        )
        more = f"; {len(self._troubles) - 1} more such errors" if len(self._troubles) > 1 else ""
        raise type(first)(f"{first} ({how}{more})") from first

    def _met(self, error: InstrumentError) -> None:
        if not self._stubborn:
            raise error
        self._troubles.append(error)
        self.deaf = self.deaf or isinstance(error, LinkError)
