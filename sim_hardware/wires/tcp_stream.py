"""TCP port of a simulated sensor that answers commands or sends without a request, as `pty` is its serial line."""

import contextlib
import selectors
import socket

from sim_hardware.wires.port import HOST
from sim_hardware.wires.pty import POLL_S, SerialInstrument
from sim_hardware.wires.selector_server import SelectorServer


class TcpStreamServer(SelectorServer):
    """Serves one sensor on loopback until closed.

    Attributes:
        port: pyserial URL of the TCP port.
        unresponsive: set it to make the sensor neither act nor reply.
    """

    def __init__(self, instrument: SerialInstrument) -> None:
        super().__init__()
        self._instrument, self.unresponsive = instrument, False
        self._clients: list[socket.socket] = []
        self._listener = socket.create_server((HOST, 0))
        self._selector.register(self._listener, selectors.EVENT_READ)
        self.port = f"socket://{HOST}:{self._listener.getsockname()[1]}"
        self._start("simulated network sensor")

    def close(self) -> None:
        """End the thread and close the port: a reader of it gets an error."""
        if not self._closing:
            super().close()

    def _wait_s(self) -> float:
        return POLL_S

    def _serve(self, sock: socket.socket) -> None:
        if sock is self._listener:
            client, _ = sock.accept()
            client.settimeout(1.0)
            self._selector.register(client, selectors.EVENT_READ)
            self._clients.append(client)
            return
        data = b""
        with contextlib.suppress(OSError):
            data = sock.recv(4096)
        if not data:
            self._drop(sock)
        elif not self.unresponsive:
            self._send(sock, self._instrument.receive(data))

    def _apply_faults(self) -> None:
        """No fault of the bench acts on a sensor's network."""

    def _advance(self) -> None:
        if self._clients and not self.unresponsive and (out := self._instrument.unsolicited_output()):
            for client in [*self._clients]:
                self._send(client, out)

    def _send(self, sock: socket.socket, data: bytes) -> None:
        try:
            sock.sendall(data)
        except OSError:  # closed, or its reader has stopped to read
            self._drop(sock)

    def _drop(self, sock: socket.socket) -> None:
        self._clients.remove(sock)
        self._selector.unregister(sock)
        sock.close()

    def _disconnect(self) -> None:
        for client in [*self._clients]:
            self._drop(client)
        self._selector.unregister(self._listener)
        self._listener.close()
