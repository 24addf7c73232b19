"""Agilent, Keysight and Picotest function generators.

33500B, 33600A, EDU33210 and FG33530 (Trueform), and the older 33210A, 33220A, 33250A and G5100A. The older models differ from a
33500B: one volatile waveform of 14-bit integers (33250A: 12-bit), overwritten by each download, a rate in whole periods, at most
50 000 cycles in a burst, at least 20 mVpp into a high-impedance load, no limits and no ABORt. A 33210A needs its option 002 for
waveforms. A G5100A has the commands of a 33220A.

Sources: 33500 Operating and Service Guide, chapters BURSt, DATA, FUNCtion, OUTPut, VOLTage; EDU33210 Series User's Guide
(EDU33212-90002) p. 84 to 94, 134 to 139, 151, 156; 33220A User's Guide p. 66, 186 (range hold), 182 (smallest amplitude), 227
(burst phase of waveforms), 234 to 241 (downloads); 33210A guide p. 166, 215; Picotest G5100A guide p. 166 (range hold); public
G5100A drivers (NICOS, lantz). Pitfalls are collected in docs/generators.md.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from drivers.generators.burst import BurstGenerator
from drivers.generators.capabilities import Capabilities
from drivers.generators.dialect import (
    ConfirmedCommand,
    ExpectedSetting,
    Levels,
    NeutralSetting,
    expect_keyword,
    expect_value,
)
from drivers.generators.scpi import ScpiDialect
from drivers.generators.waveform import Points
from drivers.transport import definite_length_block

USB_POINTS = 200_000
"""Longest waveform over USB: above 1 MB a 33622A hung with pyvisa-py (its issue 286), and a point is four bytes."""

FULL_SCALES = {"33250": 2047}
"""Largest converter value by model, if different from 8191: a 33250A has 12 bits and rejects larger values."""

NORMAL_POLARITY = NeutralSetting("OUTP:POL", "NORM", ("NORM", "NORMAL"))
NORMAL_GATE = NeutralSetting("OUTP:MODE", "NORM", ("NORM", "NORMAL"), optional=True)
NO_DELAY = NeutralSetting("TRIG:DEL", "0", optional=True)
NORMAL_ADVANCE = NeutralSetting("FUNC:ARB:ADV", "SRAT", ("SRAT", "SRATE"), optional=True)
CONTINUOUS_TRIGGER = NeutralSetting("INIT1:CONT", "ON", ("1", "ON"))
RATE_COUPLING = NeutralSetting("SOUR1:RATE:COUP", "OFF", ("0", "OFF"))
"""Settings of a 33500B and 33600A: a trigger after the first one is ignored, and the sample rate follows the other channel."""
TWO_CHANNEL_SETTINGS = (
    NeutralSetting("SOUR1:COMB:FEED", "NONE", ("NONE",)),
    NeutralSetting("SOUR1:VOLT:COUP", "OFF", ("0", "OFF")),
    NeutralSetting("SOUR1:FREQ:COUP", "OFF", ("0", "OFF")),
    NeutralSetting("SOUR1:TRAC", "OFF", ("OFF", "0")),
    NeutralSetting("SOUR2:TRAC", "OFF", ("OFF", "0")),
)
"""Settings that add the second channel to the first, or couple both."""


class TrueformDialect(ScpiDialect):
    """A 33500B smooths its waveforms, freezes its range and limits its own output."""

    capabilities = Capabilities(
        models=r"33[56][12][12]|EDU3321[12]|FG3353[12]",
        product_names="Keysight 33500B, 33600A, EDU33210 and FG33530",
        holds_range=True,
        interpolates_points=True,
        amplitude_is_waveform_span=True,
        idle_amplitude_vpp=0.01,
        panel_lock=("SYST:COMM:RLST REM", "SYST:COMM:RLST LOC"),
    )
    RATE_HEADER = "FUNC:ARB:SRAT"
    RATE_IS_SAMPLE_RATE = True

    @property
    def max_points(self) -> int:
        return USB_POINTS if self.scpi.link.name.upper().startswith("USB") else 1_000_000

    @property
    def neutral_settings(self) -> Sequence[NeutralSetting]:
        has_two_channels = re.search(r"33\d\d2", self.model)
        is_33500 = self.model.startswith("33")
        # A query of an unknown header takes the time-out: it is not asked as optional where the header is known to exist.
        of_waveform = [replace(each, optional=not is_33500) for each in (NO_DELAY, NORMAL_ADVANCE)]
        return (
            NORMAL_POLARITY,
            NORMAL_GATE,
            *of_waveform,
            *((CONTINUOUS_TRIGGER,) if is_33500 else ()),
            *(TWO_CHANNEL_SETTINGS if has_two_channels else ()),
            *((RATE_COUPLING,) if is_33500 and has_two_channels else ()),
        )

    def expected_settings(self, levels: Levels) -> Iterable[ExpectedSetting]:
        low_v, high_v = self._limits_v(levels)
        yield self.expected_load
        yield from self.common_settings(levels)
        yield from (
            expect_keyword("FUNC", "ARB"),
            expect_keyword("FUNC:ARB:FILT", "STEP"),
            expect_keyword("UNIT:ANGL", "DEG"),
            expect_keyword("FORM:BORD", "SWAP"),
            expect_value("BURS:PHAS", 0.0, 1e-3),
            expect_keyword("TRIG:SOUR", "BUS"),
            expect_keyword("VOLT:RANG:AUTO", "0"),
            expect_value("VOLT:LIM:LOW", low_v),
            expect_value("VOLT:LIM:HIGH", high_v),
            expect_keyword("VOLT:LIM:STAT", "1"),
        )

    def _limits_v(self, levels: Levels) -> tuple[float, float]:
        """Return the output limits: the armed but idle burst counts against them, so that they include its small amplitude."""
        room_v = self.capabilities.idle_amplitude_vpp / 2
        return levels.low_v - room_v, levels.high_v + room_v

    def set_up(self, levels: Levels) -> None:
        # Limits prevent a change of the load, so they are removed first and set last.
        self.write_checked("VOLT:LIM:STAT OFF")
        self.set_high_impedance_load()
        self.write_checked("VOLT:UNIT VPP", "UNIT:ANGL DEG", "VOLT:RANG:AUTO ON", "SWE:STAT OFF")
        # In this order no intermediate setting conflicts with the present ones.
        self.write_checked(f"VOLT {self.capabilities.idle_amplitude_vpp}", "ABOR", f"VOLT:OFFS {levels.rest_v:.6f}")
        self.write_checked("FORM:BORD SWAP", "DATA:VOL:CLE")

    def arm(self, levels: Levels) -> None:
        # The step filter smooths without overshoot, and is never changed again.
        self.write_checked("FUNC ARB", "FUNC:ARB:FILT STEP")
        self.write_checked("BURS:MODE TRIG", "BURS:NCYC 1", "BURS:PHAS 0", "TRIG:SOUR BUS", "BURS:STAT ON")
        self.freeze_range(levels)
        low_v, high_v = self._limits_v(levels)
        self.write_checked(f"VOLT:LIM:LOW {low_v:.6f}", f"VOLT:LIM:HIGH {high_v:.6f}", "VOLT:LIM:STAT ON")

    def download_waveform(self, points: Points) -> None:
        # A name may be given once, and the memory ends at a million points; clearing it selects a built-in waveform,
        # which at the idle amplitude moves the idle level by half of that.
        if self.scpi.query_float("DATA:VOL:FREE?") < points.size:
            self.write_checked("DATA:VOL:CLE")
        names = self.scpi.query("DATA:VOL:CAT?")
        name = next(f"TB{i}" for i in range(1, len(names) + 2) if f'"TB{i}"' not in names)
        block = definite_length_block(points.astype("<f4").tobytes())
        self.write_checked(f"DATA:ARB {name},{block}", f"FUNC:ARB {name}")

    def abort_commands(self) -> Sequence[ConfirmedCommand]:
        return [self._command("ABOR")]


class Keysight33200Dialect(ScpiDialect):
    """A 33220A freezes its range and holds each point of a waveform until the next."""

    capabilities = Capabilities(
        models="33210|33220|33250|G5100",
        product_names="Agilent and Keysight 33210A, 33220A and 33250A, and Picotest G5100A",
        holds_range=True,
        amplitude_is_waveform_span=True,
        idle_amplitude_vpp=0.02,
        min_amplitude_vpp=0.02,
        max_burst_cycles=50_000,
        panel_lock=("SYST:REM", "SYST:LOC"),
    )
    neutral_settings = (NORMAL_POLARITY, NO_DELAY)

    @property
    def max_points(self) -> int:
        return 8192 if self.model.startswith("33210") else 65_536

    def expected_settings(self, levels: Levels) -> Iterable[ExpectedSetting]:
        yield self.expected_load
        yield from self.common_settings(levels)
        yield from (
            expect_keyword("FUNC", "USER"),
            expect_keyword("FUNC:USER", "VOLATILE"),
            expect_keyword("UNIT:ANGL", "DEG"),
            expect_keyword("FORM:BORD", "NORM"),
            expect_keyword("SWE:STAT", "0"),
            expect_value("BURS:PHAS", 0.0, 1e-3),
            expect_keyword("TRIG:SOUR", "BUS"),
            expect_keyword("VOLT:RANG:AUTO", "0"),
        )

    def set_up(self, levels: Levels) -> None:
        self.set_high_impedance_load()
        self.write_checked("VOLT:UNIT VPP", "UNIT:ANGL DEG", "VOLT:RANG:AUTO ON", "SWE:STAT OFF")
        self.write_checked(f"VOLT {self.capabilities.idle_amplitude_vpp}", "BURS:STAT OFF")
        self.write_checked(f"VOLT:OFFS {levels.rest_v:.6f}", "FORM:BORD NORM")

    def arm(self, levels: Levels) -> None:
        self.write_checked("FUNC:USER VOLATILE", "FUNC USER", "FREQ 100")
        self.write_checked("BURS:MODE TRIG", "BURS:NCYC 1", "BURS:PHAS 0", "TRIG:SOUR BUS", "BURS:STAT ON")
        self.freeze_range(levels)

    def download_waveform(self, points: Points) -> None:
        counts = np.rint(points * FULL_SCALES.get(self.model[:5], 8191)).astype(">i2")
        self.write_checked(f"DATA:DAC VOLATILE,{definite_length_block(counts.tobytes())}")


class Keysight33500(BurstGenerator):
    """Driver of the Keysight 33500B, 33600A, EDU33210 and FG33530."""

    dialect_type = TrueformDialect


class Keysight33200(BurstGenerator):
    """Driver of the Agilent and Keysight 33210A, 33220A and 33250A, and of the Picotest G5100A."""

    dialect_type = Keysight33200Dialect


DRIVERS = {"keysight-33500": Keysight33500, "keysight-33200": Keysight33200}
