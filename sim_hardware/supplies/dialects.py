"""Simulated DC supplies: Keysight E36300 and E3631A, Rigol DP800, Siglent SPD3303X.

Limits, error codes and the format of replies follow the guides named in `drivers.supplies.dialects`.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from operator import itemgetter
from typing import Any

from sim_hardware import wires
from sim_hardware.generators import accept_keywords
from sim_hardware.supplies.supply import SimulatedSupply

MAX_VOLTAGE_V, MAX_CURRENT_A, MAX_OVP_V = 6.18, 5.15, 6.6


def _parse_within(text: str, unit: str, maximum: float) -> float:
    value = wires.parse_number(text, unit, 0.0, maximum)
    if not 0 <= value <= maximum:
        raise wires.ScpiError(-222)
    return value


PARSERS: Mapping[str, Callable[[str], Any]] = {
    "level_v": partial(_parse_within, unit="V", maximum=MAX_VOLTAGE_V),
    "current_limit_a": partial(_parse_within, unit="A", maximum=MAX_CURRENT_A),
    "ovp_v": partial(_parse_within, unit="V", maximum=MAX_OVP_V),
}
"""Numbers among the settings of a supply; all others are switches."""

Argument = Callable[[wires.Arguments], str]
"""Index of the value among the arguments of a command: a channel may precede or follow it."""
FIRST, SECOND, LAST = itemgetter(0), itemgetter(1), itemgetter(-1)
REAL, DECIMALS_3, DECIMALS_4 = "{:+.6E}".format, "{:.3f}".format, "{:.4f}".format


def _bit(on: bool) -> str:
    return str(int(on))


def _on_off(on: bool) -> str:
    return "ON" if on else "OFF"


class SimulatedScpiSupply:
    """One supply behind its SCPI engine (sim_hardware.wires.scpi_engine.ScpiInstrument)."""

    def __init__(
        self,
        supply: SimulatedSupply,
        identity: str,
        table: Callable[["SimulatedScpiSupply"], Sequence[wires.ScpiCommand]],
    ) -> None:
        self.identity = identity
        self.supply = supply
        self._table = table

    @property
    def commands(self) -> Sequence[wires.ScpiCommand]:
        return self._table(self)

    def reset(self) -> None:
        self.supply.reset()

    def trigger(self) -> None:
        raise wires.ScpiError(-211)

    def busy_s(self) -> float:
        return 0.0

    def setting(
        self,
        pattern: str,
        name: str,
        argument: Argument,
        show: Callable[[Any], str] | None,
        parse: Callable[[str], Any] | None = None,
    ) -> wires.ScpiCommand:
        """Make the command of a setting of the supply by its name; without `show` it has no query."""
        parse = parse or PARSERS.get(name, wires.parse_boolean)

        def setter(arguments: wires.Arguments) -> None:
            value = parse(argument(arguments))
            setattr(self.supply, name, value and not self.supply.ovp_tripped if name == "output_on" else value)
            if name != "current_limit_a":
                self.supply.update_output()

        return wires.ScpiCommand(pattern, setter, show and (lambda _: show(getattr(self.supply, name))))

    def voltmeter(self, pattern: str, show: Callable[[float], str]) -> wires.ScpiCommand:
        """Make the query of its own voltmeter."""
        return wires.ScpiCommand(pattern, None, lambda _: show(self.supply.measured_v()))


class SiglentSpdEngine(wires.ScpiEngine):
    """An SPD accepts one command per message and writes its errors without quotes (MEM: confirm on the instrument)."""

    def execute(self, message: str) -> wires.ScpiResponse | None:
        if ";" in message:
            self.queue_error(wires.ScpiError(-113))
            return None
        answer = super().execute(message)
        if answer is None or "ERR" not in message.upper():
            return answer
        code, _, text = answer.text.partition(",")
        return wires.ScpiResponse(f"{int(code)}  {text.strip(chr(34))}")


def make_supply_engine(product: str, supply: SimulatedSupply, serial: str) -> wires.ScpiEngine:
    """Return the engine of a supply by its product name. Raises ValueError if it is not simulated."""
    for start, maker, table in (
        ("E3631A", "HEWLETT-PACKARD", _e3631a),
        ("E3632", "Keysight Technologies", _e3632a),
        ("E3633", "Keysight Technologies", _e3632a),
        ("E3634", "Keysight Technologies", _e3632a),
        ("E364", "Agilent Technologies", _e364xa),
        ("E3610", "Keysight Technologies", _e3632a),
        ("E36", "Keysight Technologies", _e36300),
        ("DP8", "RIGOL TECHNOLOGIES", _dp800),
        ("SPD", "Siglent Technologies", _spd),
    ):
        if product.startswith(start):
            model = SimulatedScpiSupply(supply, f"{maker},{product},{serial},1.0", table)
            return SiglentSpdEngine(model) if start == "SPD" else wires.ScpiEngine(model)
    raise ValueError(
        f"supply.model {product!r} is not simulated: choose E36312A, E36103A, E3631A, E3632A, E3640A, E3646A, DP832 or SPD3303X"
    )


def _e36300(m: SimulatedScpiSupply) -> Sequence[wires.ScpiCommand]:
    return (
        m.setting("[SOURce:]VOLTage[:LEVel]", "level_v", FIRST, REAL),
        m.setting("[SOURce:]CURRent[:LEVel]", "current_limit_a", FIRST, REAL),
        m.voltmeter("MEASure[:SCALar]:VOLTage[:DC]", REAL),
        m.setting("OUTPut[:STATe]", "output_on", FIRST, _bit),
        m.setting("[SOURce:]VOLTage:PROTection[:LEVel]", "ovp_v", FIRST, REAL),
        m.setting("[SOURce:]VOLTage:PROTection:STATe", "ovp_enabled", FIRST, _bit),
        wires.ScpiCommand("[SOURce:]VOLTage:PROTection:TRIPped", None, lambda _: _bit(m.supply.ovp_tripped)),
        m.setting("[SOURce:]CURRent:PROTection:STATe", "ocp_enabled", FIRST, _bit),
        m.setting(
            "OUTPut:PAIR", "tracking", FIRST, lambda on: "SER" if on else "OFF", lambda text: text.upper() != "OFF"
        ),
    )


def _e3632a(m: SimulatedScpiSupply) -> Sequence[wires.ScpiCommand]:
    """One output: a channel list is an error."""
    return [_without_channel_list(c) for c in _e36300(m) if "PAIR" not in c.pattern]


def _e364xa(m: SimulatedScpiSupply) -> Sequence[wires.ScpiCommand]:
    """No over-current protection; models with two outputs select one, and can track."""
    supported = [c for c in _e3632a(m) if "CURRent:PROT" not in c.pattern]
    if m.identity.split(",")[1][4:5] < "6":
        return supported
    return [
        *supported,
        wires.ScpiCommand("INSTrument:NSELect", accept_keywords("1", "2"), lambda _: "1"),
        m.setting("OUTPut:TRACk[:STATe]", "tracking", LAST, _bit),
    ]


def _without_channel_list(command: wires.ScpiCommand) -> wires.ScpiCommand:
    def checked(action: Callable[[wires.Arguments], Any] | None) -> Callable[[wires.Arguments], Any] | None:
        if action is None:
            return None

        def run(arguments: wires.Arguments) -> Any:
            if any("@" in argument for argument in arguments):
                raise wires.ScpiError(-108)
            return action(arguments)

        return run

    return wires.ScpiCommand(command.pattern, checked(command.set), checked(command.query))


def _e3631a(m: SimulatedScpiSupply) -> Sequence[wires.ScpiCommand]:
    return (
        wires.ScpiCommand("INSTrument:NSELect", accept_keywords("1", "2", "3"), lambda _: "1"),
        m.setting("[SOURce:]VOLTage[:LEVel]", "level_v", wires.single_argument, REAL),
        m.setting("[SOURce:]CURRent[:LEVel]", "current_limit_a", wires.single_argument, REAL),
        m.voltmeter("MEASure[:SCALar]:VOLTage[:DC]", REAL),
        m.setting("OUTPut[:STATe]", "output_on", wires.single_argument, _bit),
        m.setting("OUTPut:TRACk[:STATe]", "tracking", LAST, _bit),
    )


def _dp800(m: SimulatedScpiSupply) -> Sequence[wires.ScpiCommand]:
    return (
        m.setting("[SOURce[1]:]VOLTage[:LEVel]", "level_v", wires.single_argument, DECIMALS_3),
        m.setting("[SOURce[1]:]CURRent[:LEVel]", "current_limit_a", wires.single_argument, DECIMALS_4),
        m.voltmeter("MEASure[:SCALar]:VOLTage[:DC]", DECIMALS_4),
        m.setting("OUTPut[:STATe]", "output_on", SECOND, _on_off),
        m.setting("OUTPut:OVP[:STATe]", "ovp_enabled", SECOND, _on_off),
        m.setting("OUTPut:OVP:VALue", "ovp_v", SECOND, DECIMALS_3),
        wires.ScpiCommand("OUTPut:OVP:QUES", None, lambda _: "YES" if m.supply.ovp_tripped else "NO"),
        m.setting("OUTPut:OCP[:STATe]", "ocp_enabled", SECOND, _on_off),
        m.setting("OUTPut:TRACk[:STATe]", "tracking", LAST, _on_off),
    )


def _spd(m: SimulatedScpiSupply) -> Sequence[wires.ScpiCommand]:
    """Output and tracking have no query: the status word has them."""
    s = m.supply
    return (
        m.setting("CH[1]:VOLTage", "level_v", wires.single_argument, DECIMALS_3),
        m.setting("CH[1]:CURRent", "current_limit_a", wires.single_argument, DECIMALS_3),
        m.voltmeter("MEASure:VOLTage", DECIMALS_3),
        m.setting("OUTPut", "output_on", SECOND, None),
        m.setting("OUTPut:TRACK", "tracking", FIRST, None, lambda text: text != "0"),
        wires.ScpiCommand("SYSTem:STATus", None, lambda _: f"{0x10 * s.output_on + (0xC if s.tracking else 0x4):#x}"),
    )
