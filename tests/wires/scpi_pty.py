"""SCPI instrument on a serial line: lines over a pseudo-terminal, with link faults. Not on Windows."""

import contextlib
import heapq
import itertools
import os
import select
import time

from sim_hardware.wires.port import MessagePort
from sim_hardware.wires.pty import POLL_S, PtyServer
from sim_hardware.wires.scpi_engine import split_received


class ScpiPty(PtyServer):
    """Serves a port until closed. An unplugged cable means silence: a serial line does not detect it.

    Args:
        speed: bench seconds per wall second, for answers that take the instrument time.
        command_s: bench seconds until the answer to any message is ready.
    """

    def __init__(self, instrument: MessagePort, speed: float = 1.0, command_s: float = 0.0) -> None:
        self._port, self._speed, self._command_s = instrument, speed, command_s
        self._due: list[tuple[float, int, bytes]] = []
        self._order = itertools.count()
        self._begun = b""
        super().__init__(self)

    @property
    def resource(self) -> str:
        """VISA resource string."""
        return f"ASRL{self.port}::INSTR"

    def receive(self, data: bytes) -> bytes:
        lines, self._begun = split_received(self._begun + data)
        for line in lines:
            reply = self._port.handle(line)
            if reply is not None:
                due_s = time.monotonic() + reply.wait_s(self._command_s, self._speed)
                heapq.heappush(self._due, (due_s, next(self._order), reply.data))
        return b""

    def unsolicited_output(self) -> bytes:
        out = b""
        while self._due and self._due[0][0] <= time.monotonic():
            out += heapq.heappop(self._due)[2]
        return out

    def _run(self) -> None:
        while not self._closing.is_set():
            wait_s = max(self._due[0][0] - time.monotonic(), 0.0) if self._due else POLL_S
            if select.select([self._master], [], [], min(wait_s, POLL_S))[0]:
                self.receive(os.read(self._master, 4096))
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, self.unsolicited_output())
