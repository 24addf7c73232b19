"""Capabilities of a generator family, and the drives and levels that an instrument can play."""

import re
from dataclasses import dataclass

from drivers.clock import Clock
from drivers.drive_shapes import Drive, Hold, LevelPulse, LinearSweep, PeriodicSweep, Ramp, Sine, SquareWave, Steps
from drivers.generators.waveform import reason_memory_too_small, repetition

MAX_UNSTOPPABLE_DRIVE_S = 9.0
"""Longest drive of an instrument that can only be stopped by waiting: the card's buffer holds ten seconds."""

HOLD_MARGIN_S, MIN_HOLD_MARGIN_S = 2.0, 1.0
"""Spare duration of a held level, so that its recording ends before it: late replies, a busy computer. The smaller margin is for
an instrument whose drives cannot be ended early."""

SHORTEST_RISE_S = 0.01

INTERPOLATED_STEP_FRACTION = 0.1
"""Largest step from point to point of a waveform smoothed by a filter, relative to the span."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Capabilities:
    """Capabilities of the instruments of one family.

    Args:
        models: regular expression for the beginning of the supported model names.
        product_names: maker and series, for messages.
        holds_range: whether the range of the attenuator can be frozen, so that no change of the amplitude switches a relay.
        interpolates_points: whether a filter smooths the waveform from point to point.
        amplitude_is_waveform_span: whether the amplitude setting is the span of the points, or of the converter.
        single_session: whether it answers one LAN client at a time; then the watchdog connects after the program has ended.
        joins_commands: whether one message can carry several commands.
        max_burst_cycles: largest number of periods in a burst.
        min_amplitude_vpp: smallest amplitude into a high-impedance load, if a drive could be smaller.
        idle_amplitude_vpp: amplitude between drives with a held range: negligible, and possible.
        panel_lock: commands that lock and unlock the front panel; empty without such a command.
        models_that_lock_keys: regular expression for models whose commands to lock name the keys, of which ALL is one; empty: none.
        usb_problem: reason why it cannot be used over USB, with the remedy; empty if it can.
        models_without_usb_problem: regular expression for models that can be used over USB nevertheless; empty: none.
    """

    models: str
    product_names: str
    holds_range: bool
    interpolates_points: bool = False
    amplitude_is_waveform_span: bool = False
    single_session: bool = False
    joins_commands: bool = True
    max_burst_cycles: int = 1_000_000
    min_amplitude_vpp: float = 0.0
    idle_amplitude_vpp: float = 0.02
    panel_lock: tuple[str, str] = ("", "")
    models_that_lock_keys: str = ""
    usb_problem: str = ""
    models_without_usb_problem: str = ""

    def panel_lock_of(self, model: str) -> tuple[str, str]:
        """Return the commands that lock and unlock the front panel of a model; empty without such a command."""
        fit, (lock, unlock) = self.models_that_lock_keys, self.panel_lock
        if fit and re.match(fit, model, re.IGNORECASE):
            return lock.replace(" ", " ALL,"), unlock.replace(" ", " ALL,")
        return lock, unlock

    def usb_problem_of(self, model: str) -> str:
        """Return the reason why a model cannot be used over USB, with the remedy; empty if it can."""
        fit = self.models_without_usb_problem
        return "" if fit and re.match(fit, model, re.IGNORECASE) else self.usb_problem

    def supports_model(self, model: str) -> bool:
        """Return whether a model belongs to the family, by the name that `*IDN?` reports."""
        return re.match(self.models, model.upper()) is not None


@dataclass(frozen=True, slots=True)
class PlayableDrives:
    """Drives and levels that one instrument can play.

    Args:
        capabilities: capabilities of its family.
        instrument: its name, for messages.
        max_points: largest number of points of a waveform.
        step_v: largest step from point to point that may reach the amplifier.
        clock: bench time.
    """

    capabilities: Capabilities
    instrument: str
    max_points: int
    step_v: float
    clock: Clock

    def level_pulse(self, level: Hold, rest_v: float, ramp_v_per_s: float) -> LevelPulse:
        """Return the waveform of a held level."""
        rise_s = max(abs(level.level_v - rest_v) / ramp_v_per_s, SHORTEST_RISE_S)
        speed = max(float(getattr(self.clock, "speed", 1.0)), 1.0)
        margin_s = HOLD_MARGIN_S * speed
        if not self.capabilities.holds_range:  # its remainder must be waited for
            left_s = MAX_UNSTOPPABLE_DRIVE_S - level.duration_s - 2 * rise_s
            margin_s = max(min(MIN_HOLD_MARGIN_S * speed, left_s), MIN_HOLD_MARGIN_S)
        return LevelPulse(rest_v, level.level_v, level.duration_s + margin_s, rise_s)

    def reason_level_unsupported(self, pulse: LevelPulse) -> str:
        """Return the reason why a level cannot be held as this waveform; empty if it can."""
        if not self.capabilities.holds_range and pulse.duration_s > MAX_UNSTOPPABLE_DRIVE_S:
            longest_s = MAX_UNSTOPPABLE_DRIVE_S - 2 * pulse.rise_s - MIN_HOLD_MARGIN_S
            return (
                f"{self.instrument} cannot hold its range, so that a held level can only be left by waiting for its end; {pulse.level_v:g} V can "
                f"be held for {max(longest_s, 0):.3g} s at most, not {pulse.hold_s - MIN_HOLD_MARGIN_S:.3g} s. Shorten the hold, or use a "
                "generator that holds its range or the card's analogue output. Nothing was sent"
            )
        if why := reason_memory_too_small(pulse, self.max_points, self.step_v):
            return f"{self.instrument}: {why}"
        return self._reason_too_small(pulse.high_v - pulse.low_v)

    def reason_unsupported(self, drive: Drive) -> str:
        """Return the reason why a drive cannot be played; empty if it can."""
        if isinstance(drive, LinearSweep | PeriodicSweep | Steps | SquareWave) and (
            why := reason_memory_too_small(drive, self.max_points, self.max_step_v(drive))
        ):
            return f"{self.instrument}: {why}"
        most = self.capabilities.max_burst_cycles
        cycles = (
            drive.cycles if isinstance(drive, Sine) else 1 if isinstance(drive, Hold | Ramp) else repetition(drive)[1]
        )
        if cycles > most:
            return f"{self.instrument} plays {most} cycles at most, not {cycles}; shorten the drive. Nothing was sent"
        if isinstance(drive, Hold | Ramp):
            return ""
        if why := self._reason_too_small(drive.high_v - drive.low_v):
            return why
        if not self.capabilities.holds_range and drive.duration_s > MAX_UNSTOPPABLE_DRIVE_S:
            return (
                f"{self.instrument} cannot hold its range, so that a drive can only be stopped by waiting for its end; this one "
                f"lasts {drive.duration_s:.3g} s (limit {MAX_UNSTOPPABLE_DRIVE_S:g} s). Shorten it. Nothing was sent"
            )
        return ""

    def _reason_too_small(self, span_v: float) -> str:
        smallest_vpp = self.capabilities.min_amplitude_vpp
        if span_v >= smallest_vpp * (1 - 1e-9):
            return ""
        return (
            f"{self.instrument} cannot play less than {1e3 * smallest_vpp:g} mV peak to peak, not "
            f"{1e3 * span_v:.3g} mV; raise the drive's amplitude. Nothing was sent"
        )

    def max_step_v(self, drive: Drive) -> float:
        """Return the largest step from point to point of a drive's waveform."""
        if not self.capabilities.interpolates_points:
            return self.step_v
        return max(self.step_v, INTERPOLATED_STEP_FRACTION * (drive.high_v - drive.low_v))
