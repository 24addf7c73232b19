"""TCP server of a simulated SCPI instrument: one thread, with the faults of a connection."""

import heapq
import itertools
import selectors
import socket
import time

from drivers import Clock, WallClock
from sim_hardware.wires.port import HOST, MessagePort
from sim_hardware.wires.scpi_engine import split_received
from sim_hardware.wires.selector_server import SelectorServer

_MAX_LINE_LENGTH = 1 << 24
_MIN_WAIT_S = 2e-4
"""Replies due within this time are sent immediately: the selector cannot wait for less than a millisecond."""


class ScpiTcpServer(SelectorServer):
    """Serves a port on loopback until closed; any number of connections, one after the other or together.

    Args:
        speed: bench seconds per wall second, for replies with an instrument delay.
        command_s: bench seconds until the reply to any message is ready.
        clock: bench time that waits for a late reader, for the order of messages; default: real time.

    Attributes:
        port: the TCP port.
    """

    def __init__(
        self, instrument: MessagePort, speed: float = 1.0, command_s: float = 0.0, clock: Clock | None = None
    ) -> None:
        super().__init__()
        self._instrument = instrument
        self._clock = clock or WallClock(speed)
        self._speed = speed
        self._command_s = command_s
        self._partial_lines: dict[socket.socket, bytes] = {}
        self._pending_responses: list[tuple[float, int, socket.socket, bytes]] = []
        self._sequence = itertools.count()
        self._busy_until_s = 0.0
        self._listener: socket.socket | None = None
        self.port = 0
        self._listen()
        self._start("simulated generator")

    @property
    def resource(self) -> str:
        """VISA resource string."""
        return f"TCPIP::{HOST}::{self.port}::SOCKET"

    @property
    def connections(self) -> int:
        """Number of open connections."""
        return len(self._partial_lines)

    def _listen(self) -> None:
        listener = socket.create_server((HOST, self.port))
        listener.setblocking(False)
        self.port = listener.getsockname()[1]
        self._selector.register(listener, selectors.EVENT_READ)
        self._listener = listener

    def _wait_s(self) -> float | None:
        return max(0.0, self._pending_responses[0][0] - time.monotonic()) if self._pending_responses else None

    def _serve(self, sock: socket.socket) -> None:
        if sock is self._listener:
            self._accept()
        elif sock in self._partial_lines:
            self._receive(sock)

    def _advance(self) -> None:
        while self._pending_responses and self._pending_responses[0][0] <= time.monotonic():
            _, _, sock, data = heapq.heappop(self._pending_responses)
            self._send(sock, data)

    def _disconnect(self) -> None:
        for sock in [*self._partial_lines]:
            self._drop(sock)
        self._stop_listening()

    def _apply_faults(self) -> None:
        """Close everything while the instrument is unreachable, and listen again afterwards."""
        if not self._instrument.connected:
            self._disconnect()
        elif self._listener is None:
            self._listen()

    def _stop_listening(self) -> None:
        if self._listener is not None:
            self._selector.unregister(self._listener)
            self._listener.close()
            self._listener = None

    def _accept(self) -> None:
        if self._listener is None:
            return
        sock, _ = self._listener.accept()
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._partial_lines[sock] = b""
        self._selector.register(sock, selectors.EVENT_READ)

    def _drop(self, sock: socket.socket) -> None:
        del self._partial_lines[sock]
        self._selector.unregister(sock)
        sock.close()

    def _receive(self, sock: socket.socket) -> None:
        try:
            data = sock.recv(65536)
        except OSError:
            data = b""
        if not data or len(self._partial_lines[sock]) > _MAX_LINE_LENGTH:
            self._drop(sock)
            return
        if self._instrument.single_session and sock is not next(iter(self._partial_lines)):
            return  # accepted, and never answered (dmm6500-serial-decode at 0465be2)
        lines, self._partial_lines[sock] = split_received(self._partial_lines[sock] + data)
        for line in lines:
            # Messages that arrive together are executed one after the other, as by an instrument. The time of each counts from the
            # end
            # of the previous one: after a delay of this process bench time may wait, and both would have the same time.
            self._clock.sleep(self._busy_until_s - self._clock.now())
            reply = self._instrument.handle(line)
            self._busy_until_s = self._clock.now() + self._command_s
            if reply is None:
                continue
            if (wait := reply.wait_s(self._command_s, self._speed)) > _MIN_WAIT_S:
                due = time.monotonic() + wait, next(self._sequence), sock, reply.data
                heapq.heappush(self._pending_responses, due)
            else:
                self._send(sock, reply.data)

    def _send(self, sock: socket.socket, data: bytes) -> None:
        if sock not in self._partial_lines:
            return
        try:
            sock.sendall(data)
        except OSError:
            self._drop(sock)
