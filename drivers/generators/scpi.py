"""SCPI dialect: settings that several families of generators have in common, with their headers as data."""

import math
from collections.abc import Iterable, Sequence
from functools import partial
from typing import ClassVar

from drivers.clock import Clock
from drivers.errors import InstrumentError, LinkError
from drivers.generators.capabilities import Capabilities
from drivers.generators.dialect import (
    LEVEL_TOLERANCE_V,
    ConfirmedCommand,
    ExpectedSetting,
    Levels,
    NeutralSetting,
    check_readback,
    expect_keyword,
    expect_range,
    expect_value,
)
from drivers.transport import ScpiSession


class ScpiDialect:
    """The common part of the `Dialect` of SCPI generators: commands are confirmed by the error queue and, if relevant, read back.

    A family adds `capabilities`, `max_points`, `expected_settings`, `set_up`, `arm` and `download_waveform`.
    """

    capabilities: ClassVar[Capabilities]

    SOURCE_PREFIX: ClassVar[str] = ""
    """Prefix of the headers of the source subsystem."""
    OUTPUT_HEADER: ClassVar[str] = "OUTP"
    LOAD_HEADER: ClassVar[str] = "OUTP:LOAD"
    RATE_HEADER: ClassVar[str] = "FREQ"
    RATE_IS_SAMPLE_RATE: ClassVar[bool] = False
    """Whether `RATE_HEADER` is in samples per second, or in whole periods."""
    TRIGGER_COMMAND: ClassVar[str] = "*TRG"

    def __init__(self, scpi: ScpiSession, clock: Clock, model: str) -> None:
        del clock
        self.scpi, self.model = scpi, model.upper()
        self._unknown_headers: set[str] = set()  # optional settings that this instrument has rejected as unknown

    @property
    def neutral_settings(self) -> Sequence[NeutralSetting]:
        """Persistent settings of other users; by default the polarity, if the instrument has it."""
        return (NeutralSetting("OUTP:POL", "NORM", ("NORM", "NORMAL"), optional=True),)

    def write_checked(self, *commands: str) -> None:
        """Send commands one by one, each confirmed by the error queue."""
        for command in commands:
            self.scpi.write_checked(command)

    def query_setting(self, name: str) -> str:
        return self.scpi.query(f"{name}?")

    def query_optional_setting(self, name: str) -> str | None:
        if name in self._unknown_headers:
            return None
        answer = self.scpi.query_optional(f"{name}?")
        if answer is None:
            self._unknown_headers.add(name)
        return answer

    def reset_foreign_settings(self) -> None:
        for setting in self.neutral_settings:
            if not setting.optional or self.query_optional_setting(setting.header) is not None:
                self.write_checked(f"{setting.header} {setting.value}")

    def is_output_on(self) -> bool:
        return self.query_setting(self.OUTPUT_HEADER).upper() in ("1", "ON")

    def enable_output(self) -> None:
        self.write_checked(f"{self.OUTPUT_HEADER} ON")

    def clear_errors(self) -> None:
        self.write_checked("*CLS")

    def forget_waveforms(self) -> None:
        """Do nothing: only the last downloaded waveform is used."""

    def byte_order(self, new: str = "") -> str:
        del new
        return ""

    def idle_level_v(self) -> float:
        return self.scpi.query_float(f"{self.SOURCE_PREFIX}VOLT:OFFS?")

    def offset_command(self, volts: float) -> ConfirmedCommand:
        return self._command(f"{self.SOURCE_PREFIX}VOLT:OFFS {volts:.6f}")

    def amplitude_vpp(self) -> float:
        return self.scpi.query_float(f"{self.SOURCE_PREFIX}VOLT?")

    def amplitude_command(self, vpp: float) -> ConfirmedCommand:
        return self._command(f"{self.SOURCE_PREFIX}VOLT {vpp:.6f}")

    def _command(self, text: str) -> ConfirmedCommand:
        return ConfirmedCommand(text, partial(self.write_checked, text))

    def set_rate(self, rate_hz: float, point_count: int) -> None:
        setpoint = rate_hz * point_count if self.RATE_IS_SAMPLE_RATE else rate_hz
        header = f"{self.SOURCE_PREFIX}{self.RATE_HEADER}"
        self.write_checked(f"{header} {setpoint:.10g}")
        quantity = "the sample rate" if self.RATE_IS_SAMPLE_RATE else "the frequency"
        seen = self.scpi.query_float(f"{header}?")
        check_readback(self.scpi.instrument, seen, setpoint, 1e-6 * setpoint + 1e-6, quantity)

    def set_cycles(self, cycles: int) -> None:
        self.write_checked(f"{self.SOURCE_PREFIX}BURS:NCYC {cycles:d}")

    def burst_duration_s(self) -> float:
        source = self.SOURCE_PREFIX
        if self.query_setting(f"{source}BURS:STAT").upper() not in ("1", "ON"):
            return 0.0
        return self.scpi.query_float(f"{source}BURS:NCYC?") / self.scpi.query_float(f"{source}FREQ?")

    def trigger(self) -> None:
        self.write_checked(self.TRIGGER_COMMAND)

    def abort_commands(self) -> Sequence[ConfirmedCommand]:
        # Burst mode waits for its trigger after it is switched on again; in between a few millivolts are played.
        return [self._command(f"{self.SOURCE_PREFIX}BURS:STAT {state}") for state in ("OFF", "ON")]

    def common_settings(self, levels: Levels) -> Iterable[ExpectedSetting]:
        """Return the expected settings with common headers; between drives the amplitude is small where the range is held."""
        source, small_vpp = self.SOURCE_PREFIX, 2 * self.capabilities.idle_amplitude_vpp
        amplitude = f"{source}VOLT"
        yield (
            expect_range(amplitude, 0.0, small_vpp)
            if self.capabilities.holds_range
            else expect_value(amplitude, levels.span_v)
        )
        yield from (
            expect_keyword(f"{source}VOLT:UNIT", "VPP"),
            expect_value(f"{source}VOLT:OFFS", levels.rest_v),
            expect_keyword(f"{source}BURS:STAT", "1", "ON"),
            expect_keyword(f"{source}BURS:MODE", "TRIG", "TRIGGERED"),
            expect_range(f"{source}BURS:NCYC", 1, self.capabilities.max_burst_cycles),
        )
        yield from (setting.expected for setting in self.neutral_settings)

    @property
    def expected_load(self) -> ExpectedSetting:
        """The high-impedance load."""
        return expect_range(self.LOAD_HEADER, 1e9, math.inf)

    def set_high_impedance_load(self) -> None:
        """Declare a high-impedance load: with 50 ohm declared, the amplifier would get twice the voltage."""
        self.write_checked(f"{self.LOAD_HEADER} INF")

    def freeze_range(self, levels: Levels) -> None:
        """Freeze the attenuator at the range of the largest sine on this bench.

        A relay switching later would drop the output to 0 V for some milliseconds (E1441A guide p. 99). No guide states whether
        the idle amplitude is possible in this range.
        """
        source, idle_vpp = self.SOURCE_PREFIX, self.capabilities.idle_amplitude_vpp
        self.write_checked(
            f"{source}VOLT:OFFS {levels.rest_v:.6f}", f"{source}VOLT {levels.span_v:.6f}", f"{source}VOLT:RANG:AUTO OFF"
        )
        if (seen_vpp := self.amplitude_vpp()) < levels.span_v - LEVEL_TOLERANCE_V:
            # No setting shows which range is held: the next arming must set it.
            self.write_checked(f"{source}VOLT:RANG:AUTO ON")
            raise InstrumentError(
                f"{self.scpi.instrument}: its range was to be held for {levels.span_v:g} V peak to peak, and its amplitude reads "
                f"back {seen_vpp:g} V. End other programs that control it, and arm again"
            )
        try:
            self.write_checked(f"{source}VOLT {idle_vpp}")
        except LinkError:
            raise
        except InstrumentError as refusal:
            raise InstrumentError(
                f"{refusal}. It does not take {1e3 * idle_vpp:g} mV peak to peak, at which it is stopped, while its range "
                f"is held for {levels.span_v:g} V; it was not brought up. Use another generator or the card's analogue output"
            ) from refusal
