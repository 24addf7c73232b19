"""Rigol DG1000Z, DG800, DG900, DG2000 and DG4000 function generators.

Peculiarities: a packet of a waveform carries 16 384 bytes on a DG1000Z, half of the value in the guide, and 8 points at least;
other models, whose guides give 16 384 points, get two such packets, which suit both; nothing follows a packet in its message; the trigger source is set anew before each burst. VOLT:OFFS? replies 0 for any DC level; only the query
APPL? reports it (the command APPL would switch the output on; the query does not); switches are replied as ON and OFF; a download
to a DG1000Z selects the waveform function by itself, and one of more than 8192 points the sample-rate mode, so that mode is set
from the start.

DG800, DG900, DG2000 and DG4000 have no range that could be held, so that the amplitude is constant and every drive is in the
points; no sample-rate mode, so that a waveform with fewer points than the memory is stretched by the instrument, and is therefore
sent with the full number; limits that count the amplitude at any idle level. A DG4000 has neither limits nor a choice of the idle
level, and its upload goes to the channel selected on its front panel, independent of the command: the driver verifies that
channel 1 received it, and channel 2 did not.

Sources: Menlo Systems' DG1000Z driver (packets, trigger source); DG1000Z Programming Guide 2-173 (DAC16), 2-185 (range hold);
DG2000 Programming Guide (PGB12000, firmware 00.02.01), command lists of OUTPut, SOURce:BURSt, SOURce:FUNCtion,
SOURce:TRACe and SOURce:VOLTage, the same tree as DG800 and DG900; DG800 Programming Guide 2-43, 2-47, 2-64, 2-136; DG4000
Programming Guide, TRACe:DATA:DAC.
"""

import math
import re
from collections.abc import Iterable, Sequence

import numpy as np

from drivers.errors import InstrumentError, LinkError
from drivers.generators.burst import BurstGenerator
from drivers.generators.capabilities import Capabilities
from drivers.generators.dialect import ExpectedSetting, Levels, NeutralSetting, expect_keyword, expect_value
from drivers.generators.scpi import ScpiDialect
from drivers.generators.waveform import Points
from drivers.transport import definite_length_block

FULL_SCALE = 16383
PACKET_POINTS, MEMORY_POINTS = 8192, 16_384
"""Points of a packet, and of every waveform of a DG800, DG900, DG2000 or DG4000."""

PANEL_LOCK = ":SYST:KLOC ON", ":SYST:KLOC OFF"
NORMAL_POLARITY = NeutralSetting(":OUTP1:POL", "NORM", ("NORM", "NORMAL"))
NORMAL_GATE = NeutralSetting(":OUTP1:MODE", "NORM", ("NORM", "NORMAL"), optional=True)
NO_COUPLING = NeutralSetting(":COUP", "OFF", ("FREQ:OFF,PHASE:OFF,AMPL:OFF", "OFF"), optional=True)
OTHER_CHANNEL_OFF = (
    NO_COUPLING,
    *(
        NeutralSetting(header, "OFF", ("OFF", "0"), optional=True)
        for header in (":SOUR1:TRACK", ":SOUR2:TRACK", ":SOUR1:SUM")
    ),
)


def converter_codes(points: Points) -> bytes:
    """Return the points as unsigned 14-bit codes, little-endian, over an even span, so that 0 is a code."""
    return np.rint((points + 1) / 2 * (FULL_SCALE - 1)).astype("<u2").tobytes()


class RigolDialect(ScpiDialect):
    """Rigol's headers; the offset is read from `APPL?`, the trigger source set before each burst."""

    SOURCE_PREFIX = ":SOUR1:"
    OUTPUT_HEADER = ":OUTP1"
    LOAD_HEADER = ":OUTP1:LOAD"
    TRIGGER_COMMAND = ":SOUR1:BURS:TRIG"

    _packets_ended = False
    """Whether the last packet that the instrument received was the last one of a waveform; False if unknown."""

    def download_waveform(self, points: Points) -> None:
        # Pieces of equal size: none is too small.
        packets = np.array_split(points, math.ceil(points.size / PACKET_POINTS))
        # Packets of a download that failed, or of a program that was killed, would be played before this waveform: sent twice, it
        # ends them first. A shorter end would select a waveform also where this one is lost.
        times, self._packets_ended = 1 if self._packets_ended else 2, False
        for number, packet in enumerate(packets * times, 1):
            flag = "CON" if number % len(packets) else "END"
            block = definite_length_block(converter_codes(packet))
            self.scpi.write_block_checked(f":SOUR1:TRAC:DATA:DAC16 VOLATILE,{flag},{block}")
        self._packets_ended = True

    def idle_level_v(self) -> float:
        answer = self.scpi.query(":SOUR1:APPL?")
        fields = answer.strip('"').split(",")
        try:
            return float(fields[3])
        except (IndexError, ValueError):
            self.scpi.link.clear()
            raise LinkError(
                f"{self.scpi.instrument}: ':SOUR1:APPL?' was answered by '{answer[:60]}', which names no offset; "
                f"check the cable at {self.scpi.link.name}"
            ) from None

    def trigger(self) -> None:
        self.write_checked(":SOUR1:BURS:TRIG:SOUR MAN")
        super().trigger()


class Dg1000zDialect(RigolDialect):
    """A DG1000Z freezes its range and holds each point of a waveform until the next."""

    capabilities = Capabilities(
        models=r"DG10[2-6]2Z",
        product_names="Rigol DG1000Z",
        holds_range=True,
        idle_amplitude_vpp=0.01,
        panel_lock=PANEL_LOCK,
    )
    RATE_HEADER = "FUNC:ARB:SRAT"
    RATE_IS_SAMPLE_RATE = True
    neutral_settings = (NORMAL_POLARITY, NORMAL_GATE, *OTHER_CHANNEL_OFF)
    max_points = 1_000_000

    def expected_settings(self, levels: Levels) -> Iterable[ExpectedSetting]:
        yield self.expected_load
        yield from self.common_settings(levels)
        yield from (
            expect_keyword(":SOUR1:FUNC", "USER", "ARB"),
            expect_keyword(":SOUR1:FUNC:ARB:MODE", "SRAT", "SRATE"),
            expect_keyword(":SOUR1:SWE:STAT", "OFF", "0"),
            expect_value(":SOUR1:BURS:PHAS", 0.0, 1e-3),
            expect_value(":SOUR1:BURS:TDEL", 0.0, 1e-6),
            expect_keyword(":SOUR1:BURS:TRIG:SOUR", "MAN"),
            expect_keyword(":SOUR1:BURS:IDLE", "FPT"),
            expect_keyword(":SOUR1:VOLT:RANG:AUTO", "OFF", "0"),
        )

    def set_up(self, levels: Levels) -> None:
        self.set_high_impedance_load()
        self.write_checked(":SOUR1:VOLT:UNIT VPP", ":SOUR1:VOLT:RANG:AUTO ON", ":SOUR1:SWE:STAT OFF")
        self.write_checked(f":SOUR1:VOLT {self.capabilities.idle_amplitude_vpp}", ":SOUR1:BURS:STAT OFF")
        self.write_checked(f":SOUR1:VOLT:OFFS {levels.rest_v:.6f}", ":SOUR1:FUNC:ARB:MODE SRAT")

    def arm(self, levels: Levels) -> None:
        self.write_checked(":SOUR1:BURS:MODE TRIG", ":SOUR1:BURS:NCYC 1", ":SOUR1:BURS:PHAS 0")
        self.write_checked(
            ":SOUR1:BURS:TDEL 0", ":SOUR1:BURS:TRIG:SOUR MAN", ":SOUR1:BURS:IDLE FPT", ":SOUR1:BURS:STAT ON"
        )
        self.freeze_range(levels)


COUPLED_TRIGGERS = tuple(
    NeutralSetting(header, "OFF", ("OFF", "0"), optional=True) for header in (":COUP1:TRI", ":COUP2:TRI")
)
"""Settings of a DG800, DG900 and DG2000: a trigger of the other channel starts the burst of this one."""

NEUTRAL_DG4000 = (
    NORMAL_POLARITY,
    NeutralSetting(":OUTP1:NOIS", "OFF", ("OFF", "0"), optional=True),
    NeutralSetting(":SOUR1:MOD:STAT", "OFF", ("OFF", "0"), optional=True),
    NO_COUPLING,
)


class Dg800Dialect(RigolDialect):
    """A DG800 keeps one amplitude and carries every drive in the points of its waveform.

    A DG4000 has no limits and no choice of the idle level, which is the first point, and downloads to the channel selected on its
    front panel.
    """

    capabilities = Capabilities(
        models=r"DG8[123][12](?!.*PRO)|DG9[579]2(?!.*PRO)|DG2(05|07|10)2|DG4(06|10|16|20)2",
        product_names="Rigol DG800, DG900, DG2000 and DG4000",
        holds_range=False,
        panel_lock=PANEL_LOCK,
        models_that_lock_keys="DG[289]",
    )

    @property
    def _is_dg4000(self) -> bool:
        return self.model.startswith("DG4")

    @property
    def max_points(self) -> int:
        """Number of points of every waveform; the instrument stretches fewer points."""
        return MEMORY_POINTS

    @property
    def neutral_settings(self) -> Sequence[NeutralSetting]:
        if self._is_dg4000:
            return NEUTRAL_DG4000
        has_one_channel = re.match(r"DG8\d1", self.model)
        return (NORMAL_POLARITY, *(() if has_one_channel else (*OTHER_CHANNEL_OFF, *COUPLED_TRIGGERS)))

    def expected_settings(self, levels: Levels) -> Iterable[ExpectedSetting]:
        room_v = levels.span_v / 2
        yield self.expected_load
        yield from self.common_settings(levels)
        yield from (
            expect_keyword(":SOUR1:FUNC", "USER", "ARB"),
            expect_keyword(":SOUR1:SWE:STAT", "OFF", "0"),
            expect_value(":SOUR1:BURS:PHAS", 0.0, 1e-3),
            expect_value(":SOUR1:BURS:TDEL", 0.0, 1e-6),
            expect_keyword(":SOUR1:BURS:TRIG:SOUR", "MAN"),
        )
        if self._is_dg4000:
            yield expect_keyword(":SOUR2:FUNC", "SIN")
        else:
            yield expect_keyword(":SOUR1:BURS:IDLE", "FPT")
            yield expect_value(":OUTP1:VOLL:LOW", levels.low_v - room_v)
            yield expect_value(":OUTP1:VOLL:HIGH", levels.high_v + room_v)
            yield expect_keyword(":OUTP1:VOLL:STAT", "ON", "1")

    def set_up(self, levels: Levels) -> None:
        if not self._is_dg4000:
            self.write_checked(":OUTP1:VOLL:STAT OFF")
        self.set_high_impedance_load()
        self.write_checked(":SOUR1:VOLT:UNIT VPP", ":SOUR1:SWE:STAT OFF", ":SOUR1:VOLT 0.1", ":SOUR1:BURS:STAT OFF")
        self.write_checked(f":SOUR1:VOLT:OFFS {levels.rest_v:.6f}")
        if self._is_dg4000:  # a download selects the waveform of the receiving channel
            self.write_checked(":SOUR1:FUNC SIN", ":SOUR2:FUNC SIN")

    def arm(self, levels: Levels) -> None:
        self.write_checked(":SOUR1:FREQ 100", ":SOUR1:BURS:MODE TRIG", ":SOUR1:BURS:NCYC 1")
        self.write_checked(":SOUR1:BURS:PHAS 0", ":SOUR1:BURS:TDEL 0", ":SOUR1:BURS:TRIG:SOUR MAN")
        if not self._is_dg4000:
            self.write_checked(":SOUR1:BURS:IDLE FPT")
        self.write_checked(":SOUR1:BURS:STAT ON", f":SOUR1:VOLT {levels.span_v:.6f}")
        if not self._is_dg4000:
            room_v = levels.span_v / 2
            self.write_checked(
                f":OUTP1:VOLL:LOW {levels.low_v - room_v:.6f}",
                f":OUTP1:VOLL:HIGH {levels.high_v + room_v:.6f}",
                ":OUTP1:VOLL:STAT ON",
            )

    def download_waveform(self, points: Points) -> None:
        full = stretched(points, self.max_points)
        if not self._is_dg4000:
            super().download_waveform(full)
            return
        self.scpi.write_block_checked(f":TRAC:DATA:DAC VOLATILE,{definite_length_block(converter_codes(full))}")
        own, other = (self.query_setting(f":SOUR{channel}:FUNC").upper() for channel in (1, 2))
        if own not in ("USER", "ARB") or other in ("USER", "ARB"):
            raise InstrumentError(
                f"{self.scpi.instrument} took a waveform into channel 2, because that is selected on its front panel; it was "
                "not played. Press CH1 on the instrument, and arm again"
            )


def stretched(points: Points, size: int) -> Points:
    """Return a waveform of `size` points: itself, or interpolated on a straight line from each point to the next."""
    if points.size == size:
        return points
    closed = np.append(points, points[0])
    return np.asarray(np.interp(np.arange(size) * (points.size / size), np.arange(closed.size), closed))


class RigolDg(BurstGenerator):
    """Driver of the Rigol DG1000Z."""

    dialect_type = Dg1000zDialect


class RigolDg800(BurstGenerator):
    """Driver of the Rigol DG800, DG900, DG2000 and DG4000."""

    dialect_type = Dg800Dialect


DRIVERS = {"rigol-dg": RigolDg, "rigol-dg800": RigolDg800}
