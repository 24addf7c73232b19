"""Simulated serial sensors of the air: Vaisala HMT330 (text), climate chamber with an ESPEC P-300 controller.

They run on a pseudo-terminal, like the laser sensors.
"""

from collections.abc import Callable

from sim_hardware.plant import SET_CHAMBER
from sim_hardware.sensors.line_instrument import LineInstrument


class SimulatedHmt330(LineInstrument):
    """The transmitter in poll mode.

    `read_air` returns degrees Celsius and relative humidity from 0 to 1; `perform_action` is that of the simulated bench.
    """

    end, skipped, reply_end = b"\r", b"\n", b"\r\n"

    def __init__(self, read_air: Callable[[], tuple[float, float]], perform_action: Callable[..., object]) -> None:
        self._read_air, self._perform_action = read_air, perform_action

    def _respond(self, command: str) -> str:
        temperature_c, humidity = self._read_air()
        is_request = command.upper() == "SEND"
        return f"RH= {100 * humidity:.2f} %RH T= {temperature_c:.2f} 'C" if is_request else "Unknown command"


class SimulatedEspec(SimulatedHmt330):
    """The chamber around a simulated bench."""

    set_c = 23.0

    def _respond(self, command: str) -> str:
        temperature_c, humidity = self._read_air()
        match command.upper().replace(" ", ""):
            case "TEMP?":
                return f"{temperature_c:.1f}, {self.set_c:.1f}, 90.0, -45.0"
            case "HUMI?":
                return f"{100 * humidity:.0f}, OFF, 100, 0"
            case "MODE,CONSTANT":
                return "OK:MODE, CONSTANT"
            case text if text.startswith("TEMP,S"):
                self.set_c = float(text.removeprefix("TEMP,S"))
                self._perform_action(SET_CHAMBER, {"temperature_c": self.set_c})
                return f"OK:TEMP, S{self.set_c:.1f}"
        return "NA:INVALID REQ"
