"""Keysight 33500B, 33600A, EDU33210 and FG33530 (Trueform) function generators.

Sources: 33500 Operating and Service Guide, chapters BURSt, DATA, FUNCtion, OUTPut, VOLTage; EDU33210 Series User's Guide
(EDU33212-90002) p. 84 to 94, 134 to 139, 151, 156; their pitfalls are collected in docs/generators.md.
"""

import re
from collections.abc import Iterable, Sequence

from drivers.generators.arbitrary_waveform import SINE_CYCLE, Points, definite_length_block
from drivers.generators.burst_generator import LEVEL_TOLERANCE_V
from drivers.generators.expected_setting import (
    ExpectedSetting,
    NeutralSetting,
    expect_keyword,
    expect_range,
    expect_value,
)
from drivers.generators.scpi_burst_generator import ScpiBurstGenerator

USB_POINTS = 200_000
"""Longest waveform over USB: above 1 MB a 33622A hung with pyvisa-py (its issue 286), and a point is four bytes."""

TWO_CHANNEL_SETTINGS = (
    NeutralSetting("SOUR1:COMB:FEED", "NONE", ("NONE",)),
    NeutralSetting("SOUR1:VOLT:COUP", "OFF", ("0", "OFF")),
    NeutralSetting("SOUR1:FREQ:COUP", "OFF", ("0", "OFF")),
    NeutralSetting("SOUR1:TRAC", "OFF", ("OFF", "0")),
    NeutralSetting("SOUR2:TRAC", "OFF", ("OFF", "0")),
)
"""With these, the second channel is added to the first, or moves it."""


def has_two_channels(model: str) -> bool:
    """Whether a model has two channels: the last of its five digits is 2."""
    digits = re.search(r"33\d{3}", model)
    return digits is not None and digits[0].endswith("2")


class Keysight33500(ScpiBurstGenerator):
    """A `Source` that smooths its waveforms, freezes its range and limits its own output."""

    MODELS = ("335", "336", "EDU332", "FG335")
    MODEL_PATTERN = r"33[56][12][12]|EDU3321[12]|FG3353[12]"
    PRODUCT_NAMES = "Keysight 33500B, 33600A, EDU33210 and FG33530"
    CAN_FREEZE_RANGE = True
    AMPLITUDE_IS_WAVEFORM_SPAN = True
    INTERPOLATES_POINTS = True
    NEUTRAL_SETTINGS = (
        NeutralSetting("OUTP:POL", "NORM", ("NORM", "NORMAL")),
        NeutralSetting("OUTP:MODE", "NORM", ("NORM", "NORMAL"), optional=True),
    )
    IDLE_AMPLITUDE_VPP = 0.01
    PANEL_LOCK = "SYST:COMM:RLST REM", "SYST:COMM:RLST LOC"
    RATE_HEADER = "FUNC:ARB:SRAT"
    RATE_IS_SAMPLE_RATE = True

    @property
    def _has_two_channels(self) -> bool:
        return has_two_channels(self.identity.model)

    def _neutral_settings(self) -> Iterable[NeutralSetting]:
        return self.NEUTRAL_SETTINGS + (TWO_CHANNEL_SETTINGS if self._has_two_channels else ())

    def _expected_settings(self, rest_v: float, low_v: float, high_v: float) -> Iterable[ExpectedSetting]:
        yield self._expected_load()
        yield from self._common_expected_settings(rest_v)
        yield from (
            expect_keyword("FUNC", "ARB"),
            expect_keyword("FUNC:ARB:FILT", "STEP"),
            expect_keyword("UNIT:ANGL", "DEG"),
            expect_keyword("FORM:BORD", "SWAP"),
            expect_value("BURS:PHAS", 0.0, 1e-3),
            expect_keyword("TRIG:SOUR", "BUS"),
            expect_range("VOLT", 0.0, 2 * self.IDLE_AMPLITUDE_VPP),
            expect_keyword("VOLT:RANG:AUTO", "0"),
            expect_value("VOLT:LIM:LOW", low_v - self.IDLE_AMPLITUDE_VPP / 2, LEVEL_TOLERANCE_V),
            expect_value("VOLT:LIM:HIGH", high_v + self.IDLE_AMPLITUDE_VPP / 2, LEVEL_TOLERANCE_V),
            expect_keyword("VOLT:LIM:STAT", "1"),
        )

    def _configure(self, rest_v: float, low_v: float, high_v: float) -> None:
        # Limits forbid changing the load, so they come off first and on last.
        self._write_checked("VOLT:LIM:STAT OFF")
        self._set_high_impedance_load()
        self._write_checked("VOLT:UNIT VPP", "UNIT:ANGL DEG", "VOLT:RANG:AUTO ON", "SWE:STAT OFF")
        # In this order no intermediate setting conflicts with the present ones.
        self._write_checked(
            f"VOLT {self.IDLE_AMPLITUDE_VPP}", "ABOR", f"VOLT:OFFS {rest_v:.6f}", "FORM:BORD SWAP", "DATA:VOL:CLE"
        )
        self._stored_waveform = None
        self._load_waveform(SINE_CYCLE)
        # The step filter smooths without overshoot, and is not touched again.
        self._write_checked("FUNC ARB", "FUNC:ARB:FILT STEP")
        self._write_checked("BURS:MODE TRIG", "BURS:NCYC 1", "BURS:PHAS 0", "TRIG:SOUR BUS", "BURS:STAT ON")
        self._freeze_range(rest_v, high_v - low_v)
        # The armed but idle burst counts against the limits, so they leave room for its small amplitude.
        low_v, high_v = low_v - self.IDLE_AMPLITUDE_VPP / 2, high_v + self.IDLE_AMPLITUDE_VPP / 2
        self._write_checked(f"VOLT:LIM:LOW {low_v:.6f}", f"VOLT:LIM:HIGH {high_v:.6f}", "VOLT:LIM:STAT ON")

    def _download_waveform(self, points: Points) -> None:
        # A name may be given once, and the memory ends at a million points; clearing it selects a built-in waveform,
        # which at this amplitude moves the idle level by half of SMALLEST_VPP.
        if self._scpi.query_float("DATA:VOL:FREE?") < points.size:
            self._write_checked("DATA:VOL:CLE")
        names = self._scpi.query("DATA:VOL:CAT?")
        name = next(f"TB{i}" for i in range(1, len(names) + 2) if f'"TB{i}"' not in names)
        self._write_checked(
            f"DATA:ARB {name},{definite_length_block(points.astype('<f4').tobytes())}", f"FUNC:ARB {name}"
        )

    def _abort_commands(self) -> Sequence[str]:
        return ("ABOR",)

    def _max_points(self) -> int:
        return USB_POINTS if self._scpi.link.name.upper().startswith("USB") else 1_000_000
