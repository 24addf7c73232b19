"""A Keysight 33500B (Trueform) function generator as its programming guide describes it, traps included.

The traps that matter on this bench: it wakes up and resets to 50 ohm with the output off; told of 50 ohm it puts twice
the volts on a high-impedance input; APPLy turns the output on; an amplitude in another range and another function switch
relays; leaving DC or burst starts a sine at a phase nobody knows; a value it cannot do is clipped, not refused; a waveform's
name can be given once; clearing its memory selects another waveform; the byte order of a download is the other one.
"""

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sim_hardware.generators.generator import Generator
from sim_hardware.generators.scpi_generator import ScpiBox, data_of, only
from sim_hardware.wires.scpi_engine import Arguments, Command, ScpiError, choice, number, one

SOURCE = "[SOURce[1]:]"
MEMORY_POINTS = 1_000_000
BUILT_IN = "EXP_RISE"
RISE = 1 - 2 * np.exp(-5 * np.arange(100) / 100)


class KeysightBox(ScpiBox):
    """What 33200 and 33500 boxes have in common."""

    SPAN_IS_THE_WAVES_OWN = True
    ARBITRARY: ClassVar[str] = "ARB"
    """How the waveform function is called."""

    def __init__(self, core: Generator, now: Callable[[], float], identity: str) -> None:
        super().__init__(core, now, identity)
        self._big_endian = True

    @property
    def commands(self) -> Sequence[Command]:
        settings = self._core.settings
        return [
            *self._levels.commands(SOURCE),
            Command(SOURCE + "FUNCtion[:SHAPe]", self._set_function, lambda _: self._function()),
            self._numeric(SOURCE + "FREQuency[:CW]", "frequency_hz", "HZ", 1e-6, self.TOP_HZ, 1e3),
            self._numeric(SOURCE + "FREQuency:STARt", "start_hz", "HZ", 1e-6, self.TOP_HZ, 100.0),
            self._numeric(SOURCE + "FREQuency:STOP", "stop_hz", "HZ", 1e-6, self.TOP_HZ, 1e3),
            self._numeric(SOURCE + "SWEep:TIME", "sweep_s", "S", 1e-3, 250e3, 1.0),
            Command(SOURCE + "SWEep:SPACing", only("LINear"), lambda _: "LIN"),
            self._mode(SOURCE + "SWEep:STATe", "sweep", "burst"),
            self._mode(SOURCE + "BURSt:STATe", "burst", "sweep"),
            self._kept(SOURCE + "BURSt:MODE", "TRIGgered", "GATed"),
            Command(SOURCE + "BURSt:NCYCles", self._set_cycles, lambda _: self.real(self._core.settings.cycles)),
            self._numeric(SOURCE + "BURSt:PHASe", "phase_deg", "DEG", -360.0, 360.0, 0.0),
            self._numeric(SOURCE + "BURSt:INTernal:PERiod", "period_s", "S", 1e-6, 8e3, settings.period_s),
            self._switch("OUTPut[1][:STATe]", "on"),
            Command("TRIGger[1]:SOURce", self._set_trigger, lambda _: self._core.settings.trigger),
            Command("TRIGger[1][:IMMediate]", lambda _: self.trigger()),
            Command(SOURCE + "APPLy:SINusoid", self._apply("SIN")),
            Command(SOURCE + "APPLy:DC", self._apply("DC")),
            self._kept("UNIT:ANGLe", "DEGree", "RADian"),
            Command("FORMat:BORDer", self._set_order, lambda _: "NORM" if self._big_endian else "SWAP"),
        ]

    def _function(self) -> str:
        function = self._core.settings.function
        return self.ARBITRARY if function == "ARB" else function

    def _set_function(self, a: Arguments) -> None:
        function = choice(one(a), "SINusoid", "DC", self.ARBITRARY)
        self._enter("ARB" if function == self.ARBITRARY else function)

    def _set_order(self, a: Arguments) -> None:
        self._big_endian = choice(one(a), "NORMal", "SWAPped") == "NORM"

    def _set_trigger(self, a: Arguments) -> None:
        source = choice(one(a), "IMMediate", "BUS", "EXTernal")
        if source == "IMM" and np.isinf(self._core.settings.cycles):
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
                hertz = number(asked[0], "HZ", 1e-6, self.TOP_HZ)
                self._core.change(frequency_hz=self._levels.clip(hertz, 1e-6, self.TOP_HZ))
            if 1 in asked and function == "SIN":
                self._levels.set_vpp(asked[1])
            if 2 in asked:
                self._levels.set_offset(asked[2])
            self._core.change(on=True)

        return setter


class Keysight33500(KeysightBox):
    """33500B and 33600A: named waveforms, a sample rate, a filter, output limits, ABORt."""

    def __init__(self, core: Generator, now: Callable[[], float], identity: str) -> None:
        super().__init__(core, now, identity)
        self._forget()

    def _forget(self) -> None:
        self._waves: dict[str, NDArray[np.float64]] = {}
        self._selected = BUILT_IN
        self._rate_hz = 40e3
        self._smooth = True

    def reset(self) -> None:
        super().reset()
        self._forget()
        self._play(RISE)

    @property
    def commands(self) -> Sequence[Command]:
        free = MEMORY_POINTS
        return [
            *super().commands,
            Command("ABORt[1]", lambda _: self._core.abort()),
            Command(SOURCE + "DATA:ARBitrary[1]", self._download),
            Command(SOURCE + "DATA:VOLatile:CLEar", self._clear),
            Command(
                SOURCE + "DATA:VOLatile:FREE", None, lambda _: str(free - sum(w.size for w in self._waves.values()))
            ),
            Command(SOURCE + "DATA:VOLatile:CATalog", None, lambda _: ",".join(f'"{n}"' for n in self._names())),
            Command(SOURCE + "FUNCtion:ARBitrary", self._select, lambda _: f'"{self._selected}"'),
            Command(SOURCE + "FUNCtion:ARBitrary:SRATe", self._set_rate, lambda _: self.real(self._rate_hz)),
            Command(
                SOURCE + "FUNCtion:ARBitrary:FILTer", self._set_filter, lambda _: "STEP" if self._smooth else "OFF"
            ),
        ]

    def _names(self) -> list[str]:
        return [BUILT_IN, *self._waves]

    def _download(self, a: Arguments) -> None:
        if len(a) != 2:
            raise ScpiError(-109)
        if a[0].upper() in self._waves:
            raise ScpiError(786)
        points = data_of(a[1], ">f4" if self._big_endian else "<f4", -1.0, 1.0)
        if points.size + sum(w.size for w in self._waves.values()) > MEMORY_POINTS:
            raise ScpiError(-225)
        self._waves[a[0].upper()] = points

    def _clear(self, _: Arguments) -> None:
        self._waves.clear()
        self._selected = BUILT_IN
        self._play(RISE)

    def _select(self, a: Arguments) -> None:
        name = one(a).strip("\"'").upper()
        if name not in self._names():
            raise ScpiError(-224)
        self._selected = name
        self._play(RISE if name == BUILT_IN else self._waves[name])

    def _play(self, points: NDArray[np.float64]) -> None:
        turn: dict[str, Any] = {}
        if self._core.settings.function == "ARB":
            turn["frequency_hz"] = self._rate_hz / points.size
        self._set_wave(points, smooth=self._smooth, **turn)

    def _enter(self, function: str) -> None:
        super()._enter(function)
        if function == "ARB":
            self._play(self._waves.get(self._selected, RISE))

    def _set_rate(self, a: Arguments) -> None:
        self._rate_hz = self._levels.clip(number(one(a), "SA/S", 1e-6, 250e6, 40e3), 1e-6, 250e6)
        self._play(self._waves.get(self._selected, RISE))

    def _set_filter(self, a: Arguments) -> None:
        self._smooth = choice(one(a), "NORMal", "STEP", "OFF") != "OFF"
        self._play(self._waves.get(self._selected, RISE))
