"""Stop of an unattended run from a phone: a page of its own for each run that enables it, with a new token, until the run has ended."""

from collections.abc import Callable
from secrets import token_urlsafe
from typing import TYPE_CHECKING, Any

from drivers import BenchError
from protocols.base import RestMeasured, RunEnded

if TYPE_CHECKING:
    from app.remote.server import StopServer

PORT, TOKEN_BYTES = 8464, 16
"""Port of the page, a free one while another program has it; random bytes of a token."""


class PhoneStop:
    """Page on which a phone can stop a run (app.session.RemoteStop); `observe` is an observer of the session."""

    def __init__(self) -> None:
        self._server: StopServer | None = None
        self._rest = self.url = ""
        """`url`: address of the page during a run that enables it, with the token; otherwise empty."""

    def open(self, stop: Callable[[str], None]) -> str:
        """Open the page for a new run and return its address.

        Raises:
            BenchError: no port can be opened.
        """
        from app.remote.server import StopServer  # its imports take some hundredths of a second
        from app.remote.web_server import EVERYWHERE, WebServerError

        self.close()
        self._server, self._rest, token = StopServer(stop), "", token_urlsafe(TOKEN_BYTES)
        try:
            try:
                self._server.start(token, PORT, EVERYWHERE)
            except WebServerError:
                self._server.start(token, 0, EVERYWHERE)
        except WebServerError as error:
            raise BenchError(
                f"the page for a stop from a phone cannot be opened: {error}; or set stop_from_phone to false"
            ) from None
        self.url = self._server.url
        return self.url

    def observe(self, event: Any) -> None:
        """Note the measured rest; after the end of the run the page only reports that."""
        if isinstance(event, RestMeasured):
            self._rest = f"\nAt rest: {event.words}" if event.confirmed else f"\nNOT AT REST: {event.words}"
        elif isinstance(event, RunEnded) and self._server is not None:
            self.url = ""
            self._server.conclude(f"{event.summary}{self._rest}")

    def close(self) -> None:
        """Close the page."""
        if self._server is not None:
            self._server.stop()
        self._server, self.url = None, ""
