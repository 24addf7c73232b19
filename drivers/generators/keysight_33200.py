"""Agilent/Keysight 33210A, 33220A and 33250A function generators.

As a 33500B, but: one volatile waveform of 14-bit integers that each download overwrites, a rate in whole periods, at most
50 000 cycles in a burst, no limits and no ABORt. A 33210A needs its option 002 for waveforms.

Sources: 33220A User's Guide p. 227 (burst phase of waveforms) and chapter DATA; 33210A guide p. 166, p. 215.
"""

from collections.abc import Iterable

import numpy as np

from drivers.generators.arbitrary_waveform import SINE, Points, block
from drivers.generators.burst_generator import SMALLEST_VPP
from drivers.generators.expected_setting import Setting, between, near, word
from drivers.generators.scpi_burst_generator import ScpiBurstGenerator

FULL_SCALE = 8191


class Keysight33200(ScpiBurstGenerator):
    """A `Source` that freezes its range and holds each point of a waveform until the next."""

    MODELS = ("33210", "33220", "33250")
    SOLD_AS = "Agilent and Keysight 33210A, 33220A and 33250A"
    HOLDS_RANGE = True
    MOST_CYCLES = 50_000

    def _armed_state(self, rest_v: float, low_v: float, high_v: float) -> Iterable[Setting]:
        del low_v, high_v  # this box has no limits of its own
        yield self._load_state()
        yield from self._shared_state(rest_v)
        yield from (
            word("FUNC", "USER"),
            word("FUNC:USER", "VOLATILE"),
            word("UNIT:ANGL", "DEG"),
            word("FORM:BORD", "NORM"),
            word("SWE:STAT", "0"),
            near("BURS:PHAS", 0.0, 1e-3),
            word("TRIG:SOUR", "BUS"),
            between("VOLT", 0.0, 2 * SMALLEST_VPP),
            word("VOLT:RANG:AUTO", "0"),
        )

    def _set_up(self, rest_v: float, low_v: float, high_v: float) -> None:
        self._declare_load()
        self._tell("VOLT:UNIT VPP", "UNIT:ANGL DEG", "VOLT:RANG:AUTO ON", "SWE:STAT OFF")
        self._tell(f"VOLT {SMALLEST_VPP}", "BURS:STAT OFF", f"VOLT:OFFS {rest_v:.6f}", "FORM:BORD NORM")
        self._held = None
        self._load(SINE)
        self._tell("FUNC:USER VOLATILE", "FUNC USER", "FREQ 100")
        self._tell("BURS:MODE TRIG", "BURS:NCYC 1", "BURS:PHAS 0", "TRIG:SOUR BUS", "BURS:STAT ON")
        self._freeze_range(rest_v, high_v - low_v)

    def _store(self, points: Points) -> None:
        counts = np.rint(points * FULL_SCALE).astype(">i2")
        self._tell(f"DATA:DAC VOLATILE,{block(counts.tobytes())}")

    def _vpp(self, points: Points, full_v: float) -> float:
        return float(np.ptp(points)) * full_v  # this box means the waveform's own span

    def _most_points(self) -> int:
        return 8192 if self.identity.model.startswith("33210") else 65_536
