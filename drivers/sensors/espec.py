"""Climate chamber with an ESPEC P-300 or SCP-220 controller: sensor of its air, whose temperature can be set.

A command and its reply end by CR LF; `TEMP?` answers measured, set, highest and lowest temperature, `HUMI?` likewise per cent, a
refused command `NA:` and the reason. Source: ChamberConnectLibrary of ESPEC North America (p300.py, especinteract.py). Not tried on a
chamber; the address of an RS-485 line is not supported.
"""

import threading
from typing import TYPE_CHECKING

from drivers.errors import InstrumentError, LinkError
from drivers.interfaces import Identity
from drivers.sensors.environment import EnvironmentReading

if TYPE_CHECKING:
    from drivers.transport import SerialPort


class EspecChamber:
    """A `ClimateChamber`.

    Args:
        port: the serial port.
        request: not used.
    """

    def __init__(self, port: "SerialPort", request: str = "") -> None:  # noqa: ARG002 - as every sensor of the air
        self._port, self._lock = port, threading.Lock()
        self.identity = Identity("ESPEC", f"chamber at {port.name}")

    def read(self) -> EnvironmentReading:
        with self._lock:
            celsius, *_ = self._numbers("TEMP?")
            try:
                humidity = self._numbers("HUMI?")[0] / 100
            except InstrumentError:  # a chamber without humidity
                humidity = None
        return EnvironmentReading(celsius, humidity)

    def set_temperature(self, celsius: float) -> None:
        with self._lock:
            _, _, highest, lowest = self._numbers("TEMP?")
            if not lowest <= celsius <= highest:
                raise InstrumentError(
                    f"{self._port.name}: the chamber is limited to {lowest:g} to {highest:g} °C, not {celsius:g} °C; set its limits, or another "
                    "temperature"
                )
            for command in (f"TEMP, S{celsius:.1f}", "MODE, CONSTANT"):
                self._query(command)

    def close(self) -> None:
        self._port.close()

    def _numbers(self, command: str) -> tuple[float, float, float, float]:
        answer = self._query(command)
        texts = ["nan" if text.strip() == "OFF" else text for text in answer.split(",")]
        try:
            measured, wanted, highest, lowest = map(float, texts)
        except ValueError:
            raise LinkError(f"{self._port.name} answered '{answer[:40]}' to {command}; check [environment]") from None
        return measured, wanted, highest, lowest

    def _query(self, command: str) -> str:
        answer = self._port.query(f"{command}\r\n".encode(), b"\r\n")
        if answer.startswith("NA:"):
            raise InstrumentError(
                f"{self._port.name}: the chamber refuses {command} ({answer.removeprefix('NA:').strip()})"
            )
        return answer
