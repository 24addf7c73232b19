"""Thread of a simulated instrument that serves its sockets, and applies faults when they are injected."""

import selectors
import socket
import threading
from abc import abstractmethod

from drivers import Closeable

UPDATE_TIMEOUT_S = 5.0


class SelectorServer(Closeable):
    """Serves the sockets that a subclass registers in `_selector`; the subclass calls `_start` at the end of its `__init__`."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self._wake, self._waker = socket.socketpair()
        self._selector.register(self._wake, selectors.EVENT_READ)
        self._closing = False
        self._updated = threading.Condition()
        self._updates_requested = self._updates_done = 0

    def _start(self, name: str) -> None:
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def update_from_faults(self) -> None:
        """Apply the active faults and return afterwards; call it after the injection or end of a fault."""
        if self._closing or threading.current_thread() is self._thread:  # it applies them itself after its reply
            return
        with self._updated:
            self._updates_requested += 1
            mine = self._updates_requested
            self._waker.send(b"!")
            self._updated.wait_for(lambda: self._updates_done >= mine, timeout=UPDATE_TIMEOUT_S)

    def close(self) -> None:
        """Close everything and wait for the thread."""
        self._closing = True
        self._waker.send(b"!")
        self._thread.join()
        for sock in (self._wake, self._waker):
            sock.close()
        self._selector.close()

    def _run(self) -> None:
        while not self._closing:
            for key, _ in self._selector.select(self._wait_s()):
                sock = key.fileobj
                if sock is self._wake:
                    self._wake.recv(64)
                elif isinstance(sock, socket.socket):
                    self._serve(sock)
            requested = self._updates_requested  # later requests are served by the next pass
            self._apply_faults()
            with self._updated:
                self._updates_done = requested
                self._updated.notify_all()
            self._advance()
        self._disconnect()

    @abstractmethod
    def _wait_s(self) -> float | None:
        """Return the longest wait for a socket; None: until one is ready."""

    @abstractmethod
    def _serve(self, sock: socket.socket) -> None:
        """Accept a connection, or take what a client sent."""

    @abstractmethod
    def _apply_faults(self) -> None:
        """Apply the active faults."""

    @abstractmethod
    def _advance(self) -> None:
        """Send what is due."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Close all connections and listeners."""
