"""A way down that nothing keeps from going on: neither a refused step nor an answer that cannot be read."""

from collections.abc import Callable
from typing import TypeVar

from drivers.deprecated import renamed, renamed_parameters
from drivers.errors import InstrumentError, LinkError
from drivers.transport.scpi import Link

T = TypeVar("T")


@renamed(deaf="blind", ask="query", end="raise_first_error")
class RampDown:
    """Sends the steps of one way and keeps what went wrong on it, to tell it when the way is over.

    A step is confirmed by the box as long as its answers can be read. From the first unreadable one on nothing more is
    asked, and the rest of the way is sent blind: every box obeys what it hears, whether or not we understand its answer.

    Args:
        link: the box's wire.
        stubborn: whether to go on; a way that does not lead to rest ends at its first error instead.
    """

    @renamed_parameters(stubborn="best_effort")
    def __init__(self, link: Link, *, best_effort: bool = True) -> None:
        self._link, self._best_effort = link, best_effort
        self._errors: list[InstrumentError] = []
        self.blind = False

    def query(self, action: Callable[[], T]) -> T | None:
        """What the action returns; None where it failed, or where nothing is asked any more."""
        if self.blind:
            return None
        try:
            return action()
        except InstrumentError as error:
            self._record_error(error)
            return None

    def step(self, command: str, send_confirmed: Callable[[], object]) -> None:
        """One step: `confirmed` sends and confirms it, `words` are what is sent where nothing can be confirmed.

        Raises:
            LinkError: the wire is gone, nothing can be sent at all.
        """
        if not self.blind:
            try:
                send_confirmed()
            except InstrumentError as error:
                self._record_error(error)
        if self.blind:
            self._link.write(command)

    def raise_first_error(self) -> None:
        """Tell what went wrong.

        Raises:
            InstrumentError: something did; LinkError where answers could not be read.
        """
        if not self._errors:
            return
        first = self._errors[0]
        how = (
            "its answers could not be read, and the way to rest was sent blind"
            if self.blind
            else "it was sent all the same"
        )
        more = f"; {len(self._errors) - 1} more such errors" if len(self._errors) > 1 else ""
        raise type(first)(f"{first} ({how}{more})") from first

    def _record_error(self, error: InstrumentError) -> None:
        if not self._best_effort:
            raise error
        self._errors.append(error)
        self.blind = self.blind or isinstance(error, LinkError)
