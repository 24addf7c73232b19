"""An instrument behind HiSLIP (IVI-6.1, synchronized mode): two connections a session, messages with a header, device clear.

Enough of it for one client at a time: data, trigger, status, lock, message size and device clear. Not for a real network.
"""

import contextlib
import itertools
import socket
import struct
import threading
from collections.abc import Callable
from enum import IntEnum
from types import TracebackType
from typing import Self

from sim_hardware.port import Port

HOST = "127.0.0.1"
HEADER = struct.Struct("!2sBBIQ")
VERSION = 0x0100
LARGEST = 1 << 24


class Kind(IntEnum):
    """Types of messages that are understood or sent here (IVI-6.1, table 4)."""

    INITIALIZE = 0
    INITIALIZE_RESPONSE = 1
    FATAL_ERROR = 2
    LOCK = 4
    LOCK_RESPONSE = 5
    DATA = 6
    DATA_END = 7
    CLEAR_COMPLETE = 8
    CLEAR_ACKNOWLEDGE = 9
    TRIGGER = 12
    MAX_SIZE = 15
    MAX_SIZE_RESPONSE = 16
    ASYNC_INITIALIZE = 17
    ASYNC_INITIALIZE_RESPONSE = 18
    ASYNC_CLEAR = 19
    STATUS = 21
    STATUS_RESPONSE = 22
    ASYNC_CLEAR_ACKNOWLEDGE = 23


class _Session:
    """One client: `clearing` is set from its device clear until that is complete."""

    def __init__(self) -> None:
        self.clearing = threading.Event()


class HislipServer:
    """Serves a port on loopback until closed.

    Args:
        speed: bench seconds per wall second, for answers that take the instrument time.
        command_s: bench seconds until the answer to any message is ready.

    Attributes:
        port: the TCP port.
    """

    def __init__(self, instrument: Port, speed: float = 1.0, command_s: float = 0.0) -> None:
        self._instrument, self._speed, self._command_s = instrument, speed, command_s
        self._sessions: dict[int, _Session] = {}
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()
        self._sockets: set[socket.socket] = set()
        self._threads: list[threading.Thread] = []
        self._listener: socket.socket | None = None
        self.port = 0
        self._listen()

    @property
    def resource(self) -> str:
        """VISA resource string."""
        return f"TCPIP::{HOST}::hislip0,{self.port}::INSTR"

    def poke(self) -> None:
        """Look again at what is broken; call it after a fault has come or gone."""
        if not self._instrument.connected:
            self._drop_all()
        elif self._listener is None:
            self._listen()

    def close(self) -> None:
        """Close everything and wait for the threads."""
        self._drop_all()
        for thread in self._threads:
            thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _listen(self) -> None:
        self._listener = socket.create_server((HOST, self.port))
        self.port = self._listener.getsockname()[1]
        self._begin(self._accept, self._listener)

    def _drop_all(self) -> None:
        with self._lock:
            sockets, self._listener = [*self._sockets, *([self._listener] if self._listener else [])], None
            self._sockets.clear()
            sessions = [*self._sessions.values()]
        for session in sessions:
            session.clearing.set()
        for sock in sockets:
            with contextlib.suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)
            sock.close()

    def _begin(self, work: Callable[[socket.socket], None], sock: socket.socket) -> None:
        thread = threading.Thread(target=work, args=(sock,), name="simulated HiSLIP", daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self, listener: socket.socket) -> None:
        with contextlib.suppress(OSError):  # closed by us
            while True:
                sock, _ = listener.accept()
                sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with self._lock:
                    self._sockets.add(sock)
                self._begin(self._serve, sock)

    def _serve(self, sock: socket.socket) -> None:
        """One connection: its first message says which of the two it is."""
        with contextlib.suppress(OSError, EOFError):
            kind, _, parameter, _ = _receive(sock)
            if kind == Kind.INITIALIZE:
                number = next(self._numbers)
                self._sessions[number] = _Session()
                _send(sock, Kind.INITIALIZE_RESPONSE, 0, VERSION << 16 | number)
                self._serve_data(sock, self._sessions[number])
            elif kind == Kind.ASYNC_INITIALIZE and parameter in self._sessions:
                _send(sock, Kind.ASYNC_INITIALIZE_RESPONSE, 0, 0)
                self._serve_control(sock, self._sessions[parameter])
            else:
                _send(sock, Kind.FATAL_ERROR, 3, 0, b"Invalid Initialization sequence")
        with self._lock:
            self._sockets.discard(sock)
        sock.close()

    def _serve_data(self, sock: socket.socket, session: _Session) -> None:
        message = b""
        while True:
            kind, control, parameter, payload = _receive(sock)
            if kind == Kind.CLEAR_COMPLETE:
                message = b""
                session.clearing.clear()
                _send(sock, Kind.CLEAR_ACKNOWLEDGE, control, 0)
            elif session.clearing.is_set():
                continue  # sent before the clear: never heard
            elif kind in (Kind.DATA, Kind.DATA_END, Kind.TRIGGER):
                message += b"*TRG" if kind == Kind.TRIGGER else payload
                if kind != Kind.DATA:
                    self._answer(sock, session, message.removesuffix(b"\n"), parameter)
                    message = b""

    def _answer(self, sock: socket.socket, session: _Session, message: bytes, number: int) -> None:
        reply = self._instrument.handle(message.decode("latin-1"))
        if reply is None:
            return
        wait_s = (reply.delay_s + self._command_s) / self._speed + reply.late_s
        if session.clearing.wait(wait_s):
            return  # a device clear empties the output queue
        out = reply.text.encode("latin-1", errors="replace")
        if reply.ended:
            _send(sock, Kind.DATA_END, 0, number, out + b"\n")
        else:
            _send(sock, Kind.DATA, 0, number, out)

    def _serve_control(self, sock: socket.socket, session: _Session) -> None:
        while True:
            kind, _, _, _ = _receive(sock)
            match kind:
                case Kind.MAX_SIZE:
                    _send(sock, Kind.MAX_SIZE_RESPONSE, 0, 0, struct.pack("!Q", LARGEST))
                case Kind.ASYNC_CLEAR:
                    session.clearing.set()
                    _send(sock, Kind.ASYNC_CLEAR_ACKNOWLEDGE, 0, 0)
                case Kind.STATUS:
                    _send(sock, Kind.STATUS_RESPONSE, 0, 0)
                case Kind.LOCK:
                    _send(sock, Kind.LOCK_RESPONSE, 1, 0)


def _receive(sock: socket.socket) -> tuple[int, int, int, bytes]:
    """Type, control code, parameter and payload of the next message. Raises EOFError at the end."""
    mark, kind, control, parameter, size = HEADER.unpack(_exactly(sock, HEADER.size))
    if mark != b"HS" or size > LARGEST:
        raise EOFError
    return kind, control, parameter, _exactly(sock, size)


def _exactly(sock: socket.socket, count: int) -> bytes:
    data = bytearray()
    while len(data) < count:
        part = sock.recv(min(count - len(data), 1 << 16))
        if not part:
            raise EOFError
        data += part
    return bytes(data)


def _send(sock: socket.socket, kind: int, control: int, parameter: int, payload: bytes = b"") -> None:
    sock.sendall(HEADER.pack(b"HS", kind, control, parameter, len(payload)) + payload)
