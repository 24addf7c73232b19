"""A Rigol DG1000Z or DG800 function generator as its programming guide describes it.

Its own traps: VOLT:OFFS? answers 0 in DC mode whatever the level is APPL? tells it; a download selects the
waveform function by itself, and beyond 8192 points the sample-rate mode; in the frequency mode fewer points are
stretched to 8192; switches are answered ON and OFF; the idle level of a burst is a setting of its own.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_hardware.generators.generator import Generator
from sim_hardware.generators.scpi_generator import ScpiBox, data_of
from sim_hardware.wires.scpi_engine import Arguments, Command, ScpiError, choice, number, one

SOURCE = "[SOURce[1]:]"
FULL_SCALE = 16383
PACKET_POINTS = 16_384
SHORT_POINTS = 8192


class RigolDg(ScpiBox):
    """DG1000Z and DG800; only the latter has output limits."""

    TOP_HZ = 25e6
    MOST_CYCLES = 1e6

    def __init__(self, core: Generator, now: Callable[[], float], identity: str) -> None:
        super().__init__(core, now, identity)
        self._small = ",DG8" in identity.upper()
        self._forget()

    def _forget(self) -> None:
        self._packets: list[NDArray[np.float64]] = []
        self._points = np.zeros(SHORT_POINTS)
        self._by_rate = False
        self._rate_hz = 20e6
        self._idle = "FPT"

    def reset(self) -> None:
        super().reset()
        self._forget()

    def real(self, value: float) -> str:
        return "9.900000E+37" if math.isinf(value) else f"{value:.6E}"

    def switch(self, on: bool) -> str:
        return "ON" if on else "OFF"

    @property
    def commands(self) -> Sequence[Command]:
        levels, core = self._levels, self._core
        limits = [
            Command("OUTPut[1]:VOLLimit:LOW", levels.set_limit(high=False), lambda _: self.real(levels.limits_v[0])),
            Command("OUTPut[1]:VOLLimit:HIGH", levels.set_limit(high=True), lambda _: self.real(levels.limits_v[1])),
            Command("OUTPut[1]:VOLLimit[:STATe]", levels.set_limits_on, lambda _: self.switch(levels.limits_on)),
        ]
        shared = [c for c in levels.commands(SOURCE) if "LIMit" not in c.pattern and ":RANGe" not in c.pattern]
        own_offset = next(c for c in shared if c.pattern.endswith(":OFFSet"))
        return [
            Command(own_offset.pattern, own_offset.set, self._offset),
            *(c for c in shared if c is not own_offset),
            *(limits if self._small else []),
            Command(
                SOURCE + "VOLTage:RANGe:AUTO",
                levels.set_auto_range,
                lambda _: self.switch(core.settings.auto_range),
            ),
            Command("OUTPut[1]:IMPedance", levels.set_load, lambda _: self.real(levels.load_ohm)),
            Command(SOURCE + "FUNCtion[:SHAPe]", self._set_function, lambda _: self._function()),
            Command(
                SOURCE + "FUNCtion:ARB:MODE", self._set_mode_of_rate, lambda _: "SRAT" if self._by_rate else "FREQ"
            ),
            Command(SOURCE + "FUNCtion:ARB:SRATe", self._set_rate, lambda _: self.real(self._rate_hz)),
            self._switch("OUTPut[1][:STATe]", "on"),
            self._numeric(SOURCE + "FREQuency[:FIXed]", "frequency_hz", "HZ", 1e-6, self.TOP_HZ, 1e3),
            self._mode(SOURCE + "SWEep:STATe", "sweep", "burst"),
            self._mode(SOURCE + "BURSt[:STATe]", "burst", "sweep"),
            self._kept(SOURCE + "BURSt:MODE", "TRIGgered", "GATed"),
            Command(SOURCE + "BURSt:NCYCles", self._set_cycles, lambda _: self.real(core.settings.cycles)),
            self._numeric(SOURCE + "BURSt:PHASe", "phase_deg", "DEG", 0.0, 360.0, 0.0),
            Command(SOURCE + "BURSt:TRIGger:SOURce", self._set_trigger, lambda _: self._trigger_source()),
            Command(SOURCE + "BURSt:TRIGger[:IMMediate]", lambda _: self.trigger()),
            Command(SOURCE + "BURSt:IDLE", self._set_idle, lambda _: self._idle),
            Command(SOURCE + "TRACe:DATA:DAC[16]", self._download),
            Command(SOURCE + "APPLy", None, lambda _: self._applied()),
            Command(SOURCE + "APPLy:DC", self._apply_dc),
        ]

    def _function(self) -> str:
        return {"ARB": "USER"}.get(self._core.settings.function, self._core.settings.function)

    def _set_function(self, a: Arguments) -> None:
        function = choice(one(a), "SINusoid", "DC", "USER")
        self._enter("ARB" if function == "USER" else function)
        if function == "USER":
            self._play()

    def _offset(self, _: Arguments) -> str:
        s = self._core.settings
        return self.real(0.0 if s.function == "DC" else s.emf_offset_v * self._levels.display)

    def _applied(self) -> str:
        s, shown = self._core.settings, self._levels.display
        offset = self.real(s.emf_offset_v * shown)
        if s.function == "DC":
            return f'"DC,DEF,DEF,{offset}"'
        rate = self._rate_hz if s.function == "ARB" and self._by_rate else s.frequency_hz
        return (
            f'"{self._function()},{self.real(rate)},{self.real(s.emf_vpp * shown)},{offset},{self.real(s.phase_deg)}"'
        )

    def _apply_dc(self, a: Arguments) -> None:
        if len(a) != 3:
            raise ScpiError(-109)
        self._core.change(burst=False, sweep=False, function="DC")
        self._levels.set_offset(a[2])
        self._core.change(on=True)

    def _trigger_source(self) -> str:
        return {"IMM": "INT", "BUS": "MAN"}.get(self._core.settings.trigger, "EXT")

    def _set_trigger(self, a: Arguments) -> None:
        source = choice(one(a), "INTernal", "EXTernal", "MANual")
        self._core.change(trigger={"INT": "IMM", "MAN": "BUS"}.get(source, "EXT"))

    def _set_idle(self, a: Arguments) -> None:
        self._idle = choice(one(a), "FPT", "TOP", "CENTER", "BOTTOM")
        levels = {"TOP": 1.0, "CENTER": 0.0, "BOTTOM": -1.0}
        self._core.change(idle=levels.get(self._idle))

    def _download(self, a: Arguments) -> None:
        if len(a) != 3:
            raise ScpiError(-109)
        choice(a[0], "VOLATILE")
        last = choice(a[1], "CON", "END") == "END"
        points = data_of(a[2], "<u2", 0, FULL_SCALE)
        if points.size > PACKET_POINTS or (self._small and not last):
            raise ScpiError(-225)
        self._packets.append(2 * points / (FULL_SCALE - 1) - 1)
        if not last:
            return
        self._points, self._packets = np.concatenate(self._packets), []
        if self._points.size > SHORT_POINTS:
            self._by_rate = True
        elif not self._by_rate:
            self._points = np.interp(
                np.linspace(0, self._points.size - 1, SHORT_POINTS), np.arange(self._points.size), self._points
            )
        self._play(function="ARB")

    def _play(self, **settings: Any) -> None:
        if self._by_rate:
            settings["frequency_hz"] = self._rate_hz / self._points.size
        self._set_wave(self._points, **settings)

    def _set_mode_of_rate(self, a: Arguments) -> None:
        self._by_rate = choice(one(a), "FREQ", "SRATe") == "SRAT"

    def _set_rate(self, a: Arguments) -> None:
        self._rate_hz = self._levels.clip(number(one(a), "SA/S", 1e-6, 60e6, 20e6), 1e-6, 60e6)
        if self._core.settings.function == "ARB":
            self._play()
