"""Simulated DC supplies: Keysight E36300 and E3631A, Rigol DP800, Siglent SPD3303X.

Limits, error codes and the format of replies follow the guides named in `drivers.supplies.dialects`.
"""

from collections.abc import Callable, Sequence

from sim_hardware.generators import accept_keywords
from sim_hardware.supplies.supply import SimulatedSupply
from sim_hardware.wires import (
    ScpiCommand,
    ScpiEngine,
    ScpiError,
    ScpiResponse,
    parse_boolean,
    parse_number,
    single_argument,
)

MAX_VOLTAGE_V, MAX_CURRENT_A = 6.18, 5.15


class SimulatedScpiSupply:
    """One supply behind its SCPI engine (sim_hardware.wires.scpi_engine.ScpiInstrument)."""

    def __init__(
        self, supply: SimulatedSupply, identity: str, table: Callable[["SimulatedScpiSupply"], Sequence[ScpiCommand]]
    ) -> None:
        self.identity = identity
        self.supply = supply
        self._table = table

    @property
    def commands(self) -> Sequence[ScpiCommand]:
        return self._table(self)

    def reset(self) -> None:
        self.supply.reset()

    def trigger(self) -> None:
        raise ScpiError(-211)

    def busy_s(self) -> float:
        return 0.0

    def set_voltage(self, text: str) -> None:
        self.supply.level_v = _parse_within(text, "V", MAX_VOLTAGE_V)
        self.supply.update_output()

    def set_current_limit(self, text: str) -> None:
        self.supply.current_limit_a = _parse_within(text, "A", MAX_CURRENT_A)

    def set_output(self, text: str) -> None:
        self.supply.output_on = parse_boolean(text) and not self.supply.ovp_tripped
        self.supply.update_output()

    def set_ovp_enabled(self, text: str) -> None:
        self.supply.ovp_enabled = parse_boolean(text)
        self.supply.update_output()

    def set_ocp_enabled(self, text: str) -> None:
        self.supply.ocp_enabled = parse_boolean(text)
        self.supply.update_output()

    def set_tracking(self, on: bool) -> None:
        self.supply.tracking = on
        self.supply.update_output()

    def set_ovp_level(self, text: str) -> None:
        self.supply.ovp_v = _parse_within(text, "V", 6.6)
        self.supply.update_output()


class SiglentSpdEngine(ScpiEngine):
    """An SPD takes one command a message and writes its errors without quotes (MEM: confirm on the instrument)."""

    def execute(self, message: str) -> ScpiResponse | None:
        if ";" in message:
            self.queue_error(ScpiError(-113))
            return None
        answer = super().execute(message)
        if answer is None or "ERR" not in message.upper():
            return answer
        code, _, text = answer.text.partition(",")
        return ScpiResponse(f"{int(code)}  {text.strip(chr(34))}")


def make_supply_engine(product: str, supply: SimulatedSupply, serial: str) -> ScpiEngine:
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
            return SiglentSpdEngine(model) if start == "SPD" else ScpiEngine(model)
    raise ValueError(
        f"supply.model {product!r} is not simulated: choose E36312A, E36103A, E3631A, E3632A, E3640A, E3646A, DP832 or SPD3303X"
    )


def _e36300(m: SimulatedScpiSupply) -> Sequence[ScpiCommand]:
    s = m.supply
    return (
        ScpiCommand("[SOURce:]VOLTage[:LEVel]", lambda a: m.set_voltage(a[0]), lambda _: f"{s.level_v:+.6E}"),
        ScpiCommand(
            "[SOURce:]CURRent[:LEVel]", lambda a: m.set_current_limit(a[0]), lambda _: f"{s.current_limit_a:+.6E}"
        ),
        ScpiCommand("MEASure[:SCALar]:VOLTage[:DC]", None, lambda _: f"{s.measured_v():+.6E}"),
        ScpiCommand("OUTPut[:STATe]", lambda a: m.set_output(a[0]), lambda _: str(int(s.output_on))),
        ScpiCommand(
            "[SOURce:]VOLTage:PROTection[:LEVel]", lambda a: m.set_ovp_level(a[0]), lambda _: f"{s.ovp_v:+.6E}"
        ),
        ScpiCommand(
            "[SOURce:]VOLTage:PROTection:STATe", lambda a: m.set_ovp_enabled(a[0]), lambda _: str(int(s.ovp_enabled))
        ),
        ScpiCommand("[SOURce:]VOLTage:PROTection:TRIPped", None, lambda _: str(int(s.ovp_tripped))),
        ScpiCommand(
            "[SOURce:]CURRent:PROTection:STATe", lambda a: m.set_ocp_enabled(a[0]), lambda _: str(int(s.ocp_enabled))
        ),
        ScpiCommand(
            "OUTPut:PAIR", lambda a: m.set_tracking(a[0].upper() != "OFF"), lambda _: "SER" if s.tracking else "OFF"
        ),
    )


def _e3632a(m: SimulatedScpiSupply) -> Sequence[ScpiCommand]:
    """One output: a channel list is an error."""
    return [_without_channel_list(c) for c in _e36300(m) if "PAIR" not in c.pattern]


def _e364xa(m: SimulatedScpiSupply) -> Sequence[ScpiCommand]:
    """No over-current protection; those with two outputs select one, and can track."""
    known = [c for c in _e3632a(m) if "CURRent:PROT" not in c.pattern]
    if m.identity.split(",")[1][4:5] < "6":
        return known
    return [
        *known,
        ScpiCommand("INSTrument:NSELect", accept_keywords("1", "2"), lambda _: "1"),
        _tracking_command(m),
    ]


def _tracking_command(m: SimulatedScpiSupply) -> ScpiCommand:
    return ScpiCommand(
        "OUTPut:TRACk[:STATe]",
        lambda a: m.set_tracking(parse_boolean(a[-1])),
        lambda _: str(int(m.supply.tracking)),
    )


def _without_channel_list(command: ScpiCommand) -> ScpiCommand:
    def refused(arguments: Sequence[str]) -> None:
        if any("@" in argument for argument in arguments):
            raise ScpiError(-108)

    def setter(arguments: Sequence[str]) -> None:
        refused(arguments)
        if command.set is not None:
            command.set(arguments)

    def query(arguments: Sequence[str]) -> str:
        refused(arguments)
        return command.query(arguments) if command.query is not None else ""

    return ScpiCommand(command.pattern, setter if command.set else None, query if command.query else None)


def _e3631a(m: SimulatedScpiSupply) -> Sequence[ScpiCommand]:
    s = m.supply
    return (
        ScpiCommand("INSTrument:NSELect", accept_keywords("1", "2", "3"), lambda _: "1"),
        ScpiCommand(
            "[SOURce:]VOLTage[:LEVel]", lambda a: m.set_voltage(single_argument(a)), lambda _: f"{s.level_v:+.6E}"
        ),
        ScpiCommand(
            "[SOURce:]CURRent[:LEVel]",
            lambda a: m.set_current_limit(single_argument(a)),
            lambda _: f"{s.current_limit_a:+.6E}",
        ),
        ScpiCommand("MEASure[:SCALar]:VOLTage[:DC]", None, lambda _: f"{s.measured_v():+.6E}"),
        ScpiCommand("OUTPut[:STATe]", lambda a: m.set_output(single_argument(a)), lambda _: str(int(s.output_on))),
        _tracking_command(m),
    )


def _dp800(m: SimulatedScpiSupply) -> Sequence[ScpiCommand]:
    s = m.supply
    return (
        ScpiCommand(
            "[SOURce[1]:]VOLTage[:LEVel]", lambda a: m.set_voltage(single_argument(a)), lambda _: f"{s.level_v:.3f}"
        ),
        ScpiCommand(
            "[SOURce[1]:]CURRent[:LEVel]",
            lambda a: m.set_current_limit(single_argument(a)),
            lambda _: f"{s.current_limit_a:.4f}",
        ),
        ScpiCommand("MEASure[:SCALar]:VOLTage[:DC]", None, lambda _: f"{s.measured_v():.4f}"),
        ScpiCommand("OUTPut[:STATe]", lambda a: m.set_output(a[1]), lambda _: _format_switch(s.output_on)),
        ScpiCommand("OUTPut:OVP[:STATe]", lambda a: m.set_ovp_enabled(a[1]), lambda _: _format_switch(s.ovp_enabled)),
        ScpiCommand("OUTPut:OVP:VALue", lambda a: m.set_ovp_level(a[1]), lambda _: f"{s.ovp_v:.3f}"),
        ScpiCommand("OUTPut:OVP:QUES", None, lambda _: "YES" if s.ovp_tripped else "NO"),
        ScpiCommand("OUTPut:OCP[:STATe]", lambda a: m.set_ocp_enabled(a[1]), lambda _: _format_switch(s.ocp_enabled)),
        ScpiCommand(
            "OUTPut:TRACk[:STATe]", lambda a: m.set_tracking(parse_boolean(a[-1])), lambda _: _format_switch(s.tracking)
        ),
    )


def _spd(m: SimulatedScpiSupply) -> Sequence[ScpiCommand]:
    s = m.supply
    return (
        ScpiCommand("CH[1]:VOLTage", lambda a: m.set_voltage(single_argument(a)), lambda _: f"{s.level_v:.3f}"),
        ScpiCommand(
            "CH[1]:CURRent", lambda a: m.set_current_limit(single_argument(a)), lambda _: f"{s.current_limit_a:.3f}"
        ),
        ScpiCommand("MEASure:VOLTage", None, lambda _: f"{s.measured_v():.3f}"),
        ScpiCommand("OUTPut", lambda a: m.set_output(a[1]), None),  # it has no query
        ScpiCommand(
            "OUTPut:TRACK", lambda a: m.set_tracking(a[0] != "0"), None
        ),  # it has no query, the status word has it
        ScpiCommand("SYSTem:STATus", None, lambda _: f"{0x10 * s.output_on + (0xC if s.tracking else 0x4):#x}"),
    )


def _format_switch(on: bool) -> str:
    return "ON" if on else "OFF"


def _parse_within(text: str, unit: str, maximum: float) -> float:
    value = parse_number(text, unit, 0.0, maximum)
    if not 0 <= value <= maximum:
        raise ScpiError(-222)
    return value
