"""Simulated Rigol DG1000Z, DG800, DG900, DG2000 and DG4000 function generators, after their programming guides.

Pitfalls: VOLT:OFFS? replies 0 in DC mode whatever the level that APPL? reports; a download selects the waveform function,
and beyond 8192 points the sample-rate mode; in the frequency mode fewer points are stretched to 8192; switches are replied
as ON and OFF; a packet carries 16 384 bytes, not points, and 8 points at least, what follows it in its message is lost, and
the trigger source must be set anew after a burst (Menlo Systems' DG1000Z driver); the idle level of a burst is a setting of its own; polarity, gating, coupling, tracking and the sum with the
other channel are settings that persist.

DG800, DG900, DG2000 and DG4000: no range can be held, so that an amplitude may switch a relay; there is no sample-rate mode, and a waveform of fewer
points than the memory takes is stretched from its first to its last point (DG4000 Programming Guide, TRACe:DATA:DAC; DG1000Z
Programming Guide 2-173); limits count the amplitude wherever the burst idles. An upload to a DG4000 goes to the channel that
is selected on its front panel, selects the waveform there, and has no idle level to choose; its load is replied as INFINITY.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, ClassVar

import numpy as np

from model import Array
from sim_hardware.generators.generator import InstrumentUnit, SimulatedGenerator
from sim_hardware.generators.scpi_generator import SOURCE_PATTERN, SimulatedScpiGenerator, decode_block
from sim_hardware.generators.traits import RETIME, UNKNOWN_HEADER, Trait, deviations
from sim_hardware.wires import (
    Arguments,
    ScpiCommand,
    ScpiError,
    check_argument_count,
    match_keyword,
    parse_boolean,
    parse_number,
    single_argument,
)

FULL_SCALE = 16383
PACKET_POINTS, MIN_PACKET_POINTS = 8192, 8
FREQUENCY_MODE_POINTS = 8192
DG4000_POINTS = 16_384
OTHER_CHANNEL_NOISE_V = 0.3
"""What the noise that a DG4000 can add to its output is taken as."""

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
    """Return a waveform with `size` points, as these instruments stretch a shorter one: from its first to its last."""
    return np.asarray(np.interp(np.linspace(0, points.size - 1, size), np.arange(points.size), points))


class SimulatedRigolDg(SimulatedScpiGenerator):
    """DG1000Z."""

    MAX_FREQUENCY_HZ = 25e6
    MAX_BURST_CYCLES = 1e6
    TRIGGER_KEYWORDS: ClassVar[Mapping[str, str]] = {"INTernal": "IMM", "EXTernal": "EXT", "MANual": "BUS"}
    BLOCK_ENDS_MESSAGE = True
    BURST_HEADER = "BURSt[:STATe]"
    TRIGGER_HEADER = SOURCE_PATTERN + "BURSt:TRIGger"

    def __init__(self, generator: SimulatedGenerator, now: Callable[[], float], unit: InstrumentUnit) -> None:
        super().__init__(generator, now, unit)
        self._reset_waveform()

    def _reset_waveform(self) -> None:
        self._packets: list[Array] = []
        self._points = np.zeros(FREQUENCY_MODE_POINTS)
        self._sample_rate_mode = False
        self._rate_hz = 20e6
        self._idle_keyword = "FPT"
        self._trigger_lost = False

    def reset(self) -> None:
        super().reset()
        self._reset_waveform()

    def format_number(self, value: float) -> str:
        return "9.900000E+37" if math.isinf(value) else f"{value:.6E}"

    def format_switch(self, on: bool) -> str:
        return "ON" if on else "OFF"

    @property
    def commands(self) -> Sequence[ScpiCommand]:
        levels = self._levels
        shared = [c for c in levels.commands(SOURCE_PATTERN) if "LIMit" not in c.pattern and ":RANGe" not in c.pattern]
        own_offset = next(c for c in shared if c.pattern.endswith(":OFFSet"))
        return [
            ScpiCommand(own_offset.pattern, own_offset.set, self._query_offset),
            *(c for c in shared if c is not own_offset),
            *self._range_commands(),
            *self._other_channel_commands(),
            ScpiCommand("OUTPut[1]:IMPedance", levels.set_load, lambda _: self.format_number(levels.load_ohm)),
            *super().commands,
            *self._rate_commands(),
            self._mode_command(SOURCE_PATTERN + "SWEep:STATe", "sweep", "burst"),
            self._numeric_command(SOURCE_PATTERN + "BURSt:PHASe", "phase_deg", "DEG", 0.0, 360.0, 0.0),
            *self._idle_commands(),
            self._stored_switch("SYSTem:KLOCk[:STATe]"),
            *self._download_commands(),
            ScpiCommand(SOURCE_PATTERN + "APPLy", None, lambda _: self._query_apply()),
            ScpiCommand(SOURCE_PATTERN + "APPLy:DC", self._apply_dc),
        ]

    def _range_commands(self) -> list[ScpiCommand]:
        return [
            ScpiCommand(
                SOURCE_PATTERN + "VOLTage:RANGe:AUTO",
                self._levels.set_auto_range,
                lambda _: self.format_switch(self._generator.settings.auto_range),
            ),
            self._gate_command(),
        ]

    def _rate_commands(self) -> list[ScpiCommand]:
        return [
            ScpiCommand(
                SOURCE_PATTERN + "FUNCtion:ARB:MODE",
                self._set_rate_mode,
                lambda _: "SRAT" if self._sample_rate_mode else "FREQ",
            ),
            ScpiCommand(
                SOURCE_PATTERN + "FUNCtion:ARB:SRATe", self._set_rate, lambda _: self.format_number(self._rate_hz)
            ),
        ]

    def _idle_commands(self) -> list[ScpiCommand]:
        return [ScpiCommand(SOURCE_PATTERN + "BURSt:IDLE", self._set_idle, lambda _: self._idle_keyword)]

    def _download_commands(self) -> list[ScpiCommand]:
        return [ScpiCommand(SOURCE_PATTERN + "TRACe:DATA:DAC[16]", self._download)]

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

    def _other_channel_commands(self) -> list[ScpiCommand]:
        return [
            ScpiCommand("COUPling[1][:STATe]", self._set_coupling, lambda _: self._query_coupling()),
            self._keyword_command(SOURCE_PATTERN + "TRACK", "OFF", "ON", "INVerted"),
            self._keyword_command("SOURce2:TRACK", "OFF", "ON", "INVerted"),
            ScpiCommand(
                SOURCE_PATTERN + "SUM[:STATe]",
                lambda a: self._add_other_channel(parse_boolean(single_argument(a))),
                lambda _: self.format_switch(bool(self._generator.settings.added_v)),
            ),
        ]

    def _set_coupling(self, a: Arguments) -> None:
        self._keyword_settings["COUPling"] = self.format_switch(parse_boolean(single_argument(a)))

    def _query_coupling(self) -> str:
        on = self._keyword_settings.get("COUPling", "OFF")
        return f"FREQ:{on},PHASE:{on},AMPL:{on}"

    def _select_function(self, function: str) -> None:
        super()._select_function(function)
        if function == "ARB":
            self._output_waveform()

    def _query_offset(self, _: Arguments) -> str:
        s = self._generator.settings
        return self.format_number(0.0 if s.function == "DC" else s.emf_offset_v * self._levels.display_ratio)

    def _query_apply(self) -> str:
        s, shown = self._generator.settings, self._levels.display_ratio
        offset = self.format_number(s.emf_offset_v * shown)
        if s.function == "DC":
            return f'"DC,DEF,DEF,{offset}"'
        rate = self._rate_hz if s.function == "ARB" and self._sample_rate_mode else s.frequency_hz
        return f'"{self._function_keyword()},{self.format_number(rate)},{self.format_number(s.emf_vpp * shown)},{offset},{self.format_number(s.phase_deg)}"'

    def _apply_dc(self, a: Arguments) -> None:
        check_argument_count(a, 3)
        self._generator.apply_settings(burst=False, sweep=False, function="DC")
        self._levels.set_offset(a[2])
        self._generator.apply_settings(on=True)

    def _set_idle(self, a: Arguments) -> None:
        self._idle_keyword = match_keyword(single_argument(a), "FPT", "TOP", "CENTER", "BOTTOM")
        levels = {"TOP": 1.0, "CENTER": 0.0, "BOTTOM": -1.0}
        self._generator.apply_settings(idle=levels.get(self._idle_keyword))

    def _download(self, a: Arguments) -> None:
        check_argument_count(a, 3)
        match_keyword(a[0], "VOLATILE")
        last = match_keyword(a[1], "CON", "END") == "END"
        points = decode_block(a[2], "<u2", 0, FULL_SCALE)
        if not MIN_PACKET_POINTS <= points.size <= PACKET_POINTS:
            raise ScpiError(-225)
        self._packets.append(2 * points / (FULL_SCALE - 1) - 1)
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

    def _set_rate_mode(self, a: Arguments) -> None:
        self._sample_rate_mode = match_keyword(single_argument(a), "FREQ", "SRATe") == "SRAT"

    def _set_rate(self, a: Arguments) -> None:
        self._rate_hz = self._levels.clip(parse_number(single_argument(a), "SA/S", 1e-6, 60e6, 20e6), 1e-6, 60e6)
        if self._generator.settings.function == "ARB":
            self._output_waveform()


class SimulatedRigolDg800(SimulatedRigolDg):
    """DG800, DG900, DG2000 and DG4000."""

    def __init__(self, generator: SimulatedGenerator, now: Callable[[], float], unit: InstrumentUnit) -> None:
        super().__init__(generator, now, unit)
        self._is_dg4000 = self._model.startswith("DG4")

    def _reset_waveform(self) -> None:
        super()._reset_waveform()
        self._delay_s = 0.0
        self._other_function = "SIN"
        self._panel_channel = "CH1"

    def format_polarity(self, inverted: bool) -> str:
        return super().format_polarity(inverted) if self._model.startswith("DG4") else "INV" if inverted else "NORM"

    def _range_commands(self) -> list[ScpiCommand]:
        levels = self._levels
        delay = ScpiCommand(
            SOURCE_PATTERN + "BURSt:TDELay", self._set_delay, lambda _: self.format_number(self._delay_s)
        )
        if self._is_dg4000:
            return [
                delay,
                ScpiCommand("OUTPut[1]:LOAD", levels.set_load, lambda _: self._format_load()),
                ScpiCommand("SOURce2:FUNCtion[:SHAPe]", self._set_other_function, lambda _: self._other_function),
                ScpiCommand("SYSTem:CHANnel:CURrent", self._select_channel, lambda _: self._panel_channel),
                self._stored_switch(SOURCE_PATTERN + "MOD[:STATe]"),
                *self._noise_commands(),
            ]
        return [
            delay,
            ScpiCommand(
                "OUTPut[1]:VOLLimit:LOW",
                partial(levels.set_limit, high=False),
                lambda _: self.format_number(levels.limits_v[0]),
            ),
            ScpiCommand(
                "OUTPut[1]:VOLLimit:HIGH",
                partial(levels.set_limit, high=True),
                lambda _: self.format_number(levels.limits_v[1]),
            ),
            ScpiCommand(
                "OUTPut[1]:VOLLimit[:STATe]", levels.set_limits_on, lambda _: self.format_switch(levels.limits_on)
            ),
        ]

    def _noise_commands(self) -> list[ScpiCommand]:
        if self.traits.get("noise") == "absent":
            return []

        def switch(a: Arguments) -> None:
            on = match_keyword(single_argument(a), "ON", "OFF") == "ON"
            self._generator.apply_settings(added_v=OTHER_CHANNEL_NOISE_V if on else 0.0)

        return [
            ScpiCommand(
                "OUTPut[1]:NOISe[:STATe]",
                switch,
                lambda _: self.format_switch(bool(self._generator.settings.added_v)),
            )
        ]

    def _format_load(self) -> str:
        ohm = self._levels.load_ohm
        return "INFINITY" if ohm == float("inf") else self.format_number(ohm)

    def _set_delay(self, a: Arguments) -> None:
        self._delay_s = self._levels.clip(parse_number(single_argument(a), "S"), 0.0, 100.0)

    def _set_other_function(self, a: Arguments) -> None:
        self._other_function = match_keyword(single_argument(a), "SINusoid", "USER")

    def _select_channel(self, a: Arguments) -> None:
        """Select the channel of the front panel, in the place of its key."""
        self._panel_channel = match_keyword(single_argument(a), "CH1", "CH2")

    def _other_channel_commands(self) -> list[ScpiCommand]:
        if self._is_dg4000:
            return [ScpiCommand("COUPling[:STATe]", self._set_coupling, lambda _: self._query_coupling())]
        return super()._other_channel_commands() if self._model[4:5] == "2" else []

    def _rate_commands(self) -> list[ScpiCommand]:
        return []

    def _idle_commands(self) -> list[ScpiCommand]:
        return [] if self._is_dg4000 else super()._idle_commands()

    def _download_commands(self) -> list[ScpiCommand]:
        if self._is_dg4000:
            return [ScpiCommand("[TRACe:]DATA:DAC", self._download_to_panel_channel)]
        return [ScpiCommand(SOURCE_PATTERN + "TRACe:DATA:DAC16", self._download)]

    def _download(self, a: Arguments) -> None:
        check_argument_count(a, 3)
        match_keyword(a[0], "VOLATILE")
        if match_keyword(a[1], "CON", "END") == "CON":
            raise ScpiError(-225)  # whether it takes several is not known
        points = decode_block(a[2], "<u2", 0, FULL_SCALE)
        if not MIN_PACKET_POINTS <= points.size <= PACKET_POINTS:
            raise ScpiError(-225)
        self._play(2 * points / (FULL_SCALE - 1) - 1, PACKET_POINTS)

    def _download_to_panel_channel(self, a: Arguments) -> None:
        check_argument_count(a, 2)
        match_keyword(a[0], "VOLATILE")
        points = decode_block(a[1], "<u2", 0, FULL_SCALE)
        if not 2 <= points.size <= DG4000_POINTS:
            raise ScpiError(-225)
        if self._panel_channel == "CH2":
            self._other_function = "USER"
            return
        self._play(2 * points / (FULL_SCALE - 1) - 1, DG4000_POINTS)

    def _play(self, points: Any, size: int) -> None:
        self._points = points if points.size == size else stretch(points, size)
        self._output_waveform(function="ARB")


SIMULATED = {"rigol-dg": SimulatedRigolDg, "rigol-dg800": SimulatedRigolDg800}
