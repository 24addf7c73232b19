"""Simulated Agilent, Keysight and Picotest function generators, after their programming guides.

Pitfalls on this bench: power-up and reset give 50 ohm with the output off; with 50 ohm declared a high-impedance input gets twice
the volts; APPLy turns the output on; another amplitude range and another function switch relays; leaving DC or burst starts a
sine at an unknown phase; an impossible value is clipped, not rejected; a waveform's name can be used once; clearing the memory
selects another waveform; the byte order of a download is reversed; polarity, gating and, with two channels, combining, coupling
and tracking are settings that persist.

33210A, 33220A, 33250A and G5100A have one volatile waveform and no abort: no limits that would reject a wrong level, 50 000
cycles at most, integers in big-endian order, a download that immediately replaces the waveform being played, at least 10 mVpp
into 50 ohm (PyMeasure agilent33220A at 32503b8: limits double with High Z, and values outside are clipped), and 12-bit integers
on a 33250A (Agilent's Visual Basic sample).
"""

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, ClassVar

import numpy as np

from model import Array
from sim_hardware import wires
from sim_hardware.generators.generator import InstrumentUnit, SimulatedGenerator
from sim_hardware.generators.scpi_generator import (
    OTHER_CHANNEL_V,
    SOURCE,
    SimulatedScpiGenerator,
    accept_keywords,
    decode_block,
)
from sim_hardware.generators.traits import UNKNOWN_HEADER, deviations

TRAITS = (UNKNOWN_HEADER,)
DEVIATIONS = deviations(range="", abort="", uneven="", filter="335|336|EDU|FG")

MEMORY_POINTS = 1_000_000
BUILT_IN_NAME = "EXP_RISE"
VOLATILE_POINTS = {"33210": 8192}
FULL_SCALE = {"33250": 2047}
"""Memory and largest integer of an older model, if different from 65 536 and 8191."""

BUILT_IN_WAVEFORM = 1 - 2 * np.exp(-5 * np.arange(100) / 100)


class SimulatedKeysightGenerator(SimulatedScpiGenerator):
    """Commands common to 33200 and 33500 instruments."""

    AMPLITUDE_IS_WAVEFORM_SPAN = True
    ARBITRARY_KEYWORD = "ARB"
    TRIGGER_KEYWORDS: ClassVar[Mapping[str, str]] = {"IMMediate": "IMM", "BUS": "BUS", "EXTernal": "EXT"}
    FREQUENCY_HEADER = "FREQuency[:CW]"
    TRIGGER_HEADER = "TRIGger[1]"
    LONGEST_DELAY_S = 85.0

    def __init__(self, generator: SimulatedGenerator, now: Callable[[], float], unit: InstrumentUnit) -> None:
        super().__init__(generator, now, unit)
        self._big_endian = True

    @property
    def commands(self) -> Sequence[wires.ScpiCommand]:
        period_s = self._generator.settings.period_s
        return [
            *self._levels.commands(SOURCE),
            *super().commands,
            self._number(SOURCE + "FREQuency:STARt", "start_hz", "HZ", 1e-6, self.MAX_FREQUENCY_HZ, 100.0),
            self._number(SOURCE + "FREQuency:STOP", "stop_hz", "HZ", 1e-6, self.MAX_FREQUENCY_HZ, 1e3),
            self._number(SOURCE + "SWEep:TIME", "sweep_s", "S", 1e-3, 250e3, 1.0),
            wires.ScpiCommand(SOURCE + "SWEep:SPACing", accept_keywords("LINear"), lambda _: "LIN"),
            self._mode_command(SOURCE + "SWEep:STATe", "sweep", "burst"),
            self._number(SOURCE + "BURSt:PHASe", "phase_deg", "DEG", -360.0, 360.0, 0.0),
            self._number("TRIGger[1]:DELay", "delay_s", "S", 0.0, self.LONGEST_DELAY_S, 0.0),
            self._number(SOURCE + "BURSt:INTernal:PERiod", "period_s", "S", 1e-6, 8e3, period_s),
            wires.ScpiCommand(SOURCE + "APPLy:SINusoid", partial(self._apply, function="SIN")),
            wires.ScpiCommand(SOURCE + "APPLy:DC", partial(self._apply, function="DC")),
            self._keyword_command("UNIT:ANGLe", "DEGree", "RADian"),
            self._choice("FORMat:BORDer", "_big_endian", {"NORMal": True, "SWAPped": False}),
        ]

    def _select_trigger(self, source: str) -> None:
        if source == "IMM" and np.isinf(self._generator.settings.cycles):
            self.queue_error(wires.ScpiError(-221, "turned off infinite burst to allow immediate trigger source"))
            self._generator.apply_settings(cycles=1.0)
        super()._select_trigger(source)

    def _apply(self, a: wires.Arguments, function: str) -> None:
        """Set frequency, amplitude and offset, end modes, set automatic range, turn the output on (APPLy)."""
        requested = {i: x for i, x in enumerate(a) if x.strip().upper() not in ("DEF", "DEFAULT")}
        self._levels.unfreeze_range()
        self._generator.apply_settings(burst=False, sweep=False, trigger="IMM", function=function)
        if 0 in requested:
            hertz = wires.parse_number(requested[0], "HZ", 1e-6, self.MAX_FREQUENCY_HZ)
            self._generator.apply_settings(frequency_hz=self._levels.clip(hertz, 1e-6, self.MAX_FREQUENCY_HZ))
        if 1 in requested and function == "SIN":
            self._levels.set_vpp(requested[1])
        if 2 in requested:
            self._levels.set_offset(requested[2])
        self._generator.apply_settings(on=True)


class SimulatedKeysight33500(SimulatedKeysightGenerator):
    """33500B, 33600A, EDU33210 and FG33530: named waveforms, a sample rate, a filter, output limits, ABORt."""

    LONGEST_DELAY_S = 1000.0

    def __init__(self, generator: SimulatedGenerator, now: Callable[[], float], unit: InstrumentUnit) -> None:
        super().__init__(generator, now, unit)
        self._reset_waveforms()
        self._triggers_again = True

    def trigger(self) -> None:
        if self._triggers_again:  # otherwise it is idle and waits for INITiate
            super().trigger()

    def _reset_waveforms(self) -> None:
        self._waveforms: dict[str, Array] = {}
        self._selected = BUILT_IN_NAME
        self._rate_hz = 40e3
        self._interpolated = True

    def reset(self) -> None:
        super().reset()
        self._triggers_again = True
        self._reset_waveforms()
        self._output_waveform(BUILT_IN_WAVEFORM)

    @property
    def commands(self) -> Sequence[wires.ScpiCommand]:
        shapes = {"STEP": True, "NORMal": True, "OFF": False}
        play = self._output_selected
        return [
            *super().commands,
            *self._other_channel_commands(),
            self._gate_command(),
            self._keyword_command("SYSTem:COMMunicate:RLSTate", "LOCal", "REMote", "RWLock"),
            self._setting("INITiate[1]:CONTinuous", "_triggers_again", wires.parse_boolean, self.format_switch),
            wires.ScpiCommand("ABORt[1]", lambda _: self._generator.abort()),
            wires.ScpiCommand(SOURCE + "DATA:ARBitrary[1]", self._download),
            wires.ScpiCommand(SOURCE + "DATA:VOLatile:CLEar", self._clear),
            wires.ScpiCommand(SOURCE + "DATA:VOLatile:FREE", None, lambda _: str(self._free_points)),
            wires.ScpiCommand(
                SOURCE + "DATA:VOLatile:CATalog", None, lambda _: ",".join(f'"{n}"' for n in self._names)
            ),
            wires.ScpiCommand(SOURCE + "FUNCtion:ARBitrary", self._select, lambda _: f'"{self._selected}"'),
            self._number(SOURCE + "FUNCtion:ARBitrary:SRATe", "_rate_hz", "SA/S", 1e-6, 250e6, 40e3, play),
            self._choice(SOURCE + "FUNCtion:ARBitrary:FILTer", "_interpolated", shapes, play),
            self._choice(
                SOURCE + "FUNCtion:ARBitrary:ADVance", "advances_by_trigger", {"SRATe": False, "TRIGger": True}
            ),
        ]

    def _other_channel_commands(self) -> list[wires.ScpiCommand]:
        """Return the commands of two-channel models: others answer -113."""
        if not re.search(r"33\d\d2", self._model):
            return []
        return [
            self._choice(SOURCE + "COMBine:FEED", "added_v", {"NONE": 0.0, "CH1": 0.0, "CH2": OTHER_CHANNEL_V}),
            self._stored_switch(SOURCE + "VOLTage:COUPle[:STATe]"),
            self._stored_switch(SOURCE + "FREQuency:COUPle[:STATe]"),
            self._stored_switch(SOURCE + "RATE:COUPle[:STATe]"),
            self._keyword_command(SOURCE + "TRACk", "OFF", "ON", "INVerted"),
            self._keyword_command("SOURce2:TRACk", "OFF", "ON", "INVerted"),
        ]

    @property
    def _names(self) -> list[str]:
        return [BUILT_IN_NAME, *self._waveforms]

    @property
    def _free_points(self) -> int:
        return MEMORY_POINTS - sum(w.size for w in self._waveforms.values())

    def _download(self, a: wires.Arguments) -> None:
        wires.check_argument_count(a, 2)
        if a[0].upper() in self._waveforms:
            raise wires.ScpiError(786)
        points = decode_block(a[1], ">f4" if self._big_endian else "<f4", -1.0, 1.0)
        if points.size > self._free_points:
            raise wires.ScpiError(-225)
        # A session stores the same waveform under many names until the memory is full.
        kept = (each for each in self._waveforms.values() if np.array_equal(each, points))
        self._waveforms[a[0].upper()] = next(kept, points)

    def _clear(self, _: wires.Arguments) -> None:
        self._waveforms.clear()
        self._selected = BUILT_IN_NAME
        self._output_waveform(BUILT_IN_WAVEFORM)

    def _select(self, a: wires.Arguments) -> None:
        name = wires.single_argument(a).strip("\"'").upper()
        if name not in self._names:
            raise wires.ScpiError(-224)
        self._selected = name
        self._output_selected()

    def _output_selected(self) -> None:
        self._output_waveform(self._waveforms.get(self._selected, BUILT_IN_WAVEFORM))

    def _output_waveform(self, points: Array) -> None:
        turn: dict[str, Any] = {}
        if self._generator.settings.function == "ARB":
            turn["frequency_hz"] = self._rate_hz / points.size
        self._load_waveform(points, interpolated=self._interpolated, **turn)

    def _filtered(self, points: Array) -> Array:
        return _overshooting(points) if self.traits.get("filter") == "rings" else points

    def _select_function(self, function: str) -> None:
        super()._select_function(function)
        if function == "ARB":
            self._output_selected()


def _overshooting(points: Array) -> Array:
    """Return the points with an overshoot of a quarter of each change, that decays over a hundredth of the period."""
    size = 2 * points.size  # twice the length: a product of spectra is a circular convolution
    decay = np.fft.rfft(np.exp(-np.arange(points.size) / (points.size / 100)), size)
    changes = np.fft.rfft(np.diff(points, prepend=points[0]), size)
    rung = points + 0.25 * np.fft.irfft(changes * decay, size)[: points.size]
    return np.asarray(rung)


class SimulatedKeysight33200(SimulatedKeysightGenerator):
    """33210A, 33220A, 33250A and G5100A."""

    MAX_BURST_CYCLES = 50_000.0
    ARBITRARY_KEYWORD = "USER"

    @property
    def _min_emf_vpp(self) -> float:
        return 0.02

    @property
    def _full_scale(self) -> int:
        return FULL_SCALE.get(self._model[:5], 8191)

    @property
    def commands(self) -> Sequence[wires.ScpiCommand]:
        supported = [c for c in super().commands if "LIMit" not in c.pattern]
        return [
            *supported,
            wires.ScpiCommand("SYSTem:REMote", lambda _: None),
            wires.ScpiCommand("SYSTem:LOCal", lambda _: None),
            wires.ScpiCommand(SOURCE + "DATA:DAC", self._download),
            wires.ScpiCommand(SOURCE + "FUNCtion:USER", self._select, lambda _: "VOLATILE"),
        ]

    def _download(self, a: wires.Arguments) -> None:
        wires.check_argument_count(a, 2)
        wires.match_keyword(a[0], "VOLATILE")
        points = decode_block(a[1], ">i2" if self._big_endian else "<i2", -self._full_scale, self._full_scale)
        if points.size > VOLATILE_POINTS.get(self._model[:5], 65_536):
            raise wires.ScpiError(-225)
        self._load_waveform(points / self._full_scale)

    def _select(self, a: wires.Arguments) -> None:
        wires.match_keyword(wires.single_argument(a), "VOLATILE")
        if self._generator.settings.wave is None:
            raise wires.ScpiError(-224)

    def _select_function(self, function: str) -> None:
        if function == "ARB" and self._generator.settings.wave is None:
            raise wires.ScpiError(-224)
        super()._select_function(function)


SIMULATED = {"keysight-33500": SimulatedKeysight33500, "keysight-33200": SimulatedKeysight33200}
