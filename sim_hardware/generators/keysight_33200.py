"""An Agilent 33220A function generator: as a 33500B, with one volatile waveform, whole periods, and no way to abort.

Its own traps: no limits that would catch a wrong level, 50 000 cycles at most, integers in the big-endian order, and a
download that replaces what is playing at once.
"""

from collections.abc import Sequence

from sim_hardware.generators.keysight_33500 import SOURCE, KeysightBox
from sim_hardware.generators.scpi_generator import data_of
from sim_hardware.wires.scpi_engine import Arguments, Command, ScpiError, choice, one

MEMORY_POINTS = 65_536
FULL_SCALE = 8191


class Keysight33200(KeysightBox):
    """33210A, 33220A and 33250A."""

    MOST_CYCLES = 50_000.0
    ARBITRARY = "USER"

    @property
    def commands(self) -> Sequence[Command]:
        known = [c for c in super().commands if "LIMit" not in c.pattern]
        return [
            *known,
            Command("[SOURce[1]:]DATA:DAC", self._download),
            Command(SOURCE + "FUNCtion:USER", self._select, lambda _: "VOLATILE"),
        ]

    def _download(self, a: Arguments) -> None:
        if len(a) != 2:
            raise ScpiError(-109)
        choice(a[0], "VOLATILE")
        points = data_of(a[1], ">i2" if self._big_endian else "<i2", -FULL_SCALE, FULL_SCALE)
        if points.size > MEMORY_POINTS:
            raise ScpiError(-225)
        self._set_wave(points / FULL_SCALE)

    def _select(self, a: Arguments) -> None:
        choice(one(a), "VOLATILE")
        if self._core.settings.wave is None:
            raise ScpiError(-224)

    def _enter(self, function: str) -> None:
        if function == "ARB" and self._core.settings.wave is None:
            raise ScpiError(-224)
        super()._enter(function)
