"""Simulated serial laser sensors: Keyence LK-G (text), Micro-Epsilon optoNCDT (three-byte words).

`read_displacement` returns metres from the sensor's zero, or None if there is no target in its range. The sensors run on a
pseudo-terminal: the driver opens a real port by its name. Not on Windows.
"""

from collections.abc import Callable

ReadDisplacement = Callable[[], float | None]


class SimulatedKeyenceLkg:
    """The controller: one command at a time, ended by CR."""

    def __init__(self, read_displacement: ReadDisplacement) -> None:
        self._read_displacement = read_displacement
        self._partial_line = b""
        self.in_setting_mode = False
        """Whether its setting screen is open: it then rejects measurements."""

    def receive(self, data: bytes) -> bytes:
        *lines, self._partial_line = (self._partial_line + data).split(b"\r")
        return b"".join(self._respond(line.decode("ascii", errors="replace")) + b"\r" for line in lines)

    def unsolicited_output(self) -> bytes:
        return b""

    def _respond(self, command: str) -> bytes:
        if command.upper() != "MS":
            return f"ER,{command[:2]},00".encode()
        if self.in_setting_mode:
            return b"ER,MS,01"
        seen = self._read_displacement()
        value = "+FFFFFFF" if seen is None else f"{seen * 1e3:+08.4f}"
        return f"MS,{value},XXXXXXXX".encode()


class SimulatedOptoNcdt:
    """The sensor: commands by line, measurements all the time while its output is RS422.

    Initial settings of another user: an additional value after each displacement (ILD1420 manual p. 84: bit 6 of the third byte)
    and a master value (p. 65: another formula, and displacements of up to 18 bits).
    """

    def __init__(self, read_displacement: ReadDisplacement, range_m: float = 10e-3, serial: str = "1234570") -> None:
        self._read_displacement, self._range_m, self._serial = read_displacement, range_m, serial
        self._partial_line = b""
        self.streaming = False
        """At power-on its analogue output is active."""
        self.additional_values = self.mastered = True

    def receive(self, data: bytes) -> bytes:
        *lines, self._partial_line = (self._partial_line + data).split(b"\r\n")
        return b"".join(self._respond(line.decode("ascii", errors="replace")) for line in lines)

    def unsolicited_output(self) -> bytes:
        return self._measurement_word() * 2 if self.streaming else b""

    def _respond(self, command: str) -> bytes:
        reply = ""
        match command.upper().split():
            case ["OUTPUT", "RS422"]:
                self.streaming = True
            case ["OUTPUT", "NONE" | "ANALOG"]:
                self.streaming = False
            case ["OUTADD_RS422", "NONE"]:
                self.additional_values = False
            case ["MASTERMV", "NONE"]:
                self.mastered = False
            case ["GETINFO"]:
                reply = (
                    f"Name: ILD1420-{self._range_m * 1e3:.0f}\r\nSerial: {self._serial}\r\n"
                    f"Measuring range: {self._range_m * 1e3:.2f}mm\r\n"
                )
            case _:
                reply = "E01 Unknown command\r\n"
        return f"{command}\r\n{reply}->".encode()

    def _measurement_word(self) -> bytes:
        """Zero is the middle of its range; beyond the range, the code for 'no target'."""
        seen = self._read_displacement()
        place = None if seen is None else seen / self._range_m + 0.5
        beyond = place is None or not 0 <= place <= 1
        offset = 51 if self.mastered else 1
        count = 262075 if place is None or beyond else round((place * 100 + offset) * 65520 / 102)
        word = bytes((count & 63, 64 | count >> 6 & 63, 128 | count >> 12 & 63))
        intensity = bytes((500 & 63, 64 | 500 >> 6, 192))
        return word + intensity * self.additional_values
