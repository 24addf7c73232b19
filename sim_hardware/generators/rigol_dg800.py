"""Simulated Rigol DG800, DG900, DG2000 or DG4000 function generator, after their programming guides.

Pitfalls: no range can be held, so that an amplitude may switch a relay; there is no sample-rate mode, and a waveform of fewer
points than the memory takes is stretched from its first to its last point (DG4000 Programming Guide, TRACe:DATA:DAC; DG1000Z
Programming Guide 2-173); limits count the amplitude wherever the burst idles. An upload to a DG4000 goes to the channel that
is selected on its front panel, selects the waveform there, and has no idle level to choose; its load is replied as INFINITY.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from sim_hardware.generators.generator import SimulatedGenerator
from sim_hardware.generators.rigol_dg import FULL_SCALE, MIN_PACKET_POINTS, PACKET_POINTS, SimulatedRigolDg, stretch
from sim_hardware.generators.scpi_generator import SOURCE_PATTERN, decode_block
from sim_hardware.wires.scpi_engine import (
    Arguments,
    ScpiCommand,
    ScpiError,
    check_argument_count,
    match_keyword,
    parse_number,
    single_argument,
)

DG4000_POINTS = 16_384
OTHER_CHANNEL_NOISE_V = 0.3
"""What the noise that a DG4000 can add to its output is taken as."""


class SimulatedRigolDg800(SimulatedRigolDg):
    """DG800, DG900, DG2000 and DG4000."""

    def __init__(
        self,
        generator: SimulatedGenerator,
        now: Callable[[], float],
        identity: str,
        traits: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(generator, now, identity, traits)
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
