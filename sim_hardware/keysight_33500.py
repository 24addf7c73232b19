"""A Keysight 33500B (Trueform) function generator as its programming guide describes it, traps included.

The traps that matter on this bench: it wakes up and resets to 50 ohm with the output off; told of 50 ohm it puts twice
the volts on a high-impedance input; APPLy turns the output on; an amplitude in another range switches a relay; leaving
DC or burst starts a sine at a phase nobody knows; a value it cannot do is clipped, not refused.
"""

import math
from collections.abc import Callable, Sequence
from typing import Literal, cast

from sim_hardware.generator import Generator
from sim_hardware.keysight_levels import MAX_EMF_V, Levels
from sim_hardware.scpi import Command
from sim_hardware.scpi_values import Arguments, ScpiError, boolean, choice, number, one, real

TOP_HZ = 20e6
SOURCE = "[SOURce[1]:]"


class Keysight33500:
    """SCPI model of one channel over a `Generator` (sim_hardware.scpi.Instrument).

    Args:
        now: bench time, for what depends on whether a burst is still running.

    Attributes:
        report: puts an error into the queue although the command is carried out; the engine's, once there is one.
    """

    def __init__(self, core: Generator, now: Callable[[], float], identity: str) -> None:
        self.identity = identity
        self.report: Callable[[ScpiError], None] = lambda _: None
        self._core = core
        self._now = now
        self._levels = Levels(core, self._report)

    def _report(self, error: ScpiError) -> None:
        self.report(error)

    def reset(self) -> None:
        self._levels.reset()
        self._core.reset()

    def trigger(self) -> None:
        if not self._core.ready_for_trigger(self._now()):
            raise ScpiError(-211)
        self._core.trigger()

    def busy_s(self) -> float:
        return self._core.busy_s(self._now())

    @property
    def commands(self) -> Sequence[Command]:
        core = self._core
        return [
            *self._levels.commands(SOURCE),
            Command(SOURCE + "FUNCtion[:SHAPe]", self._set_function, lambda _: core.settings.function),
            self._numeric("FREQuency[:CW]", "frequency_hz", "HZ", 1e-6, TOP_HZ, 1e3),
            self._numeric("FREQuency:STARt", "start_hz", "HZ", 1e-6, TOP_HZ, 100.0),
            self._numeric("FREQuency:STOP", "stop_hz", "HZ", 1e-6, TOP_HZ, 1e3),
            self._numeric("SWEep:TIME", "sweep_s", "S", 1e-3, 250e3, 1.0),
            Command(SOURCE + "SWEep:SPACing", _only("LINear"), lambda _: "LIN"),
            Command(SOURCE + "SWEep:STATe", self._set_mode("sweep", "burst"), lambda _: str(int(core.settings.sweep))),
            Command(SOURCE + "BURSt:STATe", self._set_mode("burst", "sweep"), lambda _: str(int(core.settings.burst))),
            Command(SOURCE + "BURSt:MODE", _only("TRIGgered"), lambda _: "TRIG"),
            Command(SOURCE + "BURSt:NCYCles", self._set_cycles, lambda _: real(core.settings.cycles)),
            self._numeric("BURSt:PHASe", "phase_deg", "DEG", -360.0, 360.0, 0.0),
            self._numeric("BURSt:INTernal:PERiod", "period_s", "S", 1e-6, 8e3, 10e-3),
            Command("OUTPut[1][:STATe]", self._set_output, lambda _: str(int(core.settings.on))),
            Command("TRIGger[1]:SOURce", self._set_trigger, lambda _: core.settings.trigger),
            Command("TRIGger[1][:IMMediate]", lambda _: self.trigger()),
            Command("ABORt[1]", lambda _: core.abort()),
            Command(SOURCE + "APPLy:SINusoid", self._apply("SIN")),
            Command(SOURCE + "APPLy:DC", self._apply("DC")),
            Command("UNIT:ANGLe", _only("DEGree"), lambda _: "DEG"),
        ]

    def _numeric(self, pattern: str, name: str, unit: str, low: float, high: float, default: float) -> Command:
        def setter(a: Arguments) -> None:
            self._core.change(**{name: self._levels.clip(number(one(a), unit, low, high, default), low, high)})

        return Command(SOURCE + pattern, setter, lambda _: real(getattr(self._core.settings, name)))

    def _set_output(self, a: Arguments) -> None:
        self._core.change(on=boolean(one(a)))

    def _set_function(self, a: Arguments) -> None:
        function = cast(Literal["SIN", "DC"], choice(one(a), "SINusoid", "DC"))
        s = self._core.settings
        self._levels.check(s.emf_vpp, s.emf_offset_v, function)
        if function == "SIN":
            # DC allows an offset that leaves no room for a sine.
            room = MAX_EMF_V - s.emf_vpp / 2
            if abs(s.emf_offset_v) > room:
                self.report(ScpiError(-221, "offset changed on exit from dc function"))
            self._core.change(function=function, emf_offset_v=min(max(s.emf_offset_v, -room), room))
            return
        if s.burst or s.sweep:
            mode = "burst" if s.burst else "sweep"
            self.report(ScpiError(-221, f"not able to {mode} dc, {mode} turned off"))
        self._core.change(function=function, burst=False, sweep=False)

    def _set_mode(self, mode: str, other: str) -> Callable[[Arguments], None]:
        def setter(a: Arguments) -> None:
            on, s = boolean(one(a)), self._core.settings
            if on and s.function == "DC":
                raise ScpiError(-221, f"not able to {mode} dc, {mode} turned off")
            changed = {mode: on}
            if on and getattr(s, other):
                self.report(ScpiError(-221, f"{other} turned off by selection of other mode or modulation"))
                changed[other] = False
            self._core.change(**changed)

        return setter

    def _set_cycles(self, a: Arguments) -> None:
        cycles = number(one(a), "", 1.0, 1e8, 1.0)
        if not math.isinf(cycles):
            self._core.change(cycles=float(round(self._levels.clip(cycles, 1.0, 1e8))))
            return
        if self._core.settings.trigger == "IMM":
            self.report(ScpiError(-221, "infinite burst changed trigger source to BUS"))
            self._core.change(trigger="BUS")
        self._core.change(cycles=cycles)

    def _set_trigger(self, a: Arguments) -> None:
        source = choice(one(a), "IMMediate", "BUS", "EXTernal")
        if source == "IMM" and math.isinf(self._core.settings.cycles):
            self.report(ScpiError(-221, "turned off infinite burst to allow immediate trigger source"))
            self._core.change(cycles=1.0)
        self._core.change(trigger=source)

    def _apply(self, function: str) -> Callable[[Arguments], None]:
        """APPLy: frequency, amplitude, offset at once. Modes end, the range goes automatic, the output comes on."""

        def setter(a: Arguments) -> None:
            asked = {i: x for i, x in enumerate(a) if x.strip().upper() not in ("DEF", "DEFAULT")}
            self._levels.unfreeze()
            self._core.change(burst=False, sweep=False, trigger="IMM", function=function)
            if 0 in asked:
                self._core.change(frequency_hz=self._levels.clip(number(asked[0], "HZ", 1e-6, TOP_HZ), 1e-6, TOP_HZ))
            if 1 in asked and function == "SIN":
                self._levels.set_vpp(asked[1])
            if 2 in asked:
                self._levels.set_offset(asked[2])
            self._core.change(on=True)

        return setter


def _only(name: str) -> Callable[[Arguments], None]:
    """A setting of which this model knows one value."""

    def setter(a: Arguments) -> None:
        choice(one(a), name)

    return setter
