"""Rigol DG800, DG900, DG2000 and DG4000 function generators.

Peculiarities beside those of a DG1000Z: no range that could be held, so that the amplitude stays and every drive is in the
points; no sample-rate mode, so that a waveform with fewer points than the memory takes is stretched by the instrument, and is
therefore sent with exactly that number; limits that count the amplitude wherever the burst idles. A DG4000 has neither limits
nor a choice of the idle level, and its upload goes to the channel that is selected on its front panel, whatever the command
says: it is verified that channel 1 took it, and that channel 2 did not.

Sources: DG2000 Programming Guide (PGB12000, firmware 00.02.01), command lists of OUTPut, SOURce:BURSt, SOURce:FUNCtion,
SOURce:TRACe and SOURce:VOLTage, the same tree as DG800 and DG900; DG800 Programming Guide 2-43, 2-47, 2-64, 2-136; DG4000
Programming Guide, TRACe:DATA:DAC.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from drivers.errors import InstrumentError
from drivers.generators.arbitrary_waveform import SINE_CYCLE, Points, definite_length_block
from drivers.generators.burst_generator import LEVEL_TOLERANCE_V
from drivers.generators.expected_setting import ExpectedSetting, NeutralSetting, expect_keyword, expect_value
from drivers.generators.rigol_dg import FULL_SCALE, PACKET_POINTS, RigolBurstGenerator

NORMAL_POLARITY = NeutralSetting(":OUTP1:POL", "NORM", ("NORM", "NORMAL"))
OTHER_CHANNEL = (
    NeutralSetting(":COUP", "OFF", ("FREQ:OFF,PHASE:OFF,AMPL:OFF", "OFF"), optional=True),
    NeutralSetting(":SOUR1:TRACK", "OFF", ("OFF", "0"), optional=True),
    NeutralSetting(":SOUR2:TRACK", "OFF", ("OFF", "0"), optional=True),
    NeutralSetting(":SOUR1:SUM", "OFF", ("OFF", "0"), optional=True),
)


@dataclass(frozen=True, slots=True)
class RigolSeries:
    """What a series differs in.

    Args:
        points: of every waveform; fewer are stretched by the instrument.
        upload: the command of a download, before its block.
        has_output_limits: whether `OUTPut:VOLLimit` exists.
        has_idle_setting: whether `BURSt:IDLE` exists; without it the first point is the idle level.
        uploads_to_panel_channel: whether a download goes to the channel that is selected on the front panel.
        neutral_settings: settings of other users that persist.
    """

    points: int
    upload: str
    has_output_limits: bool
    has_idle_setting: bool
    uploads_to_panel_channel: bool
    neutral_settings: tuple[NeutralSetting, ...]


DG800 = RigolSeries(
    PACKET_POINTS,
    ":SOUR1:TRAC:DATA:DAC16 VOLATILE,END,",
    has_output_limits=True,
    has_idle_setting=True,
    uploads_to_panel_channel=False,
    neutral_settings=(NORMAL_POLARITY, *OTHER_CHANNEL),
)
DG4000 = RigolSeries(
    16_384,
    ":TRAC:DATA:DAC VOLATILE,",
    has_output_limits=False,
    has_idle_setting=False,
    uploads_to_panel_channel=True,
    neutral_settings=(
        NORMAL_POLARITY,
        NeutralSetting(":OUTP1:NOIS", "OFF", ("OFF", "0"), optional=True),
        NeutralSetting(":SOUR1:MOD:STAT", "OFF", ("OFF", "0"), optional=True),
        OTHER_CHANNEL[0],
    ),
)


class RigolDg800(RigolBurstGenerator):
    """A `Source` that keeps one amplitude and carries every drive in the points of its waveform."""

    MODELS = ("DG8", "DG9", "DG2", "DG4")
    MODEL_PATTERN = r"DG8[123][12](?!.*PRO)|DG9[579]2(?!.*PRO)|DG2(05|07|10)2|DG4(06|10|16|20)2"
    PRODUCT_NAMES = "Rigol DG800, DG900, DG2000 and DG4000"
    CAN_FREEZE_RANGE = False

    @property
    def _series(self) -> RigolSeries:
        return DG4000 if self.identity.model.upper().startswith("DG4") else DG800

    def _neutral_settings(self) -> Iterable[NeutralSetting]:
        return self._series.neutral_settings

    def _expected_settings(self, rest_v: float, low_v: float, high_v: float) -> Iterable[ExpectedSetting]:
        half_v = (high_v - low_v) / 2
        yield self._expected_load()
        yield from self._common_expected_settings(rest_v)
        yield from (
            expect_keyword(":SOUR1:FUNC", "USER", "ARB"),
            expect_keyword(":SOUR1:SWE:STAT", "OFF", "0"),
            expect_value(":SOUR1:BURS:PHAS", 0.0, 1e-3),
            expect_value(":SOUR1:BURS:TDEL", 0.0, 1e-6),
            expect_keyword(":SOUR1:BURS:TRIG:SOUR", "MAN"),
            expect_value(":SOUR1:VOLT", high_v - low_v, LEVEL_TOLERANCE_V),
        )
        if self._series.has_idle_setting:
            yield expect_keyword(":SOUR1:BURS:IDLE", "FPT")
        if self._series.uploads_to_panel_channel:
            yield expect_keyword(":SOUR2:FUNC", "SIN")
        if self._series.has_output_limits:
            yield expect_value(":OUTP1:VOLL:LOW", low_v - half_v, LEVEL_TOLERANCE_V)
            yield expect_value(":OUTP1:VOLL:HIGH", high_v + half_v, LEVEL_TOLERANCE_V)
            yield expect_keyword(":OUTP1:VOLL:STAT", "ON", "1")

    def _configure(self, rest_v: float, low_v: float, high_v: float) -> None:
        half_v = (high_v - low_v) / 2
        if self._series.has_output_limits:
            self._write_checked(":OUTP1:VOLL:STAT OFF")
        self._set_high_impedance_load()
        self._write_checked(":SOUR1:VOLT:UNIT VPP", ":SOUR1:SWE:STAT OFF", ":SOUR1:VOLT 0.1", ":SOUR1:BURS:STAT OFF")
        self._write_checked(f":SOUR1:VOLT:OFFS {rest_v:.6f}")
        self._stored_waveform = None
        if self._series.uploads_to_panel_channel:
            self._write_checked(
                ":SOUR1:FUNC SIN", ":SOUR2:FUNC SIN"
            )  # a download selects the waveform where it arrives
        self._load_waveform(SINE_CYCLE)
        self._write_checked(
            ":SOUR1:FREQ 100", ":SOUR1:BURS:MODE TRIG", ":SOUR1:BURS:NCYC 1", ":SOUR1:BURS:PHAS 0", ":SOUR1:BURS:TDEL 0"
        )
        self._write_checked(":SOUR1:BURS:TRIG:SOUR MAN")
        if self._series.has_idle_setting:
            self._write_checked(":SOUR1:BURS:IDLE FPT")
        self._write_checked(":SOUR1:BURS:STAT ON", f":SOUR1:VOLT {2 * half_v:.6f}")
        if self._series.has_output_limits:
            self._write_checked(
                f":OUTP1:VOLL:LOW {low_v - half_v:.6f}",
                f":OUTP1:VOLL:HIGH {high_v + half_v:.6f}",
                ":OUTP1:VOLL:STAT ON",
            )

    def _download_waveform(self, points: Points) -> None:
        stretched = _stretched(points, self._series.points)
        counts = np.rint((stretched + 1) / 2 * (FULL_SCALE - 1)).astype("<u2")  # an even span, so that 0 is a count
        self._scpi.write_block_checked(self._series.upload + definite_length_block(counts.tobytes()))
        if self._series.uploads_to_panel_channel:
            own, other = (self._query_setting(f":SOUR{channel}:FUNC").upper() for channel in (1, 2))
            if own not in ("USER", "ARB") or other in ("USER", "ARB"):
                raise InstrumentError(
                    f"{self._scpi.instrument} took a waveform into channel 2, because that is selected on its front panel; it was "
                    "not played. Press CH1 on the instrument, and arm again"
                )

    def _max_points(self) -> int:
        return self._series.points


def _stretched(points: Points, size: int) -> Points:
    """Return a waveform of `size` points: itself, or interpolated on a straight line from each point to the next."""
    if points.size == size:
        return points
    closed = np.append(points, points[0])
    stretched: Points = np.interp(np.arange(size) * (points.size / size), np.arange(closed.size), closed)
    return stretched
