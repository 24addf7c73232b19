"""Simulated Agilent 33210A/33220A/33250A or Picotest G5100A: as a 33500B, with one volatile waveform and no abort.

Pitfalls: no limits that would reject a wrong level, 50 000 cycles at most, integers in big-endian order, a download that
immediately replaces the waveform being played, at least 10 mVpp into 50 ohm (PyMeasure agilent33220A at 32503b8: limits
double with High Z, and values outside are clipped), and 12-bit integers on a 33250A (Agilent's Visual Basic sample).
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

MEMORY_POINTS = {"33210": 8192}
FULL_SCALE = {"33250": 2047}
"""By model, where they are not 65 536 and 8191."""


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
    def commands(self) -> Sequence[ScpiCommand]:
        known = [c for c in super().commands if "LIMit" not in c.pattern]
        return [
            *known,
            ScpiCommand("SYSTem:REMote", lambda _: None),
            ScpiCommand("SYSTem:LOCal", lambda _: None),
            ScpiCommand(SOURCE_PATTERN + "DATA:DAC", self._download),
            ScpiCommand(SOURCE_PATTERN + "FUNCtion:USER", self._select, lambda _: "VOLATILE"),
        ]

    def _download(self, a: Arguments) -> None:
        check_argument_count(a, 2)
        match_keyword(a[0], "VOLATILE")
        points = decode_block(a[1], ">i2" if self._big_endian else "<i2", -self._full_scale, self._full_scale)
        if points.size > MEMORY_POINTS.get(self._model[:5], 65_536):
            raise ScpiError(-225)
        self._load_waveform(points / self._full_scale)

    def _select(self, a: Arguments) -> None:
        match_keyword(single_argument(a), "VOLATILE")
        if self._generator.settings.wave is None:
            raise ScpiError(-224)

    def _select_function(self, function: str) -> None:
        if function == "ARB" and self._generator.settings.wave is None:
            raise ScpiError(-224)
        super()._select_function(function)
