"""Amplitude, offset, load, range and limits of SCPI generators: what they display, clip and refuse.

The box always drives through 50 ohm and displays what would stand at the load it was *told* of. Inside, levels are those
of the open output, so a change of the declared load changes the display and not the volts.
"""

import math
from collections.abc import Callable, Sequence

from sim_hardware.generators.generator import RANGES_VPP, Generator
from sim_hardware.wires.scpi_engine import Arguments, Command, ScpiError, boolean, choice, number, one, real

SOURCE_OHM = 50.0
MAX_EMF_V = 10.0
MIN_EMF_VPP = 2e-3  # 1 mVpp into 50 ohm
RMS = 2 * math.sqrt(2)


class Levels:
    """The VOLTage commands and OUTPut:LOAD over a `Generator`.

    Args:
        report: puts an error into the queue although the command is carried out, as this box often does.
        show: how this box writes a number.
    """

    def __init__(
        self, core: Generator, report: Callable[[ScpiError], None], show: Callable[[float], str] = real
    ) -> None:
        self._core = core
        self._report = report
        self._show = show
        self.reset()

    def reset(self) -> None:
        """Factory: 50 ohm, volts peak to peak, no limits, automatic range."""
        self.load_ohm = 50.0
        self._unit = "VPP"
        self.limits_on = False
        self._low_limit_v, self._high_limit_v = -MAX_EMF_V, MAX_EMF_V
        self._frozen_vpp = math.inf  # largest amplitude of the frozen range

    @property
    def display(self) -> float:
        """Displayed volts per volt of the open output."""
        return 1.0 if math.isinf(self.load_ohm) else self.load_ohm / (self.load_ohm + SOURCE_OHM)

    @property
    def limits_v(self) -> tuple[float, float]:
        """Low and high limit in displayed volts."""
        return self._low_limit_v, self._high_limit_v

    def clip(self, value: float, low: float, high: float) -> float:
        """The nearest value that the box can do, with an error in the queue if it is another one."""
        if value > high * (1 + 1e-9) + 1e-12:
            self._report(ScpiError(-222, "value clipped to upper limit"))
        elif value < low - abs(low) * 1e-9 - 1e-12:
            self._report(ScpiError(-222, "value clipped to lower limit"))
        return min(max(value, low), high)

    def check(self, emf_vpp: float, emf_offset_v: float, function: str) -> None:
        """Raise ScpiError if that output would leave the limits that are on."""
        if not self.limits_on:
            return
        wave = self._core.settings.wave if function == "ARB" else None
        edges = (wave.low, wave.high) if wave else (0.0, 0.0) if function == "DC" else (-1.0, 1.0)
        low_v, high_v = (emf_offset_v + emf_vpp / 2 * edge for edge in edges)
        if high_v * self.display > self._high_limit_v + 1e-9:
            raise ScpiError(-221, "output voltage exceeds the high limit")
        if low_v * self.display < self._low_limit_v - 1e-9:
            raise ScpiError(-221, "output voltage exceeds the low limit")

    def unfreeze(self) -> None:
        """Let the range follow the amplitude again."""
        self._frozen_vpp = math.inf
        self._core.change(auto_range=True)

    def set_vpp(self, text: str) -> None:
        """Amplitude in the unit it carries, or the present one."""
        unit = next((u for u in ("VPP", "VRMS", "DBM") if text.strip().upper().endswith(u)), self._unit)
        s = self._core.settings
        top = min(2 * (MAX_EMF_V - abs(s.emf_offset_v)), self._frozen_vpp)
        low, high = (self._shown(emf * self.display, unit) for emf in (MIN_EMF_VPP, top))
        value = number(text, unit if unit in text.upper() else "V", low, high)
        emf = self._meant(value, unit) / self.display
        self._put(self.clip(emf, MIN_EMF_VPP, top), s.emf_offset_v)

    def set_offset(self, text: str) -> None:
        """Offset in volts."""
        s = self._core.settings
        top = MAX_EMF_V - (s.emf_vpp / 2 if s.function != "DC" else 0.0)
        value = number(text, "V", -top * self.display, top * self.display, 0.0) / self.display
        self._put(s.emf_vpp, self.clip(value, -top, top))

    def _put(self, emf_vpp: float, emf_offset_v: float) -> None:
        self.check(emf_vpp, emf_offset_v, self._core.settings.function)
        self._core.change(emf_vpp=emf_vpp, emf_offset_v=emf_offset_v)

    def _meant(self, value: float, unit: str) -> float:
        """Displayed volts peak to peak of an amplitude in `unit`."""
        if unit == "DBM":
            if math.isinf(self.load_ohm):
                raise ScpiError(-221, "dBm needs a finite load")
            return RMS * math.sqrt(self.load_ohm * 1e-3 * 10 ** (value / 10))
        return value * (RMS if unit == "VRMS" else 1.0)

    def _shown(self, vpp: float, unit: str) -> float:
        """An amplitude in `unit` of displayed volts peak to peak."""
        if unit == "DBM" and not math.isinf(self.load_ohm):
            return 10 * math.log10((max(vpp, 1e-12) / RMS) ** 2 / self.load_ohm * 1e3)
        return vpp / (RMS if unit == "VRMS" else 1.0)

    def _edge(self, high: bool) -> Callable[[Arguments], None]:
        def setter(a: Arguments) -> None:
            s = self._core.settings
            most = MAX_EMF_V * self.display
            value = number(one(a), "V", -most, most) / self.display
            low_v = s.emf_offset_v - s.emf_vpp / 2 if high else value
            high_v = value if high else s.emf_offset_v + s.emf_vpp / 2
            if high_v - low_v < MIN_EMF_VPP:
                raise ScpiError(-221, "high level must be above low level")
            if max(abs(low_v), abs(high_v)) > MAX_EMF_V * (1 + 1e-9):
                raise ScpiError(-222)
            self._put(high_v - low_v, (high_v + low_v) / 2)

        return setter

    def _set_unit(self, a: Arguments) -> None:
        unit = choice(one(a), "VPP", "VRMS", "DBM")
        if unit == "DBM" and math.isinf(self.load_ohm):
            raise ScpiError(-221, "dBm needs a finite load")
        self._unit = unit

    def set_load(self, a: Arguments) -> None:
        if self.limits_on:
            raise ScpiError(-221, "load cannot be changed while voltage limits are on")
        ohm = number(one(a), "OHM", 1.0, 10e3, 50.0)
        self.load_ohm = ohm if math.isinf(ohm) else self.clip(ohm, 1.0, 10e3)
        if math.isinf(ohm) and self._unit == "DBM":
            self._unit = "VPP"
            self._report(ScpiError(-221, "amplitude units changed to Vpp due to high-Z load"))

    def set_auto_range(self, a: Arguments) -> None:
        once = one(a).strip().upper() == "ONCE"
        auto = not once and boolean(a[0])
        if auto or once:
            self.unfreeze()
        if not auto:
            if self._core.settings.auto_range:
                vpp = self._core.settings.emf_vpp * (1 - 1e-9)
                self._frozen_vpp = next(r for r in RANGES_VPP if r >= vpp)
            self._core.change(auto_range=False)

    def set_limit(self, high: bool) -> Callable[[Arguments], None]:
        def setter(a: Arguments) -> None:
            most = MAX_EMF_V * self.display
            value = self.clip(number(one(a), "V", -most, most), -most, most)
            before = self._low_limit_v, self._high_limit_v
            self._low_limit_v, self._high_limit_v = (before[0], value) if high else (value, before[1])
            try:
                self._present()
            except ScpiError:
                self._low_limit_v, self._high_limit_v = before
                raise

        return setter

    def set_limits_on(self, a: Arguments) -> None:
        self.limits_on = boolean(one(a))
        try:
            self._present()
        except ScpiError:
            self.limits_on = False
            raise

    def _present(self) -> None:
        s = self._core.settings
        self.check(s.emf_vpp, s.emf_offset_v, s.function)

    def commands(self, source: str) -> Sequence[Command]:
        """The commands, their patterns beginning with `source`."""
        level, voltage = source + "VOLTage[:LEVel][:IMMediate]", source + "VOLTage"

        def volts(swings: float) -> Callable[[Arguments], str]:
            def show(_: Arguments) -> str:
                s = self._core.settings
                return self._show((s.emf_offset_v + swings * s.emf_vpp / 2) * self.display)

            return show

        def amplitude(_: Arguments) -> str:
            return self._show(self._shown(self._core.settings.emf_vpp * self.display, self._unit))

        return [
            Command(level + "[:AMPLitude]", lambda a: self.set_vpp(one(a)), amplitude),
            Command(level + ":OFFSet", lambda a: self.set_offset(one(a)), volts(0)),
            Command(level + ":HIGH", self._edge(high=True), volts(+1)),
            Command(level + ":LOW", self._edge(high=False), volts(-1)),
            Command(voltage + ":UNIT", self._set_unit, lambda _: self._unit),
            Command(voltage + ":RANGe:AUTO", self.set_auto_range, lambda _: str(int(self._core.settings.auto_range))),
            Command(voltage + ":LIMit:HIGH", self.set_limit(high=True), lambda _: self._show(self._high_limit_v)),
            Command(voltage + ":LIMit:LOW", self.set_limit(high=False), lambda _: self._show(self._low_limit_v)),
            Command(voltage + ":LIMit:STATe", self.set_limits_on, lambda _: str(int(self.limits_on))),
            Command("OUTPut[1]:LOAD", self.set_load, lambda _: self._show(self.load_ohm)),
        ]
