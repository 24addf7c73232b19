"""Generator capabilities: which models a driver is for, and which drives and levels their instruments can play."""

import math
import re
from typing import ClassVar

from drivers.clock import Clock
from drivers.drive import Drive, Hold, LinearSweep, PeriodicSweep, Ramp, Sine, SquareWave, Steps
from drivers.generators.arbitrary_waveform import reason_memory_too_small
from drivers.generators.generator_commands import GeneratorCommands
from drivers.level_pulse import LevelPulse
from drivers.transport.scpi import ScpiSession

MAX_UNSTOPPABLE_DRIVE_S = 9.0
"""Longest drive of an instrument that can only be stopped by waiting: the card's buffer holds ten seconds."""

HOLD_MARGIN_S, MIN_HOLD_MARGIN_S = 2.0, 1.0
"""How much longer than planned a level is held, so that its recording ends before it: late replies, a busy computer. The smaller
margin is that of an instrument whose drives cannot be ended early."""

SHORTEST_RISE_S = 0.01

INTERPOLATED_STEP_FRACTION = 0.1
"""Largest step from point to point, relative to the span, of a waveform that a filter smooths."""


class GeneratorCapabilities(GeneratorCommands):
    """What the instruments of one family can do: constants of a subclass, and what follows from them for a drive."""

    MODELS: ClassVar[tuple[str, ...]]
    """Prefixes of the supported model names, in capitals."""
    MODEL_PATTERN: ClassVar[str] = ""
    """Regular expression for the supported model names where a prefix is not enough: relatives with another command set."""
    PRODUCT_NAMES: ClassVar[str]
    CAN_FREEZE_RANGE: ClassVar[bool]
    INTERPOLATES_POINTS: ClassVar[bool] = False
    """Whether a filter smooths the waveform from point to point."""
    AMPLITUDE_IS_WAVEFORM_SPAN: ClassVar[bool] = False
    """Whether the amplitude setting means the span of the points as they are, or of the converter."""
    SINGLE_SESSION: ClassVar[bool] = False
    """Whether the instrument answers one LAN client at a time: the watchdog connects after the program has ended."""
    MAX_BURST_CYCLES: ClassVar[int] = 1_000_000
    MIN_AMPLITUDE_VPP: ClassVar[float] = 0.0
    """Smallest amplitude into a high-impedance load, where a drive could be smaller."""

    _scpi: ScpiSession
    _clock: Clock
    _step_v: float

    @classmethod
    def supports_model(cls, model: str) -> bool:
        """Return whether this driver is for a model, by the name that `*IDN?` reports."""
        name, pattern = model.upper(), ""
        for kind in cls.__mro__:  # a pattern goes with the prefixes beside it, not with those of a derived class
            pattern = pattern or vars(kind).get("MODEL_PATTERN", "")
            if "MODELS" in vars(kind):
                break
        return name.startswith(cls.MODELS) and re.match(pattern, name) is not None

    def level_pulse(self, level: Hold, rest_v: float, ramp_v_per_s: float) -> LevelPulse:
        rise_s = max(abs(level.level_v - rest_v) / ramp_v_per_s, SHORTEST_RISE_S)
        speed = max(float(getattr(self._clock, "speed", 1.0)), 1.0)
        margin_s = HOLD_MARGIN_S * speed
        if not self.CAN_FREEZE_RANGE:  # what is left of it has to be waited for
            left_s = MAX_UNSTOPPABLE_DRIVE_S - level.duration_s - 2 * rise_s
            margin_s = max(min(MIN_HOLD_MARGIN_S * speed, left_s), MIN_HOLD_MARGIN_S)
        return LevelPulse(rest_v, level.level_v, level.duration_s + margin_s, rise_s)

    def reason_level_unsupported(self, pulse: LevelPulse) -> str:
        name = self._scpi.instrument
        if not self.CAN_FREEZE_RANGE and pulse.duration_s > MAX_UNSTOPPABLE_DRIVE_S:
            longest_s = MAX_UNSTOPPABLE_DRIVE_S - 2 * pulse.rise_s - MIN_HOLD_MARGIN_S
            return (
                f"{name} cannot hold its range, so that a held level can only be left by waiting for its end; {pulse.level_v:g} V can "
                f"be held for {max(longest_s, 0):.3g} s at most, not {pulse.hold_s - MIN_HOLD_MARGIN_S:.3g} s. Shorten the hold, or use a "
                "generator that holds its range or the card's analogue output. Nothing was sent"
            )
        if why := reason_memory_too_small(pulse, self._max_points(), self._step_v):
            return f"{name}: {why}"
        return self._reason_too_small(pulse.high_v - pulse.low_v)

    def reason_unsupported(self, drive: Drive) -> str:
        name = self._scpi.instrument
        if isinstance(drive, LinearSweep | PeriodicSweep | Steps | SquareWave) and (
            why := reason_memory_too_small(drive, self._max_points(), self._max_step_v(drive))
        ):
            return f"{name}: {why}"
        cycles = (
            drive.cycles
            if isinstance(drive, Sine | SquareWave)
            else drive.periods
            if isinstance(drive, PeriodicSweep)
            else 1
        )
        if cycles > self.MAX_BURST_CYCLES:
            return f"{name} plays {self.MAX_BURST_CYCLES} cycles at most, not {cycles}; shorten the drive. Nothing was sent"
        if not isinstance(drive, Hold | Ramp) and (why := self._reason_too_small(drive.high_v - drive.low_v)):
            return why
        if (
            not self.CAN_FREEZE_RANGE
            and not isinstance(drive, Hold | Ramp)
            and drive.duration_s > MAX_UNSTOPPABLE_DRIVE_S
        ):
            return (
                f"{name} cannot hold its range, so that a drive can only be stopped by waiting for its end; this one "
                f"lasts {drive.duration_s:.3g} s (limit {MAX_UNSTOPPABLE_DRIVE_S:g} s). Shorten it. Nothing was sent"
            )
        return ""

    def _reason_too_small(self, span_v: float) -> str:
        if span_v >= self.MIN_AMPLITUDE_VPP * (1 - 1e-9):
            return ""
        return (
            f"{self._scpi.instrument} cannot play less than {1e3 * self.MIN_AMPLITUDE_VPP:g} mV peak to peak, not "
            f"{1e3 * span_v:.3g} mV; raise the drive's amplitude. Nothing was sent"
        )

    def _max_step_v(self, drive: Drive) -> float:
        return (
            max(self._step_v, INTERPOLATED_STEP_FRACTION * (drive.high_v - drive.low_v))
            if self.INTERPOLATES_POINTS
            else self._step_v
        )

    @property
    def plays_to_the_end(self) -> bool:
        """Whether a drive can only be stopped by waiting for its end."""
        return not self.CAN_FREEZE_RANGE

    @property
    def unattended_end(self) -> str:
        limit = "" if self.CAN_FREEZE_RANGE else f" within {MAX_UNSTOPPABLE_DRIVE_S:g} s"
        return f"a drive plays to its end and is at rest{limit}"

    def unattended_rest_s(self, drive: Drive, rest_v: float) -> float:
        del rest_v
        return math.inf if isinstance(drive, Hold) else drive.duration_s
