"""HTTP server of web pages (Tornado): one request a connection, in a thread of its own; read-only but for the stop of a run.

One loop reads and writes all connections, so that a slow client holds its connection only; what reads files or draws runs in a few threads. Every
connection ends after a fixed total time, whatever was sent until then. The token is in the fragment of a page's address, which browsers do not
send: it is in no log and no referrer.
"""

import asyncio
import hmac
import socket
import threading
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from importlib.resources import files
from typing import Any, ClassVar, TypeVar

from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream, StreamClosedError
from tornado.web import Application, HTTPError, RequestHandler

from app.common import OperationCancelled, Progress
from drivers import Deadline

T = TypeVar("T")

LOOPBACK, EVERYWHERE = "127.0.0.1", "0.0.0.0"  # noqa: S104 - only with a token
MAX_CONNECTIONS, MAX_PER_ADDRESS = 128, 32
"""A browser opens six at once."""
MAX_HEADER_BYTES, CHUNK_BYTES = 16_384, 1 << 18
POOLS = {"pages": 4, "drawings": 1, "exports": 2}
"""Number of threads per kind of task: lists do not wait for exports, and matplotlib, which is not thread-safe, has one thread."""
MAX_WAITING = 32
"""Requests that may wait for the threads of a pool."""
MIN_TOKEN_LENGTH = 16
READ_ONLY = (
    "nothing can be commanded here; an unattended run can be stopped from a phone if it was started with stop_from_phone, at the address "
    "that was shown at its start"
)
"""Answer to a request that is no request to read."""
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; form-action 'self'; "
    "base-uri 'none'; frame-ancestors 'none'"
)
DOCUMENT_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox; frame-ancestors 'none'"
"""Policy of pictures and reports, whose styles are in them: nothing runs, nothing is loaded."""
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": POLICY,
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "Server": "TactorBench",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}

Routes = Sequence[tuple[str, type["PageHandler"], dict[str, Any]]]


class WebServerError(Exception):
    """The pages cannot be served; the message gives address, reason and remedy."""


def page_file(name: str) -> tuple[str, bytes]:
    """Return type and contents of a file of the pages: no frameworks, nothing from other hosts."""
    kind = {"js": "javascript"}.get(name.rpartition(".")[2], name.rpartition(".")[2])
    return f"text/{kind}; charset=utf-8", files("app.remote").joinpath(name).read_bytes()


def network_address() -> str:
    """Return the address of this computer in its network; the loopback address without a network. Sends nothing."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, suppress(OSError):
        probe.connect(("192.0.2.1", 9))  # an address of documentation; a datagram socket only looks up its own address
        return str(probe.getsockname()[0])
    return LOOPBACK


@dataclass(frozen=True)
class ServerLimits:
    """Longest times of a connection, s, and numbers of connections."""

    request_s: float = Deadline.WEB_REQUEST.seconds
    total_s: float = Deadline.WEB_ANSWER.seconds
    connections: int = MAX_CONNECTIONS
    per_address: int = MAX_PER_ADDRESS


class WebServer:
    """Serves routes while it is started.

    Args:
        routes: patterns of paths, their handlers and the arguments of `initialize`.
        limits: times and numbers of connections.
        settings: further settings of the Tornado application.
    """

    def __init__(self, routes: Routes, limits: ServerLimits | None = None, **settings: Any) -> None:
        self._routes, self._limits, self._settings = routes, limits or ServerLimits(), settings
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._end = asyncio.Event()
        self._host = ""
        self.token, self.port = "", 0

    @property
    def url(self) -> str:
        """Address of the first page, with the token if there is one; empty while it is off."""
        host = network_address() if self._host == EVERYWHERE else self._host
        shown = f"[{host}]" if ":" in host else host
        return "" if self._thread is None else f"http://{shown}:{self.port}/{f'#{self.token}' if self.token else ''}"

    def start(self, token: str, port: int, host: str = LOOPBACK) -> None:
        """Open the port; an empty token serves this computer alone.

        Raises:
            WebServerError: the token is too short, or the port cannot be opened; a server that ran before runs on.
        """
        if token and len(token) < MIN_TOKEN_LENGTH:
            raise WebServerError(f"the token has {len(token)} characters; it needs at least {MIN_TOKEN_LENGTH}")
        self.stop()
        try:
            family = socket.AF_INET6 if ":" in host else socket.AF_INET
            listening = socket.create_server((host, port), family=family, backlog=self._limits.connections)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", "") or error
            raise WebServerError(
                f"port {port} of {host} cannot be opened: {reason}; another program may use it, or the address is not of this computer"
            ) from None
        self.token, self._host, self.port = token, host, int(listening.getsockname()[1])
        ready = threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve(listening, ready)), name="web page", daemon=True
        )
        self._thread.start()
        ready.wait()

    def stop(self) -> None:
        """Close the port and all connections."""
        thread, self._thread = self._thread, None
        if thread is not None and self._loop is not None:
            self._loop.call_soon_threadsafe(self._end.set)
            thread.join()
            self.port = 0

    async def before_closing(self) -> None:
        """Wait, in the loop of the server, for what must be answered before the connections are closed."""

    async def _serve(self, listening: socket.socket, ready: threading.Event) -> None:
        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        workers = _Workers()
        application = Application(
            [*self._routes, (r".*", PageHandler, {})],
            token=self.token,
            cookie=f"tactor-bench-{self.port}",
            workers=workers,
            log_function=lambda _: None,  # an open page asks every second
            **self._settings,
        )
        server = _BoundedServer(application, self._limits)
        listening.setblocking(False)
        server.add_socket(listening)
        ready.set()
        await self._end.wait()
        server.stop()
        await self.before_closing()
        await server.close_all_connections()
        await workers.close()


class _Workers:
    """Threads that answer requests; a request waits for one, and too many are refused."""

    def __init__(self) -> None:
        self._pools = {name: ThreadPoolExecutor(size, f"web {name}") for name, size in POOLS.items()}
        self._running: Counter[str] = Counter()

    async def run(self, pool: str, action: Callable[[], T]) -> T:
        """Return the result of `action`.

        Raises:
            OverflowError: too many requests wait.
        """
        if self._running[pool] >= POOLS[pool] + MAX_WAITING:
            raise OverflowError
        self._running[pool] += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(self._pools[pool], action)
        finally:
            self._running[pool] -= 1

    async def close(self) -> None:
        for pool in self._pools.values():
            await asyncio.to_thread(pool.shutdown, cancel_futures=True)


class _BoundedServer(HTTPServer):
    """Server whose connections have one request, a total time, and a largest number, each address by itself."""

    def initialize(self, application: Application, limits: ServerLimits) -> None:  # type: ignore[override]
        self._limits = limits
        self._open: Counter[str] = Counter()
        super().initialize(
            application,
            no_keep_alive=True,
            idle_connection_timeout=limits.request_s,
            body_timeout=limits.request_s,
            max_body_size=0,
            max_header_size=MAX_HEADER_BYTES,
        )

    def handle_stream(self, stream: IOStream, address: Any) -> None:
        """Serve a connection, or close it at once where there are too many."""
        host = str(address[0])
        if self._open.total() >= self._limits.connections or self._open[host] >= self._limits.per_address:
            stream.close()
            return
        self._open[host] += 1
        asyncio.get_running_loop().call_later(self._limits.total_s, stream.close)
        super().handle_stream(stream, address)

    def on_close(self, server_conn: Any) -> None:
        """Forget a closed connection."""
        host = str(server_conn.context.address[0])
        self._open[host] -= 1
        self._open += Counter()  # drops the addresses without one
        super().on_close(server_conn)


class _ConnectionProgress(Progress):
    """Cancels what is computed for a connection that was closed."""

    closed = False

    @property
    def cancelled(self) -> bool:
        return self.closed


class PageHandler(RequestHandler):
    """Answer to one request: headers, token, and errors as a line of text. By itself it answers that there is no such page."""

    needs_token = False
    methods: ClassVar[tuple[str, ...]] = ("GET", "HEAD")

    def set_default_headers(self) -> None:
        for name, value in HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        """Check method, host and token before anything is read.

        Without a token only names of this computer are answered: another name comes from a page of another site (DNS rebinding).
        """
        self.progress = _ConnectionProgress()
        if self.request.method not in self.methods:
            self.send_error(HTTPStatus.METHOD_NOT_ALLOWED, text=READ_ONLY)
        elif not self._token and self.request.host_name not in (LOOPBACK, "localhost"):
            self.send_error(HTTPStatus.FORBIDDEN, text="unknown host")
        elif self.needs_token and not self.is_authorized:
            self.refuse()

    @property
    def _token(self) -> str:
        return str(self.settings["token"])

    @property
    def is_authorized(self) -> bool:
        """Whether the request has the token, in its header or as the cookie of a session."""
        given = self.request.headers.get("Authorization", "").removeprefix("Bearer ")
        given = given or self.get_cookie(self.settings["cookie"], "") or ""
        return not self._token or hmac.compare_digest(given.encode("utf-8", "replace"), self._token.encode())

    def refuse(self) -> None:
        """Answer a request without a valid token."""
        self.send_error(HTTPStatus.UNAUTHORIZED, text="token required")

    async def get(self, *_: str) -> None:
        self.send_error(HTTPStatus.NOT_FOUND)

    async def head(self, *arguments: str) -> None:
        await self.get(*arguments)

    async def work(self, action: Callable[[], T], pool: str = "pages") -> T | None:
        """Return the result of an action in a thread of a pool; None after an answer that it was not done."""
        workers: _Workers = self.settings["workers"]
        try:
            return await workers.run(pool, action)
        except OperationCancelled:  # the connection is closed
            return None
        except OverflowError:
            self.set_header("Retry-After", "5")
            self.send_error(HTTPStatus.SERVICE_UNAVAILABLE, text="too many requests wait: try again")
            return None

    def answer(self, kind: str, body: bytes | str, headers: Mapping[str, str] | None = None) -> None:
        """Send a whole answer."""
        self.set_header("Content-Type", kind)
        for name, value in (headers or {}).items():
            self.set_header(name, value)
        self.finish(body)

    async def stream(self, chunks: Callable[[int], bytes], length: int) -> None:
        """Send `length` bytes as the client takes them; `chunks` returns up to a number of bytes."""
        self.set_header("Content-Length", str(length))
        with suppress(StreamClosedError):
            while self.request.method == "GET" and (chunk := chunks(CHUNK_BYTES)):
                self.write(chunk)
                await self.flush()
            self.finish()

    def on_connection_close(self) -> None:
        """End what is computed for the client."""
        self.progress.closed = True

    def write_error(self, status_code: int, text: str = "", **_: Any) -> None:
        """Answer an error with one line of text."""
        if status_code == HTTPStatus.METHOD_NOT_ALLOWED:
            self.set_header("Allow", ", ".join(self.methods))
        if status_code == HTTPStatus.UNAUTHORIZED:
            self.set_header("WWW-Authenticate", 'Bearer realm="Tactor Bench"')
        self.answer("text/plain; charset=utf-8", f"{text or HTTPStatus(status_code).phrase.lower()}\n")

    def log_exception(self, typ: Any, value: Any, tb: Any) -> None:
        """Log what no answer explains; a wrong request is no error of the program."""
        if not isinstance(value, HTTPError):
            super().log_exception(typ, value, tb)


class FileHandler(PageHandler):
    """Answers with a file of the pages, which has no data."""

    def initialize(self, name: str) -> None:
        self._name = name

    async def get(self, *_: str) -> None:
        self.answer(*page_file(self._name))


class SessionHandler(PageHandler):
    """Stores the token as a cookie of the browser, which pictures and links then send."""

    needs_token = True

    async def get(self, *_: str) -> None:
        name = self.settings["cookie"]
        self.set_cookie(name, self._token, httponly=True, samesite="Strict")
        self.answer("text/plain; charset=utf-8", "ok\n")
