"""VISA link: TCP socket, VXI-11, HiSLIP, USB-TMC or serial, chosen by the resource string.

pyvisa-py opens a dead socket without complaint and raises OSError, not VisaIOError, later; its HiSLIP raises other exceptions:
all become LinkError. After a missing reply the next one must not be mistaken for it: a socket is reopened, a serial line is read
up to the identity, which the instrument sends after the replies that are due, and all other connections have a device clear.
"""

import contextlib
import secrets
import select
import socket
import struct
import sys
import threading
import time
import warnings
from collections.abc import Iterator, Sized
from typing import Any

import pyvisa
from pyvisa.constants import BufferOperation, StatusCode
from pyvisa.errors import VisaIOError

from drivers.deadlines import CallThread, Deadline
from drivers.errors import LinkError
from drivers.transport.errors import silence_remedy, translate_errors, within_deadline

VISA_ERRORS = (pyvisa.Error, OSError, ValueError, RuntimeError, AssertionError, struct.error)
"""Exceptions of pyvisa and pyvisa-py when a connection fails; the last three come from its HiSLIP."""

PROGRAM_KEY = f"tactor-bench {secrets.token_hex(8)}"
"""Key of the locks that this process takes in instruments."""

BITS_PER_BYTE = 11
"""Number of bits of a byte on a serial line: start, eight, parity, stop."""

IDENTITY_QUERY = "*IDN?"

MAX_DRAIN_S = 5.0
"""Longest wait for a serial line to become quiet; after that another device is connected, or the baud rate is wrong."""


class VisaLink:
    """One open VISA resource.

    Args:
        resource: a VISA resource string, e.g. `TCPIP::192.0.2.7::5025::SOCKET`.
        timeout_s: longest wait for a reply.
        baud: bits per second of a serial line.
        backend: the VISA library; `@py` is pyvisa-py, `@ivi` a vendor's.
        lock_key: key of the instrument's own lock, which this program and its watchdog share.
        holds_exclusive_lock: whether the lock of VXI-11, which nobody can share, is held until this link is closed.

    Raises:
        LinkError: no answer at the resource, or another program has locked the instrument.
    """

    def __init__(
        self,
        resource: str,
        timeout_s: float = 2.0,
        backend: str = "@py",
        *,
        baud: int = 9600,
        lock_key: str = PROGRAM_KEY,
        holds_exclusive_lock: bool = False,
    ) -> None:
        self.name, self._lock_key = resource, lock_key
        self._holds_exclusive_lock = holds_exclusive_lock
        self._baud = baud
        self._remedy = "check the cable and the address"
        if "::5024::" in resource or "::5555::" in resource:
            self._remedy += f"; {silence_remedy(resource)}"
        if resource.upper().startswith("USB") and backend == "@py" and sys.platform == "win32":
            self._remedy += f'; if a vendor\'s driver holds it, only {VENDOR_VISA} can open it: set backend = "@ivi" in the bench file'
        self.timeout_s = timeout_s
        self._manager = _open_manager(resource, backend)
        self._session: Any = None
        self._asked = self._identity = ""  # the last message, and the reply to *IDN? once it is known
        self._out_of_step = False
        self.calls = CallThread(f"VISA {resource}")
        _open_links.add(self)
        try:
            self.reopen()
        except LinkError:
            _open_links.discard(self)
            self.calls.end()
            raise

    @contextlib.contextmanager
    def _translate_errors(self) -> Iterator[None]:
        # Every Exception: VISA_ERRORS, and the bare Exception that an unknown host name raises.
        with translate_errors(self.name, self._remedy):
            try:
                yield
            except VisaIOError as error:
                if error.error_code == StatusCode.error_timeout:
                    raise LinkError(self._silence_message) from error
                raise LinkError(f"{self.name}: {error.description or error}") from error
            except UnicodeDecodeError as error:
                raise LinkError(f"{self.name} sent bytes that are not text; check the cable and the port") from error

    @property
    def _silence_message(self) -> str:
        return f"{self.name} was silent for {self.timeout_s:g} s; {silence_remedy(self.name)}"

    @within_deadline(bytes_s=lambda link, message: link.bytes_s(message))
    def write(self, message: str) -> None:
        with self._translate_errors():
            session = self._open_session()
            self._raise_if_closed(0.0)
            if self._out_of_step and "?" in message and IDENTITY_QUERY not in message:
                self._read_until_identity()
            self._asked = message
            if self._is_serial:  # time for a long waveform at this baud rate
                session.timeout = 1000 * (self.timeout_s + self.bytes_s(message))
            try:
                # Latin-1 carries every byte of a binary block unchanged.
                session.write(message, encoding="latin-1")
            finally:
                if self._is_serial:
                    session.timeout = 1000 * self.timeout_s

    @within_deadline()
    def read(self) -> str:
        with self._translate_errors():
            session = self._open_session()
            self._raise_if_closed(self.timeout_s)
            answer: str = session.read()
            if self._is_serial and IDENTITY_QUERY in self._asked:
                self._identity = answer
            elif self._identity:
                while answer.endswith(self._identity):  # it came later than it was waited for
                    answer = session.read()
            return answer

    @within_deadline(bytes_s=lambda link, count: link.bytes_s(range(count)))
    def read_bytes(self, count: int) -> bytes:
        """Return a number of bytes of a reply. Raises LinkError if they do not arrive in time."""
        with self._translate_errors():
            session = self._open_session()
            self._raise_if_closed(self.timeout_s)
            data: bytes = session.read_bytes(count)
            return data

    def _raise_if_closed(self, timeout_s: float) -> None:
        """Wait for input on a socket; raise LinkError if none arrives, or if the other side has closed it.

        pyvisa-py mistakes a closed connection for silence.
        """
        wire: Any = self._wire_session()
        sock: Any = getattr(wire, "interface", None)
        pending: Any = getattr(wire, "_pending_buffer", None)
        if not isinstance(sock, socket.socket) or pending:
            return
        readable, _, _ = select.select([sock], [], [], timeout_s)
        if timeout_s and not readable:
            raise LinkError(self._silence_message)
        if readable and not sock.recv(1, socket.MSG_PEEK):
            raise LinkError(f"{self.name} has closed the connection; check the instrument's power and cable")

    def _wire_session(self) -> Any:
        """Return pyvisa-py's own session; None with another VISA library."""
        with contextlib.suppress(AttributeError, KeyError, TypeError):
            library: Any = self._manager.visalib
            return library.sessions[self._session.session]
        return None

    @within_deadline(Deadline.SOURCE_OPENING)
    def clear(self) -> None:
        # pyvisa-py 0.8.1 reads a raw socket until nothing is readable: a socket closed by the peer stays readable for ever,
        # and clear() never returns. A new connection also discards a late reply.
        if self.name.upper().endswith("::SOCKET"):
            self.reopen()
        elif self._is_serial and self._identity:
            self._read_until_identity()
        elif self._is_serial:
            self._read_until_quiet()
        else:
            try:
                with self._translate_errors():
                    self._open_session().clear()
            except LinkError:  # pyvisa-py's HiSLIP fails on a late reply that has arrived
                self.reopen()

    def _read_until_identity(self) -> None:
        """Discard input up to the identity; a query is sent only after it has arrived. Raises LinkError if it does not arrive in time."""
        session, until_s, self._out_of_step = self._open_session(), time.monotonic() + self.timeout_s, True
        with self._translate_errors():
            session.write(IDENTITY_QUERY)
            while self._out_of_step and time.monotonic() < until_s:
                with contextlib.suppress(UnicodeDecodeError):  # half a reply
                    self._out_of_step = not session.read().endswith(self._identity)
        if self._out_of_step:
            raise LinkError(f"{self.name} does not send its identity; check the cable and the baud rate")

    def _read_until_quiet(self) -> None:
        """Discard input until nothing arrives for the reply timeout."""
        session, until_s = self._open_session(), time.monotonic() + MAX_DRAIN_S
        with self._translate_errors():
            try:
                while time.monotonic() < until_s:
                    session.read_bytes(1)
            except VisaIOError as error:
                if error.error_code != StatusCode.error_timeout:
                    raise

    def bytes_s(self, message: Sized) -> float:
        """Return how long bytes take on a serial line; 0 on all others."""
        return BITS_PER_BYTE * len(message) / self._baud if self._is_serial else 0.0

    @property
    def _is_serial(self) -> bool:
        return self.name.upper().startswith("ASRL")

    def reopen(self) -> None:
        if self.calls.given_up:  # a session that hangs cannot be closed, but its socket can
            self._shut_down_socket()
            self.calls, self._session = CallThread(f"VISA {self.name}"), None
        self._open()

    @within_deadline(Deadline.SOURCE_OPENING)
    def _open(self) -> None:
        self._close_session()
        self._identity, self._out_of_step = "", False
        with self._translate_errors():
            opened = self._manager.open_resource(
                self.name,
                open_timeout=round(1000 * Deadline.SOURCE_OPENING.seconds),
                read_termination="\n",
                write_termination="\n",
                timeout=self.timeout_s * 1000,
            )
            if threading.current_thread() is not self.calls or self.calls.given_up:  # it comes too late
                opened.close()
                return
            self._session = opened
            if self._is_serial:
                self._session.baud_rate = self._baud
                self._session.flush(BufferOperation.discard_read_buffer)
            self._disable_nagle()
            try:
                self._lock_instrument()
            except LinkError:
                self._close_session()
                raise

    def _lock_instrument(self) -> None:
        """Take the instrument's own lock, where its protocol has one. Raises LinkError if another program has it.

        HiSLIP holds it until the connection ends. VXI-11 knows exclusive locks only, which keep out the watchdog, too; some instruments
        keep the lock of a lost connection until they are switched off (python-vxi11, pull request 33). There it is given back at once,
        if it is not to be held.
        """
        wire, address = self._wire_session(), self.name.upper()
        if not (address.startswith("TCPIP") and address.endswith("INSTR")):
            return
        from pyvisa_py.protocols.rpc import RPCError  # with the backend, which is imported at the first opening

        try:
            if "::HISLIP" not in address:
                self._session.lock_excl(0)
                if not self._holds_exclusive_lock:
                    self._session.unlock()
            elif wire is None:
                self._session.lock(0, self._lock_key)
            elif wire.interface.async_lock_request(0.0, self._lock_key) == "failure":  # pyvisa-py has no `lock` for it
                raise LinkError(self._lock_message)
        except VisaIOError as error:
            if error.error_code == StatusCode.error_resource_locked:
                raise LinkError(self._lock_message) from error
            # Any other error: this instrument has no lock.
        except RPCError:  # it does not know the procedure
            pass

    @property
    def _lock_message(self) -> str:
        return f"{self.name} is locked by another program, perhaps on another computer; end its session there, and open the bench again"

    def _disable_nagle(self) -> None:
        """Disable Nagle's algorithm: two messages before a reply take 44 ms on a socket, and pyvisa-py has no setting for it."""
        with contextlib.suppress(AttributeError, OSError, TypeError):
            self._wire_session().interface.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def close(self) -> None:
        with contextlib.suppress(LinkError):
            self._close()
        self.calls.end()

    @within_deadline()
    def _close(self) -> None:
        if self._holds_exclusive_lock and self._session is not None:
            with contextlib.suppress(*VISA_ERRORS):
                self._session.unlock()
        self._close_session()
        _open_links.discard(self)
        _close_manager(self._manager)

    def _open_session(self) -> Any:
        if self._session is None:
            raise LinkError(f"{self.name} is closed")
        return self._session

    def _close_session(self) -> None:
        self._shut_down_socket()
        session, self._session = self._session, None
        if session is not None:
            with contextlib.suppress(*VISA_ERRORS):
                session.close()

    def _shut_down_socket(self) -> None:
        """End the connection: an instrument of one session serves the next one once it knows of the end."""
        sock: Any = getattr(self._wire_session(), "interface", None)
        if isinstance(sock, socket.socket):
            with contextlib.suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)


_open_links: set[VisaLink] = set()

VENDOR_VISA = "a vendor's VISA library (NI-VISA, Keysight IO Libraries)"


def _open_manager(resource: str, backend: str) -> pyvisa.ResourceManager:
    """Return the resource manager of a VISA library. Raises LinkError if it is missing or cannot carry the resource."""
    if resource.upper().startswith("GPIB") and backend == "@py":
        raise LinkError(f'{resource}: GPIB needs {VENDOR_VISA}; install it and set backend = "@ivi" in the bench file')
    try:
        return pyvisa.ResourceManager(backend)
    except VISA_ERRORS as error:
        needed = VENDOR_VISA if backend == "@ivi" else f"the VISA library '{backend}'"
        raise LinkError(
            f"{resource}: {needed} is not installed on this computer ({error}); install it, or connect the instrument by LAN"
        ) from error


def _close_manager(manager: pyvisa.ResourceManager) -> None:
    """Close a resource manager that no open link uses: PyVISA has one of each kind, and closing it closes all its sessions."""
    if not any(link._manager is manager for link in _open_links):  # noqa: SLF001 - of this module
        with contextlib.suppress(pyvisa.Error, OSError):
            manager.close()


def list_resources(backend: str = "@py") -> tuple[list[str], list[str]]:
    """Return the resource strings discovered by VISA, and messages on interfaces that could not be searched."""
    manager = pyvisa.ResourceManager(backend)
    try:
        with warnings.catch_warnings():
            # VISA's discovery leaves sockets open and warns about missing packages.
            warnings.simplefilter("ignore")
            names = sorted(manager.list_resources("?*"))
        debug_info = str(manager.visalib.get_debug_info())
    except (pyvisa.Error, OSError, ValueError) as error:
        return [], [f"VISA resources could not be listed: {error}"]
    finally:
        _close_manager(manager)
    missing = []
    if "PyUSB" in debug_info:
        missing.append(
            "USB instruments were not searched for: that needs libusb (a package of your system, libusb-1.0)"
        )
    if "zeroconf not installed" in debug_info:
        missing.append(
            "HiSLIP instruments were not searched for: that needs 'pip install zeroconf'; a host that is given is queried"
        )
    return [name for name in names if not name.startswith("PRLGX")], missing
