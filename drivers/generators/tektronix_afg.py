"""Tektronix AFG3000, AFG31000 and AFG1000 function generators.

Peculiarities: no range that could be frozen; a trigger source whose default, the internal timer, repeats the burst for
ever; a built-in DC whose offset has no effect (AFG1000), which an idle burst does not need; and on an AFG1000 a load that
can neither be set nor queried remotely: set High Z once at the front panel. If that is forgotten, the amplifier's input
gets twice the volts, which is measured at arming, before high voltage is enabled. On an AFG31000 the level between bursts is
a setting of its own, and a sequencer may be on in the place of the generator.

Sources: AFG3000 Series Programmer Manual (DATA, TRIGger); the README of asvela/tektronix-func-gen for the AFG1022;
public AFG31000 drivers (Karabo: BURSt:IDLE; after programmer manual 077-148-803: SEQControl:STATe); tm_devices at db887dd.
"""

import re
from collections.abc import Iterable

import numpy as np

from drivers.generators.arbitrary_waveform import SINE_CYCLE, Points, definite_length_block
from drivers.generators.burst_generator import LEVEL_TOLERANCE_V
from drivers.generators.expected_setting import ExpectedSetting, NeutralSetting, expect_keyword, expect_value
from drivers.generators.scpi_burst_generator import ScpiBurstGenerator

FULL_SCALE = 16382


class TektronixAfg(ScpiBurstGenerator):
    """A `Source` that keeps one amplitude and carries every drive in the points of its edit memory."""

    MODELS = ("AFG3", "AFG1")
    MODEL_PATTERN = r"AFG1|AFG3(?!25)\d{3}(?!\d)|AFG31(02|05|10)[12]"
    PRODUCT_NAMES = "Tektronix AFG3000, AFG31000 and AFG1000"
    CAN_FREEZE_RANGE = False
    SOURCE_PREFIX = "SOUR1:"
    OUTPUT_HEADER = "OUTP1:STAT"
    LOAD_HEADER = "OUTP1:IMP"
    PANEL_LOCK = "SYST:KLOC:STAT ON", "SYST:KLOC:STAT OFF"
    NEUTRAL_SETTINGS = (NeutralSetting("OUTP1:POL", "NORM", ("NORM", "NORMAL"), optional=True),)
    AFG3000_SETTINGS = (
        NeutralSetting("SOUR1:COMB:FEED", '""', ('""', "''", ""), optional=True),
        *(
            NeutralSetting(f"{source}:{quantity}:CONC:STAT", "OFF", ("0", "OFF"), optional=True)
            for source in ("SOUR1", "SOUR2")
            for quantity in ("VOLT", "FREQ")
        ),
    )

    AFG31000_SETTINGS = (NeutralSetting("SEQC:STAT", "OFF", ("0", "OFF"), optional=True),)

    @property
    def _is_afg31000(self) -> bool:
        return re.match(r"AFG31\d{3}", self.identity.model, re.IGNORECASE) is not None

    @property
    def _is_afg1000(self) -> bool:
        return self.identity.model.upper().startswith("AFG1")

    def _neutral_settings(self) -> Iterable[NeutralSetting]:
        yield from (*self.NEUTRAL_SETTINGS, *(() if self._is_afg1000 else self.AFG3000_SETTINGS))
        yield from self.AFG31000_SETTINGS if self._is_afg31000 else ()

    def _expected_settings(self, rest_v: float, low_v: float, high_v: float) -> Iterable[ExpectedSetting]:
        yield from self._common_expected_settings(rest_v)
        yield from (
            expect_keyword("SOUR1:FUNC:SHAP", "EMEM", "EMEMORY", "EMEM1"),
            expect_keyword("SOUR1:FREQ:MODE", "CW", "FIX", "FIXED"),
            expect_value("SOUR1:BURS:TDEL", 0.0, 1e-9),
            expect_keyword("TRIG:SOUR", "EXT"),
            expect_value("SOUR1:VOLT", high_v - low_v, LEVEL_TOLERANCE_V),
        )
        if self._is_afg31000:
            yield expect_keyword("SOUR1:BURS:IDLE", "START", "STAR")
        if not self._is_afg1000:
            half_v = (high_v - low_v) / 2
            yield self._expected_load()
            yield expect_value("SOUR1:VOLT:LIM:LOW", low_v - half_v, LEVEL_TOLERANCE_V)
            yield expect_value("SOUR1:VOLT:LIM:HIGH", high_v + half_v, LEVEL_TOLERANCE_V)

    def _configure(self, rest_v: float, low_v: float, high_v: float) -> None:
        half_v = (high_v - low_v) / 2
        if not self._is_afg1000:
            self._write_checked("SOUR1:VOLT:LIM:LOW MIN", "SOUR1:VOLT:LIM:HIGH MAX")
            self._set_high_impedance_load()
        self._write_checked("SOUR1:VOLT:UNIT VPP", "SOUR1:FREQ:MODE CW")
        self._write_checked("SOUR1:VOLT 0.1", "SOUR1:BURS:STAT OFF", f"SOUR1:VOLT:OFFS {rest_v:.6f}")
        self._stored_waveform = None
        self._load_waveform(SINE_CYCLE)
        self._write_checked("SOUR1:FUNC:SHAP EMEM", "SOUR1:FREQ 100")
        # On the external trigger the burst waits for ever, and *TRG fires it all the same.
        self._write_checked("TRIG:SOUR EXT", "SOUR1:BURS:MODE TRIG", "SOUR1:BURS:NCYC 1", "SOUR1:BURS:TDEL 0")
        if self._is_afg31000:
            self._write_checked("SOUR1:BURS:IDLE START")  # the first point; it may be the last one, too
        self._write_checked("SOUR1:BURS:STAT ON", f"SOUR1:VOLT {2 * half_v:.6f}")
        if (
            not self._is_afg1000
        ):  # the amplitude is there although it does not play, and counts wherever the burst idles
            self._write_checked(
                f"SOUR1:VOLT:LIM:LOW {low_v - half_v:.6f}", f"SOUR1:VOLT:LIM:HIGH {high_v + half_v:.6f}"
            )

    def _download_waveform(self, points: Points) -> None:
        counts = np.rint((points + 1) / 2 * FULL_SCALE).astype(">u2")
        self._write_checked(f"DATA:DEF EMEM,{points.size}", f"DATA:DATA EMEM,{definite_length_block(counts.tobytes())}")

    def _max_points(self) -> int:
        return 8192 if self._is_afg1000 else 65_536
