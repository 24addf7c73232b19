"""Rigol DG1000Z and DG800 function generators.

What is their own: the offset that VOLT:OFFS? answers is 0 whatever a DC level is, only APPL? tells it (sending APPL would
switch the output on; asking does not); switches are answered ON and OFF; a download ends in the waveform function by
itself, and one of more than 8192 points in the sample-rate mode, so that mode is set from the start.

Sources: DG1000Z Programming Guide 2-173 (DAC16), 2-185 (range hold); DG800 Programming Guide 2-43, 2-47, 2-64.
"""

from collections.abc import Iterable

import numpy as np

from drivers.errors import LinkError
from drivers.generators.arbitrary_waveform import SINE, Points, block
from drivers.generators.burst_generator import LEVEL_TOLERANCE_V, SMALLEST_VPP
from drivers.generators.expected_setting import Setting, between, near, word
from drivers.generators.scpi_burst_generator import ScpiBurstGenerator

FULL_SCALE = 16383
PACKET_POINTS = 16_384


class RigolDg(ScpiBurstGenerator):
    """A `Source` that freezes its range and holds each point of a waveform until the next."""

    MODELS = ("DG10", "DG8")
    SOLD_AS = "Rigol DG1000Z and DG800"
    HOLDS_RANGE = True
    SOURCE = ":SOUR1:"
    OUTPUT = ":OUTP1"
    LOAD = ":OUTP1:LOAD"
    RATE = "FUNC:ARB:SRAT"
    RATE_OF_SAMPLES = True
    TRIGGER = ":SOUR1:BURS:TRIG"

    def _armed_state(self, rest_v: float, low_v: float, high_v: float) -> Iterable[Setting]:
        yield self._load_state()
        yield from self._shared_state(rest_v)
        yield from (
            word(":SOUR1:FUNC", "USER", "ARB"),
            word(":SOUR1:FUNC:ARB:MODE", "SRAT", "SRATE"),
            word(":SOUR1:SWE:STAT", "OFF", "0"),
            near(":SOUR1:BURS:PHAS", 0.0, 1e-3),
            word(":SOUR1:BURS:TRIG:SOUR", "MAN"),
            word(":SOUR1:BURS:IDLE", "CENTER"),
            between(":SOUR1:VOLT", 0.0, 2 * SMALLEST_VPP),
            word(":SOUR1:VOLT:RANG:AUTO", "OFF", "0"),
        )
        if self._limits_itself:
            yield near(":OUTP1:VOLL:LOW", low_v - SMALLEST_VPP / 2, LEVEL_TOLERANCE_V)
            yield near(":OUTP1:VOLL:HIGH", high_v + SMALLEST_VPP / 2, LEVEL_TOLERANCE_V)
            yield word(":OUTP1:VOLL:STAT", "ON", "1")

    def idle_v(self) -> float:
        answer = self._scpi.ask(":SOUR1:APPL?")
        fields = answer.strip('"').split(",")
        try:
            return float(fields[3])
        except (IndexError, ValueError):
            self._scpi.link.clear()
            raise LinkError(
                f"{self._scpi.instrument}: ':SOUR1:APPL?' was answered by '{answer[:60]}', which names no offset; "
                f"check the cable at {self._scpi.link.name}"
            ) from None

    @property
    def _limits_itself(self) -> bool:
        return self.identity.model.upper().startswith("DG8")

    def _set_up(self, rest_v: float, low_v: float, high_v: float) -> None:
        if self._limits_itself:
            self._tell(":OUTP1:VOLL:STAT OFF")
        self._declare_load()
        self._tell(":SOUR1:VOLT:UNIT VPP", ":SOUR1:VOLT:RANG:AUTO ON", ":SOUR1:SWE:STAT OFF")
        self._tell(f":SOUR1:VOLT {SMALLEST_VPP}", ":SOUR1:BURS:STAT OFF")
        self._tell(f":SOUR1:VOLT:OFFS {rest_v:.6f}", ":SOUR1:FUNC:ARB:MODE SRAT")
        self._held = None
        self._load(SINE)
        self._tell(":SOUR1:BURS:MODE TRIG", ":SOUR1:BURS:NCYC 1", ":SOUR1:BURS:PHAS 0", ":SOUR1:BURS:TRIG:SOUR MAN")
        self._tell(":SOUR1:BURS:IDLE CENTER", ":SOUR1:BURS:STAT ON")
        self._freeze_range(rest_v, high_v - low_v)
        if self._limits_itself:
            low_v, high_v = low_v - SMALLEST_VPP / 2, high_v + SMALLEST_VPP / 2
            self._tell(f":OUTP1:VOLL:LOW {low_v:.6f}", f":OUTP1:VOLL:HIGH {high_v:.6f}", ":OUTP1:VOLL:STAT ON")

    def _store(self, points: Points) -> None:
        counts = np.rint((points + 1) / 2 * (FULL_SCALE - 1)).astype("<u2")  # an even span, so that 0 is a count
        for first in range(0, counts.size, PACKET_POINTS):
            flag = "END" if first + PACKET_POINTS >= counts.size else "CON"
            packet = counts[first : first + PACKET_POINTS]
            self._tell(f":SOUR1:TRAC:DATA:DAC16 VOLATILE,{flag},{block(packet.tobytes())}")

    def _most_points(self) -> int:
        return PACKET_POINTS if self._limits_itself else 1_000_000
