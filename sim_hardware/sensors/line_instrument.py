"""Base of the simulated instruments that answer lines of text."""

from abc import ABC, abstractmethod


class LineInstrument(ABC):
    """Answers each line up to `end`, without `skipped` characters, by a reply with its own end; sends nothing by itself."""

    end, skipped, reply_end = b"\r\n", b"", b""
    _partial_line = b""

    def receive(self, data: bytes) -> bytes:
        *lines, self._partial_line = (self._partial_line + data).replace(self.skipped, b"").split(self.end)
        return b"".join(
            self._respond(line.decode("ascii", errors="replace")).encode() + self.reply_end for line in lines
        )

    def unsolicited_output(self) -> bytes:
        return b""

    @abstractmethod
    def _respond(self, command: str) -> str:
        """Return the reply to a line, without its end."""
