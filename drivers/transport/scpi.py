"""SCPI session: every command is confirmed by the instrument's error queue in the same message.

A message that ends in a query costs one round trip and no Nagle stall (two plain writes before a query cost 44 ms on
a socket), and a rejected setting is known before the next one is sent.
"""

import contextlib
import re
import statistics
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol

from drivers.errors import InstrumentError, LinkError
from drivers.interfaces import Identity
from drivers.transport.errors import reply_remedy

SCPI_INFINITY = 9.9e37
"""Infinity in SCPI; its "not a number" is 9.91e37 (SCPI-99, vol. 1, 7.2.1)."""

UNDEFINED_HEADER = re.compile(r"\s*-11[34]\b(?!\.)")
"""Report of an unknown command, or of a channel that the model does not have (SCPI-99, vol. 2, 21.8.9)."""

ERROR_REPORT = re.compile(r'\s*[+-]?\d+(,|  )\s*"?[A-Za-z]')
"""Reply to `SYST:ERR?`; a Siglent supply separates code and text by blanks."""

MEASURED_REPLIES = 15
MAX_BLOCK_HEADER = 512
"""Longest text before the bytes of a reply."""

SLOW_REPLY_S = 0.01
"""Reply time above which the steps of a ramp to rest are sent without waiting for each reply. A serial or USB line is never slow
in this sense: its bytes take the time."""


class Link(Protocol):
    """A connection that carries lines. `name` is its resource string."""

    name: str

    def write(self, message: str) -> None:
        """Send a message. Raises LinkError if the connection failed."""

    def read(self) -> str:
        """Return the next reply, without its line end. Raises LinkError if none arrives within the timeout."""
        ...

    def clear(self) -> None:
        """Discard pending replies: a late reply after a timeout would be mistaken for the next query's reply."""

    def reopen(self) -> None:
        """Close and open again. Raises LinkError if nothing answers."""

    def close(self) -> None:
        """Close the connection."""


def join_commands(commands: Sequence[str]) -> str:
    """Return one message of several commands, each from the root of the command tree."""
    return ";:".join(command.removeprefix(":") for command in commands)


class ScpiSession:
    """SCPI queries and confirmed commands over a link. `instrument` names it in errors; `now` is bench time."""

    def __init__(self, link: Link, instrument: str, now: Callable[[], float] = time.monotonic) -> None:
        self.link = link
        self.instrument = instrument
        self._now = now
        self._reply_times_s: deque[float] = deque(maxlen=MEASURED_REPLIES)

    @property
    def reply_s(self) -> float:
        """Median time from a query to its reply, of the last queries; 0 before the first."""
        return statistics.median(self._reply_times_s) if self._reply_times_s else 0.0

    @property
    def slow_reply_s(self) -> float:
        """Time of a reply if a ramp to rest must not wait for each reply, else 0.

        The last two replies count in addition to the median, because a connection may become slow at any time.
        """
        if getattr(self.link, "confirms_steps", False):
            return 0.0
        latest = list(self._reply_times_s)[-2:]
        reply_s = max(self.reply_s, min(latest, default=0.0))
        return reply_s if reply_s > SLOW_REPLY_S and not self.link.name.upper().startswith(("ASRL", "USB")) else 0.0

    def query(self, query: str) -> str:
        """Return the reply to a query.

        Raises:
            LinkError: no reply, or a broken connection, resynchronised if possible.
        """
        begin_s = self._now()
        try:
            self.link.write(query)
            answer = self.link.read().strip()
            self._reply_times_s.append(self._now() - begin_s)
            return answer
        except LinkError as error:
            with contextlib.suppress(LinkError):  # if the connection is lost, the first error reports it
                self.link.clear()
            shown = query.partition(",#")[0]  # without the bytes of a waveform
            raise LinkError(f"{self.instrument}: no answer to '{shown}': {error}") from error

    def query_optional(self, query: str) -> str | None:
        """Return the reply to a query that the instrument may not know; None if it reports an unknown header.

        An unknown header is not answered. On a socket or serial line the error queue is asked at once, so that no reply timeout
        passes; USB-TMC, VXI-11, HiSLIP and GPIB discard a reply at the next message (IEEE 488.2, 6.3.2.3).

        Raises:
            LinkError: no reply, although it knows the query.
        """
        name = self.link.name.upper()
        try:
            if name.startswith(("USB", "GPIB")) or (name.startswith("TCPIP") and not name.endswith("SOCKET")):
                return self.query(query)
            self.link.write(query)
            answer = self.query("SYST:ERR?")
            if UNDEFINED_HEADER.match(answer):
                return None
            if ERROR_REPORT.match(answer):  # of something else, and the query was not answered
                return self.query(query)
        except LinkError:
            if not UNDEFINED_HEADER.match(self.query("SYST:ERR?")):
                raise
            return None
        try:
            self.link.read()
        except LinkError:  # a second message that arrived early was lost
            self.link.clear()
        return answer

    def query_float(self, query: str) -> float:
        """Return the reply to a query as a number.

        Raises:
            LinkError: the reply is not a number (a garbled line, or SCPI's own "not a number" and infinity).
        """
        answer = self.query(query)
        try:
            value = float(answer)
        except ValueError:
            self.link.clear()
            raise LinkError(
                f"{self.instrument}: '{query}' was answered by '{answer[:60]}', which is not a number; "
                f"{reply_remedy(self.link.name, query, answer)}"
            ) from None
        if not abs(value) < SCPI_INFINITY:
            raise LinkError(f"{self.instrument}: '{query}' was answered by '{answer[:60]}', which is not a value")
        return value

    def query_block(self, query: str, marker: bytes, size: Callable[[str], int]) -> bytes:
        """Return the bytes after `marker` in the reply to a query; `size` returns their number from the preceding text.

        Raises:
            LinkError: no such reply, or this kind of connection does not carry bytes.
        """
        read_bytes: Callable[[int], bytes] | None = getattr(self.link, "read_bytes", None)
        if read_bytes is None:
            raise LinkError(f"{self.link.name} does not carry the reply to '{query}'")
        try:
            self.link.write(query)
            header = b""
            while not header.endswith(marker):
                header += read_bytes(1)
                if len(header) > MAX_BLOCK_HEADER:
                    raise LinkError(f"no waveform, but '{header[:60].decode('latin-1')}'")
            data = read_bytes(size(header.decode("latin-1")))
            # An end of line may or may not follow the bytes: the next line of text is the identity.
            self.link.write("*IDN?")
            if not self.link.read().strip():
                self.link.read()
        except LinkError as error:
            with contextlib.suppress(LinkError):
                self.link.clear()
            raise LinkError(f"{self.instrument}: no answer to '{query}': {error}") from error
        return data

    def write_checked(self, command: str) -> None:
        """Send a command and check the instrument's error queue.

        Raises:
            InstrumentError: the instrument rejected it; the message carries its error text.
        """
        self._check_error_report(command, self.query(f"{command};:SYST:ERR?"))

    def write_block_checked(self, command: str) -> None:
        """Send a command that ends in a binary block, in a message of its own, and check the error queue.

        Raises:
            InstrumentError: the instrument rejected it; the message carries its error text.
        """
        self.link.write(command)
        self.query("*OPC?")
        self._check_error_report(command, self.query("SYST:ERR?"))

    def _check_error_report(self, command: str, answer: str) -> None:
        shown = command.partition(",#")[0]
        code, _, text = answer.partition(",")
        try:
            refused = int(code) != 0
        except ValueError:
            self.link.clear()
            raise LinkError(
                f"{self.instrument}: '{shown}' was answered by '{answer[:60]}', which is not an error report; "
                f"{reply_remedy(self.link.name, command, answer)}"
            ) from None
        if refused:
            text = text.strip().strip('"')
            raise InstrumentError(f"{self.instrument} refused '{shown}': {text} ({code})")

    def identify(self) -> Identity:
        """Return the identity that `*IDN?` reports."""
        parts = [part.strip() for part in self.query("*IDN?").split(",")]
        if len(parts) < 2:
            raise LinkError(
                f"{self.instrument}: '*IDN?' was answered by '{','.join(parts)[:60]}'; is this the instrument? "
                f"If it is, {reply_remedy(self.link.name, '*IDN?', ','.join(parts))}"
            )
        return Identity(*[*parts, "", ""][:4])


def definite_length_block(data: bytes) -> str:
    """Return an IEEE 488.2 definite-length block, its bytes as Latin-1 text."""
    length = str(len(data))
    return f"#{len(length)}{length}{data.decode('latin-1')}"
