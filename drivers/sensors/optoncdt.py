"""Micro-Epsilon optoNCDT 1420/1750/1900 laser sensors over RS-422: single readings for static tests.

The sensor continuously sends a word of three bytes for each measurement: 00 and six low bits, 01 and six middle bits, 10 and the
high bits (ILD1402/1420 manuals, ch. RS422); 11 marks an additional value such as the intensity (ILD1420 p. 84). Millimetres are
(x 102 / 65520 - 1) / 100 of the measuring range; values above 65520 are codes for "no target", "too near", "too far", and never a
displacement. With a master value another formula holds (p. 65): both settings of an earlier user are reset when the sensor is
opened.

RS-422 and the analogue output exclude each other (ILD1420 manual p. 116): a bench that records the sensor by the card cannot use
this driver on the same sensor. The fields of GETINFO are from memory: a different range raises an error.
"""

import math
import re

from drivers.clock import Clock
from drivers.errors import InstrumentError, LinkError
from drivers.interfaces import Identity, Reading
from drivers.transport import SerialPort

FULL_COUNT = 65520
MAX_FRAMES = 64


class OptoNcdt:
    """A `Meter` (see drivers.interfaces).

    Args:
        port: the serial port.
        clock: bench time.
        range_m: the sensor's measuring range, 10 mm for an ILD1420-10.

    Raises:
        LinkError: no answer on the port, or another device.
        InstrumentError: the sensor reports another measuring range.
    """

    def __init__(self, port: SerialPort, clock: Clock, *, range_m: float) -> None:
        self._port, self._clock, self._range_m = port, clock, range_m
        try:
            port.query(b"OUTPUT NONE\r\n", b"->")
            port.query(b"OUTADD_RS422 NONE\r\n", b"->")  # if rejected, additional values are recognised by their flag
            self._remove_master_value()
            info = port.query(b"GETINFO\r\n", b"->")
            port.write(b"OUTPUT RS422\r\n")
            self.identity = self._parse_identity(info)
            self.read()
        except InstrumentError:
            port.close()
            raise

    def read(self) -> Reading:
        # Words in the port's buffer are old: a reading must have been sent after this call.
        self._port.discard_input()
        count = self._read_count()
        time_s = self._clock.now()
        if count > FULL_COUNT:
            return Reading(math.nan, "m", False, time_s)
        return Reading((count * 102 / FULL_COUNT - 1) / 100 * self._range_m, "m", True, time_s)

    def close(self) -> None:
        self._port.close()

    def _remove_master_value(self) -> None:
        answer = self._port.query(b"MASTERMV NONE\r\n", b"->")
        refusal = re.search(r"\bE\d+.*", answer)
        if refusal and "unknown" not in refusal[0].lower():  # a model without the command has no such master value
            raise InstrumentError(
                f"the sensor at {self._port.name} refuses to take its master value back ({refusal[0].strip()}); log in as "
                "professional with the sensor's own tool and send MASTERMV NONE"
            )

    def _read_count(self) -> int:
        last = b""
        for _ in range(3 * MAX_FRAMES):
            byte = self._port.read(1)
            if not byte:
                raise LinkError(
                    f"{self._port.name} was silent for {self._port.timeout_s:g} s; check that the sensor is on, measures, and "
                    "sends over RS422"
                )
            last = (last + byte)[-3:]
            if len(last) == 3 and last[0] >> 6 == 0 and last[1] >> 6 == 1 and last[2] >> 6 == 2:
                return last[0] & 63 | (last[1] & 63) << 6 | (last[2] & 63) << 12
        raise LinkError(f"{self._port.name} sends bytes that are not a measurement; check the baud rate")

    def _parse_identity(self, info: str) -> Identity:
        def field(name: str) -> str:
            match = re.search(rf"{name}:\s*(\S+)", info, re.IGNORECASE)
            return match[1] if match else ""

        model = field("Name")
        if not model:
            raise LinkError(f"{self._port.name} answered '{info[:40]}'; is this an optoNCDT?")
        reported_mm = re.match(r"[0-9.]+", field("Measuring range"))
        if reported_mm and not math.isclose(float(reported_mm[0]), self._range_m * 1e3, rel_tol=1e-3):
            raise InstrumentError(
                f"{model} at {self._port.name} has a measuring range of {reported_mm[0]} mm, the bench file says "
                f"{self._range_m * 1e3:g} mm; correct range_m"
            )
        return Identity("Micro-Epsilon", model, field("Serial"))
