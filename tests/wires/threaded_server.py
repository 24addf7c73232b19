"""Loopback server with a thread per connection; it is down while its instrument is unreachable."""

import contextlib
import socket
import threading
from abc import abstractmethod
from collections.abc import Callable

from drivers.interfaces import Closeable
from sim_hardware.wires.port import HOST, MessagePort


class ThreadedServer(Closeable):
    """Serves a port until closed; `_serve` is what the thread of a connection does, until OSError or EOFError.

    Args:
        speed: bench seconds per wall second, for answers that take the instrument time.
        command_s: bench seconds until the answer to any message is ready.

    Attributes:
        port: the TCP port.
    """

    def __init__(self, instrument: MessagePort, speed: float = 1.0, command_s: float = 0.0) -> None:
        self._instrument, self._speed, self._command_s = instrument, speed, command_s
        self._lock = threading.Lock()
        self._sockets: set[socket.socket] = set()
        self._threads: list[threading.Thread] = []
        self._listener: socket.socket | None = None
        self.port = 0
        self._listen()

    def poke(self) -> None:
        """Apply the active faults; call it after a fault is injected or cleared."""
        if not self._instrument.connected:
            self._drop_all()
        elif self._listener is None:
            self._listen()

    def close(self) -> None:
        """Close everything and wait for the threads."""
        self._drop_all()
        for thread in self._threads:
            thread.join()

    @abstractmethod
    def _serve(self, sock: socket.socket) -> None: ...

    def _wake(self) -> None:
        """Wake waiting threads: the connections are about to be closed."""

    def _listen(self) -> None:
        self._listener = socket.create_server((HOST, self.port))
        self.port = self._listener.getsockname()[1]
        self._begin(self._accept, self._listener)

    def _drop_all(self) -> None:
        with self._lock:
            sockets, self._listener = [*self._sockets, *([self._listener] if self._listener else [])], None
            self._sockets.clear()
        self._wake()
        for sock in sockets:
            with contextlib.suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)
            sock.close()

    def _begin(self, work: Callable[[socket.socket], None], sock: socket.socket) -> None:
        thread = threading.Thread(target=work, args=(sock,), name=f"simulated {type(self).__name__}", daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self, listener: socket.socket) -> None:
        with contextlib.suppress(OSError):  # closed by us
            while True:
                sock, _ = listener.accept()
                sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with self._lock:
                    self._sockets.add(sock)
                self._begin(self._attend, sock)

    def _attend(self, sock: socket.socket) -> None:
        with contextlib.suppress(OSError, EOFError):
            self._serve(sock)
        with self._lock:
            self._sockets.discard(sock)
        sock.close()


def exactly(sock: socket.socket, count: int) -> bytes:
    """The next `count` bytes.

    Raises:
        EOFError: the other side has closed.
    """
    data = bytearray()
    while len(data) < count:
        part = sock.recv(min(count - len(data), 1 << 16))
        if not part:
            raise EOFError
        data += part
    return bytes(data)
