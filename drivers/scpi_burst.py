"""Burst generators that speak SCPI: the settings that Keysight, Rigol and Tektronix share, with their headers as data."""

from collections.abc import Mapping
from typing import ClassVar

from drivers.burst_generator import SMALLEST_VPP, BurstGenerator


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
    ARMED: ClassVar[Mapping[str, tuple[str, ...]]]
    """Queries of the source subsystem, and the answers that an armed burst gives."""

    def idle_v(self) -> float:
        return self._scpi.ask_number(f"{self.SOURCE}VOLT:OFFS?")

    def _is_armed(self, *, output: bool = True) -> bool:
        return (
            (not output or self._scpi.ask(f"{self.OUTPUT}?").upper() in ("1", "ON"))
            and self._load_is_infinite()
            and all(self._scpi.ask(f"{query}?").upper() in answers for query, answers in self.ARMED.items())
        )

    def _load_is_infinite(self) -> bool:
        return self._scpi.ask_number(f"{self.LOAD}?") > 1e9

    def _declare_load(self) -> None:
        """High impedance: declared 50 ohm, the amplifier would get twice what is asked."""
        self._scpi.tell(f"{self.LOAD} INF")
        self._agree(self._scpi.ask_number(f"{self.LOAD}?"), 9.9e37, 1e36, "the load in ohm (infinite)")

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

    def _set_offset(self, volts: float) -> None:
        self._tell(f"{self.SOURCE}VOLT:OFFS {volts:.6f}")

    def _amplitude(self) -> float:
        return self._scpi.ask_number(f"{self.SOURCE}VOLT?")

    def _set_amplitude(self, vpp: float) -> None:
        self._tell(f"{self.SOURCE}VOLT {vpp:.6f}")

    def _set_rate(self, rate_hz: float, size: int) -> None:
        wanted = rate_hz * size if self.RATE_OF_SAMPLES else rate_hz
        self._tell(f"{self.SOURCE}{self.RATE} {wanted:.10g}")
        seen = self._scpi.ask_number(f"{self.SOURCE}{self.RATE}?")
        self._agree(seen, wanted, 1e-6 * wanted + 1e-6, "the sample rate" if self.RATE_OF_SAMPLES else "the frequency")

    def _set_cycles(self, cycles: int) -> None:
        self._tell(f"{self.SOURCE}BURS:NCYC {cycles:d}")

    def _longest_s(self) -> float:
        return self._scpi.ask_number(f"{self.SOURCE}BURS:NCYC?") / self._scpi.ask_number(f"{self.SOURCE}FREQ?")

    def _trigger(self) -> None:
        self._tell(self.TRIGGER)

    def _cut(self) -> None:
        # Burst mode that comes on anew waits for its trigger; in between the box plays its few millivolts.
        self._tell(f"{self.SOURCE}BURS:STAT OFF", f"{self.SOURCE}BURS:STAT ON")
