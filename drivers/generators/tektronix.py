"""Tektronix AFG3000, AFG31000 and AFG1000 function generators.

Peculiarities: no range that could be frozen; a trigger source whose default, the internal timer, repeats the burst for ever; a
built-in DC whose offset has no effect (AFG1000), which an idle burst does not need; and on an AFG1000 a load that can neither be
set nor queried remotely: set High Z once at the front panel. If it is not set, the amplifier's input gets twice the volts, which
is measured at arming, before high voltage is enabled. On an AFG31000 the level between bursts is a separate setting, and a
sequencer may be on in place of the generator.

Sources: AFG3000 Series Programmer Manual (DATA, TRIGger); the README of asvela/tektronix-func-gen for the AFG1022;
public AFG31000 drivers (Karabo: BURSt:IDLE; after programmer manual 077-148-803: SEQControl:STATe); tm_devices at db887dd.
"""

import re
from collections.abc import Iterable, Sequence

import numpy as np

from drivers.generators.burst import BurstGenerator
from drivers.generators.capabilities import Capabilities
from drivers.generators.dialect import ExpectedSetting, Levels, NeutralSetting, expect_keyword, expect_value
from drivers.generators.scpi import ScpiDialect
from drivers.generators.waveform import Points
from drivers.transport import definite_length_block

FULL_SCALE = 16382

NORMAL_POLARITY = NeutralSetting("OUTP1:POL", "NORM", ("NORM", "NORMAL"), optional=True)
NO_ADDED_SIGNAL = NeutralSetting("SOUR1:COMB:FEED", '""', ('""', "''", ""), optional=True)
NO_CONCURRENT_CHANNELS = tuple(
    NeutralSetting(f"{source}:{quantity}:CONC:STAT", "OFF", ("0", "OFF"), optional=True)
    for source in ("SOUR1", "SOUR2")
    for quantity in ("VOLT", "FREQ")
)
NO_SEQUENCER = NeutralSetting("SEQC:STAT", "OFF", ("0", "OFF"), optional=True)


class AfgDialect(ScpiDialect):
    """An AFG keeps one amplitude and carries every drive in the points of its edit memory."""

    capabilities = Capabilities(
        models=r"AFG1|AFG3(?!25)\d{3}(?!\d)|AFG31(02|05|10)[12]",
        product_names="Tektronix AFG3000, AFG31000 and AFG1000",
        holds_range=False,
        panel_lock=("SYST:KLOC:STAT ON", "SYST:KLOC:STAT OFF"),
    )
    SOURCE_PREFIX = "SOUR1:"
    OUTPUT_HEADER = "OUTP1:STAT"
    LOAD_HEADER = "OUTP1:IMP"

    @property
    def _is_afg31000(self) -> bool:
        return re.match(r"AFG31\d{3}", self.model) is not None

    @property
    def _is_afg1000(self) -> bool:
        return self.model.startswith("AFG1")

    @property
    def max_points(self) -> int:
        return 8192 if self._is_afg1000 else 65_536

    @property
    def neutral_settings(self) -> Sequence[NeutralSetting]:
        if self._is_afg1000:
            return (NORMAL_POLARITY,)
        coupled = () if re.match(r"AFG3\d+1(?!\d)", self.model) else NO_CONCURRENT_CHANNELS
        sequencer = (NO_SEQUENCER,) if self._is_afg31000 else ()
        return (NORMAL_POLARITY, NO_ADDED_SIGNAL, *coupled, *sequencer)

    def expected_settings(self, levels: Levels) -> Iterable[ExpectedSetting]:
        yield from self.common_settings(levels)
        yield from (
            expect_keyword("SOUR1:FUNC:SHAP", "EMEM", "EMEMORY", "EMEM1"),
            expect_keyword("SOUR1:FREQ:MODE", "CW", "FIX", "FIXED"),
            expect_value("SOUR1:BURS:TDEL", 0.0, 1e-9),
            expect_keyword("TRIG:SOUR", "EXT"),
        )
        if self._is_afg31000:
            yield expect_keyword("SOUR1:BURS:IDLE", "START", "STAR")
        if not self._is_afg1000:
            room_v = levels.span_v / 2
            yield self.expected_load
            yield expect_value("SOUR1:VOLT:LIM:LOW", levels.low_v - room_v)
            yield expect_value("SOUR1:VOLT:LIM:HIGH", levels.high_v + room_v)

    def set_up(self, levels: Levels) -> None:
        if not self._is_afg1000:
            self.write_checked("SOUR1:VOLT:LIM:LOW MIN", "SOUR1:VOLT:LIM:HIGH MAX")
            self.set_high_impedance_load()
        self.write_checked("SOUR1:VOLT:UNIT VPP", "SOUR1:FREQ:MODE CW")
        self.write_checked("SOUR1:VOLT 0.1", "SOUR1:BURS:STAT OFF", f"SOUR1:VOLT:OFFS {levels.rest_v:.6f}")

    def arm(self, levels: Levels) -> None:
        self.write_checked("SOUR1:FUNC:SHAP EMEM", "SOUR1:FREQ 100")
        # On the external trigger the burst waits for ever, and *TRG fires it all the same.
        self.write_checked("TRIG:SOUR EXT", "SOUR1:BURS:MODE TRIG", "SOUR1:BURS:NCYC 1", "SOUR1:BURS:TDEL 0")
        if self._is_afg31000:
            self.write_checked("SOUR1:BURS:IDLE START")  # the first point; the instrument may also wait at the last one
        self.write_checked("SOUR1:BURS:STAT ON", f"SOUR1:VOLT {levels.span_v:.6f}")
        if not self._is_afg1000:  # the limits count the amplitude at any idle level, although it does not play
            room_v = levels.span_v / 2
            self.write_checked(
                f"SOUR1:VOLT:LIM:LOW {levels.low_v - room_v:.6f}", f"SOUR1:VOLT:LIM:HIGH {levels.high_v + room_v:.6f}"
            )

    def download_waveform(self, points: Points) -> None:
        codes = np.rint((points + 1) / 2 * FULL_SCALE).astype(">u2")
        self.write_checked(f"DATA:DEF EMEM,{points.size}", f"DATA:DATA EMEM,{definite_length_block(codes.tobytes())}")


class TektronixAfg(BurstGenerator):
    """Driver of the Tektronix AFG3000, AFG31000 and AFG1000."""

    dialect_type = AfgDialect


DRIVERS = {"tektronix-afg": TektronixAfg}
