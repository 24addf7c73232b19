"""Burst generators: the policy of all function generators, which rest in an armed burst.

A change of function, load or range can drop an instrument's output to 0 V, which is -500 V on the specimen. Therefore these are
set once, before the output comes up. The function is always the arbitrary waveform, whose first point is the idle level, the
offset; a sine is one cycle of it repeated, a sweep or a series of steps is a waveform played once, and so is a held level with
its ramps from and to rest. Every drive is a finite burst: it returns to the offset by itself if this computer fails. The offset
itself moves only on the way to rest, and during commissioning.

Instruments that can freeze the range of their attenuator set the amplitude of a drive, and are stopped by reducing it in small
steps. Other instruments would switch a relay on the way: they keep one amplitude, scale the drive in the points of the waveform,
and are stopped by waiting for the end.

The commands of a family, and what its instruments can do, are a `Dialect`.
"""

import math
import re
from collections.abc import Callable
from contextlib import suppress
from typing import ClassVar

import numpy as np

from drivers.clock import Clock
from drivers.drive_shapes import Drive, Hold, LevelPulse, LinearSweep, PeriodicSweep, Ramp, Sine, SquareWave, Steps
from drivers.errors import InstrumentError, LinkError
from drivers.generators.capabilities import MAX_UNSTOPPABLE_DRIVE_S, PlayableDrives
from drivers.generators.dialect import LEVEL_TOLERANCE_V, Dialect, Levels, mismatches
from drivers.generators.output import HASTENED_END_S, BurstOutput
from drivers.generators.waveform import SINE_CYCLE, render_waveform, repetition
from drivers.interfaces import Identity
from drivers.transport import Link, ScpiSession, reply_remedy

FOREIGN_OUTPUT_RAMP_V_PER_S = 5.0
"""Slope of the ramp to rest of an earlier program's level, before the instrument is configured."""


class BurstGenerator:
    """A `Source` (see drivers.interfaces); the driver of a family is a subclass with its dialect.

    Args:
        link: the connection.
        clock: bench time, which paces the staircases.
        step_v: largest single step of a staircase in volts.
        step_interval_s: time between the steps of a staircase.

    Raises:
        LinkError: nothing answers.
        InstrumentError: another instrument answers, or the family cannot be used on this connection.
    """

    dialect_type: ClassVar[type[Dialect]]

    single_session: ClassVar[bool] = False
    """Whether the instruments answer one LAN client at a time."""
    hastens_levels: bool = False
    """Whether Stop plays the remainder of a level faster, for instruments that cannot abort it. Only after a commissioning that
    measured that a change of frequency continues a running burst: no guide states it."""
    hastened_end_s: ClassVar[float] = HASTENED_END_S

    def __init__(self, link: Link, clock: Clock, *, step_v: float = 0.05, step_interval_s: float = 0.002) -> None:
        self.capabilities = self.dialect_type.capabilities
        self._scpi = ScpiSession(link, f"function generator at {link.name}", clock.now)
        self._clock, self._step_v = clock, step_v
        self.identity: Identity = self._scpi.identify()
        if not self.supports_model(self.identity.model):
            link.close()
            from drivers.generators.unsuitable import reason_unsuitable

            remedy = reason_unsuitable(self.identity) or "Correct the driver or the resource in the bench file"
            raise InstrumentError(
                f"{link.name} answered as '{self.identity}'; this driver is for {self.capabilities.product_names}. {remedy[0].upper()}{remedy[1:]}"
            )
        if link.name.upper().startswith("USB") and (problem := self.capabilities.usb_problem_of(self.identity.model)):
            link.close()
            raise InstrumentError(f"{link.name}: {problem}")
        self._scpi.instrument = f"function generator {self.identity.model}"
        self.dialect = self.dialect_type(self._scpi, clock, self.identity.model)
        self.playable = PlayableDrives(self.capabilities, self._scpi.instrument, self.dialect.max_points, step_v, clock)
        self._output = BurstOutput(self._scpi, clock, self.dialect, step_v, step_interval_s)
        self.byte_order = self._output.byte_order
        self.on_failure: Callable[[BaseException], None] = lambda _: None
        self._output.on_failure = lambda error: self.on_failure(error)  # noqa: PLW0108 - it is replaced later
        self.plays_to_the_end = not self.capabilities.holds_range
        """Whether a drive can only be stopped by waiting for its end."""
        limit = f" within {MAX_UNSTOPPABLE_DRIVE_S:g} s" if self.plays_to_the_end else ""
        self.unattended_end = f"a drive plays to its end and is at rest{limit}"

    def __init_subclass__(cls) -> None:
        cls.single_session = cls.dialect_type.capabilities.single_session

    @classmethod
    def supports_model(cls, model: str) -> bool:
        """Return whether this driver supports a model, by the name that `*IDN?` reports."""
        return cls.dialect_type.capabilities.supports_model(model)

    def reconnect(self) -> None:
        self._scpi.link.reopen()
        seen = self._scpi.identify()
        if seen != self.identity:
            raise LinkError(f"{self._scpi.link.name} now answers as '{seen}', not '{self.identity}'")
        self._output.stored_waveform = None  # it may have lost power meanwhile
        self.dialect.forget_waveforms()

    def close(self) -> None:
        self._scpi.link.close()

    def lock_panel(self) -> str:
        """Lock the front panel; return the reason if it is not locked, empty if it is."""
        lock, _ = self.capabilities.panel_lock_of(self.identity.model)
        if not lock:
            return "this driver knows no command for it"
        try:
            self._scpi.write_checked(lock)
        except InstrumentError as refusal:
            return f"its front panel is not locked: {refusal}"
        return ""

    def unlock_panel(self) -> None:
        """Unlock the front panel; without connection it stays locked."""
        _, unlock = self.capabilities.panel_lock_of(self.identity.model)
        with suppress(InstrumentError):
            if unlock:
                self._scpi.write_checked(unlock)

    def is_output_on(self) -> bool:
        return self.dialect.is_output_on()

    def idle_level_v(self) -> float:
        return self.dialect.idle_level_v()

    def is_at_rest(self, rest_v: float, low_v: float, high_v: float) -> bool:
        self._output.rest_v = rest_v
        self._output.stored_waveform = None  # another waveform may have been loaded at the front panel
        self.dialect.forget_waveforms()
        if not self.is_output_on() or first_mismatch(self.dialect, Levels(rest_v, low_v, high_v)):
            return False
        self.dialect.clear_errors()  # of another program, which the next command would be blamed for
        if self.plays_to_the_end or not self._output.has_ended():
            self.stop()  # a burst that another program started shows in no setting, also at the idle amplitude
        return True

    def is_left_live(self, rest_v: float, low_v: float, high_v: float) -> bool:
        if not self.is_output_on() or not has_our_setup(self.dialect, Levels(rest_v, low_v, high_v)):
            return False
        away = abs(self.idle_level_v() - rest_v) > LEVEL_TOLERANCE_V
        return away or (
            self.capabilities.holds_range and self.dialect.amplitude_vpp() > 2 * self.capabilities.idle_amplitude_vpp
        )

    def initialize_at_rest(self, rest_v: float, low_v: float, high_v: float) -> None:
        levels = Levels(rest_v, low_v, high_v)
        self._output.rest_v, self._output.stored_waveform = rest_v, None
        self.dialect.clear_errors()
        if self.is_output_on() and has_our_setup(self.dialect, levels):
            # A drive or level of an earlier program goes to rest like any drive. High voltage is disabled here; but the
            # operator may have switched off the wrong amplifier, and a slow ramp does not damage the specimen.
            self.stop()
            self.ramp_to(rest_v, abs(self.idle_level_v() - rest_v) / FOREIGN_OUTPUT_RAMP_V_PER_S)
        # If all settings are as expected, no setting that could drop the output is touched.
        if not self.is_output_on() or first_mismatch(self.dialect, levels):
            self._configure(levels)
        self._output.burst_end_s = self._clock.now()

    def _configure(self, levels: Levels) -> None:
        """Set and verify everything, then switch the output on."""
        self.dialect.reset_foreign_settings()
        self.dialect.set_up(levels)
        self._output.stored_waveform = None
        self._output.load_waveform(SINE_CYCLE)
        self.dialect.arm(levels)
        if wrong := first_mismatch(self.dialect, levels):
            state = "is on as it was found" if self.is_output_on() else "was not brought up"
            raise InstrumentError(
                f"{self._scpi.instrument} does not read back as it was set up ({wrong}); its output {state}. Look at "
                "its front panel, and switch it off and on"
            )
        self.dialect.enable_output()
        if not self.is_output_on():
            raise InstrumentError(f"{self._scpi.instrument}: its output did not come on; look at its front panel")

    def level_pulse(self, level: Hold, rest_v: float, ramp_v_per_s: float) -> LevelPulse:
        return self.playable.level_pulse(level, rest_v, ramp_v_per_s)

    def reason_level_unsupported(self, pulse: LevelPulse) -> str:
        return self.playable.reason_level_unsupported(pulse)

    def reason_unsupported(self, drive: Drive) -> str:
        return self.playable.reason_unsupported(drive)

    def unattended_rest_s(self, drive: Drive, rest_v: float) -> float:
        del rest_v
        return math.inf if isinstance(drive, Hold) else drive.duration_s

    def start_level(self, pulse: LevelPulse) -> float:
        if why := self.reason_level_unsupported(pulse):
            raise InstrumentError(why)
        points, full_v = render_waveform(pulse, self.playable.max_points, self._step_v)
        self._output.keep_level(pulse, points.size)
        return self._output.start_burst(points, full_v, 1 / pulse.duration_s, 1, pulse.rest_v)

    def adopt_level(self, pulse: LevelPulse, end_s: float) -> None:
        """Adopt a level started by another process, which ends by itself at a bench time."""
        points, _ = render_waveform(pulse, self.playable.max_points, self._step_v)
        self._output.keep_level(pulse, points.size)
        self._output.burst_end_s = end_s

    def start_drive(self, drive: Drive) -> None:
        if why := self.reason_unsupported(drive):
            raise InstrumentError(why)
        match drive:
            case Hold(level_v, _):
                self._output.check_idle_level(level_v)
            case Ramp(start_v, stop_v, duration_s):
                self._output.check_idle_level(start_v)
                self.ramp_to(stop_v, duration_s)
            case Sine(frequency_hz, amplitude_v, offset_v, cycles):
                self._output.start_burst(SINE_CYCLE, amplitude_v, frequency_hz, cycles, offset_v)
            case LinearSweep() | Steps() | PeriodicSweep() | SquareWave():
                points, full_v = render_waveform(drive, self.playable.max_points, self.playable.max_step_v(drive))
                rate_hz, periods = repetition(drive)
                self._output.start_burst(points, full_v, rate_hz, periods, drive.end_levels_v[0])

    def end_level(self, duration_s: float) -> None:
        if self.plays_to_the_end and self.hastens_levels:
            self._output.hasten_end()
        self._output.stop(0.0 if self._output.has_ended() else duration_s)

    def stop(self) -> None:
        self._output.stop()

    def ramp_to(self, level_v: float, duration_s: float) -> None:
        self._output.ramp_to(level_v, duration_s)

    def predict_rest_s(self, distance_v: float, ramp_v_per_s: float) -> float:
        return self._output.predict_rest_s(distance_v, ramp_v_per_s)

    def upload_longest(self) -> None:
        """Upload a waveform with the driver's largest number of points without playing it, to measure the duration.

        Raises:
            InstrumentError: the upload was rejected.
        """
        size = self.playable.max_points
        self._output.load_waveform(np.sin(2 * np.pi * np.arange(size) / size))


def first_mismatch(dialect: Dialect, levels: Levels) -> str:
    """Describe the first setting that differs from the armed state at rest; empty if none does."""
    settings = dialect.expected_settings(levels)
    for setting, answer in mismatches(settings, dialect.query_setting, dialect.query_optional_setting):
        odd = not setting.keywords and not re.fullmatch(r"[-+.\dE]+", answer, re.IGNORECASE)
        why = f"; {reply_remedy('the connection', f'{setting.name}?', answer)}" if odd else ""
        return f"{setting.name} is {answer[:40]}, not {setting.expected}{why}"
    return ""


def has_our_setup(dialect: Dialect, levels: Levels) -> bool:
    """Whether it is armed by this driver, with any drive or level. In another state a setting of volts may give other volts."""
    modes = (s for s in dialect.expected_settings(levels) if s.keywords or math.isinf(s.high))
    return next(mismatches(modes, dialect.query_setting, dialect.query_optional_setting), None) is None
