"""Burst generators that speak SCPI: the settings that Keysight, Rigol and Tektronix share, with their headers as data."""

import math
from collections.abc import Iterable, Sequence
from typing import ClassVar

from drivers.generators.burst_generator import LEVEL_TOLERANCE_V, SMALLEST_VPP, BurstGenerator
from drivers.generators.expected_setting import Setting, between, near, word


class ScpiBurstGenerator(BurstGenerator):
    """A burst generator whose every setting is confirmed by its error queue and, where it matters, read back."""

    SOURCE: ClassVar[str] = ""
    """What stands before the headers of the source subsystem."""
    OUTPUT: ClassVar[str] = "OUTP"
    LOAD: ClassVar[str] = "OUTP:LOAD"
    RATE: ClassVar[str] = "FREQ"
    RATE_OF_SAMPLES: ClassVar[bool] = False
    """Whether `RATE` counts samples a second, or whole periods."""
    TRIGGER: ClassVar[str] = "*TRG"

    def idle_v(self) -> float:
        return self._scpi.ask_number(f"{self.SOURCE}VOLT:OFFS?")

    def _answer(self, name: str) -> str:
        return self._scpi.ask(f"{name}?")

    def _output_is_on(self) -> bool:
        return self._answer(self.OUTPUT).upper() in ("1", "ON")

    def _forget_errors(self) -> None:
        self._tell("*CLS")

    def _shared_state(self, rest_v: float) -> Iterable[Setting]:
        """What every dialect of these is asked by the same words."""
        source = self.SOURCE
        yield from (
            word(f"{source}VOLT:UNIT", "VPP"),
            near(f"{source}VOLT:OFFS", rest_v, LEVEL_TOLERANCE_V),
            word(f"{source}BURS:STAT", "1", "ON"),
            word(f"{source}BURS:MODE", "TRIG", "TRIGGERED"),
            between(f"{source}BURS:NCYC", 1, self.MOST_CYCLES),
        )

    def _load_state(self) -> Setting:
        return between(self.LOAD, 1e9, math.inf)

    def _declare_load(self) -> None:
        """High impedance: declared 50 ohm, the amplifier would get twice what is asked."""
        self._scpi.tell(f"{self.LOAD} INF")

    def _freeze_range(self, rest_v: float, span_v: float) -> None:
        """Hold the attenuator at the range of the largest sine this bench may ask for.

        A relay that switches later drops the output to 0 V for some milliseconds (E1441A guide p. 99).
        """
        source = self.SOURCE
        wide, small = f"{source}VOLT {span_v:.6f}", f"{source}VOLT {SMALLEST_VPP}"
        self._tell(f"{source}VOLT:OFFS {rest_v:.6f}", wide, f"{source}VOLT:RANG:AUTO OFF", small)

    def _tell(self, *commands: str) -> None:
        for command in commands:
            self._scpi.tell(command)

    def _output_on(self) -> None:
        self._tell(f"{self.OUTPUT} ON")

    def _offset_words(self, volts: float) -> str:
        return f"{self.SOURCE}VOLT:OFFS {volts:.6f}"

    def _set_offset(self, volts: float) -> None:
        self._tell(self._offset_words(volts))

    def _amplitude(self) -> float:
        return self._scpi.ask_number(f"{self.SOURCE}VOLT?")

    def _amplitude_words(self, vpp: float) -> str:
        return f"{self.SOURCE}VOLT {vpp:.6f}"

    def _set_amplitude(self, vpp: float) -> None:
        self._tell(self._amplitude_words(vpp))

    def _set_rate(self, rate_hz: float, size: int) -> None:
        wanted = rate_hz * size if self.RATE_OF_SAMPLES else rate_hz
        self._tell(f"{self.SOURCE}{self.RATE} {wanted:.10g}")
        seen = self._scpi.ask_number(f"{self.SOURCE}{self.RATE}?")
        self._agree(seen, wanted, 1e-6 * wanted + 1e-6, "the sample rate" if self.RATE_OF_SAMPLES else "the frequency")

    def _set_cycles(self, cycles: int) -> None:
        self._tell(f"{self.SOURCE}BURS:NCYC {cycles:d}")

    def _longest_s(self) -> float:
        if self._answer(f"{self.SOURCE}BURS:STAT").upper() not in ("1", "ON"):
            return 0.0
        return self._scpi.ask_number(f"{self.SOURCE}BURS:NCYC?") / self._scpi.ask_number(f"{self.SOURCE}FREQ?")

    def _trigger(self) -> None:
        self._tell(self.TRIGGER)

    def _say(self, words: str) -> None:
        self._tell(words)

    def _cut_words(self) -> Sequence[str]:
        # Burst mode that comes on anew waits for its trigger; in between the box plays its few millivolts.
        return f"{self.SOURCE}BURS:STAT OFF", f"{self.SOURCE}BURS:STAT ON"
