"""Rigol DG1000Z function generators, and what all older Rigol function generators share.

Peculiarities: a packet of a waveform carries 16 384 bytes, half of what the guide says, and 8 points at least; nothing
follows a packet in its message; the trigger source is set anew before each burst. VOLT:OFFS? replies 0 whatever a DC level
is, only the query APPL? reports it (the command APPL would switch the output on; the query does not); switches are replied
as ON and OFF; a download selects the waveform function by itself, and one of more than 8192 points the sample-rate mode, so
that mode is set from the start.

Sources: Menlo Systems' DG1000Z driver (packets, trigger source); DG1000Z Programming Guide 2-173 (DAC16), 2-185 (range hold).
"""

import math
from collections.abc import Iterable

import numpy as np

from drivers.errors import LinkError
from drivers.generators.arbitrary_waveform import SINE_CYCLE, Points, definite_length_block
from drivers.generators.expected_setting import (
    ExpectedSetting,
    NeutralSetting,
    expect_keyword,
    expect_range,
    expect_value,
)
from drivers.generators.scpi_burst_generator import ScpiBurstGenerator

FULL_SCALE = 16383
PACKET_POINTS = 8192


class RigolBurstGenerator(ScpiBurstGenerator):
    """A burst generator with Rigol's headers: its offset is read from `APPL?`, its trigger source set before each burst."""

    SOURCE_PREFIX = ":SOUR1:"
    OUTPUT_HEADER = ":OUTP1"
    LOAD_HEADER = ":OUTP1:LOAD"
    TRIGGER_COMMAND = ":SOUR1:BURS:TRIG"
    PANEL_LOCK = ":SYST:KLOC ON", ":SYST:KLOC OFF"

    def idle_level_v(self) -> float:
        answer = self._scpi.query(":SOUR1:APPL?")
        fields = answer.strip('"').split(",")
        try:
            return float(fields[3])
        except (IndexError, ValueError):
            self._scpi.link.clear()
            raise LinkError(
                f"{self._scpi.instrument}: ':SOUR1:APPL?' was answered by '{answer[:60]}', which names no offset; "
                f"check the cable at {self._scpi.link.name}"
            ) from None

    def _trigger(self) -> None:
        self._write_checked(":SOUR1:BURS:TRIG:SOUR MAN")
        super()._trigger()


class RigolDg(RigolBurstGenerator):
    """A `Source` that freezes its range and holds each point of a waveform until the next."""

    MODELS = ("DG10",)
    MODEL_PATTERN = r"DG10[2-6]2Z"
    PRODUCT_NAMES = "Rigol DG1000Z"
    CAN_FREEZE_RANGE = True
    RATE_HEADER = "FUNC:ARB:SRAT"
    RATE_IS_SAMPLE_RATE = True
    IDLE_AMPLITUDE_VPP = 0.01
    NEUTRAL_SETTINGS = (
        NeutralSetting(":OUTP1:POL", "NORM", ("NORM", "NORMAL")),
        NeutralSetting(":OUTP1:MODE", "NORM", ("NORM", "NORMAL"), optional=True),
        NeutralSetting(":COUP", "OFF", ("FREQ:OFF,PHASE:OFF,AMPL:OFF", "OFF"), optional=True),
        NeutralSetting(":SOUR1:TRACK", "OFF", ("OFF", "0"), optional=True),
        NeutralSetting(":SOUR2:TRACK", "OFF", ("OFF", "0"), optional=True),
        NeutralSetting(":SOUR1:SUM", "OFF", ("OFF", "0"), optional=True),
    )

    def _expected_settings(self, rest_v: float, low_v: float, high_v: float) -> Iterable[ExpectedSetting]:
        del low_v, high_v  # this model has no output limits
        yield self._expected_load()
        yield from self._common_expected_settings(rest_v)
        yield from (
            expect_keyword(":SOUR1:FUNC", "USER", "ARB"),
            expect_keyword(":SOUR1:FUNC:ARB:MODE", "SRAT", "SRATE"),
            expect_keyword(":SOUR1:SWE:STAT", "OFF", "0"),
            expect_value(":SOUR1:BURS:PHAS", 0.0, 1e-3),
            expect_keyword(":SOUR1:BURS:TRIG:SOUR", "MAN"),
            expect_keyword(":SOUR1:BURS:IDLE", "FPT"),
            expect_range(":SOUR1:VOLT", 0.0, 2 * self.IDLE_AMPLITUDE_VPP),
            expect_keyword(":SOUR1:VOLT:RANG:AUTO", "OFF", "0"),
        )

    def _configure(self, rest_v: float, low_v: float, high_v: float) -> None:
        self._set_high_impedance_load()
        self._write_checked(":SOUR1:VOLT:UNIT VPP", ":SOUR1:VOLT:RANG:AUTO ON", ":SOUR1:SWE:STAT OFF")
        self._write_checked(f":SOUR1:VOLT {self.IDLE_AMPLITUDE_VPP}", ":SOUR1:BURS:STAT OFF")
        self._write_checked(f":SOUR1:VOLT:OFFS {rest_v:.6f}", ":SOUR1:FUNC:ARB:MODE SRAT")
        self._stored_waveform = None
        self._load_waveform(SINE_CYCLE)
        self._write_checked(
            ":SOUR1:BURS:MODE TRIG", ":SOUR1:BURS:NCYC 1", ":SOUR1:BURS:PHAS 0", ":SOUR1:BURS:TRIG:SOUR MAN"
        )
        self._write_checked(":SOUR1:BURS:IDLE FPT", ":SOUR1:BURS:STAT ON")
        self._freeze_range(rest_v, high_v - low_v)

    def _download_waveform(self, points: Points) -> None:
        counts = np.rint((points + 1) / 2 * (FULL_SCALE - 1)).astype("<u2")  # an even span, so that 0 is a count
        packets = np.array_split(counts, math.ceil(counts.size / PACKET_POINTS))  # of equal size: none is too small
        for packet in packets:
            flag = "END" if packet is packets[-1] else "CON"
            block = definite_length_block(packet.tobytes())
            self._scpi.write_block_checked(f":SOUR1:TRAC:DATA:DAC16 VOLATILE,{flag},{block}")

    def _max_points(self) -> int:
        return 1_000_000
