"""Agilent/Keysight 33210A, 33220A and 33250A function generators.

As a 33500B, but: one volatile waveform of 14-bit integers that each download overwrites, a rate in whole periods, at most
50 000 cycles in a burst, no limits and no ABORt. A 33210A needs its option 002 for waveforms.

Sources: 33220A User's Guide p. 227 (burst phase of waveforms) and chapter DATA; 33210A guide p. 166, p. 215.
"""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from drivers.burst_generator import SMALLEST_VPP
from drivers.scpi_burst import ScpiBurstGenerator
from drivers.waveform import SINE, Points, block

FULL_SCALE = 8191


class Keysight33200(ScpiBurstGenerator):
    """A `Source` that freezes its range and holds each point of a waveform until the next."""

    MODELS = ("33210", "33220", "33250")
    SOLD_AS = "Agilent and Keysight 33210A, 33220A and 33250A"
    HOLDS_RANGE = True
    MOST_CYCLES = 50_000
    ARMED: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "FUNC": ("USER",),
        "FUNC:USER": ("VOLATILE",),
        "BURS:STAT": ("1",),
        "TRIG:SOUR": ("BUS",),
    }

    def _set_up(self, rest_v: float, low_v: float, high_v: float) -> None:
        self._tell("*CLS")
        self._declare_load()
        self._tell("VOLT:UNIT VPP", "UNIT:ANGL DEG", "VOLT:RANG:AUTO ON", "SWE:STAT OFF")
        self._tell(f"VOLT {SMALLEST_VPP}", f"VOLT:OFFS {rest_v:.6f}", "FORM:BORD NORM")
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
