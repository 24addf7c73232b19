"""HiSLIP server (IVI-6.1, synchronized mode) for a simulated instrument, with device clear.

Enough for one client at a time: data, trigger, status, lock, message size and device clear. Not for a real network.
"""

import itertools
import socket
import struct
import threading
from enum import IntEnum

from sim_hardware.wires.port import HOST, MessagePort
from tests.wires.threaded_server import ThreadedServer, exactly

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
        self.lock_key: bytes | None = None


class HislipServer(ThreadedServer):
    """Serves sessions of two connections each; the first message of a connection distinguishes them."""

    def __init__(self, instrument: MessagePort, speed: float = 1.0, command_s: float = 0.0) -> None:
        self._sessions: dict[int, _Session] = {}
        self._numbers = itertools.count(1)
        super().__init__(instrument, speed, command_s)

    @property
    def resource(self) -> str:
        """VISA resource string."""
        return f"TCPIP::{HOST}::hislip0,{self.port}::INSTR"

    def _wake(self) -> None:
        for session in [*self._sessions.values()]:
            session.clearing.set()

    def _serve(self, sock: socket.socket) -> None:
        kind, _, parameter, _ = _receive(sock)
        if kind == Kind.INITIALIZE:
            number = next(self._numbers)
            self._sessions[number] = _Session()
            _send(sock, Kind.INITIALIZE_RESPONSE, 0, VERSION << 16 | number)
            try:
                self._serve_data(sock, self._sessions[number])
            finally:
                self._sessions[number].lock_key = None  # its locks end with the connection
        elif kind == Kind.ASYNC_INITIALIZE and parameter in self._sessions:
            _send(sock, Kind.ASYNC_INITIALIZE_RESPONSE, 0, 0)
            self._serve_control(sock, self._sessions[parameter])
        else:
            _send(sock, Kind.FATAL_ERROR, 3, 0, b"Invalid Initialization sequence")

    def _serve_data(self, sock: socket.socket, session: _Session) -> None:
        message = b""
        while True:
            kind, control, parameter, payload = _receive(sock)
            if kind == Kind.CLEAR_COMPLETE:
                message = b""
                session.clearing.clear()
                _send(sock, Kind.CLEAR_ACKNOWLEDGE, control, 0)
            elif session.clearing.is_set():
                continue  # sent before the clear: ignored
            elif kind in (Kind.DATA, Kind.DATA_END, Kind.TRIGGER):
                message += b"*TRG" if kind == Kind.TRIGGER else payload
                if kind != Kind.DATA:
                    self._answer(sock, session, message.removesuffix(b"\n"), parameter)
                    message = b""

    def _answer(self, sock: socket.socket, session: _Session, message: bytes, number: int) -> None:
        reply = self._instrument.handle(message.decode("latin-1"))
        if reply is None:
            return
        if session.clearing.wait(reply.wait_s(self._command_s, self._speed)):
            return  # a device clear empties the output queue
        _send(sock, Kind.DATA_END if reply.terminated else Kind.DATA, 0, number, reply.data)

    def _serve_control(self, sock: socket.socket, session: _Session) -> None:
        while True:
            kind, control, _, payload = _receive(sock)
            match kind:
                case Kind.MAX_SIZE:
                    _send(sock, Kind.MAX_SIZE_RESPONSE, 0, 0, struct.pack("!Q", LARGEST))
                case Kind.ASYNC_CLEAR:
                    session.clearing.set()
                    _send(sock, Kind.ASYNC_CLEAR_ACKNOWLEDGE, 0, 0)
                case Kind.STATUS:
                    _send(sock, Kind.STATUS_RESPONSE, 0, 0)
                case Kind.LOCK:
                    _send(sock, Kind.LOCK_RESPONSE, self._lock_reply(session, control, payload), 0)

    def _lock_reply(self, session: _Session, control: int, key: bytes) -> int:
        """Return 0 refused, 1 exclusive (an empty key), 2 shared, 3 nothing to release (IVI-6.1, table 13)."""
        if not control:
            session.lock_key, held = None, session.lock_key
            return 3 if held is None else 2 if held else 1
        others = [
            each.lock_key for each in self._sessions.values() if each is not session and each.lock_key is not None
        ]
        if any(other != key or not key for other in others):
            return 0
        session.lock_key = key
        return 2 if key else 1


def _receive(sock: socket.socket) -> tuple[int, int, int, bytes]:
    """Type, control code, parameter and payload of the next message. Raises EOFError at the end."""
    mark, kind, control, parameter, size = HEADER.unpack(exactly(sock, HEADER.size))
    if mark != b"HS" or size > LARGEST:
        raise EOFError
    return kind, control, parameter, exactly(sock, size)


def _send(sock: socket.socket, kind: int, control: int, parameter: int, payload: bytes = b"") -> None:
    sock.sendall(HEADER.pack(b"HS", kind, control, parameter, len(payload)) + payload)
