"""Output of a burst generator: stored waveform, playing burst, and ways to rest."""

import hashlib
import math
from collections.abc import Callable

import numpy as np

from drivers.clock import Clock
from drivers.drive_shapes import LevelPulse
from drivers.errors import InstrumentError, LinkError
from drivers.generators.capabilities import MAX_UNSTOPPABLE_DRIVE_S
from drivers.generators.dialect import LEVEL_TOLERANCE_V, Dialect, check_readback
from drivers.generators.waveform import SINE_CYCLE, Points
from drivers.transport import RampDown, ScpiSession, join_commands

SLOW_WIRE_ROUND_TRIPS = 7
"""Number of replies that the pipelined way from a held level to rest waits for."""

HASTENED_END_S, HASTENED_V_PER_S = 1.2, 40.0
"""Time to rest of a level with a hastened end, and largest slope of its return: 40 mV in 1 ms."""

SHORT_BURST_HZ = 1013.0
"""Frequency of the burst that is left in the instrument. If a person switches burst mode off, it is played continuously: a card would
see no motion of a frequency that is a multiple of its sample rate."""

BURST_END_MARGIN_S = 0.1
"""Largest delay of a burst's end relative to the computer's clock."""


class BurstOutput:
    """The output of one instrument with the commands of a dialect.

    Args:
        scpi: session with the instrument.
        clock: bench time, which paces the staircases.
        dialect: the commands of its family.
        step_v: largest single step of a staircase in volts.
        step_interval_s: time between the steps of a staircase.
    """

    rest_v: float | None = None
    """The rest level: a ramp to it continues despite errors. None in a watchdog, whose ramps all go to rest."""
    burst_end_s: float | None = None
    """End of the burst started here; unknown at first."""
    stored_waveform: str | None = None
    """Digest of the waveform in the instrument; unknown at first."""
    _waveform_span: float | None = None
    """Volts of the amplitude setting per volt of the waveform's largest point, between 1 (to one side) and 2; unknown at first."""
    _last_amplitude_vpp: float | None = None
    _last_offset_v: float | None = None
    """The last sent settings, used if they cannot be read back."""
    _level: tuple[LevelPulse, int] | None = None
    """The last started level, and its number of points."""

    def __init__(
        self, scpi: ScpiSession, clock: Clock, dialect: Dialect, step_v: float, step_interval_s: float
    ) -> None:
        self._scpi, self._clock, self._dialect = scpi, clock, dialect
        self._capabilities = dialect.capabilities
        self._step_v, self._step_interval_s = step_v, step_interval_s
        self.on_failure: Callable[[BaseException], None] = lambda _: None

    def byte_order(self, new: str = "") -> str:
        """Set the byte order of waveforms if `new` is given, and return the present one; empty if the model has only one."""
        if new:
            self.stored_waveform = None
        return self._dialect.byte_order(new)

    def load_waveform(self, points: Points) -> None:
        """Download a waveform unless it is the stored one."""
        digest = hashlib.sha256(points.tobytes()).hexdigest()
        if digest == self.stored_waveform:
            return
        if self._capabilities.holds_range:  # a transient during the download then stays this small
            self._change_amplitude(self._capabilities.idle_amplitude_vpp)
        self.stored_waveform = None
        self._dialect.download_waveform(points)
        self.stored_waveform = digest

    def start_burst(self, points: Points, full_v: float, rate_hz: float, cycles: int, idle_v: float) -> float:
        """Play `cycles` periods of the waveform at `rate_hz` periods a second, a full-scale point being `full_v`.

        Returns the bench time just before the trigger was sent.
        """
        seconds = cycles / rate_hz
        self.check_idle_level(idle_v)
        if not self._capabilities.holds_range:
            points, full_v = self._scaled_to_amplitude(points, full_v)
        self.load_waveform(points)
        self._dialect.set_rate(rate_hz, points.size)
        self._dialect.set_cycles(cycles)
        if self._capabilities.holds_range:
            self._set_drive_amplitude(points, full_v)
        triggered_s = self._clock.now()
        self.burst_end_s = triggered_s + seconds  # for other threads, while the trigger waits for its reply
        try:
            self._dialect.trigger()
        finally:  # if the reply is lost, a burst that began at the last moment must be assumed
            self.burst_end_s = self._clock.now() + seconds
        return triggered_s

    def _scaled_to_amplitude(self, points: Points, full_v: float) -> tuple[Points, float]:
        """Return the points of a drive at the present amplitude, and the volts of a full-scale point."""
        most_v = self._dialect.amplitude_vpp() / 2
        if full_v > most_v + LEVEL_TOLERANCE_V:
            raise InstrumentError(
                f"{self._scpi.instrument} was set up for {most_v:.3g} V at most around where it idles, not {full_v:.3g} V; "
                "lower the drive's amplitude, or arm the bench again. Nothing was sent"
            )
        return points * (full_v / most_v), most_v

    def _set_drive_amplitude(self, points: Points, full_v: float) -> None:
        """Set the amplitude at which a full-scale point is `full_v` away from the offset, and read it back."""
        vpp = (float(np.ptp(points)) if self._capabilities.amplitude_is_waveform_span else 2) * full_v
        self._waveform_span = vpp / full_v
        self._change_amplitude(vpp)
        self._check(self._dialect.amplitude_vpp(), vpp, LEVEL_TOLERANCE_V, "the amplitude in volts peak to peak")

    def _change_amplitude(self, vpp: float) -> None:
        self._last_amplitude_vpp = vpp
        self._dialect.amplitude_command(vpp).send()

    def check_idle_level(self, level_v: float) -> None:
        """Raise InstrumentError if the output does not idle at the first level of a drive."""
        seen = self._dialect.idle_level_v()
        if abs(seen - level_v) > LEVEL_TOLERANCE_V:
            raise InstrumentError(
                f"{self._scpi.instrument} idles at {seen:.4f} V where the drive begins at {level_v:.4f} V; nothing was sent"
            )

    def keep_level(self, pulse: LevelPulse, point_count: int) -> None:
        """Remember a level before it is played, so that its end can be hastened."""
        self._level = pulse, point_count

    def hasten_end(self) -> None:
        """Play the remainder of a level faster; without confirmation the natural end is waited for."""
        begin_s, level, end_s = self._clock.now(), self._level, self.burst_end_s
        if level is None or end_s is None or end_s - begin_s <= HASTENED_END_S:
            return
        pulse, size = level
        ratio = min((end_s - begin_s) / HASTENED_END_S, HASTENED_V_PER_S / pulse.slew_v_per_s)
        if ratio <= 1:
            return
        self._level = None  # only once
        try:
            self._dialect.set_rate(ratio / pulse.duration_s, size)
        except InstrumentError as error:
            self.on_failure(error)
            return
        self.burst_end_s = self._clock.now() + (end_s - begin_s) / ratio

    def has_ended(self) -> bool:
        """Whether the last burst started here has certainly ended; False if another program may have started one."""
        return self.burst_end_s is not None and self._clock.now() > self.burst_end_s + BURST_END_MARGIN_S

    def stop(self, duration_s: float = 0.0) -> None:
        """Reduce the amplitude in steps, in about `duration_s` or at the highest rate of steps, and abort."""
        if not self._capabilities.holds_range:
            self._wait_for_burst_end()
            return
        way = self._ramp_down()
        # Otherwise an old entry of the queue would be mistaken for the result of the first step.
        way.query(self._dialect.clear_errors)
        amplitude_vpp = way.query(self._dialect.amplitude_vpp)
        if amplitude_vpp is None:
            amplitude_vpp = self._last_amplitude_vpp
        if amplitude_vpp is None:
            way.raise_first_error()  # neither read nor set: a step could increase the amplitude
            return
        idle_vpp = self._capabilities.idle_amplitude_vpp
        if self.has_ended() and amplitude_vpp <= idle_vpp * (1 + 1e-6):
            way.raise_first_error()
            return  # under a held level an abort may play the idle amplitude once more, beyond the amplifier's range
        self._reduce_amplitude(way, amplitude_vpp, duration_s)
        # Aborting a running cycle then leaves a few millivolts on the output at most, whatever the firmware does.
        for command in self._dialect.abort_commands():
            way.step(*command)
        way.flush()
        left_vpp = way.query(self._dialect.amplitude_vpp)
        way.raise_first_error()
        if left_vpp is not None:
            self._check(left_vpp, idle_vpp, idle_vpp, "the amplitude in volts peak to peak")
        self.burst_end_s = self._clock.now()

    def _reduce_amplitude(self, way: RampDown, amplitude_vpp: float, duration_s: float) -> None:
        """Set the idle amplitude in steps of at most `step_v` at the output."""
        idle_vpp = self._capabilities.idle_amplitude_vpp
        span = self._waveform_span or (1.0 if self._capabilities.amplitude_is_waveform_span else 2.0)
        steps = max(math.ceil((amplitude_vpp - idle_vpp) / span / self._step_v), 0)
        for i in range(1, steps + 1):
            self._last_amplitude_vpp = vpp = amplitude_vpp + (idle_vpp - amplitude_vpp) * i / steps
            way.step(*self._dialect.amplitude_command(vpp))
            self._clock.sleep(max(self._step_interval_s, duration_s / steps))

    def ramp_to(self, level_v: float, duration_s: float) -> None:
        """Move the offset to a level in steps, and read it back."""
        way = self._ramp_down(best_effort=self.rest_v in (None, level_v))
        start_v = way.query(self._dialect.idle_level_v)
        if start_v is None:
            start_v = self._last_offset_v
        if start_v is None:
            way.raise_first_error()
            return
        steps = self._step_count(abs(level_v - start_v), duration_s)
        way.limit_duration(duration_s, steps, self._scpi.reply_s, getattr(self._clock, "speed", 1.0))
        for i in range(1, steps + 1):
            volts = start_v + (level_v - start_v) * i / steps
            self._last_offset_v = volts  # before it is sent: if the reply is lost, the new value must be assumed
            way.step(*self._dialect.offset_command(volts))
            self._clock.sleep(duration_s / steps)
        way.flush()
        reached_v = way.query(self._dialect.idle_level_v)
        way.raise_first_error()
        if reached_v is not None:
            self._check(reached_v, level_v, LEVEL_TOLERANCE_V, "the offset in volts")

    def predict_rest_s(self, distance_v: float, ramp_v_per_s: float) -> float:
        """Return the duration of `stop` and a ramp of `distance_v` to rest, by the measured reply time."""
        ramp_s = distance_v / ramp_v_per_s
        round_trips = SLOW_WIRE_ROUND_TRIPS
        if not self._scpi.slow_reply_s:
            round_trips += self._step_count(distance_v, ramp_s)
        return ramp_s + round_trips * self._scpi.reply_s

    def _step_count(self, distance_v: float, duration_s: float) -> int:
        return max(math.ceil(distance_v / self._step_v), math.ceil(duration_s / (4 * self._step_interval_s)), 1)

    def _ramp_down(self, best_effort: bool = True) -> RampDown:
        return RampDown(
            self._scpi.link,
            best_effort=best_effort,
            slow_reply_s=lambda: self._scpi.slow_reply_s,
            now=self._clock.now,
            join=join_commands if self._capabilities.joins_commands else None,
            on_failure=self.on_failure,
        )

    def _wait_for_burst_end(self) -> None:
        if self.burst_end_s is None:  # started by another program, in the worst case just now
            try:
                longest_s = self._dialect.burst_duration_s()
            except LinkError as error:
                self.on_failure(error)
                longest_s = MAX_UNSTOPPABLE_DRIVE_S
            self.burst_end_s = self._clock.now() + min(longest_s, MAX_UNSTOPPABLE_DRIVE_S)
        self._clock.sleep(self.burst_end_s - self._clock.now())
        self._ramp_down().query(self._shorten_next_burst)

    def _shorten_next_burst(self) -> None:
        """Set one short cycle: a program that connects later cannot know when a burst began and waits for its full duration."""
        self._dialect.set_cycles(1)
        self._dialect.set_rate(SHORT_BURST_HZ, SINE_CYCLE.size)

    def _check(self, readback: float, setpoint: float, tolerance: float, quantity: str) -> None:
        check_readback(self._scpi.instrument, readback, setpoint, tolerance, quantity)
