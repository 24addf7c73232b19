"""Agilent/Keysight 33210A, 33220A and 33250A and Picotest G5100A function generators.

As a 33500B, but: one volatile waveform of 14-bit integers (33250A: 12-bit) that each download overwrites, a rate in whole
periods, at most 50 000 cycles in a burst, at least 20 mVpp into a high-impedance load, no limits and no ABORt. A 33210A
needs its option 002 for waveforms. A G5100A has the commands of a 33220A.

Sources: 33220A User's Guide p. 66, 186 (range hold), 182 (smallest amplitude), 227 (burst phase of waveforms), 234 to 241
(downloads); 33210A guide p. 166, 215; Picotest G5100A guide p. 166 (range hold); public G5100A drivers (NICOS, lantz).
"""

from collections.abc import Iterable

import numpy as np

from drivers.generators.arbitrary_waveform import SINE_CYCLE, Points, definite_length_block
from drivers.generators.expected_setting import (
    ExpectedSetting,
    NeutralSetting,
    expect_keyword,
    expect_range,
    expect_value,
)
from drivers.generators.scpi_burst_generator import ScpiBurstGenerator

FULL_SCALES = {"33250": 2047}
"""Largest converter value by model, where it is not 8191: a 33250A has 12 bits and rejects more."""


class Keysight33200(ScpiBurstGenerator):
    """A `Source` that freezes its range and holds each point of a waveform until the next."""

    MODELS = ("33210", "33220", "33250", "G5100")
    PRODUCT_NAMES = "Agilent and Keysight 33210A, 33220A and 33250A, and Picotest G5100A"
    CAN_FREEZE_RANGE = True
    AMPLITUDE_IS_WAVEFORM_SPAN = True
    IDLE_AMPLITUDE_VPP = MIN_AMPLITUDE_VPP = 0.02
    MAX_BURST_CYCLES = 50_000
    PANEL_LOCK = "SYST:REM", "SYST:LOC"
    NEUTRAL_SETTINGS = (NeutralSetting("OUTP:POL", "NORM", ("NORM", "NORMAL")),)

    def _expected_settings(self, rest_v: float, low_v: float, high_v: float) -> Iterable[ExpectedSetting]:
        del low_v, high_v  # this model has no output limits
        yield self._expected_load()
        yield from self._common_expected_settings(rest_v)
        yield from (
            expect_keyword("FUNC", "USER"),
            expect_keyword("FUNC:USER", "VOLATILE"),
            expect_keyword("UNIT:ANGL", "DEG"),
            expect_keyword("FORM:BORD", "NORM"),
            expect_keyword("SWE:STAT", "0"),
            expect_value("BURS:PHAS", 0.0, 1e-3),
            expect_keyword("TRIG:SOUR", "BUS"),
            expect_range("VOLT", 0.0, 2 * self.IDLE_AMPLITUDE_VPP),
            expect_keyword("VOLT:RANG:AUTO", "0"),
        )

    def _configure(self, rest_v: float, low_v: float, high_v: float) -> None:
        self._set_high_impedance_load()
        self._write_checked("VOLT:UNIT VPP", "UNIT:ANGL DEG", "VOLT:RANG:AUTO ON", "SWE:STAT OFF")
        self._write_checked(
            f"VOLT {self.IDLE_AMPLITUDE_VPP}", "BURS:STAT OFF", f"VOLT:OFFS {rest_v:.6f}", "FORM:BORD NORM"
        )
        self._stored_waveform = None
        self._load_waveform(SINE_CYCLE)
        self._write_checked("FUNC:USER VOLATILE", "FUNC USER", "FREQ 100")
        self._write_checked("BURS:MODE TRIG", "BURS:NCYC 1", "BURS:PHAS 0", "TRIG:SOUR BUS", "BURS:STAT ON")
        self._freeze_range(rest_v, high_v - low_v)

    def _download_waveform(self, points: Points) -> None:
        counts = np.rint(points * FULL_SCALES.get(self.identity.model[:5], 8191)).astype(">i2")
        self._write_checked(f"DATA:DAC VOLATILE,{definite_length_block(counts.tobytes())}")

    def _max_points(self) -> int:
        return 8192 if self.identity.model.startswith("33210") else 65_536
