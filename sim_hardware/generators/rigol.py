"""Simulated Rigol DG1000Z, DG800, DG900, DG2000 and DG4000 function generators, after their programming guides.

Pitfalls: VOLT:OFFS? replies 0 in DC mode for any level reported by APPL?; a download selects the waveform function, and beyond
8192 points the sample-rate mode; in the frequency mode fewer points are stretched to 8192; switches are replied as ON and OFF; a
packet carries 16 384 bytes, not points, and 8 points at least, later commands in its message are lost, and the trigger source
must be set anew after a burst (Menlo Systems' DG1000Z driver); the idle level of a burst is a setting of its own; polarity,
gating, coupling, tracking and the sum with the other channel are settings that persist.

DG800, DG900, DG2000 and DG4000: no range can be held, so that an amplitude may switch a relay; there is no sample-rate mode, and
a waveform of fewer points than the memory takes is stretched from its first to its last point (DG4000 Programming Guide,
TRACe:DATA:DAC; DG1000Z Programming Guide 2-173); limits count the amplitude at any idle level. An upload to a DG4000 goes to the
channel selected on its front panel, selects the waveform there, and has no choice of the idle level; its load is replied as
INFINITY.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from model import Array
from sim_hardware import wires
from sim_hardware.generators.generator import InstrumentUnit, SimulatedGenerator
from sim_hardware.generators.scpi_generator import SOURCE, SimulatedScpiGenerator, decode_block
from sim_hardware.generators.traits import RETIME, UNKNOWN_HEADER, Trait, deviations

FULL_SCALE = 16383
PACKET_POINTS, MIN_PACKET_POINTS = 8192, 8
FREQUENCY_MODE_POINTS = 8192
MEMORY_POINTS = 16_384
OTHER_CHANNEL_NOISE_V = 0.3
"""Volts that represent the noise that a DG4000 can add to its output."""
OTHER_FUNCTION = "SOURce2:FUNCtion[:SHAPe]"
PANEL_CHANNEL, KEY_LOCK = "SYSTem:CHANnel:CURrent", "SYSTem:KLOCk"
"""Commands of a DG4000 for the function of channel 2 and, in place of a key, the channel selected on its front panel."""

TRAITS = (
    UNKNOWN_HEADER,
    Trait(
        "noise",
        ("present", "absent"),
        "whether it has OUTPut:NOISe: seen on a DG4202 (firmware 00.01.14), in no guide of the other models",
        models="DG4",
    ),
    Trait(
        "trigger-source",
        ("kept", "lost-after-burst"),
        "whether the trigger source must be set anew after a burst: seen on a DG1000Z by Menlo Systems, not by others",
    ),
    RETIME,
)
DEVIATIONS = deviations(range="DG10", abort="DG10", uneven="DG10")


def stretch(points: Array, size: int) -> Array:
    """Return a waveform stretched to `size` points from its first to its last point, as by these instruments."""
    return np.asarray(np.interp(np.linspace(0, points.size - 1, size), np.arange(points.size), points))


def _decoded_points(block: str, fewest: int, most: int) -> Array:
    """Return the points of a download, -1 to 1. Raises ScpiError for another number of them."""
    points = decode_block(block, "<u2", 0, FULL_SCALE)
    if not fewest <= points.size <= most:
        raise wires.ScpiError(-225)
    return 2 * points / (FULL_SCALE - 1) - 1


class SimulatedRigolDg(SimulatedScpiGenerator):
    """DG1000Z."""

    MAX_FREQUENCY_HZ = 25e6
    MAX_BURST_CYCLES = 1e6
    TRIGGER_KEYWORDS: ClassVar[Mapping[str, str]] = {"INTernal": "IMM", "EXTernal": "EXT", "MANual": "BUS"}
    BLOCK_ENDS_MESSAGE = True
    BURST_HEADER = "BURSt[:STATe]"
    TRIGGER_HEADER = SOURCE + "BURSt:TRIGger"

    def __init__(self, generator: SimulatedGenerator, now: Callable[[], float], unit: InstrumentUnit) -> None:
        super().__init__(generator, now, unit)
        self._reset_waveform()

    def _reset_waveform(self) -> None:
        self._packets: list[Array] = []
        self._points = np.zeros(FREQUENCY_MODE_POINTS)
        self._sample_rate_mode = False
        self._rate_hz = 20e6
        self._trigger_lost = False

    def reset(self) -> None:
        super().reset()
        self._reset_waveform()

    def format_number(self, value: float) -> str:
        return "9.900000E+37" if math.isinf(value) else f"{value:.6E}"

    def format_switch(self, on: bool) -> str:
        return "ON" if on else "OFF"

    @property
    def commands(self) -> Sequence[wires.ScpiCommand]:
        levels = self._levels
        shared = [c for c in levels.commands(SOURCE) if "LIMit" not in c.pattern and ":RANGe" not in c.pattern]
        own_offset = next(c for c in shared if c.pattern.endswith(":OFFSet"))
        return [
            wires.ScpiCommand(own_offset.pattern, own_offset.set, self._query_offset),
            *(c for c in shared if c is not own_offset),
            *self._range_commands(),
            *self._other_channel_commands(),
            wires.ScpiCommand("OUTPut[1]:IMPedance", levels.set_load, lambda _: self.format_number(levels.load_ohm)),
            *super().commands,
            *self._rate_commands(),
            self._mode_command(SOURCE + "SWEep:STATe", "sweep", "burst"),
            self._number(SOURCE + "BURSt:PHASe", "phase_deg", "DEG", 0.0, 360.0, 0.0),
            self._number(SOURCE + "BURSt:TDELay", "delay_s", "S", 0.0, 100.0, 0.0),
            *self._idle_commands(),
            self._panel_lock_command(),
            *self._download_commands(),
            wires.ScpiCommand(SOURCE + "APPLy", None, lambda _: self._query_apply()),
            wires.ScpiCommand(SOURCE + "APPLy:DC", self._apply_dc),
        ]

    def _range_commands(self) -> list[wires.ScpiCommand]:
        core, levels, shown = self._generator, self._levels, self.format_switch
        return [
            wires.ScpiCommand(
                SOURCE + "VOLTage:RANGe:AUTO", levels.set_auto_range, lambda _: shown(core.settings.auto_range)
            ),
            self._gate_command(),
        ]

    def _rate_commands(self) -> list[wires.ScpiCommand]:
        return [
            self._choice(SOURCE + "FUNCtion:ARB:MODE", "_sample_rate_mode", {"FREQ": False, "SRATe": True}),
            self._number(SOURCE + "FUNCtion:ARB:SRATe", "_rate_hz", "SA/S", 1e-6, 60e6, 20e6, self._change_rate),
        ]

    def _panel_lock_command(self) -> wires.ScpiCommand:
        return self._stored_switch("SYSTem:KLOCk[:STATe]")

    def _idle_commands(self) -> list[wires.ScpiCommand]:
        return [self._choice(SOURCE + "BURSt:IDLE", "idle", {"FPT": None, "TOP": 1.0, "CENTER": 0.0, "BOTTOM": -1.0})]

    def _download_commands(self) -> list[wires.ScpiCommand]:
        return [wires.ScpiCommand(SOURCE + "TRACe:DATA:DAC[16]", self._download)]

    def trigger(self) -> None:
        if self._trigger_lost:
            return
        super().trigger()
        self._trigger_lost = self.traits.get("trigger-source") == "lost-after-burst"

    def _select_trigger(self, source: str) -> None:
        super()._select_trigger(source)
        self._trigger_lost = False

    def format_polarity(self, inverted: bool) -> str:
        return (
            "INVERTED" if inverted else "NORMAL"
        )  # in full, unlike a Keysight (DG1000Z and DG4000 programming guides)

    def _other_channel_commands(self) -> list[wires.ScpiCommand]:
        return [
            wires.ScpiCommand("COUPling[1][:STATe]", self._set_coupling, lambda _: self._query_coupling()),
            self._keyword_command(SOURCE + "TRACK", "OFF", "ON", "INVerted"),
            self._keyword_command("SOURce2:TRACK", "OFF", "ON", "INVerted"),
            self._sum_command(SOURCE + "SUM[:STATe]"),
        ]

    def _set_coupling(self, a: wires.Arguments) -> None:
        self._keyword_settings["COUPling"] = self.format_switch(wires.parse_boolean(wires.single_argument(a)))

    def _query_coupling(self) -> str:
        on = self._keyword_settings.get("COUPling", "OFF")
        return f"FREQ:{on},PHASE:{on},AMPL:{on}"

    def _select_function(self, function: str) -> None:
        super()._select_function(function)
        if function == "ARB":
            self._output_waveform()

    def _query_offset(self, _: wires.Arguments) -> str:
        s = self._generator.settings
        return self.format_number(0.0 if s.function == "DC" else s.emf_offset_v * self._levels.display_ratio)

    def _query_apply(self) -> str:
        s, shown = self._generator.settings, self._levels.display_ratio
        offset = self.format_number(s.emf_offset_v * shown)
        if s.function == "DC":
            return f'"DC,DEF,DEF,{offset}"'
        rate = self._rate_hz if s.function == "ARB" and self._sample_rate_mode else s.frequency_hz
        return f'"{self._function_keyword()},{self.format_number(rate)},{self.format_number(s.emf_vpp * shown)},{offset},{self.format_number(s.phase_deg)}"'

    def _apply_dc(self, a: wires.Arguments) -> None:
        wires.check_argument_count(a, 3)
        self._generator.apply_settings(burst=False, sweep=False, function="DC")
        self._levels.set_offset(a[2])
        self._generator.apply_settings(on=True)

    def _download(self, a: wires.Arguments) -> None:
        wires.check_argument_count(a, 3)
        wires.match_keyword(a[0], "VOLATILE")
        last = wires.match_keyword(a[1], "CON", "END") == "END"
        self._packets.append(_decoded_points(a[2], MIN_PACKET_POINTS, PACKET_POINTS))
        if not last:
            return
        self._points, self._packets = np.concatenate(self._packets), []
        if self._points.size > FREQUENCY_MODE_POINTS:
            self._sample_rate_mode = True
        elif not self._sample_rate_mode:
            self._points = stretch(self._points, FREQUENCY_MODE_POINTS)
        self._output_waveform(function="ARB")

    def _output_waveform(self, **settings: Any) -> None:
        if self._sample_rate_mode:
            settings["frequency_hz"] = self._rate_hz / self._points.size
        self._load_waveform(self._points, **settings)

    def _change_rate(self) -> None:
        if self._generator.settings.function == "ARB":
            self._output_waveform()


class SimulatedRigolDg800(SimulatedRigolDg):
    """DG800, DG900, DG2000 and DG4000."""

    def __init__(self, generator: SimulatedGenerator, now: Callable[[], float], unit: InstrumentUnit) -> None:
        super().__init__(generator, now, unit)
        self._is_dg4000 = self._model.startswith("DG4")

    def format_polarity(self, inverted: bool) -> str:
        return super().format_polarity(inverted) if self._model.startswith("DG4") else "INV" if inverted else "NORM"

    def _range_commands(self) -> list[wires.ScpiCommand]:
        levels = self._levels
        if not self._is_dg4000:
            return levels.limit_commands("OUTPut[1]:VOLLimit", "[:STATe]", self.format_switch)
        noise = self._choice("OUTPut[1]:NOISe[:STATe]", "added_v", {"OFF": 0.0, "ON": OTHER_CHANNEL_NOISE_V})
        return [
            wires.ScpiCommand("OUTPut[1]:LOAD", levels.set_load, lambda _: self._format_load()),
            self._keyword_command(OTHER_FUNCTION, "SINusoid", "USER"),
            self._keyword_command(PANEL_CHANNEL, "CH1", "CH2"),
            self._stored_switch(SOURCE + "MOD[:STATe]"),
            *([] if self.traits.get("noise") == "absent" else [noise]),
        ]

    def _format_load(self) -> str:
        ohm = self._levels.load_ohm
        return "INFINITY" if ohm == float("inf") else self.format_number(ohm)

    def _other_channel_commands(self) -> list[wires.ScpiCommand]:
        if self._is_dg4000:
            return [wires.ScpiCommand("COUPling[:STATe]", self._set_coupling, lambda _: self._query_coupling())]
        if not re.match(r"DG\d+2", self._model):
            return []
        triggers = [self._stored_switch(f"COUPling{channel}:TRIgger[:STATe]") for channel in ("[1]", "2")]
        return [*super()._other_channel_commands(), *triggers]

    def _panel_lock_command(self) -> wires.ScpiCommand:
        """Return the lock of keys by their names; of the names only ALL is understood (DG2000 Programming Guide, SYSTem:KLOCk)."""
        if self._is_dg4000:
            return super()._panel_lock_command()

        def lock(a: wires.Arguments) -> None:
            wires.check_argument_count(a, 2)
            wires.match_keyword(a[0], "ALL")
            self._keyword_settings[KEY_LOCK] = str(int(wires.parse_boolean(a[1])))

        return wires.ScpiCommand(KEY_LOCK, lock, lambda _: self._keyword_settings.get(KEY_LOCK, "0"))

    def _rate_commands(self) -> list[wires.ScpiCommand]:
        return []

    def _idle_commands(self) -> list[wires.ScpiCommand]:
        return [] if self._is_dg4000 else super()._idle_commands()

    def _download_commands(self) -> list[wires.ScpiCommand]:
        if self._is_dg4000:
            return [wires.ScpiCommand("[TRACe:]DATA:DAC", self._download_to_panel_channel)]
        return [wires.ScpiCommand(SOURCE + "TRACe:DATA:DAC16", self._download)]

    def _download(self, a: wires.Arguments) -> None:
        wires.check_argument_count(a, 3)
        wires.match_keyword(a[0], "VOLATILE")
        last = wires.match_keyword(a[1], "CON", "END") == "END"
        # A packet is no larger than on a DG1000Z, whose guide has the same value as theirs (DG800 Programming Guide 2-136).
        self._packets.append(_decoded_points(a[2], MIN_PACKET_POINTS, PACKET_POINTS))
        if last:
            points, self._packets = np.concatenate(self._packets), []
            self._play(points, MEMORY_POINTS)

    def _download_to_panel_channel(self, a: wires.Arguments) -> None:
        wires.check_argument_count(a, 2)
        wires.match_keyword(a[0], "VOLATILE")
        points = _decoded_points(a[1], 2, MEMORY_POINTS)
        if self._keyword_settings.get(PANEL_CHANNEL) == "CH2":
            self._keyword_settings[OTHER_FUNCTION] = "USER"
            return
        self._play(points, MEMORY_POINTS)

    def _play(self, points: Array, size: int) -> None:
        self._points = points if points.size == size else stretch(points, size)
        self._output_waveform(function="ARB")


SIMULATED = {"rigol-dg": SimulatedRigolDg, "rigol-dg800": SimulatedRigolDg800}
