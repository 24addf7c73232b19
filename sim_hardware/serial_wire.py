"""A simulated serial instrument on a pseudo-terminal: the driver opens a true port, by its name. Not on Windows."""

import os
import select
import threading
from types import TracebackType
from typing import Self

from sim_hardware.laser_meters import SerialModel

TICK_S = 0.01


class PtyPort:
    """Serves one instrument until closed.

    Attributes:
        port: the name to open, such as `/dev/pts/3`.
        silent: set it to make the instrument neither obey nor answer.
    """

    def __init__(self, model: SerialModel) -> None:
        import tty

        self.silent = False
        self._model = model
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)  # a terminal would echo and turn CR into LF
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="simulated serial sensor", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Pull the plug: whoever reads the port gets an error."""
        if not self._closing.is_set():
            self._closing.set()
            self._thread.join()
            os.close(self._master)
            os.close(self._slave)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _run(self) -> None:
        while not self._closing.is_set():
            readable, _, _ = select.select([self._master], [], [], TICK_S)
            data = os.read(self._master, 4096) if readable else b""
            if not self.silent:
                self._send((self._model.receive(data) if data else b"") + self._model.tick())

    def _send(self, data: bytes) -> None:
        try:
            if data:
                os.write(self._master, data)
        except BlockingIOError:
            return  # nobody reads: what a serial line has not carried is lost
