"""Displacement sensors that answer by text, on a serial line or TCP: single readings for static tests.

A reply is `HEAD,...,value`, the value in millimetres; errors are `ER,HEAD,nn`. The dialects, with their sources, and what no document
states are in meters.toml: compare the first reading with the controller's display.
"""

import math
import re

from drivers.clock import Clock
from drivers.errors import InstrumentError, LinkError
from drivers.interfaces import Identity, Reading
from drivers.sensors.meter_dialects import TextDialect
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
MAX_AVERAGING_S = 5.0
"""Longest average of a reading, which is waited for."""
NUMBER_PATTERN = re.compile(r"[+-][0-9]*\.?[0-9]+")


class TextMeter:
    """A `Meter` (see drivers.interfaces).

    Args:
        port: the serial port or TCP connection.
        clock: bench time.
        dialect: question and reply.
        output: output or amplifier to read, from 1.

    Raises:
        LinkError: no answer on the port, or another device.
        InstrumentError: the sensor has a setting with which it does not measure, or a filter whose delay is unknown or too long.
    """

    def __init__(self, port: SerialPort, clock: Clock, dialect: TextDialect, *, output: int = 1) -> None:
        self._port, self._clock, self._dialect = port, clock, dialect
        self._numbers = {"output": output, "amplifier": output - 1}
        self.identity = Identity(dialect.maker, dialect.model)
        self.averaging_s = 0.0
        """Duration of the average that it sends; a reading waits for one that begins with it."""
        try:
            self.averaging_s = self._ask_averaging_s()
            for question, accepted, remedy in dialect.checks:
                if not re.fullmatch(accepted, reply := self._ask(question)[-1].strip()):
                    raise InstrumentError(
                        f"{self.identity} at {port.name}: {remedy} (it answered '{reply}' to {question.strip()})"
                    )
            self.read()
        except InstrumentError:
            port.close()
            raise

    def read(self) -> Reading:
        self._clock.sleep(self.averaging_s)
        fields = self._ask(self._dialect.ask)
        time_s, number = self._clock.now(), int(self._dialect.field.format(**self._numbers))
        text = fields[number].strip() if number < len(fields) else ""
        if re.fullmatch(self._dialect.invalid, text):
            return Reading(math.nan, "m", False, time_s)
        if NUMBER_PATTERN.fullmatch(text):
            return Reading(float(text) * 1e-3, "m", True, time_s)
        raise LinkError(
            f"{self.identity} at {self._port.name} answered '{','.join(fields)[:40]}', which has no value of output "
            f"{self._numbers['output']}; check the port, the baud rate and that the output is on"
        )

    def close(self) -> None:
        self._port.close()

    def _ask_averaging_s(self) -> float:
        if (asked := self._dialect.averaging) is None:
            return 0.0
        self._ask(asked.begin, asked.begin.strip())
        try:
            period, (*_, kind, count) = self._ask(asked.period, "SR")[-1], self._ask(asked.count, "SR")
        finally:
            self._ask(asked.end, asked.end.strip())
        try:
            averaging_s = asked.periods_s[int(period)] * asked.counts[int(count)] if kind == asked.kind else math.inf
        except (ValueError, IndexError):
            averaging_s = math.inf
        if averaging_s > MAX_AVERAGING_S:
            raise InstrumentError(
                f"{self.identity} at {self._port.name}: its filter (kind {kind}, number {count} at sampling cycle {period}) delays a reading for "
                f"longer than {MAX_AVERAGING_S:g} s, or is no average; choose an average of fewer values"
            )
        return averaging_s

    def _ask(self, question: str, head: str = "") -> list[str]:
        """Return the fields of the reply. Its first field must be `head`; empty: the first field of a reading."""
        command, end = question.format(**self._numbers), self._dialect.end
        fields = self._port.query(command.encode(), end.encode()).split(",")
        if fields[0] == "ER":
            reason = ERROR_REASONS.get(fields[-1], "it reports an error")
            raise InstrumentError(f"{self.identity} at {self._port.name}: {reason} ({','.join(fields)})")
        if fields[0] != (head or self._dialect.head):
            raise LinkError(
                f"{self.identity} at {self._port.name} answered '{','.join(fields)[:40]}' to {command.strip()}; check the port, the baud rate "
                "and the driver in the bench file"
            )
        return fields
