"""A Tektronix AFG3000 or AFG1000 function generator as its programmer manual describes it.

Its own traps: a burst is triggered by the internal timer unless told otherwise, and comes again and again; there is no
range to freeze; an AFG1000's built-in DC pays no heed to the offset, and its load is for the front panel only.
"""

from collections.abc import Callable, Sequence

import numpy as np

from sim_hardware.generators.generator import Generator
from sim_hardware.generators.scpi_generator import ScpiBox, data_of
from sim_hardware.wires.scpi_engine import Arguments, Command, ScpiError, choice, number, one

SOURCE = "[SOURce[1]:]"
FULL_SCALE = 16382


class TektronixAfg(ScpiBox):
    """AFG3000 and AFG1000.

    Args:
        high_z: what the front panel of an AFG1000 was set to by hand.
    """

    TOP_HZ = 25e6
    MOST_CYCLES = 1e6

    def __init__(self, core: Generator, now: Callable[[], float], identity: str, *, high_z: bool = True) -> None:
        super().__init__(core, now, identity)
        self._small = ",AFG1" in identity.upper()
        self._memory_points = 8192 if self._small else 65_536
        self._edit = np.zeros(1000)
        self._high_z = high_z
        self._delay_s = 0.0
        if self._small and high_z:
            self._levels.set_load(["INF"])

    def reset(self) -> None:
        super().reset()
        self._delay_s = 0.0
        self._core.change(period_s=1e-3)
        if self._small and self._high_z:
            self._levels.set_load(["INF"])

    @property
    def commands(self) -> Sequence[Command]:
        levels, core = self._levels, self._core
        shared = [c for c in levels.commands(SOURCE) if not any(w in c.pattern for w in (":RANGe", ":LOAD", ":STATe"))]
        load = Command("OUTPut[1]:IMPedance", levels.set_load, lambda _: self.real(levels.load_ohm))
        kept = [c for c in shared if not (self._small and "LIMit" in c.pattern)]
        return [
            *kept,
            *([] if self._small else [load]),
            Command(SOURCE + "FUNCtion[:SHAPe]", self._set_function, lambda _: self._function()),
            self._numeric(SOURCE + "FREQuency[:FIXed]", "frequency_hz", "HZ", 1e-6, self.TOP_HZ, 1e3),
            Command(SOURCE + "FREQuency:MODE", self._set_sweep, lambda _: "SWE" if core.settings.sweep else "CW"),
            self._mode(SOURCE + "BURSt:STATe", "burst", "sweep"),
            self._kept(SOURCE + "BURSt:MODE", "TRIGgered", "GATed"),
            Command(SOURCE + "BURSt:NCYCles", self._set_cycles, lambda _: self.real(core.settings.cycles)),
            Command(SOURCE + "BURSt:TDELay", self._set_delay, lambda _: self.real(self._delay_s)),
            self._switch("OUTPut[1][:STATe]", "on"),
            Command("TRIGger[:SEQuence]:SOURce", self._set_trigger, lambda _: self._trigger_source()),
            Command("TRIGger[:SEQuence][:IMMediate]", lambda _: self.trigger()),
            Command("TRACe:DEFine", self._define),
            Command("DATA:DEFine", self._define),
            Command("DATA[:DATA]", self._download),
            Command("DATA:POINts", None, lambda _: str(self._edit.size)),
        ]

    def trigger(self) -> None:
        # *TRG fires an external trigger, and there is no other way to fire it from the wire.
        s = self._core.settings
        if not s.burst or s.trigger != "BUS" or self.busy_s() > 0:
            raise ScpiError(-211)
        self._core.trigger()

    def _function(self) -> str:
        return {"ARB": "EMEM"}.get(self._core.settings.function, self._core.settings.function)

    def _set_function(self, a: Arguments) -> None:
        function = choice(one(a), "SINusoid", "DC", "EMEMory")
        self._enter("ARB" if function == "EMEM" else function)
        if function == "EMEM":
            self._set_wave(self._edit)
        elif function == "DC" and self._small:
            self._core.change(emf_offset_v=0.0)

    def _set_sweep(self, a: Arguments) -> None:
        self._core.change(sweep=choice(one(a), "CW", "FIXed", "SWEep") == "SWE")

    def _trigger_source(self) -> str:
        return "TIM" if self._core.settings.trigger == "IMM" else "EXT"

    def _set_trigger(self, a: Arguments) -> None:
        self._core.change(trigger="IMM" if choice(one(a), "TIMer", "EXTernal") == "TIM" else "BUS")

    def _set_delay(self, a: Arguments) -> None:
        self._delay_s = self._levels.clip(number(one(a), "S"), 0.0, 85.0)

    def _define(self, a: Arguments) -> None:
        if len(a) != 2:
            raise ScpiError(-109)
        choice(a[0], "EMEMory")
        size = int(number(a[1], ""))
        if not 2 <= size <= self._memory_points:
            raise ScpiError(-222)
        self._put(np.zeros(size))

    def _download(self, a: Arguments) -> None:
        if len(a) != 2:
            raise ScpiError(-109)
        choice(a[0], "EMEMory")
        points = data_of(a[1], ">u2", 0, FULL_SCALE)
        if points.size > self._memory_points:
            raise ScpiError(-225)
        self._put(2 * points / FULL_SCALE - 1)

    def _put(self, points: np.ndarray) -> None:
        self._edit = points
        if self._core.settings.function == "ARB":
            self._set_wave(points)
