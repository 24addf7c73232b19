"""Modbus TCP client: reads and writes holding registers, and checks that a reply belongs to its request.

A maintained library was considered (docs/decisions/0153-second-card-family.md). The stream of a LabJack has the same header on a
second port, which no library reads.
"""

import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.errors import AcquisitionError

READ_REGISTERS, WRITE_REGISTERS = 3, 16
HEADER = struct.Struct(">HHHBB")
"""Transaction, protocol (0), length of the rest in bytes, unit and function."""

HEADER_REST = 2
"""Bytes of the header that its length counts: unit and function."""

UNIT = 1


class ModbusError(AcquisitionError):
    """The device rejected a request with a Modbus exception; the connection is in order."""


class ModbusConnection:
    """A TCP connection whose failures are `AcquisitionError`s with a remedy.

    Args:
        host: name or address.
        port: TCP port.
        name: name of the device in messages.
        timeout_s: longest wait for the connection, and for bytes.
        receive_bytes: size of the receive buffer; 0: chosen by the operating system.

    Raises:
        AcquisitionError: nothing listens there.
    """

    def __init__(self, host: str, port: int, name: str, timeout_s: float, receive_bytes: int = 0) -> None:
        self.name = name
        self._socket = socket.socket()
        with self._translated():
            if receive_bytes:
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
            self._socket.settimeout(timeout_s)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._socket.connect((host, port))

    @contextmanager
    def _translated(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:  # a time-out included
            self.close()
            reason = error.strerror or str(error) or type(error).__name__
            raise AcquisitionError(f"{self.name} does not answer ({reason}); check its cable and its power") from None

    def send(self, data: bytes) -> None:
        with self._translated():
            self._socket.sendall(data)

    def receive(self, count: int) -> bytes:
        """Return exactly this number of bytes."""
        data = bytearray()
        with self._translated():
            while len(data) < count:
                part = self._socket.recv(count - len(data))
                if not part:
                    raise ConnectionError("it closed the connection")
                data += part
        return bytes(data)

    def close(self) -> None:
        self._socket.close()


class ModbusClient:
    """Registers of one device. Calls of several threads are made one after the other.

    Args:
        host: name or address.
        port: TCP port, by default 502.
        name: name of the device in messages.
        timeout_s: longest wait for a reply.

    Raises:
        AcquisitionError: the device does not answer.
    """

    def __init__(self, host: str, port: int, name: str, timeout_s: float) -> None:
        self.name = name
        self._connection = ModbusConnection(host, port, name, timeout_s)
        self._transaction = 0
        self._lock = threading.Lock()

    def read(self, address: int, count: int) -> bytes:
        """Return `count` registers as big-endian bytes.

        Raises:
            ModbusError: the device rejected the address.
            AcquisitionError: it does not answer, or not to this request; the connection is closed.
        """
        reply = self._request(READ_REGISTERS, struct.pack(">HH", address, count))
        if len(reply) != 1 + 2 * count or reply[0] != 2 * count:
            self._refuse(f"sent {len(reply) - 1} bytes for {count} registers")
        return reply[1:]

    def write(self, address: int, data: bytes) -> None:
        """Write registers. Raises as `read`."""
        count = len(data) // 2
        begin = struct.pack(">HH", address, count)
        if self._request(WRITE_REGISTERS, begin + bytes([len(data)]) + data) != begin:
            self._refuse("confirmed another register than the one that was written")

    def close(self) -> None:
        self._connection.close()

    def _request(self, function: int, body: bytes) -> bytes:
        with self._lock:
            self._transaction = (self._transaction + 1) & 0xFFFF
            header = HEADER.pack(self._transaction, 0, HEADER_REST + len(body), UNIT, function)
            self._connection.send(header + body)
            transaction, protocol, length, _, answered = HEADER.unpack(self._connection.receive(HEADER.size))
            if transaction != self._transaction or protocol or not HEADER_REST < length <= 254:
                self._refuse(f"answered to request {transaction} instead of {self._transaction}")
            reply = self._connection.receive(length - HEADER_REST)
        if answered == function | 0x80:
            raise ModbusError(
                f"{self.name} rejected register {struct.unpack_from('>H', body)[0]} (Modbus exception {reply[0]})"
            )
        if answered != function:
            self._refuse(f"answered with function {answered} instead of {function}")
        return reply

    def _refuse(self, what: str) -> None:
        """Close the connection, on which later replies would be taken for others, too."""
        self._connection.close()
        raise AcquisitionError(f"{self.name} {what}; check its address and its cable, and measure again")
