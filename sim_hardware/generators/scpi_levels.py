"""Amplitude, offset, load, range and limits of simulated SCPI generators: display, clipping, errors.

The output always drives through 50 ohm and displays the voltage at the *declared* load. Levels are stored as levels of the
open output, so a change of the declared load changes the display and not the volts.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import ClassVar

from sim_hardware import wires
from sim_hardware.generators.generator import RANGES_VPP, SimulatedGenerator

SOURCE_OHM = 50.0
MAX_EMF_V = 10.0
MIN_EMF_VPP = 2e-3  # 1 mVpp into 50 ohm
VPP_PER_VRMS = 2 * math.sqrt(2)


class OutputLevels:
    """The VOLTage commands and OUTPut:LOAD over a `SimulatedGenerator`.

    Args:
        generator: the output stage.
        queue_error: function that queues an error for an executed command, which is common.
        format_number: function that formats a number for this family.
        min_emf_vpp: smallest amplitude at the open output.
    """

    min_held_vpp: ClassVar[float] = 0.0
    """Smallest amplitude with a held range, if larger: a guide states that it may be larger, but not its value."""

    def __init__(
        self,
        generator: SimulatedGenerator,
        queue_error: Callable[[wires.ScpiError], None],
        format_number: Callable[[float], str] = wires.format_real,
        min_emf_vpp: float = MIN_EMF_VPP,
    ) -> None:
        self._generator = generator
        self._queue_error = queue_error
        self._format_number = format_number
        self._min_emf_vpp = min_emf_vpp
        self.reset()

    def reset(self) -> None:
        """Factory: 50 ohm, volts peak to peak, no limits, automatic range."""
        self.load_ohm = 50.0
        self._unit = "VPP"
        self.limits_on = False
        self._low_limit_v, self._high_limit_v = -MAX_EMF_V, MAX_EMF_V
        self._frozen_range_vpp = math.inf  # largest amplitude of the frozen range

    @property
    def display_ratio(self) -> float:
        """Displayed volts per volt of the open output."""
        return 1.0 if math.isinf(self.load_ohm) else self.load_ohm / (self.load_ohm + SOURCE_OHM)

    def clip(self, value: float, low: float, high: float) -> float:
        """Return the nearest possible value; queue an error if it differs."""
        if value > high * (1 + 1e-9) + 1e-12:
            self._queue_error(wires.ScpiError(-222, "value clipped to upper limit"))
        elif value < low - abs(low) * 1e-9 - 1e-12:
            self._queue_error(wires.ScpiError(-222, "value clipped to lower limit"))
        return min(max(value, low), high)

    def check_limits(self, emf_vpp: float, emf_offset_v: float, function: str) -> None:
        """Raise ScpiError if the output would leave the active limits."""
        if not self.limits_on:
            return
        wave = self._generator.settings.wave if function == "ARB" else None
        edges = (wave.low, wave.high) if wave else (0.0, 0.0) if function == "DC" else (-1.0, 1.0)
        low_v, high_v = (emf_offset_v + emf_vpp / 2 * edge for edge in edges)
        if high_v * self.display_ratio > self._high_limit_v + 1e-9:
            raise wires.ScpiError(-221, "output voltage exceeds the high limit")
        if low_v * self.display_ratio < self._low_limit_v - 1e-9:
            raise wires.ScpiError(-221, "output voltage exceeds the low limit")

    def unfreeze_range(self) -> None:
        """Make the range follow the amplitude again."""
        self._frozen_range_vpp = math.inf
        self._generator.apply_settings(auto_range=True)

    def set_vpp(self, text: str) -> None:
        """Amplitude in the unit it carries, or the present one."""
        unit = next((u for u in ("VPP", "VRMS", "DBM") if text.strip().upper().endswith(u)), self._unit)
        s = self._generator.settings
        top = min(2 * (MAX_EMF_V - abs(s.emf_offset_v)), self._frozen_range_vpp)
        floor = self._min_emf_vpp if math.isinf(self._frozen_range_vpp) else max(self._min_emf_vpp, self.min_held_vpp)
        low, high = (self._from_vpp(emf * self.display_ratio, unit) for emf in (floor, top))
        value = wires.parse_number(text, unit if unit in text.upper() else "V", low, high)
        emf = self._to_vpp(value, unit) / self.display_ratio
        self._apply_levels(self.clip(emf, floor, top), s.emf_offset_v)

    def set_offset(self, text: str) -> None:
        """Offset in volts."""
        s = self._generator.settings
        top = MAX_EMF_V - (s.emf_vpp / 2 if s.function != "DC" else 0.0)
        value = (
            wires.parse_number(text, "V", -top * self.display_ratio, top * self.display_ratio, 0.0) / self.display_ratio
        )
        self._apply_levels(s.emf_vpp, self.clip(value, -top, top))

    def _apply_levels(self, emf_vpp: float, emf_offset_v: float) -> None:
        self.check_limits(emf_vpp, emf_offset_v, self._generator.settings.function)
        self._generator.apply_settings(emf_vpp=emf_vpp, emf_offset_v=emf_offset_v)

    def _to_vpp(self, value: float, unit: str) -> float:
        """Displayed volts peak to peak of an amplitude in `unit`."""
        if unit == "DBM":
            if math.isinf(self.load_ohm):
                raise wires.ScpiError(-221, "dBm needs a finite load")
            return VPP_PER_VRMS * math.sqrt(self.load_ohm * 1e-3 * 10 ** (value / 10))
        return value * (VPP_PER_VRMS if unit == "VRMS" else 1.0)

    def _from_vpp(self, vpp: float, unit: str) -> float:
        """An amplitude in `unit` of displayed volts peak to peak."""
        if unit == "DBM" and not math.isinf(self.load_ohm):
            return 10 * math.log10((max(vpp, 1e-12) / VPP_PER_VRMS) ** 2 / self.load_ohm * 1e3)
        return vpp / (VPP_PER_VRMS if unit == "VRMS" else 1.0)

    def _set_level(self, a: wires.Arguments, high: bool) -> None:
        s = self._generator.settings
        most = MAX_EMF_V * self.display_ratio
        value = wires.parse_number(wires.single_argument(a), "V", -most, most) / self.display_ratio
        low_v = s.emf_offset_v - s.emf_vpp / 2 if high else value
        high_v = value if high else s.emf_offset_v + s.emf_vpp / 2
        if high_v - low_v < self._min_emf_vpp:
            raise wires.ScpiError(-221, "high level must be above low level")
        if max(abs(low_v), abs(high_v)) > MAX_EMF_V * (1 + 1e-9):
            raise wires.ScpiError(-222)
        self._apply_levels(high_v - low_v, (high_v + low_v) / 2)

    def _set_unit(self, a: wires.Arguments) -> None:
        unit = wires.match_keyword(wires.single_argument(a), "VPP", "VRMS", "DBM")
        if unit == "DBM" and math.isinf(self.load_ohm):
            raise wires.ScpiError(-221, "dBm needs a finite load")
        self._unit = unit

    def set_load(self, a: wires.Arguments) -> None:
        if self.limits_on:
            raise wires.ScpiError(-221, "load cannot be changed while voltage limits are on")
        ohm = wires.parse_number(wires.single_argument(a), "OHM", 1.0, 10e3, 50.0)
        self.load_ohm = ohm if math.isinf(ohm) else self.clip(ohm, 1.0, 10e3)
        if math.isinf(ohm) and self._unit == "DBM":
            self._unit = "VPP"
            self._queue_error(wires.ScpiError(-221, "amplitude units changed to Vpp due to high-Z load"))

    def set_auto_range(self, a: wires.Arguments) -> None:
        once = wires.single_argument(a).strip().upper() == "ONCE"
        auto = not once and wires.parse_boolean(a[0])
        if auto or once:
            self.unfreeze_range()
        if not auto:
            if self._generator.settings.auto_range:
                vpp = self._generator.settings.emf_vpp * (1 - 1e-9)
                self._frozen_range_vpp = next(r for r in RANGES_VPP if r >= vpp)
            self._generator.apply_settings(auto_range=False)

    def set_limit(self, a: wires.Arguments, high: bool) -> None:
        most = MAX_EMF_V * self.display_ratio
        value = self.clip(wires.parse_number(wires.single_argument(a), "V", -most, most), -most, most)
        before = self._low_limit_v, self._high_limit_v
        self._low_limit_v, self._high_limit_v = (before[0], value) if high else (value, before[1])
        try:
            self._check_present_levels()
        except wires.ScpiError:
            self._low_limit_v, self._high_limit_v = before
            raise

    def set_limits_on(self, a: wires.Arguments) -> None:
        self.limits_on = wires.parse_boolean(wires.single_argument(a))
        try:
            self._check_present_levels()
        except wires.ScpiError:
            self.limits_on = False
            raise

    def _check_present_levels(self) -> None:
        s = self._generator.settings
        self.check_limits(s.emf_vpp, s.emf_offset_v, s.function)

    def commands(self, source: str) -> Sequence[wires.ScpiCommand]:
        """Return the commands, with patterns that begin with `source`."""
        level, voltage = source + "VOLTage[:LEVel][:IMMediate]", source + "VOLTage"
        core, number = self._generator, self._format_number

        def shown(on: bool) -> str:
            return str(int(on))

        def volts(_: wires.Arguments, swings: float) -> str:
            s = core.settings
            return number((s.emf_offset_v + swings * s.emf_vpp / 2) * self.display_ratio)

        def amplitude(_: wires.Arguments) -> str:
            return number(self._from_vpp(core.settings.emf_vpp * self.display_ratio, self._unit))

        return [
            wires.ScpiCommand(level + "[:AMPLitude]", lambda a: self.set_vpp(wires.single_argument(a)), amplitude),
            wires.ScpiCommand(
                level + ":OFFSet", lambda a: self.set_offset(wires.single_argument(a)), partial(volts, swings=0)
            ),
            wires.ScpiCommand(level + ":HIGH", partial(self._set_level, high=True), partial(volts, swings=+1)),
            wires.ScpiCommand(level + ":LOW", partial(self._set_level, high=False), partial(volts, swings=-1)),
            wires.ScpiCommand(voltage + ":UNIT", self._set_unit, lambda _: self._unit),
            wires.ScpiCommand(voltage + ":RANGe:AUTO", self.set_auto_range, lambda _: shown(core.settings.auto_range)),
            *self.limit_commands(voltage + ":LIMit", ":STATe", shown),
            wires.ScpiCommand("OUTPut[1]:LOAD", self.set_load, lambda _: number(self.load_ohm)),
        ]

    def limit_commands(self, limit: str, state: str, format_switch: Callable[[bool], str]) -> list[wires.ScpiCommand]:
        """Return the commands of both limits, with patterns that begin with `limit`, and of their switch, which ends with `state`."""
        number = self._format_number
        return [
            wires.ScpiCommand(
                limit + ":HIGH", partial(self.set_limit, high=True), lambda _: number(self._high_limit_v)
            ),
            wires.ScpiCommand(limit + ":LOW", partial(self.set_limit, high=False), lambda _: number(self._low_limit_v)),
            wires.ScpiCommand(limit + state, self.set_limits_on, lambda _: format_switch(self.limits_on)),
        ]
