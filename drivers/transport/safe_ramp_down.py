"""Safe ramp-down: continues despite rejected steps and unreadable replies."""

from collections.abc import Callable
from typing import TypeVar

from drivers.deprecated import renamed, renamed_parameters
from drivers.errors import InstrumentError, LinkError
from drivers.transport.scpi import Link

T = TypeVar("T")


@renamed(deaf="blind", ask="query", end="raise_first_error")
class RampDown:
    """Sends the steps of one ramp and collects the errors, to be raised when the ramp is complete.

    The instrument confirms each step as long as its replies can be read. After the first unreadable reply nothing more is
    queried and the rest is sent blind: an instrument carries out what it receives, whether or not its reply arrives.

    Args:
        link: the link to the instrument.
        best_effort: whether to continue after an error; a ramp that does not lead to rest raises the first one instead.
    """

    @renamed_parameters(stubborn="best_effort")
    def __init__(self, link: Link, *, best_effort: bool = True) -> None:
        self._link, self._best_effort = link, best_effort
        self._errors: list[InstrumentError] = []
        self.blind = False

    def query(self, action: Callable[[], T]) -> T | None:
        """Return what the action returns; None if it failed, or if replies cannot be read any more."""
        if self.blind:
            return None
        try:
            return action()
        except InstrumentError as error:
            self._record_error(error)
            return None

    def step(self, command: str, send_confirmed: Callable[[], object]) -> None:
        """Send one step: `send_confirmed` sends and confirms it; `command` is sent if replies cannot be read any more.

        Raises:
            LinkError: the connection is lost, nothing can be sent.
        """
        if not self.blind:
            try:
                send_confirmed()
            except InstrumentError as error:
                self._record_error(error)
        if self.blind:
            self._link.write(command)

    def raise_first_error(self) -> None:
        """Raise the first error of the ramp, if there was one.

        Raises:
            InstrumentError: a step failed; LinkError if replies could not be read.
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
