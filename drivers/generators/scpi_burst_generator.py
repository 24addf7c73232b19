"""SCPI burst generators: settings common to Keysight, Rigol and Tektronix, with their headers as data."""

import contextlib
import math
from collections.abc import Iterable, Sequence
from typing import ClassVar

from drivers.errors import InstrumentError, LinkError
from drivers.generators.burst_generator import LEVEL_TOLERANCE_V, BurstGenerator
from drivers.generators.expected_setting import (
    ExpectedSetting,
    NeutralSetting,
    expect_keyword,
    expect_range,
    expect_value,
)
from drivers.transport.scpi import join_commands


class ScpiBurstGenerator(BurstGenerator):
    """A burst generator whose settings are confirmed by its error queue and, where it matters, read back."""

    SOURCE_PREFIX: ClassVar[str] = ""
    """Prefix of the headers of the source subsystem."""
    OUTPUT_HEADER: ClassVar[str] = "OUTP"
    LOAD_HEADER: ClassVar[str] = "OUTP:LOAD"
    RATE_HEADER: ClassVar[str] = "FREQ"
    RATE_IS_SAMPLE_RATE: ClassVar[bool] = False
    """Whether `RATE_HEADER` is in samples per second, or in whole periods."""
    TRIGGER_COMMAND: ClassVar[str] = "*TRG"
    NEUTRAL_SETTINGS: ClassVar[tuple[NeutralSetting, ...]] = (
        NeutralSetting("OUTP:POL", "NORM", ("NORM", "NORMAL"), optional=True),
    )
    """Settings of other users that persist; by default the polarity, for a plug-in's instrument that may have none."""

    PANEL_LOCK: ClassVar[tuple[str, str]] = ("", "")
    """Commands that lock and unlock the front panel; empty if none is known."""

    _unknown_headers: frozenset[str] = frozenset()
    """Optional settings that this instrument has said it does not know."""

    def lock_panel(self) -> str:
        """Lock the front panel; return why it is not locked, empty if it is."""
        lock, _ = self.PANEL_LOCK
        if not lock:
            return f"{self._scpi.instrument}: no command that locks its front panel is known"
        try:
            self._write_checked(lock)
        except InstrumentError as refusal:
            return f"its front panel is not locked: {refusal}"
        return ""

    def unlock_panel(self) -> None:
        """Unlock the front panel; one that cannot be reached any more stays locked."""
        with contextlib.suppress(InstrumentError):
            self._write_checked(self.PANEL_LOCK[1])

    def idle_level_v(self) -> float:
        return self._scpi.query_float(f"{self.SOURCE_PREFIX}VOLT:OFFS?")

    def _query_setting(self, name: str) -> str:
        return self._scpi.query(f"{name}?")

    def _query_optional_setting(self, name: str) -> str | None:
        if name in self._unknown_headers:
            return None
        answer = self._scpi.query_optional(f"{name}?")
        if answer is None:
            self._unknown_headers |= {name}
        return answer

    def _neutral_settings(self) -> Iterable[NeutralSetting]:
        """Return the settings of other users that this model has."""
        return self.NEUTRAL_SETTINGS

    def _reset_foreign_settings(self) -> None:
        for setting in self._neutral_settings():
            if not setting.optional or self._query_optional_setting(setting.header) is not None:
                self._write_checked(f"{setting.header} {setting.value}")

    def _is_output_on(self) -> bool:
        return self._query_setting(self.OUTPUT_HEADER).upper() in ("1", "ON")

    def _clear_error_queue(self) -> None:
        self._write_checked("*CLS")

    def _common_expected_settings(self, rest_v: float) -> Iterable[ExpectedSetting]:
        """Return the expected settings whose headers all these instruments share."""
        source = self.SOURCE_PREFIX
        yield from (
            expect_keyword(f"{source}VOLT:UNIT", "VPP"),
            expect_value(f"{source}VOLT:OFFS", rest_v, LEVEL_TOLERANCE_V),
            expect_keyword(f"{source}BURS:STAT", "1", "ON"),
            expect_keyword(f"{source}BURS:MODE", "TRIG", "TRIGGERED"),
            expect_range(f"{source}BURS:NCYC", 1, self.MAX_BURST_CYCLES),
        )
        yield from (setting.expected for setting in self._neutral_settings())

    def _expected_load(self) -> ExpectedSetting:
        return expect_range(self.LOAD_HEADER, 1e9, math.inf)

    def _set_high_impedance_load(self) -> None:
        """Declare a high-impedance load: with 50 ohm declared, the amplifier would get twice the voltage."""
        self._scpi.write_checked(f"{self.LOAD_HEADER} INF")

    def _freeze_range(self, rest_v: float, span_v: float) -> None:
        """Freeze the attenuator at the range of the largest sine on this bench.

        A relay that switches later would drop the output to 0 V for some milliseconds (E1441A guide p. 99). Whether the idle
        amplitude is possible in that range, no guide says (33220A User's Guide p. 66: perhaps not).
        """
        source = self.SOURCE_PREFIX
        wide, small = f"{source}VOLT {span_v:.6f}", f"{source}VOLT {self.IDLE_AMPLITUDE_VPP}"
        self._write_checked(f"{source}VOLT:OFFS {rest_v:.6f}", wide, f"{source}VOLT:RANG:AUTO OFF")
        try:
            self._write_checked(small)
        except LinkError:
            raise
        except InstrumentError as refusal:
            raise InstrumentError(
                f"{refusal}. It does not take {1e3 * self.IDLE_AMPLITUDE_VPP:g} mV peak to peak, at which it is stopped, while its range "
                f"is held for {span_v:g} V; it was not brought up. Use another generator or the card's analogue output"
            ) from refusal

    @staticmethod
    def _join_commands(commands: Sequence[str]) -> str:
        return join_commands(commands)

    def _write_checked(self, *commands: str) -> None:
        for command in commands:
            self._scpi.write_checked(command)

    def _enable_output(self) -> None:
        self._write_checked(f"{self.OUTPUT_HEADER} ON")

    def _offset_command(self, volts: float) -> str:
        return f"{self.SOURCE_PREFIX}VOLT:OFFS {volts:.6f}"

    def _set_offset(self, volts: float) -> None:
        self._write_checked(self._offset_command(volts))

    def _query_amplitude(self) -> float:
        return self._scpi.query_float(f"{self.SOURCE_PREFIX}VOLT?")

    def _amplitude_command(self, vpp: float) -> str:
        return f"{self.SOURCE_PREFIX}VOLT {vpp:.6f}"

    def _set_amplitude(self, vpp: float) -> None:
        self._write_checked(self._amplitude_command(vpp))

    def _set_rate(self, rate_hz: float, point_count: int) -> None:
        setpoint = rate_hz * point_count if self.RATE_IS_SAMPLE_RATE else rate_hz
        self._write_checked(f"{self.SOURCE_PREFIX}{self.RATE_HEADER} {setpoint:.10g}")
        seen = self._scpi.query_float(f"{self.SOURCE_PREFIX}{self.RATE_HEADER}?")
        self._check_readback(
            seen, setpoint, 1e-6 * setpoint + 1e-6, "the sample rate" if self.RATE_IS_SAMPLE_RATE else "the frequency"
        )

    def _set_cycles(self, cycles: int) -> None:
        self._write_checked(f"{self.SOURCE_PREFIX}BURS:NCYC {cycles:d}")

    def _query_burst_duration_s(self) -> float:
        if self._query_setting(f"{self.SOURCE_PREFIX}BURS:STAT").upper() not in ("1", "ON"):
            return 0.0
        return self._scpi.query_float(f"{self.SOURCE_PREFIX}BURS:NCYC?") / self._scpi.query_float(
            f"{self.SOURCE_PREFIX}FREQ?"
        )

    def _trigger(self) -> None:
        self._write_checked(self.TRIGGER_COMMAND)

    def _send(self, command: str) -> None:
        self._write_checked(command)

    def _abort_commands(self) -> Sequence[str]:
        # Burst mode that is switched on again waits for its trigger; in between a few millivolts are played.
        return f"{self.SOURCE_PREFIX}BURS:STAT OFF", f"{self.SOURCE_PREFIX}BURS:STAT ON"
