"""Laser sensors that answer on a serial line: Keyence LK-G in text, Micro-Epsilon optoNCDT in words of three bytes.

`see` is what the laser sees: metres from its zero, or None where there is no target in its range.

A simulated serial instrument on a pseudo-terminal: the driver opens a true port, by its name. Not on Windows.
"""

import os
import select
from collections.abc import Callable
from typing import Protocol

from sim_hardware.wires.pty import TICK_S, PtyLine

See = Callable[[], float | None]


class SerialModel(Protocol):
    """What a serial wire needs of an instrument."""

    def receive(self, data: bytes) -> bytes:
        """What it sends back at once."""

    def tick(self) -> bytes:
        """What it sends by itself, a few times in a hundredth of a second."""


class LkG:
    """The controller: one command at a time, ended by CR."""

    def __init__(self, see: See) -> None:
        self._see = see
        self._begun = b""
        self.setting = False
        """Whether somebody has left its setting screen open: it then refuses to measure."""

    def receive(self, data: bytes) -> bytes:
        *lines, self._begun = (self._begun + data).split(b"\r")
        return b"".join(self._answer(line.decode("ascii", errors="replace")) + b"\r" for line in lines)

    def tick(self) -> bytes:
        return b""

    def _answer(self, command: str) -> bytes:
        if command.upper() != "MS":
            return f"ER,{command[:2]},00".encode()
        if self.setting:
            return b"ER,MS,01"
        seen = self._see()
        value = "+FFFFFFF" if seen is None else f"{seen * 1e3:+08.4f}"
        return f"MS,{value},XXXXXXXX".encode()


class Ild1420:
    """The sensor: commands by line, measurements all the time while its output is RS422."""

    def __init__(self, see: See, range_m: float = 10e-3, serial: str = "1234570") -> None:
        self._see, self._range_m, self._serial = see, range_m, serial
        self._begun = b""
        self.sending = False
        """At power-on its output is the analogue one."""

    def receive(self, data: bytes) -> bytes:
        *lines, self._begun = (self._begun + data).split(b"\r\n")
        return b"".join(self._answer(line.decode("ascii", errors="replace")) for line in lines)

    def tick(self) -> bytes:
        return self._word() * 2 if self.sending else b""

    def _answer(self, command: str) -> bytes:
        told = ""
        match command.upper().split():
            case ["OUTPUT", "RS422"]:
                self.sending = True
            case ["OUTPUT", "NONE" | "ANALOG"]:
                self.sending = False
            case ["GETINFO"]:
                told = (
                    f"Name: ILD1420-{self._range_m * 1e3:.0f}\r\nSerial: {self._serial}\r\n"
                    f"Measuring range: {self._range_m * 1e3:.2f}mm\r\n"
                )
            case _:
                told = "E01 Unknown command\r\n"
        return f"{command}\r\n{told}->".encode()

    def _word(self) -> bytes:
        """Its zero is the middle of its range; beyond it, the code for 'no target'."""
        seen = self._see()
        place = None if seen is None else seen / self._range_m + 0.5
        count = 262075 if place is None or not 0 <= place <= 1 else round((place * 100 + 1) * 65520 / 102)
        return bytes((count & 63, 64 | count >> 6 & 63, 128 | count >> 12 & 63))


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
