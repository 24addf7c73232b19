"""Pseudo-terminal as a serial line, with a thread that serves a simulated instrument at its far end. Not on Windows."""

import contextlib
import os
import select
import threading
from typing import Protocol

from drivers import Closeable

POLL_S = 0.01


class SerialInstrument(Protocol):
    """Interface of an instrument on a serial line."""

    def receive(self, data: bytes) -> bytes:
        """Return the immediate reply."""

    def unsolicited_output(self) -> bytes:
        """Return unsolicited output; called every POLL_S."""


class PtyServer(Closeable):
    """Serves one instrument until closed.

    Attributes:
        port: the name to open, such as `/dev/pts/3`.
        unresponsive: set it to make the instrument neither act nor reply.
    """

    def __init__(self, instrument: SerialInstrument) -> None:
        import tty

        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)  # a terminal would echo and turn CR into LF
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self.unresponsive = False
        self._instrument = instrument
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="simulated serial sensor", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and close the line: a reader of the port gets an error."""
        if not self._closing.is_set():
            self._closing.set()
            self._thread.join()
            os.close(self._master)
            os.close(self._slave)

    def _run(self) -> None:
        while not self._closing.is_set():
            readable, _, _ = select.select([self._master], [], [], POLL_S)
            data = os.read(self._master, 4096) if readable else b""
            if not self.unresponsive and (
                out := (self._instrument.receive(data) if data else b"") + self._instrument.unsolicited_output()
            ):
                # Without a reader, bytes not yet sent on the serial line are lost.
                with contextlib.suppress(BlockingIOError):
                    os.write(self._master, out)
