"""Tektronix AFG3000 and AFG1000 function generators.

What is their own: no range that could be frozen; a trigger source whose default, the internal timer, repeats the burst for
ever; a built-in DC whose offset does nothing (AFG1000), which an idle burst does without; and on an AFG1000 a load that
the wire can neither set nor ask: set High Z on its front panel once. If that is forgotten the amplifier's input sees
twice the volts, which arming measures before it lets high voltage on.

Sources: AFG3000 Series Programmer Manual (DATA, TRIGger); the README of asvela/tektronix-func-gen for the AFG1022.
"""

from collections.abc import Iterable

import numpy as np

from drivers.generators.arbitrary_waveform import SINE, Points, block
from drivers.generators.burst_generator import LEVEL_TOLERANCE_V
from drivers.generators.expected_setting import Setting, near, word
from drivers.generators.scpi_burst_generator import ScpiBurstGenerator

FULL_SCALE = 16382


class TektronixAfg(ScpiBurstGenerator):
    """A `Source` that keeps one amplitude and carries every drive in the points of its edit memory."""

    MODELS = ("AFG3", "AFG1")
    SOLD_AS = "Tektronix AFG3000 and AFG1000"
    HOLDS_RANGE = False
    SOURCE = "SOUR1:"
    OUTPUT = "OUTP1:STAT"
    LOAD = "OUTP1:IMP"

    @property
    def _small(self) -> bool:
        return self.identity.model.upper().startswith("AFG1")

    def _armed_state(self, rest_v: float, low_v: float, high_v: float) -> Iterable[Setting]:
        yield from self._shared_state(rest_v)
        yield from (
            word("SOUR1:FUNC:SHAP", "EMEM", "EMEMORY", "EMEM1"),
            word("SOUR1:FREQ:MODE", "CW", "FIX", "FIXED"),
            near("SOUR1:BURS:TDEL", 0.0, 1e-9),
            word("TRIG:SOUR", "EXT"),
            near("SOUR1:VOLT", high_v - low_v, LEVEL_TOLERANCE_V),
        )
        if not self._small:
            half_v = (high_v - low_v) / 2
            yield self._load_state()
            yield near("SOUR1:VOLT:LIM:LOW", low_v - half_v, LEVEL_TOLERANCE_V)
            yield near("SOUR1:VOLT:LIM:HIGH", high_v + half_v, LEVEL_TOLERANCE_V)

    def _set_up(self, rest_v: float, low_v: float, high_v: float) -> None:
        half_v = (high_v - low_v) / 2
        if not self._small:
            self._tell("SOUR1:VOLT:LIM:LOW MIN", "SOUR1:VOLT:LIM:HIGH MAX")
            self._declare_load()
        self._tell("SOUR1:VOLT:UNIT VPP", "SOUR1:FREQ:MODE CW")
        self._tell("SOUR1:VOLT 0.1", "SOUR1:BURS:STAT OFF", f"SOUR1:VOLT:OFFS {rest_v:.6f}")
        self._held = None
        self._load(SINE)
        self._tell("SOUR1:FUNC:SHAP EMEM", "SOUR1:FREQ 100")
        # On the external trigger the burst waits for ever, and *TRG fires it all the same.
        self._tell("TRIG:SOUR EXT", "SOUR1:BURS:MODE TRIG", "SOUR1:BURS:NCYC 1", "SOUR1:BURS:TDEL 0")
        self._tell("SOUR1:BURS:STAT ON", f"SOUR1:VOLT {2 * half_v:.6f}")
        if not self._small:  # the amplitude is there although it does not play, and counts wherever the burst idles
            self._tell(f"SOUR1:VOLT:LIM:LOW {low_v - half_v:.6f}", f"SOUR1:VOLT:LIM:HIGH {high_v + half_v:.6f}")

    def _store(self, points: Points) -> None:
        counts = np.rint((points + 1) / 2 * FULL_SCALE).astype(">u2")
        self._tell(f"DATA:DEF EMEM,{points.size}", f"DATA:DATA EMEM,{block(counts.tobytes())}")

    def _most_points(self) -> int:
        return 8192 if self._small else 65_536
