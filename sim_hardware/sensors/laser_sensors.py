"""Simulated serial laser sensors: Keyence LK-G, LK-G5000 and IL (text), Micro-Epsilon optoNCDT (three-byte words).

`read_displacement` returns metres from the sensor's zero, or None if there is no target in its range. The sensors run on a
pseudo-terminal: the driver opens a real port by its name. Not on Windows.
"""

from collections.abc import Callable

from sim_hardware.sensors.line_instrument import LineInstrument

ReadDisplacement = Callable[[], float | None]


class SimulatedKeyenceLkg(LineInstrument):
    """The controller: one command at a time, ended by CR."""

    end = reply_end = b"\r"

    def __init__(self, read_displacement: ReadDisplacement) -> None:
        self._read_displacement = read_displacement
        self.in_setting_mode = False
        """Whether its setting screen is open: it then rejects measurements."""

    def _respond(self, command: str) -> str:
        if command.upper() != "MS":
            return f"ER,{command[:2]},00"
        if self.in_setting_mode:
            return "ER,MS,01"
        seen = self._read_displacement()
        value = "+FFFFFFF" if seen is None else f"{seen * 1e3:+08.4f}"
        return f"MS,{value},XXXXXXXX"


class SimulatedKeyenceLkg5000(SimulatedKeyenceLkg):
    """An LK-G5000: the number of the output is in the question and in the reply; its other outputs do not measure.

    Attributes:
        settings: replies by command that asks for a setting in the communication mode: sampling cycle, and kind and number of the filter.
    """

    def __init__(self, read_displacement: ReadDisplacement) -> None:
        super().__init__(read_displacement)
        self.settings = {"SR,CA": "0", "SR,OC,01": "0,0"}

    def _respond(self, command: str) -> str:
        if command in ("Q0", "R0"):
            self.in_setting_mode = command == "Q0"
            return command
        if command in self.settings and self.in_setting_mode:
            return f"{command},{self.settings[command]}"
        name, _, output = command.upper().partition(",")
        if name != "MS" or not output:
            return f"ER,{command[:2]},00"
        reply = super()._respond("MS")
        if reply.startswith("ER"):
            return reply
        value = reply.split(",")[1] if output == "01" else "XXXXXXXX"
        return f"MS,{output},{value}"


class SimulatedKeyenceIl(LineInstrument):
    """An IL amplifier behind a DL-RS1A: reads data numbers of the amplifier 00.

    Attributes:
        data: replies by data number; 038 is the measured value.
    """

    reply_end = b"\r\n"

    def __init__(self, read_displacement: ReadDisplacement) -> None:
        self._read_displacement = read_displacement
        self.data = {"033": "00000", "050": "0", "051": "0"}

    def _respond(self, command: str) -> str:
        name, *place = command.split(",")
        if name != "SR" or len(place) != 2:
            return f"ER,{name},00"
        amplifier, number = place
        if amplifier != "00" or number not in (*self.data, "038"):
            return "ER,SR,22"
        seen = self._read_displacement()
        value = "+99.999" if seen is None else f"{seen * 1e3:+07.3f}"
        return f"SR,{amplifier},{number},{self.data.get(number, value)}"


class SimulatedOptoNcdt(LineInstrument):
    """The sensor: commands by line, measurements all the time while its output is RS422.

    Initial settings of another user: an additional value after each displacement (ILD1420 manual p. 84: bit 6 of the third byte)
    and a master value (p. 65: another formula, and displacements of up to 18 bits).
    """

    def __init__(self, read_displacement: ReadDisplacement, range_m: float = 10e-3, serial: str = "1234570") -> None:
        self._read_displacement, self._range_m, self._serial = read_displacement, range_m, serial
        self.streaming = False
        """At power-on its analogue output is active."""
        self.additional_values = self.mastered = True

    def unsolicited_output(self) -> bytes:
        return self._measurement_word() * 2 if self.streaming else b""

    def _respond(self, command: str) -> str:
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
        return f"{command}\r\n{reply}->"

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


KEYENCE: dict[str, Callable[[ReadDisplacement], SimulatedKeyenceLkg | SimulatedKeyenceIl]] = {
    "keyence-lkg": SimulatedKeyenceLkg,
    "keyence-lkg5000": SimulatedKeyenceLkg5000,
    "keyence-il": SimulatedKeyenceIl,
}
"""Simulated Keyence sensors by their driver."""


def simulated_keyence(driver: str, read_displacement: ReadDisplacement) -> SimulatedKeyenceLkg | SimulatedKeyenceIl:
    """Return the simulated sensor of a driver."""
    return KEYENCE[driver](read_displacement)
