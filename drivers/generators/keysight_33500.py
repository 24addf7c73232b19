"""Keysight 33500B/33600A (Trueform) function generators.

Sources: 33500 Operating and Service Guide, chapters BURSt, DATA, FUNCtion, OUTPut, VOLTage; traps of bench boxes are
collected in docs/generators.md.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from drivers.generators.arbitrary_waveform import SINE, Points, block
from drivers.generators.burst_generator import LEVEL_TOLERANCE_V, SMALLEST_VPP
from drivers.generators.expected_setting import Setting, between, near, word
from drivers.generators.scpi_burst_generator import ScpiBurstGenerator


class Keysight33500(ScpiBurstGenerator):
    """A `Source` that smooths its waveforms, freezes its range and limits its own output."""

    MODELS = ("335", "336")
    SOLD_AS = "Keysight 33500B and 33600A"
    HOLDS_RANGE = True
    SMOOTHS = True
    RATE = "FUNC:ARB:SRAT"
    RATE_OF_SAMPLES = True

    def _armed_state(self, rest_v: float, low_v: float, high_v: float) -> Iterable[Setting]:
        yield self._load_state()
        yield from self._shared_state(rest_v)
        yield from (
            word("FUNC", "ARB"),
            word("FUNC:ARB:FILT", "STEP"),
            word("UNIT:ANGL", "DEG"),
            word("FORM:BORD", "SWAP"),
            near("BURS:PHAS", 0.0, 1e-3),
            word("TRIG:SOUR", "BUS"),
            between("VOLT", 0.0, 2 * SMALLEST_VPP),
            word("VOLT:RANG:AUTO", "0"),
            near("VOLT:LIM:LOW", low_v - SMALLEST_VPP / 2, LEVEL_TOLERANCE_V),
            near("VOLT:LIM:HIGH", high_v + SMALLEST_VPP / 2, LEVEL_TOLERANCE_V),
            word("VOLT:LIM:STAT", "1"),
        )

    def _set_up(self, rest_v: float, low_v: float, high_v: float) -> None:
        # Limits forbid changing the load, so they come off first and on last.
        self._tell("VOLT:LIM:STAT OFF")
        self._declare_load()
        self._tell("VOLT:UNIT VPP", "UNIT:ANGL DEG", "VOLT:RANG:AUTO ON", "SWE:STAT OFF")
        # In this order no intermediate setting conflicts with the box's present one.
        self._tell(f"VOLT {SMALLEST_VPP}", "ABOR", f"VOLT:OFFS {rest_v:.6f}", "FORM:BORD SWAP", "DATA:VOL:CLE")
        self._held = None
        self._load(SINE)
        # The step filter smooths without overshoot, and is not touched again.
        self._tell("FUNC ARB", "FUNC:ARB:FILT STEP")
        self._tell("BURS:MODE TRIG", "BURS:NCYC 1", "BURS:PHAS 0", "TRIG:SOUR BUS", "BURS:STAT ON")
        self._freeze_range(rest_v, high_v - low_v)
        # The armed but idle burst counts against the box's limits, so they leave room for its small amplitude.
        low_v, high_v = low_v - SMALLEST_VPP / 2, high_v + SMALLEST_VPP / 2
        self._tell(f"VOLT:LIM:LOW {low_v:.6f}", f"VOLT:LIM:HIGH {high_v:.6f}", "VOLT:LIM:STAT ON")

    def _store(self, points: Points) -> None:
        # A name may be given once, and the memory ends at a million points; clearing it selects a built-in waveform,
        # which at this amplitude moves the idle level by half of SMALLEST_VPP.
        if self._scpi.ask_number("DATA:VOL:FREE?") < points.size:
            self._tell("DATA:VOL:CLE")
        names = self._scpi.ask("DATA:VOL:CAT?")
        name = next(f"TB{i}" for i in range(1, len(names) + 2) if f'"TB{i}"' not in names)
        self._tell(f"DATA:ARB {name},{block(points.astype('<f4').tobytes())}", f"FUNC:ARB {name}")

    def _vpp(self, points: Points, full_v: float) -> float:
        return float(np.ptp(points)) * full_v  # this box means the waveform's own span

    def _cut_words(self) -> Sequence[str]:
        return ("ABOR",)

    def _most_points(self) -> int:
        return 1_000_000
