"""Simulated Agilent 33210A/33220A/33250A: as a 33500B, with one volatile waveform and no abort.

Pitfalls: no limits that would reject a wrong level, 50 000 cycles at most, integers in big-endian order, and a download
that immediately replaces the waveform being played.
"""

from collections.abc import Sequence

from sim_hardware.generators.keysight_33500 import SimulatedKeysightGenerator
from sim_hardware.generators.scpi_generator import SOURCE_PATTERN, decode_block
from sim_hardware.wires.scpi_engine import (
    Arguments,
    ScpiCommand,
    ScpiError,
    check_argument_count,
    match_keyword,
    single_argument,
)

MEMORY_POINTS = 65_536
FULL_SCALE = 8191


class SimulatedKeysight33200(SimulatedKeysightGenerator):
    """33210A, 33220A and 33250A."""

    MAX_BURST_CYCLES = 50_000.0
    ARBITRARY_KEYWORD = "USER"

    @property
    def commands(self) -> Sequence[ScpiCommand]:
        known = [c for c in super().commands if "LIMit" not in c.pattern]
        return [
            *known,
            ScpiCommand(SOURCE_PATTERN + "DATA:DAC", self._download),
            ScpiCommand(SOURCE_PATTERN + "FUNCtion:USER", self._select, lambda _: "VOLATILE"),
        ]

    def _download(self, a: Arguments) -> None:
        check_argument_count(a, 2)
        match_keyword(a[0], "VOLATILE")
        points = decode_block(a[1], ">i2" if self._big_endian else "<i2", -FULL_SCALE, FULL_SCALE)
        if points.size > MEMORY_POINTS:
            raise ScpiError(-225)
        self._load_waveform(points / FULL_SCALE)

    def _select(self, a: Arguments) -> None:
        match_keyword(single_argument(a), "VOLATILE")
        if self._generator.settings.wave is None:
            raise ScpiError(-224)

    def _select_function(self, function: str) -> None:
        if function == "ARB" and self._generator.settings.wave is None:
            raise ScpiError(-224)
        super()._select_function(function)
