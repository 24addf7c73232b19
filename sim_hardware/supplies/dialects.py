"""What DC supplies of three makers answer: Keysight E36300 and E3631A, Rigol DP800, Siglent SPD3303X.

Limits, error codes and the spelling of answers follow the guides named in `drivers.supplies.dc_supply`.
"""

from collections.abc import Callable, Sequence

from sim_hardware.supplies.supply import Supply
from sim_hardware.wires.scpi_engine import Answer, Arguments, Command, Engine, ScpiError, boolean, number

HIGHEST_V, HIGHEST_A = 6.18, 5.15


class SupplyModel:
    """One supply behind its SCPI engine (sim_hardware.wires.scpi_engine.Instrument)."""

    def __init__(self, supply: Supply, identity: str, table: Callable[["SupplyModel"], Sequence[Command]]) -> None:
        self.identity = identity
        self.supply = supply
        self._table = table

    @property
    def commands(self) -> Sequence[Command]:
        return self._table(self)

    def reset(self) -> None:
        self.supply.reset()

    def trigger(self) -> None:
        raise ScpiError(-211)

    def busy_s(self) -> float:
        return 0.0

    def set_volts(self, text: str) -> None:
        self.supply.level_v = _within(text, "V", HIGHEST_V)
        self.supply.follow()

    def set_current(self, text: str) -> None:
        self.supply.current_a = _within(text, "A", HIGHEST_A)

    def switch(self, text: str) -> None:
        self.supply.on = boolean(text) and not self.supply.tripped
        self.supply.follow()

    def protect(self, text: str) -> None:
        self.supply.ovp = boolean(text)
        self.supply.follow()

    def protect_at(self, text: str) -> None:
        self.supply.ovp_v = _within(text, "V", 6.6)
        self.supply.follow()


class SpdEngine(Engine):
    """An SPD takes one command a message and writes its errors without quotes (MEM: confirm on the box)."""

    def execute(self, message: str) -> Answer | None:
        if ";" in message:
            self.report(ScpiError(-113))
            return None
        answer = super().execute(message)
        if answer is None or "ERR" not in message.upper():
            return answer
        code, _, text = answer.text.partition(",")
        return Answer(f"{int(code)}  {text.strip(chr(34))}")


def engine_of(product: str, supply: Supply, serial: str) -> Engine:
    """The supply of that product's maker. Raises ValueError for one that nobody simulates."""
    for start, maker, table in (
        ("E3631A", "HEWLETT-PACKARD", _e3631a),
        ("E36", "Keysight Technologies", _e36300),
        ("DP8", "RIGOL TECHNOLOGIES", _dp800),
        ("SPD", "Siglent Technologies", _spd),
    ):
        if product.startswith(start):
            model = SupplyModel(supply, f"{maker},{product},{serial},1.0", table)
            return SpdEngine(model) if start == "SPD" else Engine(model)
    raise ValueError(f"supply.model {product!r} is not simulated: choose E36312A, E3631A, DP832 or SPD3303X")


def _e36300(m: SupplyModel) -> Sequence[Command]:
    s = m.supply
    return (
        Command("[SOURce:]VOLTage[:LEVel]", lambda a: m.set_volts(a[0]), lambda _: f"{s.level_v:+.6E}"),
        Command("[SOURce:]CURRent[:LEVel]", lambda a: m.set_current(a[0]), lambda _: f"{s.current_a:+.6E}"),
        Command("MEASure[:SCALar]:VOLTage[:DC]", None, lambda _: f"{s.measured_v():+.6E}"),
        Command("OUTPut[:STATe]", lambda a: m.switch(a[0]), lambda _: str(int(s.on))),
        Command("[SOURce:]VOLTage:PROTection[:LEVel]", lambda a: m.protect_at(a[0]), lambda _: f"{s.ovp_v:+.6E}"),
        Command("[SOURce:]VOLTage:PROTection:STATe", lambda a: m.protect(a[0]), lambda _: str(int(s.ovp))),
        Command("[SOURce:]VOLTage:PROTection:TRIPped", None, lambda _: str(int(s.tripped))),
    )


def _e3631a(m: SupplyModel) -> Sequence[Command]:
    s = m.supply
    return (
        Command("INSTrument:NSELect", lambda a: _one_of(a, "1", "2", "3"), lambda _: "1"),
        Command("[SOURce:]VOLTage[:LEVel]", lambda a: m.set_volts(_alone(a)), lambda _: f"{s.level_v:+.6E}"),
        Command("[SOURce:]CURRent[:LEVel]", lambda a: m.set_current(_alone(a)), lambda _: f"{s.current_a:+.6E}"),
        Command("MEASure[:SCALar]:VOLTage[:DC]", None, lambda _: f"{s.measured_v():+.6E}"),
        Command("OUTPut[:STATe]", lambda a: m.switch(_alone(a)), lambda _: str(int(s.on))),
    )


def _dp800(m: SupplyModel) -> Sequence[Command]:
    s = m.supply
    return (
        Command("[SOURce[1]:]VOLTage[:LEVel]", lambda a: m.set_volts(_alone(a)), lambda _: f"{s.level_v:.3f}"),
        Command("[SOURce[1]:]CURRent[:LEVel]", lambda a: m.set_current(_alone(a)), lambda _: f"{s.current_a:.4f}"),
        Command("MEASure[:SCALar]:VOLTage[:DC]", None, lambda _: f"{s.measured_v():.4f}"),
        Command("OUTPut[:STATe]", lambda a: m.switch(a[1]), lambda _: _spelled(s.on)),
        Command("OUTPut:OVP[:STATe]", lambda a: m.protect(a[1]), lambda _: _spelled(s.ovp)),
        Command("OUTPut:OVP:VALue", lambda a: m.protect_at(a[1]), lambda _: f"{s.ovp_v:.3f}"),
        Command("OUTPut:OVP:QUES", None, lambda _: "YES" if s.tripped else "NO"),
    )


def _spd(m: SupplyModel) -> Sequence[Command]:
    s = m.supply
    return (
        Command("CH[1]:VOLTage", lambda a: m.set_volts(_alone(a)), lambda _: f"{s.level_v:.3f}"),
        Command("CH[1]:CURRent", lambda a: m.set_current(_alone(a)), lambda _: f"{s.current_a:.3f}"),
        Command("MEASure:VOLTage", None, lambda _: f"{s.measured_v():.3f}"),
        Command("OUTPut", lambda a: m.switch(a[1]), None),  # it cannot be asked
        Command("SYSTem:STATus", None, lambda _: f"{0x10 * s.on:#x}"),
    )


def _spelled(on: bool) -> str:
    return "ON" if on else "OFF"


def _alone(arguments: Arguments) -> str:
    if len(arguments) != 1:
        raise ScpiError(-108 if arguments else -109)
    return arguments[0]


def _one_of(arguments: Arguments, *choices: str) -> None:
    if _alone(arguments) not in choices:
        raise ScpiError(-224)


def _within(text: str, unit: str, highest: float) -> float:
    value = number(text, unit, 0.0, highest)
    if not 0 <= value <= highest:
        raise ScpiError(-222)
    return value
