"""Temperature and humidity sensors on a serial port that send their readings as text.

A reading has a number followed by a unit of temperature (`'C`, `C`, `'F`, `K`) and a number followed by `%` or `%RH`; the first
of each counts, because transmitters send relative humidity and temperature before derived quantities. Vaisala HMT330 answers
`SEND` by `RH= 98.4 %RH T= 31.1 'C` (User's Guide M210566EN, p. 102), HMP230 by `RH= 43.0 %RH T= 21.0 'C Tdp= 8.0 'C ...`
(M210225en, p. 87).
"""

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from drivers.errors import LinkError
from drivers.interfaces import Identity

if TYPE_CHECKING:
    from drivers.transport import SerialPort

NUMBER = r"([-+]?\d+(?:\.\d+)?)"
TEMPERATURE = re.compile(rf"{NUMBER}\s*'?\s*(C|F|K)\b")
HUMIDITY = re.compile(rf"{NUMBER}\s*%")
LOWEST_C, HIGHEST_C = -40.0, 85.0
"""Plausible temperatures of laboratory air."""


@dataclass(frozen=True, slots=True)
class EnvironmentReading:
    """Temperature in degrees Celsius and relative humidity from 0 to 1; None for a quantity that the sensor does not measure."""

    temperature_c: float | None
    humidity: float | None


class EnvironmentSensor(Protocol):
    """Measures the air of the laboratory. A driver is called with an open `SerialPort` and the request of the bench file."""

    identity: Identity

    def read(self) -> EnvironmentReading:
        """Return the present reading.

        Raises:
            InstrumentError: no reply, or a reply without a reading.
        """
        ...

    def close(self) -> None:
        """Close the connection."""


@runtime_checkable
class ClimateChamber(EnvironmentSensor, Protocol):
    """A sensor in a climate chamber, whose temperature it can set."""

    def set_temperature(self, celsius: float) -> None:
        """Set the temperature, degrees Celsius; the chamber approaches it in its own time.

        Raises:
            InstrumentError: no reply, or the chamber refuses the temperature.
        """


class TextEnvironmentSensor:
    """An `EnvironmentSensor` that sends its readings as lines of text.

    Args:
        port: the serial port.
        request: line that requests a reading; empty for a sensor that sends by itself.
    """

    def __init__(self, port: "SerialPort", request: str = "") -> None:
        self._port, self._request = port, request
        self.identity = Identity("", f"sensor at {port.name}")

    def read(self) -> EnvironmentReading:
        if self._request:
            answer = self._port.query(f"{self._request}\r".encode(), b"\n")
            if answer.casefold().lstrip(">").strip() == self._request.casefold():  # it echoes commands
                answer = self._port.read_line(b"\n")
        else:
            self._port.query(b"", b"\n")  # its begin may have been sent earlier
            answer = self._port.read_line(b"\n")
        return parse_reading(answer, self._port.name)

    def close(self) -> None:
        self._port.close()


def parse_reading(line: str, where: str) -> EnvironmentReading:
    """Return the reading in a line of text.

    Raises:
        LinkError: it has no temperature and no humidity, or an implausible value.
    """
    temperature, humidity = TEMPERATURE.search(line), HUMIDITY.search(line)
    if temperature is None and humidity is None:
        raise LinkError(
            f"{where} sent '{line[:40]}', which is neither a temperature nor a humidity; check [environment]"
        )
    celsius = math.nan
    if temperature is not None:
        value = float(temperature[1])
        celsius = {"C": value, "F": (value - 32) / 1.8, "K": value - 273.15}[temperature[2]]
    share = math.nan if humidity is None else float(humidity[1]) / 100
    if not (math.isnan(celsius) or LOWEST_C <= celsius <= HIGHEST_C) or not (math.isnan(share) or 0 <= share <= 1):
        raise LinkError(
            f"{where} sent '{line[:40]}'; expected are {LOWEST_C:g} to {HIGHEST_C:g} °C and 0 to 100 %. Check the sensor"
        )
    return EnvironmentReading(None if temperature is None else celsius, None if humidity is None else share)
