"""Message record: every message of a session with an instrument, with times, as a file for its vendor.

One JSON object a line: `t` in seconds of bench time from the begin, and `sent`, `received`, `bytes` (received without a line end),
`error` or `did` (`clear`, `reopen`, `close`). Bytes of waveforms are Latin-1 characters. The first line has the format and the address.
"""

import json
import logging
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from drivers.errors import InstrumentError, LinkError
from drivers.interfaces import Closeable
from drivers.transport.scpi import Link

FORMAT = "tactor-bench messages 1"

log = logging.getLogger(__name__)


class MessageRecord(Closeable):
    """A file of messages.

    Args:
        path: the file; an existing one is replaced.

    Raises:
        InstrumentError: it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._file = path.open("w", encoding="utf-8")
        except OSError as error:
            raise InstrumentError(
                f"the messages cannot be recorded in '{path}' ({error.strerror}); correct record_messages in the bench file"
            ) from error
        self._begin_s: float | None = None

    def around(self, link: Link, now: Callable[[], float]) -> "RecordedLink":
        """Return the link with its messages recorded."""
        if self._begin_s is None:
            self._begin_s = now()
            self._write({"format": FORMAT, "address": link.name})
        begin_s = self._begin_s
        return RecordedLink(link, lambda what, text: self._write({"t": round(now() - begin_s, 6), what: text}))

    def _write(self, line: dict[str, Any]) -> None:
        if self._file.closed:
            return
        try:
            self._file.write(json.dumps(line) + "\n")
            self._file.flush()  # the last line before a crash is the one that is wanted
        except OSError as error:
            # A full disk must not keep a message from the instrument, least of all one that brings it to rest.
            self.close()
            log.warning("The record of messages ends here: %s", error.strerror)

    def close(self) -> None:
        with suppress(OSError):  # what could not be written
            self._file.close()


class RecordedLink:
    """A link that notes what passes; all other behaviour is the original link's."""

    def __init__(self, link: Link, note: Callable[[str, str], None]) -> None:
        self._link, self._note, self.name = link, note, link.name

    def write(self, message: str) -> None:
        self._note("sent", message)
        self._link.write(message)

    def read(self) -> str:
        return self._noted("received", self._link.read)

    def read_bytes(self, count: int) -> bytes:
        read: Callable[[int], bytes] = self._link.read_bytes  # type: ignore[attr-defined]
        return self._noted("bytes", lambda: read(count).decode("latin-1")).encode("latin-1")

    def _noted(self, what: str, read: Callable[[], str]) -> str:
        try:
            text = read()
        except LinkError as error:
            self._note("error", str(error))
            raise
        self._note(what, text)
        return text

    def clear(self) -> None:
        self._note("did", "clear")
        self._link.clear()

    def reopen(self) -> None:
        self._note("did", "reopen")
        self._link.reopen()

    def close(self) -> None:
        self._note("did", "close")
        self._link.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)
