"""Simulated network sensors: Micro-Epsilon optoNCDT 2300 (nanometres) and capaNCDT 6200 (counts of the measuring range).

A sensor has a data port, on which it sends blocks by itself, and a command port. It is not kinder than a real one: a connection
begins in the middle of a block, blocks have several frames, and an optoNCDT begins with a master value and an additional value.
"""

import struct
from collections import deque
from itertools import count

from sim_hardware.sensors.laser_sensors import ReadDisplacement
from sim_hardware.sensors.line_instrument import LineInstrument

PREAMBLE = b"SAEM"
FRAMES = 3


class SimulatedMicroEpsilon:
    """The data port of a sensor; `commands` is its command port.

    Args:
        model: `optoncdt-2300` or `capancdt-6200`.
        channels: numbers of the channels of a capaNCDT, of which the last one measures.
    """

    def __init__(
        self,
        read_displacement: ReadDisplacement,
        range_m: float,
        model: str,
        serial: int = 10110002,
        channels: tuple[int, ...] = (1,),
    ) -> None:
        self._read_displacement, self.range_m, self.is_laser = read_displacement, range_m, model == "optoncdt-2300"
        self.serial, self.channels = serial, channels
        self.additional_values = self.mastered = True
        """Settings of another user."""
        self.average_kind, self.averaged_values = "0", 8
        self._recent: deque[int] = deque(maxlen=8)
        self._counter = count()
        self._sent = False
        self.commands = MicroEpsilonCommands(self)

    def receive(self, _: bytes) -> bytes:
        return b""

    def unsolicited_output(self) -> bytes:
        block = self._block()
        begin, self._sent = 0 if self._sent else len(block) // 2, True
        return block[begin:]

    def _block(self) -> bytes:
        """The middle of the range is the zero of the bench; a laser counts from the begin of its range."""
        seen = self._read_displacement()
        place = None if seen is None else seen / self.range_m + 0.5
        valid = place is not None and 0 <= place <= 1
        if self.is_laser:
            nanometres = round((place or 0) * self.range_m * 1e9) + 5_000_000 * self.mastered
            values = [nanometres if valid else 0x7FFFFFFB] + [500] * self.additional_values
            fixed = struct.pack("<4sIIII", PREAMBLE, 4120178, self.serial, 1, 0)
        else:
            measured = self._averaged(round((place or 0) * 0xFFFFFF)) if valid else 0xFFFFFF
            values = [0x123456] * (len(self.channels) - 1) + [measured]
            mask = sum(1 << 2 * (number - 1) for number in self.channels)
            fixed = struct.pack("<4sIIQI", PREAMBLE, 2303023, self.serial, mask, 0)
        frame = struct.pack(f"<{len(values)}i", *values)
        return fixed + struct.pack("<HHI", FRAMES, len(frame), next(self._counter) & 0xFFFFFFFF) + frame * FRAMES

    def _averaged(self, value: int) -> int:
        """Return the moving average at the end of a block in which the value stays."""
        self._recent.extend([value] * FRAMES)
        last = list(self._recent)[-self.averaged_values :]
        return value if self.average_kind == "0" else round(sum(last) / len(last))


class MicroEpsilonCommands(LineInstrument):
    """The command port of a sensor."""

    end, skipped = b"\r", b"\n"

    def __init__(self, sensor: SimulatedMicroEpsilon) -> None:
        self._sensor = sensor

    def _respond(self, command: str) -> str:
        sensor = self._sensor
        if not sensor.is_laser:
            known = command.removeprefix("$CHI") in map(str, sensor.channels)
            info = f"ANO2303023,NAMCS2,SNO{sensor.serial},OFS0,RNG{1e6 * sensor.range_m:.0f},UNTum,DTY1"
            told = {"$AVT?": sensor.average_kind, "$AVN?": str(sensor.averaged_values)}.get(command)
            reply = told or (f":{info}" if known else " $UNKNOWN COMMAND")
            return f"{command}\r{command}{reply}OK\r\n"
        reply = ""
        match command.upper().split():
            case ["MASTERMV", "NONE"]:
                sensor.mastered = False
            case ["OUTADD_ETH", "NONE"]:
                sensor.additional_values = False
            case ["OUTSTATISTIC_ETH", "NONE"]:
                pass
            case ["AVERAGE", "NONE"]:
                sensor.average_kind = "0"
            case ["GETINFO"]:
                reply = f"Name: ILD2300\r\nSerial: {sensor.serial}\r\nMeasuring range: {1e3 * sensor.range_m:.2f}mm\r\n"
            case _:
                reply = "E01 Unknown command\r\n"
        return f"{command}\r\n{reply}->"
