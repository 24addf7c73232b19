"""Server of the read-only page of a running bench, for a phone or a second screen; off until it is started."""

import json
from collections.abc import Callable
from http import HTTPStatus
from typing import Any

from app.remote.web_server import EVERYWHERE, LOOPBACK, FileHandler, PageHandler, ServerLimits, WebServer
from protocols.base import to_jsonable

ReadState = Callable[[], dict[str, Any]]


class RemoteView(WebServer):
    """Serves the page while it is started; the page sends its token with every request for the state.

    Args:
        read_state: returns the state as JSON values; called in threads of the server.
        limits: times and numbers of connections.
    """

    def __init__(self, read_state: ReadState, limits: ServerLimits | None = None) -> None:
        pages = (("/", "page.html"), ("/page.css", "page.css"), ("/page.js", "page.js"))
        routes = [(path, FileHandler, {"name": name}) for path, name in pages]
        super().__init__([*routes, ("/state.json", _StateHandler, {"read_state": read_state})], limits)

    def start(self, token: str, port: int, host: str = "") -> None:
        """Serve the page: to the network with a token, and to this computer alone without one.

        Raises:
            WebServerError: the token is too short, or the port is in use.
        """
        super().start(token, port, host or (EVERYWHERE if token else LOOPBACK))


class _StateHandler(PageHandler):
    needs_token = True

    def initialize(self, read_state: ReadState) -> None:
        self._read_state = read_state

    async def get(self, *_: str) -> None:
        found = await self.work(self._read)
        if found is not None and found[0]:
            self.answer("application/json", found[0])
        elif found is not None:
            self.send_error(HTTPStatus.INTERNAL_SERVER_ERROR, text=found[1])

    def _read(self) -> tuple[bytes, str]:
        """Return the state as JSON, or why it cannot be read."""
        try:
            state = json.dumps(to_jsonable(self._read_state()), allow_nan=False)
        except Exception as error:  # noqa: BLE001 - a page without an answer would show an old state
            return b"", f"the state cannot be read: {type(error).__name__}"
        return state.encode("utf-8", "replace"), ""
