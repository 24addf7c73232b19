"""HTTP server of the read-only web page: standard library, GET only, in threads of its own, off until it is started.

The token is in the fragment of the page's address, which browsers do not send: it is in no log and no referrer. The page sends it with every
request for the state. Without a token only this computer is served, and only by its own names (which excludes DNS rebinding).
"""

import hmac
import json
import os
import socket
import socketserver
import threading
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any

from drivers import Deadline
from protocols.base import to_jsonable

LOOPBACK, EVERYWHERE = "127.0.0.1", "0.0.0.0"  # noqa: S104 - only with a token
MAX_CONNECTIONS, MAX_PER_ADDRESS = 16, 4
"""A browser opens one or two."""
MIN_TOKEN_LENGTH = 16
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
FILES = {
    path: (f"text/{kind}; charset=utf-8", files("app.remote").joinpath(name).read_bytes())
    for path, name, kind in (
        ("/", "page.html", "html"),
        ("/page.css", "page.css", "css"),
        ("/page.js", "page.js", "javascript"),
    )
}
"""Type and contents of the files of the page, by path: no frameworks, nothing from other hosts, texts are set as text and never as HTML."""

STATE_PATH = "/state.json"

ReadState = Callable[[], dict[str, Any]]


class RemoteViewError(Exception):
    """The page cannot be served; the message gives address, reason and remedy."""


def network_address() -> str:
    """Return the address of this computer in its network; the loopback address without a network. Sends nothing."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, suppress(OSError):
        probe.connect(("192.0.2.1", 9))  # an address of documentation; a datagram socket only looks up its own address
        return str(probe.getsockname()[0])
    return LOOPBACK


class RemoteView:
    """Serves the page while it is started.

    Args:
        read_state: returns the state as JSON values; called in threads of the server.
    """

    def __init__(self, read_state: ReadState) -> None:
        self._read_state = read_state
        self._server: _Server | None = None
        self._thread: threading.Thread | None = None
        self.token = ""

    @property
    def port(self) -> int:
        """Port that is served; 0 if none is."""
        return 0 if self._server is None else int(self._server.server_address[1])

    @property
    def url(self) -> str:
        """Address of the page, with the token if there is one; empty while it is off."""
        if self._server is None:
            return ""
        host = network_address() if self.token else LOOPBACK
        return f"http://{host}:{self.port}/{f'#{self.token}' if self.token else ''}"

    def start(self, token: str, port: int) -> None:
        """Serve the page: to the network with a token, and to this computer alone without one.

        Raises:
            RemoteViewError: the token is too short, or the port is in use.
        """
        if token and len(token) < MIN_TOKEN_LENGTH:
            raise RemoteViewError(f"the token has {len(token)} characters; it needs at least {MIN_TOKEN_LENGTH}")
        self.stop()
        host = EVERYWHERE if token else LOOPBACK
        try:
            server = _Server((host, port), token, self._read_state)
        except OSError as error:
            raise RemoteViewError(
                f"port {port} of {host} cannot be opened: {error.strerror or error}; another program may use it"
            ) from None
        self._server, self.token = server, token
        self._thread = threading.Thread(target=server.serve_forever, args=(0.1,), name="web page", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Close the port and all connections."""
        server, thread = self._server, self._thread
        self._server = self._thread = None
        if server is not None and thread is not None:
            server.shutdown()
            thread.join()
            server.close_connections()
            server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = False  # server_close waits for them, after close_connections has ended their reading
    request_queue_size = 2 * MAX_CONNECTIONS
    allow_reuse_address = os.name == "posix"  # elsewhere it would let two programs have one port

    def __init__(self, address: tuple[str, int], token: str, read_state: ReadState) -> None:
        self.token, self.read_state = token, read_state
        self._free = threading.BoundedSemaphore(MAX_CONNECTIONS)
        self._lock = threading.Lock()
        self._open: dict[socket.socket, str] = {}
        """Connections, with their addresses."""
        super().__init__(address, _Handler)

    def server_bind(self) -> None:
        socketserver.TCPServer.server_bind(self)  # HTTPServer would look up the computer's name, which may take seconds
        self.server_name, self.server_port = str(self.server_address[0]), int(self.server_address[1])

    def process_request(self, request: Any, client_address: Any) -> None:
        address = str(client_address[0])
        with self._lock:
            refused = sum(each == address for each in self._open.values()) >= MAX_PER_ADDRESS
        if refused or not self._free.acquire(blocking=False):
            self.shutdown_request(request)
            return
        with self._lock:
            self._open[request] = address
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            with self._lock:
                self._open.pop(request, None)
            self._free.release()

    def close_connections(self) -> None:
        with self._lock:
            for each in self._open:
                with suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Leave out connections that ended early."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = Deadline.WEB_PAGE.seconds
    server_version, sys_version = "TactorBench", ""
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        self._answer(with_body=True)

    def do_HEAD(self) -> None:
        self._answer(with_body=False)

    def _answer(self, with_body: bool) -> None:
        path = self.path.partition("?")[0]
        if not self._is_host_allowed():
            self._send(HTTPStatus.FORBIDDEN, "text/plain", b"unknown host\n", with_body)
        elif path in FILES:
            self._send(HTTPStatus.OK, *FILES[path], with_body)
        elif path != STATE_PATH:
            self._send(HTTPStatus.NOT_FOUND, "text/plain", b"not found\n", with_body)
        elif not self._is_authorized():
            self._send(HTTPStatus.UNAUTHORIZED, "text/plain", b"token required\n", with_body)
        else:
            try:
                body = json.dumps(to_jsonable(self.server.read_state()), allow_nan=False).encode("utf-8", "replace")
            except Exception as error:  # noqa: BLE001 - a page without an answer would show an old state
                body = f"the state cannot be read: {type(error).__name__}\n".encode()
                self._send(HTTPStatus.INTERNAL_SERVER_ERROR, "text/plain", body, with_body)
            else:
                self._send(HTTPStatus.OK, "application/json", body, with_body)

    def _is_authorized(self) -> bool:
        expected = self.server.token
        given = self.headers.get("Authorization", "").removeprefix("Bearer ")
        return not expected or hmac.compare_digest(given.encode("utf-8", "replace"), expected.encode())

    def _is_host_allowed(self) -> bool:
        """Without a token only names of this computer are answered: another name comes from a page of another site."""
        name = self.headers.get("Host", "").rpartition(":")[0] or self.headers.get("Host", "")
        return bool(self.server.token) or name in (LOOPBACK, "localhost")

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:  # noqa: ARG002
        """Answer everything else, such as another method, with a status and the same headers."""
        status = HTTPStatus.METHOD_NOT_ALLOWED if code == HTTPStatus.NOT_IMPLEMENTED else HTTPStatus(code)
        self.close_connection = True
        self._send(status, "text/plain", f"{status.phrase}\n".encode(), with_body=self.command != "HEAD")

    def _send(self, status: HTTPStatus, kind: str, body: bytes, with_body: bool) -> None:
        self.send_response(status)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        if status is HTTPStatus.METHOD_NOT_ALLOWED:
            self.send_header("Allow", "GET, HEAD")
        if status is HTTPStatus.UNAUTHORIZED:
            self.send_header("WWW-Authenticate", 'Bearer realm="Tactor Bench"')
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if with_body:
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - the name of the base class
        """Log nothing: a page that is open asks every second."""
