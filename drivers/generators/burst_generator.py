"""Burst generators: the common driver of all function generators, which rest in an armed burst.

A change of function, load or range can drop an instrument's output to 0 V, which is -500 V on the specimen. So all of them
are set once, before the output comes up. The function is always the arbitrary waveform: its first point is the idle level,
which is the offset (33220A guide p. 227); a sine is one cycle of it repeated, a sweep or a series of steps is a waveform
played once, and so is a held level with its ramps from and to rest. Every drive is a finite burst: it returns to the offset
by itself if this computer fails. The offset itself moves on the way to rest only, and while an instrument is commissioned.

Instruments differ in one respect that matters. Those that can freeze the range of their attenuator set a drive's amplitude
as the amplitude, and are stopped by reducing it in small steps. Those that cannot would switch a relay on the way: they
keep one amplitude, scale the drive in the points of the waveform, and are stopped by waiting for the end.

A subclass supplies the commands of one family and what its instruments can do.
"""

import hashlib
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import ClassVar

import numpy as np

from drivers.clock import Clock
from drivers.drive import Drive, Hold, LinearSweep, PeriodicSweep, Ramp, Sine, SquareWave, Steps
from drivers.errors import InstrumentError, LinkError
from drivers.generators.arbitrary_waveform import SINE_CYCLE, Points, render_waveform
from drivers.generators.generator_capabilities import MAX_UNSTOPPABLE_DRIVE_S, GeneratorCapabilities
from drivers.generators.unsuitable import reason_unsuitable
from drivers.interfaces import Identity
from drivers.level_pulse import LevelPulse
from drivers.transport.safe_ramp_down import RampDown
from drivers.transport.scpi import Link, ScpiSession

LEVEL_TOLERANCE_V = 1e-3
IDLE_AMPLITUDE_VPP = 0.02
"""Idle amplitude of an instrument that sets a drive's amplitude as its amplitude: too small to matter, and possible on all."""

FOREIGN_OUTPUT_RAMP_V_PER_S = 5.0
"""Slope at which a level that an earlier program left is ramped to rest before the instrument is configured."""

SLOW_WIRE_ROUND_TRIPS = 7
"""Replies that the way from a held level to rest waits for when its steps are pipelined."""

HASTENED_END_S, HASTENED_V_PER_S = 1.2, 40.0
"""When a level is at rest whose end is hastened, and the slope up to which its return may be: 40 mV in 1 ms."""

BURST_END_MARGIN_S = 0.1
"""How much later than by the computer's clock a burst may end."""


class BurstGenerator(GeneratorCapabilities):
    """A `Source` (see drivers.interfaces); a subclass per family supplies its commands and capabilities.

    Args:
        link: the connection.
        clock: bench time, which paces the staircases.
        step_v: largest single step of a staircase in volts.
        step_interval_s: time between the steps of a staircase.

    Raises:
        LinkError: nothing answers.
        InstrumentError: another instrument answers.
    """

    IDLE_AMPLITUDE_VPP: ClassVar[float] = IDLE_AMPLITUDE_VPP

    _burst_end_s: float | None = None
    """End of the burst that was started here; unknown at first."""
    _rest_v: float | None = None
    """The rest level: a ramp to it continues despite errors. None in a watchdog that only goes to rest: every ramp does there."""
    _waveform_span: float | None = None
    """Volts of the amplitude setting per volt of the waveform's largest point, between 1 (to one side) and 2; unknown at first."""
    _last_amplitude_vpp: float | None = None
    _last_offset_v: float | None = None
    """The last settings sent, for use when they cannot be read back."""
    hastens_levels: bool = False
    """Whether Stop plays what is left of a level faster, where its end could only be waited for. Only where commissioning has
    measured that a change of frequency continues a running burst: no guide says so."""
    hastened_end_s: ClassVar[float] = HASTENED_END_S
    _level: tuple[LevelPulse, int] | None = None
    """The level that was started last, and its number of points."""

    def __init__(self, link: Link, clock: Clock, *, step_v: float = 0.05, step_interval_s: float = 0.002) -> None:
        self._scpi = ScpiSession(link, f"function generator at {link.name}", clock.now)
        self._clock = clock
        self._step_v = step_v
        self._step_interval_s = step_interval_s
        self.identity: Identity = self._scpi.identify()
        if not self.supports_model(self.identity.model):
            link.close()
            remedy = reason_unsuitable(self.identity) or "Correct the driver or the resource in the bench file"
            raise InstrumentError(
                f"{link.name} answered as '{self.identity}'; this driver is for {self.PRODUCT_NAMES}. {remedy[0].upper()}{remedy[1:]}"
            )
        self._scpi.instrument = f"function generator {self.identity.model}"
        self._stored_waveform: str | None = None  # digest of the downloaded waveform; unknown at first

    def reconnect(self) -> None:
        self._scpi.link.reopen()
        seen = self._scpi.identify()
        if seen != self.identity:
            raise LinkError(f"{self._scpi.link.name} now answers as '{seen}', not '{self.identity}'")
        self._stored_waveform = None  # it may have lost power in between

    def is_output_on(self) -> bool:
        return self._is_output_on()

    def close(self) -> None:
        self._scpi.link.close()

    def is_at_rest(self, rest_v: float, low_v: float, high_v: float) -> bool:
        self._rest_v = rest_v
        self._stored_waveform = None  # another one may have been loaded at the front panel
        if not self._is_output_on() or self._first_mismatch(rest_v, low_v, high_v):
            return False
        if not self.CAN_FREEZE_RANGE:
            self.stop()  # a burst that another program started shows in no setting
        return True

    def is_left_live(self, rest_v: float, low_v: float, high_v: float) -> bool:
        if not self._is_output_on() or not self._has_our_setup(rest_v, low_v, high_v):
            return False
        away = abs(self.idle_level_v() - rest_v) > LEVEL_TOLERANCE_V
        return away or (self.CAN_FREEZE_RANGE and self._query_amplitude() > 2 * self.IDLE_AMPLITUDE_VPP)

    def initialize_at_rest(self, rest_v: float, low_v: float, high_v: float) -> None:
        self._rest_v, self._stored_waveform = rest_v, None
        self._clear_error_queue()
        limits = rest_v, low_v, high_v
        if self._is_output_on() and self._has_our_setup(*limits):
            self._ramp_foreign_output_down(rest_v)
        if not self._is_output_on() or self._first_mismatch(
            *limits
        ):  # otherwise no setting that could drop the output is touched
            self._reset_foreign_settings()
            self._configure(*limits)
            if wrong := self._first_mismatch(*limits):
                output = "is on as it was found" if self._is_output_on() else "was not brought up"
                raise InstrumentError(
                    f"{self._scpi.instrument} does not read back as it was set up ({wrong}); its output {output}. Look at "
                    "its front panel, and switch it off and on"
                )
            self._enable_output()
            if not self._is_output_on():
                raise InstrumentError(f"{self._scpi.instrument}: its output did not come on; look at its front panel")
        self._burst_end_s = self._clock.now()

    def start_level(self, pulse: LevelPulse) -> float:
        if why := self.reason_level_unsupported(pulse):
            raise InstrumentError(why)
        points, full_v = render_waveform(pulse, self._max_points(), self._step_v)
        self._level = pulse, points.size
        return self._start_burst(points, full_v, 1 / pulse.duration_s, 1, pulse.rest_v)

    def adopt_level(self, pulse: LevelPulse, end_s: float) -> None:
        """Take over a level that another process started, and that ends by itself at a bench time."""
        points, _ = render_waveform(pulse, self._max_points(), self._step_v)
        self._level, self._burst_end_s = (pulse, points.size), end_s

    def start_drive(self, drive: Drive) -> None:
        if why := self.reason_unsupported(drive):
            raise InstrumentError(why)
        match drive:
            case Hold(level_v, _):
                self._check_idle_level(level_v)
            case Ramp(start_v, stop_v, duration_s):
                self._check_idle_level(start_v)
                self.ramp_to(stop_v, duration_s)
            case Sine(frequency_hz, amplitude_v, offset_v, cycles):
                self._start_burst(SINE_CYCLE, amplitude_v, frequency_hz, cycles, offset_v)
            case LinearSweep() | Steps():
                points, full_v = render_waveform(drive, self._max_points(), self._max_step_v(drive))
                self._start_burst(points, full_v, 1 / drive.duration_s, 1, drive.end_levels_v[0])
            case PeriodicSweep():
                points, full_v = render_waveform(drive, self._max_points(), self._max_step_v(drive))
                self._start_burst(points, full_v, 1 / drive.period_s, drive.periods, drive.offset_v)
            case SquareWave():
                points, full_v = render_waveform(drive, self._max_points(), self._max_step_v(drive))
                self._start_burst(points, full_v, drive.frequency_hz, drive.cycles, drive.offset_v)

    def end_level(self, duration_s: float) -> None:
        if not self.CAN_FREEZE_RANGE and self.hastens_levels:
            self._hasten_burst_end()
        self._stop_within(0.0 if self._burst_has_ended() else duration_s)

    def stop(self) -> None:
        self._stop_within(0.0)

    def _stop_within(self, duration_s: float) -> None:
        """Reduce the amplitude in steps, in about `duration_s` or as fast as the steps may follow each other, and abort."""
        if not self.CAN_FREEZE_RANGE:
            self._wait_for_burst_end()
            return
        way = self._ramp_down()
        way.query(
            self._clear_error_queue
        )  # or an old entry of the queue would be mistaken for the result of the first step
        amplitude = way.query(self._query_amplitude)
        if amplitude is None:
            amplitude = self._last_amplitude_vpp
        if amplitude is None:
            way.raise_first_error()  # neither read nor set: a step could increase it
            return
        if self._burst_has_ended() and amplitude <= self.IDLE_AMPLITUDE_VPP * (1 + 1e-6):
            way.raise_first_error()
            return  # under a held level an abort may play the idle amplitude once more, beyond the amplifier's range
        # Aborting a running cycle then leaves a few millivolts on the output at most, whatever the firmware does.
        span = self._waveform_span or (1.0 if self.AMPLITUDE_IS_WAVEFORM_SPAN else 2.0)
        steps = max(math.ceil((amplitude - self.IDLE_AMPLITUDE_VPP) / span / self._step_v), 0)
        for i in range(1, steps + 1):
            self._last_amplitude_vpp = vpp = amplitude + (self.IDLE_AMPLITUDE_VPP - amplitude) * i / steps
            way.step(self._amplitude_command(vpp), partial(self._set_amplitude, vpp))
            self._clock.sleep(max(self._step_interval_s, duration_s / steps))
        for command in self._abort_commands():
            way.step(command, partial(self._send, command))
        way.flush()
        left = way.query(self._query_amplitude)
        way.raise_first_error()
        if left is not None:
            self._check_readback(
                left, self.IDLE_AMPLITUDE_VPP, self.IDLE_AMPLITUDE_VPP, "the amplitude in volts peak to peak"
            )

    def _hasten_burst_end(self) -> None:
        """Play what is left of a level faster; if that cannot be confirmed, its end is waited for as if it was not."""
        begin_s, level, end_s = self._clock.now(), self._level, self._burst_end_s
        if level is None or end_s is None or end_s - begin_s <= HASTENED_END_S:
            return
        pulse, size = level
        ratio = min((end_s - begin_s) / HASTENED_END_S, HASTENED_V_PER_S / pulse.slew_v_per_s)
        if ratio <= 1:
            return
        self._level = None  # hastened once
        try:
            self._set_rate(ratio / pulse.duration_s, size)
        except InstrumentError:
            return
        self._burst_end_s = self._clock.now() + (end_s - begin_s) / ratio

    def upload_longest(self) -> None:
        """Upload a waveform of the most points that the driver sends, without playing it: to time it.

        Raises:
            InstrumentError: it was rejected.
        """
        self._load_waveform(np.sin(2 * np.pi * np.arange(self._max_points()) / self._max_points()))

    def _burst_has_ended(self) -> bool:
        """Whether the burst that was started here last is certainly over; False if another program may have started one."""
        return self._burst_end_s is not None and self._clock.now() > self._burst_end_s + BURST_END_MARGIN_S

    def ramp_to(self, level_v: float, duration_s: float) -> None:
        way = self._ramp_down(best_effort=self._rest_v in (None, level_v))
        start = way.query(self.idle_level_v)
        if start is None:
            start = self._last_offset_v
        if start is None:
            way.raise_first_error()
            return
        steps = self._step_count(abs(level_v - start), duration_s)
        way.limit_duration(duration_s, steps, self._scpi.reply_s, getattr(self._clock, "speed", 1.0))
        for i in range(1, steps + 1):
            volts = start + (level_v - start) * i / steps
            self._last_offset_v = volts  # before it is sent: if the reply is lost, it must be assumed to be set
            way.step(self._offset_command(volts), partial(self._set_offset, volts))
            self._clock.sleep(duration_s / steps)
        way.flush()
        reached = way.query(self.idle_level_v)
        way.raise_first_error()
        if reached is not None:
            self._check_readback(reached, level_v, LEVEL_TOLERANCE_V, "the offset in volts")

    def _step_count(self, distance_v: float, duration_s: float) -> int:
        return max(math.ceil(distance_v / self._step_v), math.ceil(duration_s / (4 * self._step_interval_s)), 1)

    def predict_rest_s(self, distance_v: float, ramp_v_per_s: float) -> float:
        ramp_s = distance_v / ramp_v_per_s
        round_trips = SLOW_WIRE_ROUND_TRIPS
        if not self._scpi.slow_reply_s:
            round_trips += self._step_count(distance_v, ramp_s)
        return ramp_s + round_trips * self._scpi.reply_s

    def _ramp_down(self, best_effort: bool = True) -> RampDown:
        return RampDown(
            self._scpi.link,
            best_effort=best_effort,
            slow_reply_s=lambda: self._scpi.slow_reply_s,
            now=self._clock.now,
            join=self._join_commands,
        )

    def _ramp_foreign_output_down(self, rest_v: float) -> None:
        """Ramp a drive or level that an earlier program left to rest, like any drive.

        High voltage is disabled here, and everything is configured again afterwards. But the operator may have switched
        off the wrong amplifier, and a slow ramp does not damage the specimen.
        """
        self.stop()
        self.ramp_to(rest_v, abs(self.idle_level_v() - rest_v) / FOREIGN_OUTPUT_RAMP_V_PER_S)

    def _wait_for_burst_end(self) -> None:
        if self._burst_end_s is None:  # started by another program: in the worst case just now
            try:
                longest_s = self._query_burst_duration_s()
            except LinkError:
                longest_s = MAX_UNSTOPPABLE_DRIVE_S
            self._burst_end_s = self._clock.now() + min(longest_s, MAX_UNSTOPPABLE_DRIVE_S)
        self._clock.sleep(self._burst_end_s - self._clock.now())
        RampDown(self._scpi.link).query(self._shorten_next_burst)

    def _shorten_next_burst(self) -> None:
        """Set one short cycle: a program that connects later cannot know when a burst began and waits for its full duration."""
        self._set_cycles(1)
        self._set_rate(1000.0, SINE_CYCLE.size)

    def _change_amplitude(self, vpp: float) -> None:
        self._last_amplitude_vpp = vpp
        self._set_amplitude(vpp)

    def _start_burst(self, points: Points, full_v: float, rate_hz: float, cycles: int, idle_v: float) -> float:
        """Play `cycles` periods of the waveform at `rate_hz` periods a second, a full-scale point being `full_v`.

        Returns the bench time just before the trigger was sent.
        """
        name, seconds = self._scpi.instrument, cycles / rate_hz
        self._check_idle_level(idle_v)
        if not self.CAN_FREEZE_RANGE:
            most_v = self._query_amplitude() / 2
            if full_v > most_v + LEVEL_TOLERANCE_V:
                raise InstrumentError(
                    f"{name} was set up for {most_v:.3g} V at most around where it idles, not {full_v:.3g} V; "
                    "lower the drive's amplitude, or arm the bench again. Nothing was sent"
                )
            points, full_v = points * (full_v / most_v), most_v
        self._load_waveform(points)
        self._set_rate(rate_hz, points.size)
        self._set_cycles(cycles)
        if self.CAN_FREEZE_RANGE:
            expected = self._amplitude_setting_vpp(points, full_v)
            self._waveform_span = expected / full_v
            self._change_amplitude(expected)
            self._check_readback(
                self._query_amplitude(), expected, LEVEL_TOLERANCE_V, "the amplitude in volts peak to peak"
            )
        triggered_s = self._clock.now()
        self._burst_end_s = triggered_s + seconds  # before it is sent: if the reply is lost, it must be assumed to play
        self._trigger()
        self._burst_end_s = self._clock.now() + seconds
        return triggered_s

    def _load_waveform(self, points: Points) -> None:
        expected = hashlib.sha256(points.tobytes()).hexdigest()
        if expected == self._stored_waveform:
            return
        if self.CAN_FREEZE_RANGE:
            self._change_amplitude(self.IDLE_AMPLITUDE_VPP)  # a transient during the download then stays this small
        self._stored_waveform = None
        self._download_waveform(points)
        self._stored_waveform = expected

    def _check_readback(self, readback: float, setpoint: float, tolerance: float, quantity: str) -> None:
        if not abs(readback - setpoint) <= tolerance:
            raise InstrumentError(
                f"{self._scpi.instrument}: {quantity} was set to {setpoint:.6g} and reads back {readback:.6g} (limit {tolerance:.2g}); "
                "nothing more was sent. See its actual setting on the instrument's front panel"
            )

    def _check_idle_level(self, level_v: float) -> None:
        seen = self.idle_level_v()
        if abs(seen - level_v) > LEVEL_TOLERANCE_V:
            raise InstrumentError(
                f"{self._scpi.instrument} idles at {seen:.4f} V where the drive begins at {level_v:.4f} V; nothing was sent"
            )

    _join_commands: Callable[[Sequence[str]], str] | None = None
    """Joins commands to one message, where the instrument takes several."""

    def _amplitude_setting_vpp(self, points: Points, full_v: float) -> float:
        """Return the amplitude setting at which a full-scale point is `full_v` away from the offset."""
        return (float(np.ptp(points)) if self.AMPLITUDE_IS_WAVEFORM_SPAN else 2) * full_v
