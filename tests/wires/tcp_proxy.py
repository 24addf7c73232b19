"""TCP proxy between a driver and a simulated instrument: delay, silence and cut connections."""

import contextlib
import queue
import socket
import threading
import time

from drivers.interfaces import Closeable

Chunk = tuple[float, bytes]
"""When it is passed on (monotonic), and what; no bytes at the end of the stream."""


class TcpProxy(Closeable):
    """Passes bytes on in both directions until closed.

    Attributes:
        port: where it listens on loopback.
        delay_s: time every byte takes in each direction.
        silent: whether it swallows everything.
    """

    def __init__(self, target_port: int, delay_s: float = 0.0) -> None:
        self._target_port, self.delay_s, self.silent = target_port, delay_s, False
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._sockets: list[socket.socket] = []
        self._threads: list[threading.Thread] = []
        self._start(self._accept)

    @property
    def resource(self) -> str:
        return f"TCPIP::127.0.0.1::{self.port}::SOCKET"

    def cut(self) -> None:
        """Close all connections; new ones are accepted."""
        sockets, self._sockets = self._sockets, []
        for sock in sockets:
            with contextlib.suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.cut()
        for thread in self._threads:
            thread.join(5.0)

    def _start(self, work: object, *arguments: object) -> None:
        thread = threading.Thread(target=work, args=arguments, name="TCP proxy", daemon=True)  # type: ignore[arg-type]
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            try:
                far = socket.create_connection(("127.0.0.1", self._target_port))
            except OSError:
                near.close()
                continue
            for sock in (near, far):
                sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._sockets += [near, far]
            for source, sink in ((near, far), (far, near)):
                chunks: queue.SimpleQueue[Chunk] = queue.SimpleQueue()
                self._start(self._receive, source, chunks)
                self._start(self._pass_on, sink, chunks)

    def _receive(self, source: socket.socket, chunks: "queue.SimpleQueue[Chunk]") -> None:
        while True:
            try:
                data = source.recv(65536)
            except OSError:
                data = b""
            if not self.silent or not data:
                chunks.put((time.monotonic() + self.delay_s, data))
            if not data:
                return

    def _pass_on(self, sink: socket.socket, chunks: "queue.SimpleQueue[Chunk]") -> None:
        while True:
            due, data = chunks.get()
            time.sleep(max(due - time.monotonic(), 0.0))
            with contextlib.suppress(OSError):
                if data:
                    sink.sendall(data)
                    continue
                sink.shutdown(socket.SHUT_RDWR)
            if not data:
                sink.close()
                return
