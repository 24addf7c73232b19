"""Serial port for text and bytes: RS-232, RS-422 behind USB, or any pyserial URL.

DTR and RTS keep their defaults: some converters have no such lines, and some sensors reset on them.
"""

import contextlib

import serial

from drivers.deadlines import CallThread, Deadline
from drivers.errors import LinkError
from drivers.transport.errors import translate_errors, within_deadline

try:
    from termios import error as TerminalError  # noqa: N812 - an unplugged converter raises it, and it is not an OSError
except ImportError:  # Windows
    TerminalError = OSError  # type: ignore[misc, assignment]

PORT_ERRORS = (serial.SerialException, TerminalError, OSError)


class SerialPort:
    """One open port.

    Args:
        port: `COM3`, `/dev/ttyUSB0`, or a pyserial URL such as `socket://host:port`.
        baud: bits per second.
        timeout_s: longest wait for a reply.

    Raises:
        LinkError: the port does not exist or cannot be opened.
    """

    def __init__(self, port: str, baud: int, timeout_s: float = 1.0) -> None:
        self.name = port
        self.timeout_s, self._baud = timeout_s, baud
        self.calls = CallThread(f"serial port {port}")
        try:
            self._open()
        except LinkError:
            self.calls.end()
            raise

    @within_deadline(Deadline.SOURCE_OPENING)
    def _open(self) -> None:
        with self._translate_errors():
            self._port = serial.serial_for_url(
                self.name, baudrate=self._baud, timeout=self.timeout_s, write_timeout=self.timeout_s
            )

    @within_deadline()
    def write(self, data: bytes) -> None:
        with self._translate_errors():
            self._port.write(data)

    @within_deadline()
    def query(self, command: bytes, terminator: bytes) -> str:
        """Return the reply to a command without its terminator. Earlier input is discarded.

        Raises:
            LinkError: silence, an incomplete reply, or bytes that are not text.
        """
        with self._translate_errors():
            self._port.reset_input_buffer()
            self._port.write(command)
        return self.read_line(terminator)

    @within_deadline()
    def read_line(self, terminator: bytes) -> str:
        """Return the text up to a terminator.

        Raises:
            LinkError: silence, an incomplete line, or bytes that are not text.
        """
        with self._translate_errors():
            answer = bytes(self._port.read_until(terminator))
        if not answer.endswith(terminator):
            half = f" (it began '{answer[:20]!r}' and did not end)" if answer else ""
            raise LinkError(f"{self.name} was silent for {self.timeout_s:g} s{half}; check power, cable and baud rate")
        try:
            return answer[: -len(terminator)].decode("ascii").strip()
        except UnicodeDecodeError:
            raise LinkError(f"{self.name} sent bytes that are not text; check the baud rate") from None

    @within_deadline()
    def read(self, count: int) -> bytes:
        """Return the next bytes; fewer at a timeout."""
        with self._translate_errors():
            return bytes(self._port.read(count))

    @within_deadline()
    def discard_input(self) -> None:
        """Discard received bytes."""
        with self._translate_errors():
            self._port.reset_input_buffer()

    def close(self) -> None:
        with contextlib.suppress(LinkError):
            self._close()
        self.calls.end()

    @within_deadline()
    def _close(self) -> None:
        with contextlib.suppress(*PORT_ERRORS):
            self._port.close()

    def _translate_errors(self) -> contextlib.AbstractContextManager[None]:
        return translate_errors(self.name, "check its cable and the port's name", (*PORT_ERRORS, ValueError))


def list_serial_ports() -> list[tuple[str, str]]:
    """Return names and descriptions of the serial ports of this computer."""
    from serial.tools import list_ports

    return sorted(
        (port.device, "" if port.description in (None, "n/a") else port.description) for port in list_ports.comports()
    )
