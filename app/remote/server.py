"""Servers of pages for a phone: the read-only page of a running bench, and the page that can stop one run. Off until they are started."""

import asyncio
import json
import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from http import HTTPStatus
from typing import Any, ClassVar

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


STOP_ANSWER_S, CLOSING_S = 30.0, 1.0
"""Longest time in which the answer to a stop waits for the end of the run, and in which such answers are sent when the server is closed."""


class StopServer(WebServer):
    """Serves the page that can stop one run. Each run has a server with a token of its own; after the run it can only report the end.

    The page sends the token only with the stop itself: who listens to the network gets it when it is spent.

    Args:
        stop: requests the end of the run, with who asked as text; called in the thread of the server.
        limits: times and numbers of connections.
    """

    def __init__(self, stop: Callable[[str], None], limits: ServerLimits | None = None) -> None:
        self._stop, self._lock, self._ended = stop, threading.Lock(), Future[str]()
        self._answers: set[asyncio.Task[Any]] = set()
        pages = (("/", "stop.html"), ("/page.css", "page.css"), ("/stop.js", "stop.js"))
        routes = [(path, FileHandler, {"name": name}) for path, name in pages]
        super().__init__([*routes, ("/stop", _StopHandler, {"answer": self._answer})], limits)

    def conclude(self, text: str) -> None:
        """Report the end of the run to those who asked for it; from now on nothing can be stopped. Any thread."""
        with self._lock:
            if not self._ended.done():
                self._ended.set_result(text)

    async def before_closing(self) -> None:
        self.conclude("the program ends")
        if self._answers:
            await asyncio.wait(self._answers, timeout=CLOSING_S)

    async def _answer(self, by: str) -> str:
        """Stop the run, wait for its end, and return that as text; empty if it has not ended in time."""
        task = asyncio.current_task()
        assert task is not None
        self._answers.add(task)
        task.add_done_callback(self._answers.discard)
        with self._lock:  # a stop that comes late must not end the next run
            if not self._ended.done():
                self._stop(by)
        with suppress(TimeoutError):
            return await asyncio.wait_for(asyncio.shield(asyncio.wrap_future(self._ended)), STOP_ANSWER_S)
        return ""


class _StopHandler(PageHandler):
    needs_token = True
    methods: ClassVar[tuple[str, ...]] = ("POST",)

    def initialize(self, answer: Callable[[str], Any]) -> None:
        self._stop = answer

    async def post(self, *_: str) -> None:
        ended = await self._stop(f"a phone at {self.request.remote_ip}")
        self.set_status(HTTPStatus.OK if ended else HTTPStatus.ACCEPTED)
        self.answer("text/plain; charset=utf-8", f"{ended or f'the run has not ended after {STOP_ANSWER_S:g} s'}\n")
