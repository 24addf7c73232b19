"""Keyence LK-G laser displacement sensors over RS-232: single readings for static tests.

`MS` is answered by `MS,` and the values of the outputs, each a sign and seven characters in millimetres; `+FFFFFFF` is out
of range and `XXXXXXX` no measurement (LK-G manual 5-5, 5-6). Errors are `ER,MS,nn`. That `MS` names both
outputs in this order is from public code, not from the manual: compare the first reading with the controller's display.
"""

import math
import re

from drivers.clock import Clock
from drivers.errors import InstrumentError, LinkError
from drivers.interfaces import Identity, Reading
from drivers.transport import SerialPort

ERROR_REASONS = {
    "00": "unknown command",
    "01": "it is not in a state to do so; bring it from its setting screen back to measuring",
    "20": "the command has a wrong length",
    "21": "the command has a wrong count of parameters",
    "22": "a parameter is not valid",
    "88": "its head did not answer in time; check the head's cable",
    "99": "it reports an error of another kind; look at its display",
}
NUMBER_PATTERN = re.compile(r"[+-][0-9]*\.?[0-9]+")


class KeyenceLkg:
    """A `Meter` (see drivers.interfaces).

    Args:
        port: the serial port.
        clock: bench time.
        output: output of the controller to read, 1 or 2.

    Raises:
        LinkError: no answer on the port, or another device.
    """

    def __init__(self, port: SerialPort, clock: Clock, *, output: int = 1) -> None:
        self._port, self._clock, self._output = port, clock, output
        self.identity = Identity("Keyence", "LK-G")
        try:
            self.read()
        except InstrumentError:
            port.close()
            raise

    def read(self) -> Reading:
        answer = self._port.query(b"MS\r", b"\r")
        time_s = self._clock.now()
        head, *fields = answer.split(",")
        if head == "ER":
            code = fields[-1] if fields else ""
            raise InstrumentError(
                f"{self.identity} at {self._port.name}: {ERROR_REASONS.get(code, 'it reports an error')} ({answer})"
            )
        if head != "MS" or len(fields) < self._output:
            raise LinkError(
                f"{self.identity} at {self._port.name} answered '{answer[:40]}' where output {self._output} was asked; "
                "check the port, the baud rate and that the output is on"
            )
        text = fields[self._output - 1].strip()
        if NUMBER_PATTERN.fullmatch(text):
            return Reading(float(text) * 1e-3, "m", True, time_s)
        if set(text) <= set("+-FX"):
            return Reading(math.nan, "m", False, time_s)
        raise LinkError(f"{self.identity} at {self._port.name} answered '{answer[:40]}', which is not a value")

    def close(self) -> None:
        self._port.close()
