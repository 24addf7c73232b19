"""Pseudo-terminal as a serial line, with a thread that serves its far end. Not on Windows."""

import os
import threading
from abc import abstractmethod

from drivers import Closeable

POLL_S = 0.01


class PtyServer(Closeable):
    """Served until closed; `_run` is what the thread does, until `_closing` is set.

    Attributes:
        port: the name to open, such as `/dev/pts/3`.
    """

    def __init__(self, name: str) -> None:
        import tty

        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)  # a terminal would echo and turn CR into LF
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and close the line: a reader of the port gets an error."""
        if not self._closing.is_set():
            self._closing.set()
            self._thread.join()
            os.close(self._master)
            os.close(self._slave)

    @abstractmethod
    def _run(self) -> None: ...

    def _send(self, data: bytes) -> None:
        try:
            os.write(self._master, data)
        except BlockingIOError:
            return  # no reader: bytes that a serial line has not carried are lost
