"""In-process link to a simulated SCPI instrument: same messages and faults, on the bench clock."""

from drivers import Clock, LinkError
from sim_hardware.wires.port import MessagePort
from sim_hardware.wires.scpi_engine import split_received


class InProcessLink:
    """A link to an SCPI instrument in this process. Replies queue up, so a late one is read by the next query.

    Args:
        command_s: bench time of each message.
        timeout_s: bench time after which `read` raises.
    """

    def __init__(
        self,
        port: MessagePort,
        clock: Clock,
        name: str = "generator (direct)",
        command_s: float = 1e-3,
        timeout_s: float = 2.0,
    ) -> None:
        self.name = name
        self._port = port
        self._clock = clock
        self._command_s = command_s
        self._timeout_s = timeout_s
        self._pending: list[tuple[float, str, bool]] = []
        self._open = True

    def write(self, message: str) -> None:
        """Send one message. Raises LinkError if not connected."""
        self._check_connected()
        self._clock.sleep(self._command_s)
        messages, _ = split_received(f"{message}\n".encode("latin-1"))
        for received in messages:  # one message, unless a byte of it ends it earlier
            reply = self._port.handle(received)
            if reply is not None:
                self._pending.append((self._clock.now() + reply.delay_s + reply.late_s, reply.text, reply.terminated))

    def read(self) -> str:
        """Return the next reply without its end of line. Raises LinkError if none arrives in time."""
        self._check_connected()
        if not self._pending or self._pending[0][0] > self._clock.now() + self._timeout_s:
            self._raise_timeout("did not answer")
        ready, text, ended = self._pending[0]
        self._clock.sleep(max(0.0, ready - self._clock.now()))
        if not ended:
            self._raise_timeout("began an answer and did not end it")
        del self._pending[0]
        return text

    def read_bytes(self, count: int) -> bytes:
        """Return a number of bytes of the next reply. Raises LinkError if they do not arrive in time."""
        text = self.read()
        if len(text) < count:
            self._raise_timeout("sent too few bytes")
        if rest := text[count:]:
            self._pending.insert(0, (self._clock.now(), rest, True))
        return text[:count].encode("latin-1")

    def clear(self) -> None:
        """Drop all pending replies."""
        self._pending.clear()

    def reopen(self) -> None:
        """Close and open again. Raises LinkError if the instrument is unreachable."""
        self._pending.clear()
        self._open = True
        self._check_connected()

    def close(self) -> None:
        """Close the link without changing the output."""
        self._open = False
        self._pending.clear()

    def _check_connected(self) -> None:
        if not self._open:
            raise LinkError(f"{self.name}: the connection is closed; open it again")
        if not self._port.connected:
            raise LinkError(f"{self.name}: the connection was lost; check its power and its cable, then reconnect")

    def _raise_timeout(self, reason: str) -> None:
        self._clock.sleep(self._timeout_s)
        raise LinkError(f"{self.name} {reason} within {self._timeout_s:g} s; check that it is on and its cable is in")
