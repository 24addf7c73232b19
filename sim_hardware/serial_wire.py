"""A simulated serial instrument on a pseudo-terminal: the driver opens a true port, by its name. Not on Windows."""

import os
import select

from sim_hardware.laser_meters import SerialModel
from sim_hardware.pty_line import TICK_S, PtyLine


class PtyPort(PtyLine):
    """Serves one instrument until closed.

    Attributes:
        silent: set it to make the instrument neither obey nor answer.
    """

    def __init__(self, model: SerialModel) -> None:
        self.silent = False
        self._model = model
        super().__init__("simulated serial sensor")

    def _run(self) -> None:
        while not self._closing.is_set():
            readable, _, _ = select.select([self._master], [], [], TICK_S)
            data = os.read(self._master, 4096) if readable else b""
            if not self.silent and (out := (self._model.receive(data) if data else b"") + self._model.tick()):
                self._send(out)
