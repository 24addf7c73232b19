"""VXI-11 server (VXIbus TCP/IP instrument protocol, 1995) over ONC RPC (RFC 5531), with device clear.

Only the core channel, and without a port mapper: the resource names the port (`TCPIP::host,port::INSTR`).
"""

import socket
import struct
import threading
import time
from enum import IntEnum

from sim_hardware.wires.port import HOST, MessagePort
from tests.wires.threaded_server import ThreadedServer, exactly

CORE, VERSION = 0x0607AF, 1
LARGEST = 1 << 24
LAST = 1 << 31
"""Marks the last fragment of a record."""

END = 8
"""Flag of a write: the message is complete."""

ALL, ENDED = 1, 4
"""Reasons of a read: as much as was asked for, and the end of the answer."""


class Call(IntEnum):
    """Procedures of the core channel that are understood here (table B.1)."""

    CREATE_LINK = 10
    WRITE = 11
    READ = 12
    STATUS = 13
    TRIGGER = 14
    CLEAR = 15
    LOCK = 18
    UNLOCK = 19
    DESTROY_LINK = 23


class Failure(IntEnum):
    """Errors that are answered here (table B.2)."""

    NONE = 0
    LOCKED = 11
    NOT_LOCKED = 12
    TIMEOUT = 15


class Vxi11Server(ThreadedServer):
    """Serves one link per connection: replies wait until they are read."""

    def __init__(self, instrument: MessagePort, speed: float = 1.0, command_s: float = 0.0) -> None:
        self._away = threading.Event()
        self.lock_owner: object = None
        """The link that has the exclusive lock."""
        self.knows_locks = True
        super().__init__(instrument, speed, command_s)

    @property
    def resource(self) -> str:
        """VISA resource string."""
        return f"TCPIP::{HOST},{self.port}::inst0::INSTR"

    def _listen(self) -> None:
        self._away.clear()
        super()._listen()

    def _wake(self) -> None:
        self._away.set()

    def _serve(self, sock: socket.socket) -> None:
        link = _Link(self._instrument, self._speed, self._command_s, self._away)
        try:
            self._serve_link(sock, link)
        finally:
            self._unlock(link)

    def _serve_link(self, sock: socket.socket, link: "_Link") -> None:
        while True:
            call = _record(sock)
            number, _, _, program, version, procedure = struct.unpack_from("!6I", call)
            _, after = _opaque(call, 28)  # credential: a flavour, then as many bytes as it says
            _, after = _opaque(call, after + 4)  # verifier
            known = program == CORE and version == VERSION and procedure in Call._value2member_map_
            known = known and (self.knows_locks or procedure not in (Call.LOCK, Call.UNLOCK))
            result = self._carry_out(link, Call(procedure), call[after:]) if known else b""
            accepted = struct.pack("!6I", number, 1, 0, 0, 0, 0 if known else 3)
            sock.sendall(struct.pack("!I", LAST | len(accepted) + len(result)) + accepted + result)

    def _carry_out(self, link: "_Link", call: Call, arguments: bytes) -> bytes:
        if call == Call.UNLOCK:
            return struct.pack("!i", Failure.NONE if self._unlock(link) else Failure.NOT_LOCKED)
        if call not in (Call.CREATE_LINK, Call.DESTROY_LINK) and self.lock_owner not in (None, link):
            return struct.pack("!iiI", Failure.LOCKED, 0, 0)[
                : 12 if call == Call.READ else 8 if call in (Call.WRITE, Call.STATUS) else 4
            ]
        if call == Call.LOCK:
            self.lock_owner = link
            return struct.pack("!i", Failure.NONE)
        return link.carry_out(call, arguments)

    def _unlock(self, link: "_Link") -> bool:
        owned = self.lock_owner is link
        if owned:
            self.lock_owner = None
        return owned


class _Link:
    """Input and pending replies of one client."""

    def __init__(self, instrument: MessagePort, speed: float, command_s: float, away: threading.Event) -> None:
        self._instrument, self._speed, self._command_s, self._away = instrument, speed, command_s, away
        self._begun = b""
        self._answers: list[tuple[float, bytes, bool]] = []  # due, what is left of it, whether it ends there

    def carry_out(self, call: Call, arguments: bytes) -> bytes:
        match call:
            case Call.CREATE_LINK:
                return struct.pack("!iiII", Failure.NONE, 1, 0, LARGEST)
            case Call.WRITE:
                flags = struct.unpack_from("!4I", arguments)[3]
                data, _ = _opaque(arguments, 16)
                self._write(data, ended=bool(flags & END))
                return struct.pack("!iI", Failure.NONE, len(data))
            case Call.READ:
                _, most, timeout_ms = struct.unpack_from("!3I", arguments)
                error, reason, data = self._read(most, timeout_ms / 1000)
                return struct.pack("!iiI", error, reason, len(data)) + data + bytes(-len(data) % 4)
            case Call.TRIGGER:
                self._write(b"*TRG", ended=True)
            case Call.CLEAR:
                self._begun = b""
                self._answers.clear()
            case Call.STATUS:
                return struct.pack("!iI", Failure.NONE, 0)
        return struct.pack("!i", Failure.NONE)

    def _write(self, data: bytes, ended: bool) -> None:
        self._begun += data
        if not ended:
            return
        message, self._begun = self._begun.removesuffix(b"\n"), b""
        reply = self._instrument.handle(message.decode("latin-1"))
        if reply is not None:
            due_s = time.monotonic() + reply.wait_s(self._command_s, self._speed)
            self._answers.append((due_s, reply.data, reply.terminated))

    def _read(self, most: int, timeout_s: float) -> tuple[Failure, int, bytes]:
        wait_s = self._answers[0][0] - time.monotonic() if self._answers else timeout_s
        if wait_s > 0 and self._away.wait(min(wait_s, timeout_s)):
            raise EOFError
        if not self._answers or wait_s > timeout_s:
            return Failure.TIMEOUT, 0, b""
        due_s, data, ended = self._answers.pop(0)
        if len(data) > most:
            self._answers.insert(0, (due_s, data[most:], ended))
            return Failure.NONE, ALL, data[:most]
        return Failure.NONE, ENDED if ended else 0, data


def _record(sock: socket.socket) -> bytes:
    """The next call, from its fragments."""
    record, mark = b"", 0
    while not mark & LAST:
        (mark,) = struct.unpack("!I", exactly(sock, 4))
        if (mark & ~LAST) > LARGEST:
            raise EOFError
        record += exactly(sock, mark & ~LAST)
    return record


def _opaque(data: bytes, at: int) -> tuple[bytes, int]:
    """Return length-prefixed bytes and the offset after them."""
    (size,) = struct.unpack_from("!I", data, at)
    return data[at + 4 : at + 4 + size], at + 4 + size + -size % 4
