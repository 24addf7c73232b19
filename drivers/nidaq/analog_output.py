"""NI analogue output as a `Source`: renders drives to samples, on the same timebase as the input.

A drive is rendered and written to the card completely before it starts, so that a drive ends by itself if the program hangs. A
level other than rest is also held by a finite buffer, which returns to rest unless the program renews it. Input and output divide
one 100 MHz timebase: a frequency that is exact in one is exact in the other.

Never done here: a device reset (it puts 0 V on every output, -500 V on the specimen), a zero "to be safe", and stopping a task
within a wave unless its output is measured (it stays at the present sample). A drive is stopped by rewriting the samples not yet
on their way as a fade-out; its task is released only when the output is measured at its idle level. If NI's driver refuses a
rewrite, the present sample is kept, measured, and left by a ramp.

Sources: X Series User Manual ch. 5 (FIFO, reference); NI-DAQmx help: regeneration, states after a reset, internal
channels. Rewriting a running buffer was not tested on a real card: see docs/decisions/0014-analogue-output.md.
"""

import contextlib
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from drivers.clock import Clock
from drivers.drive_shapes import Drive, Hold, Ramp
from drivers.errors import AcquisitionError, BenchError, CardInUseError, InstrumentError
from drivers.nidaq.analog_input import INPUT, OUTPUT, READBACK, NiConnection
from drivers.nidaq.card_limits import largest_output_rate_hz
from drivers.nidaq.errors import translate_errors
from drivers.nidaq.output_readback import RELEASE_TOLERANCE_V, OutputReadback
from drivers.nidaq.output_task import OutputQueue, OutputTask, PlaybackProgress, find_queue, write_level
from drivers.nidaq.playback_control import RELEASE_TIMEOUT_S, PlaybackControl
from drivers.nidaq.rendering import (
    FADE_S,
    HOLD_RATES_HZ,
    LONG_DRIVE_RATE_HZ,
    MAX_SAMPLES,
    QUEUE_S,
    RETURN_V_PER_S,
    SAMPLE_RATES_HZ,
    STEP_V,
    Array,
    HeldLevel,
    render_samples,
    sample_count,
    sample_rate_for,
)

LEVEL_TOLERANCE_V = 5e-3
RELEASE_S = 0.2
"""Allowance in the prediction of the way to rest for measuring the level at the release of a task."""

HOLD_TASK_LEASES = 6
"""Duration of a held level's buffer; at its end the next buffer continues at the same level."""

STOP_ROUND_TRIPS, RAMP_ROUND_TRIPS = 12, 24


class NiAnalogOutput:
    """One analogue output as a `Source` (see drivers.interfaces).

    Args:
        device: the card's name, e.g. `Dev1`.
        channel: the output, e.g. `ao0`.
        clock: bench time, which paces the waits.
        server: `host:port` of a gRPC device server, or None for the local driver.
        start_trigger: empty, or the signal that starts a drive, e.g. `ai/SampleClock`: the drive's first sample then falls on a
            scan of the running input, so that its phase is reproducible.
        margin_s: lead of the rewrite of a stopped drive over the samples on their way: time for computer and bus.
        lease_s: duration of a level other than rest without `renew_hold`.

    Raises:
        InstrumentError: driver, server or card is missing.
    """

    holds_rewrites_back: bool = False
    """Whether NI's driver refused a rewrite of a running task."""

    def __init__(
        self,
        device: str,
        channel: str,
        clock: Clock,
        *,
        server: str | None = None,
        start_trigger: str = "",
        margin_s: float = 0.1,
        lease_s: float = 5.0,
    ) -> None:
        self._connection, self._server = NiConnection(device, server), server
        self._physical_channel = f"{device}/{channel}"
        self._trigger = f"/{device}/{start_trigger}" if start_trigger else ""
        self._clock, self._margin_s, self.lease_s = clock, margin_s, lease_s
        self._description = f"{self._connection.description} output {channel}"
        self.identity = self._connection.identity
        try:
            with translate_errors(self._connection.description):
                card = self._connection.device_properties()
                self._max_rate_hz = largest_output_rate_hz(card, self._connection.description, SAMPLE_RATES_HZ[0])
        except InstrumentError:
            self._connection.close()
            raise
        self._readback = OutputReadback(
            self._connection, f"{device}/_{channel}_vs_aognd", self._description, self._clock
        )
        self._control = PlaybackControl(clock, margin_s, self._description)
        self._task: OutputTask | None = None
        self._drive: Drive | None = None
        self._hold: HeldLevel | None = None
        self._start_s = self._renew_at_s = 0.0
        self._rest_v: float | None = None
        self._measured_queue: OutputQueue | None = None
        self._reply_s = 0.0
        with contextlib.suppress(CardInUseError):  # by a running program: starting the acquisition reports it
            self._connection.clear_abandoned(INPUT, OUTPUT, READBACK)
        self._level_v = self._readback.inside_v()

    def is_at_rest(self, rest_v: float, low_v: float, high_v: float) -> bool:
        del low_v, high_v  # the card's output range is fixed at +-10 V; HvAmplifier checks the amplifier's
        if self._is_playing():
            return False
        rests = self._level_v is not None and abs(self.idle_level_v() - rest_v) <= LEVEL_TOLERANCE_V
        self._rest_v = rest_v if rests else self._rest_v
        return rests

    def is_left_live(self, rest_v: float, low_v: float, high_v: float) -> bool:
        del low_v, high_v
        return self._is_playing() or self._level_v is None or abs(self._level_v - rest_v) > LEVEL_TOLERANCE_V

    def initialize_at_rest(self, rest_v: float, low_v: float, high_v: float) -> None:
        del low_v, high_v
        self._release_task()
        self._rest_v = rest_v
        measured = self._readback.inside_v()
        self._level_v = self._level_v if measured is None else measured
        if self._level_v is None:
            self._write_level(rest_v)  # the level is unknown; high voltage is disabled here
        else:
            self.ramp_to(rest_v, 0.5)
        seen = self._readback.inside_v()
        if seen is not None and abs(seen - rest_v) > LEVEL_TOLERANCE_V:
            raise InstrumentError(
                f"{self._description} was set to {rest_v:g} V and measures {seen:.4f} V inside the card "
                f"(limit {LEVEL_TOLERANCE_V:g} V); check what is connected to it"
            )

    def reason_unsupported(self, drive: Drive) -> str:
        if isinstance(drive, Hold | Ramp):
            return ""
        rate = self._rate_for(drive)
        if rate > self._max_rate_hz:
            return (
                f"{self._description}: a {drive.kind} of this frequency and slope takes {rate:g} samples/s, the card gives "
                f"{self._max_rate_hz:g}; lower its frequency or amplitude. Nothing was sent"
            )
        if (samples := sample_count(drive, rate)) > MAX_SAMPLES:
            return (
                f"{self._description}: a {drive.kind} of {drive.duration_s:g} s takes {samples} samples, the limit is "
                f"{MAX_SAMPLES}; shorten it or lower its frequency. Nothing was sent"
            )
        return ""

    @property
    def starts_on_scan(self) -> bool:
        """Whether a drive starts on a scan of the running input."""
        return bool(self._trigger)

    @property
    def unattended_end(self) -> str:
        if self._server:
            rest = f"{self.lease_s:g} s later, at {RETURN_V_PER_S:g} V/s"
            return f"a drive plays to its end and is at rest; a held level returns to rest {rest}"
        return "the output stays at the sample that was converted last"

    def unattended_rest_s(self, drive: Drive, rest_v: float) -> float:
        if not self._server:
            return math.inf
        if not isinstance(drive, Hold):
            return drive.duration_s
        return self.lease_s + abs(drive.level_v - rest_v) / RETURN_V_PER_S

    def predict_rest_s(self, distance_v: float, ramp_v_per_s: float) -> float:
        replies_s = (STOP_ROUND_TRIPS + RAMP_ROUND_TRIPS) * self._reply_s
        return self._margin_s + self._queue_limit_s() + FADE_S + RELEASE_S + distance_v / ramp_v_per_s + replies_s

    def start_drive(self, drive: Drive) -> None:
        begins_v, _ = drive.end_levels_v
        idle_v = self.idle_level_v()
        if self._task is not None and self._hold is None:
            raise InstrumentError(f"{self._description} still plays; stop that first. Nothing was sent")
        if abs(idle_v - begins_v) > LEVEL_TOLERANCE_V:
            raise InstrumentError(
                f"{self._description} idles at {idle_v:.4f} V where the drive begins at {begins_v:.4f} V; nothing was sent"
            )
        if why := self.reason_unsupported(drive):
            raise InstrumentError(why)
        if isinstance(drive, Hold):
            return
        self._end_hold()
        if abs(self.idle_level_v() - begins_v) > LEVEL_TOLERANCE_V:
            raise InstrumentError(
                f"{self._description}: the level of {begins_v:g} V has returned to rest by itself; run again"
            )
        rate = self._rate_for(drive)
        task = OutputTask(
            self._connection, self._physical_channel, self._description, rate, sample_count(drive, rate), self._trigger
        )
        self._start(task, lambda first, count: render_samples(drive, task.rate_hz, first, count), drive, None)

    def renew_hold(self) -> None:
        hold, task = self._hold, self._task
        if hold is None or task is None or self._clock.now() < self._renew_at_s:
            return
        progress = PlaybackProgress(task, self._clock, self._margin_s)
        if progress.first_changeable() >= hold.return_sample:
            raise self._late_renewal(hold)
        target = progress.generated + math.ceil(self.lease_s * task.rate_hz)
        if self.holds_rewrites_back or target > hold.latest_return_sample:
            self._hand_over(hold, progress)
            return
        begins = hold.return_sample
        renewed = replace(hold, return_sample=target)
        try:
            is_in_time = task.rewrite(begins, renewed.samples(begins, target + hold.fall + 1 - begins), progress)
        except AcquisitionError:
            # A card that does not answer raises here as well.
            progress = PlaybackProgress(task, self._clock, self._margin_s)
            self.holds_rewrites_back = True
            self._hand_over(hold, progress)
            return
        if not is_in_time:
            raise self._late_renewal(hold)
        self._hold = renewed
        self._renew_at_s = self._clock.now() + self.lease_s / 4

    def stop(self) -> None:
        task, drive = self._task, self._drive
        if self._hold is not None:
            self._end_hold(to_rest=True)
            return
        if task is None or drive is None or task.is_done():
            self.idle_level_v()
            return
        try:
            level_v, end, remainder = self._control.fade_out(task, drive)
        except AcquisitionError as refused:
            self._stop_where_it_is(task, drive, refused)
            return
        self._drive = Hold(level_v, drive.duration_s)
        self._control.fill(task, remainder, level_v, end)
        if self._control.await_sample(task, end):
            self._await_level(task, level_v)
        else:  # armed, but never triggered: nothing has moved
            level_v = drive.end_levels_v[0]
        self._release_task()
        self._write_level(level_v)

    def ramp_to(self, level_v: float, duration_s: float) -> None:
        to_level = self._rest_v is not None and abs(level_v - self._rest_v) > LEVEL_TOLERANCE_V
        self._end_hold(to_rest=not to_level)
        idle_v = self.idle_level_v()
        if to_level:
            self._start_hold(idle_v, level_v, duration_s)
            if self._hold is not None and self._task is not None:
                self._control.await_sample(self._task, self._hold.rise + 1)
            return
        if abs(level_v - idle_v) > STEP_V / 4:
            ramp = Ramp(idle_v, level_v, duration_s)
            rate = sample_rate_for(ramp)
            # Never triggered: a ramp to rest must not wait for a clock that may have stopped.
            task = OutputTask(
                self._connection, self._physical_channel, self._description, rate, sample_count(ramp, rate)
            )
            self._start(task, lambda first, count: render_samples(ramp, task.rate_hz, first, count), ramp, None)
            self._control.await_sample(task, task.total)
            self._release_task()
        self._write_level(level_v)

    def idle_level_v(self) -> float:
        task, hold = self._task, self._hold
        if task is not None and hold is not None:
            if task.generated() < hold.return_sample:
                return hold.level_v
            self._end_hold()
        elif task is not None and self._drive is not None and task.is_done():
            level_v = self._drive.end_levels_v[1]
            self._release_task()
            self._write_level(level_v)
        if self._level_v is None:
            raise InstrumentError(f"{self._description}: its level is not known; prepare it with high voltage disabled")
        return self._level_v

    def reconnect(self) -> None:
        expected_v = self._expected_v()
        with contextlib.suppress(BenchError):
            self._release_task()  # with a lost connection the task is lost, too
        self._task = self._drive = self._hold = None
        self._connection.reopen()
        measured = self._readback.inside_v()
        if measured is not None:
            self._level_v = measured
        elif expected_v is not None:
            # The input is busy. A reading of the drive's cable may confirm a level, but cannot serve as a start level.
            seen = self._readback.cable_volts()
            confirmed = seen is not None and bool(np.abs(seen - expected_v).max() <= RELEASE_TOLERANCE_V)
            self._level_v = expected_v if confirmed else None

    def close(self) -> None:
        """Release the card. A playing drive is brought to its offset, and rest is written last."""
        with contextlib.suppress(BenchError):
            if self._rest_v is not None and self._level_v is not None:
                self.stop()
                self.ramp_to(self._rest_v, 0.5)
        with contextlib.suppress(BenchError):
            self._release_task()
        self._connection.close()

    def _queue(self) -> OutputQueue:
        if self._measured_queue is None:
            begin_s = self._clock.now()
            self._measured_queue = find_queue(
                self._connection, self._physical_channel, self._description, SAMPLE_RATES_HZ[0]
            )
            self._reply_s = (self._clock.now() - begin_s) / STOP_ROUND_TRIPS
        return self._measured_queue or OutputQueue()

    def _rate_for(self, drive: Drive) -> float:
        """Return the sample rate of a drive: fine enough, and fast enough for the queue."""
        queue, limit_s = self._queue(), self._queue_limit_s()
        slowest = next(
            (rate for rate in SAMPLE_RATES_HZ if queue.samples_at(rate) <= limit_s * rate), SAMPLE_RATES_HZ[-1]
        )
        return sample_rate_for(drive, slowest)

    def _queue_limit_s(self) -> float:
        """Return the longest time for which samples of a drive are on their way; longer only on a card without a choice."""
        return max(QUEUE_S, self._queue().samples_at(LONG_DRIVE_RATE_HZ) / LONG_DRIVE_RATE_HZ)

    def _start_hold(self, from_v: float, level_v: float, duration_s: float) -> None:
        rest_v = level_v if self._rest_v is None else self._rest_v
        ramp = Ramp(from_v, level_v, max(duration_s, 1e-3))
        queue, fine = self._queue(), ramp.slew_v_per_s / STEP_V
        rate = next(
            (r for r in HOLD_RATES_HZ if r >= fine and queue.samples_at(r) <= self.lease_s / 4 * r), HOLD_RATES_HZ[-1]
        )
        lease = math.ceil(self.lease_s * rate)
        rise, fall = math.ceil(ramp.duration_s * rate), math.ceil(abs(level_v - rest_v) / RETURN_V_PER_S * rate) + 1
        hold = HeldLevel(
            from_v, level_v, rest_v, rise, fall, rise + lease, rise + HOLD_TASK_LEASES * lease + fall + 1
        )  # fmt: skip
        task = OutputTask(self._connection, self._physical_channel, self._description, rate, hold.total)
        self._start(task, hold.samples, None, hold)
        self._renew_at_s = self._start_s + ramp.duration_s + self.lease_s / 4

    def _hand_over(self, hold: HeldLevel, progress: PlaybackProgress) -> None:
        """Release the task of a level and begin the next: the output stays at the last converted sample, the level."""
        if not progress.is_released_before(hold.return_sample):
            raise self._late_renewal(hold)
        self._release_task()
        self._level_v = hold.level_v
        self._start_hold(hold.level_v, hold.level_v, 0.0)

    def _late_renewal(self, hold: HeldLevel) -> InstrumentError:
        return InstrumentError(
            f"{self._description}: the level of {hold.level_v:g} V was not renewed for {self.lease_s:g} s, because this "
            "program was held up, and returns to rest by itself; close other programs and run again"
        )

    def _end_hold(self, to_rest: bool = False) -> None:
        """Release a held level: stay at it, or at rest if its return has begun.

        With `to_rest` its return is awaited on a connection on which a ramp to rest would begin later.
        """
        hold, task = self._hold, self._task
        if hold is None or task is None:
            return
        self._control.await_sample(task, hold.rise + 1)
        level_v, returned = hold.level_v, hold.return_sample + hold.fall + 1
        progress = PlaybackProgress(task, self._clock, self._margin_s)
        is_sooner = (returned - progress.generated) / task.rate_hz < RAMP_ROUND_TRIPS * progress.reply_s
        if (to_rest and is_sooner) or not progress.is_released_before(hold.return_sample):
            self._control.await_sample(task, returned)
            level_v = hold.rest_v
        self._release_task()
        self._write_level(level_v)

    def _start(
        self, task: OutputTask, render: Callable[[int, int], Array], drive: Drive | None, hold: HeldLevel | None
    ) -> None:
        try:
            task.write(render, self._clock)
            # Set before the task starts: if the reply is lost, a playing drive must be assumed.
            self._task, self._drive, self._hold, self._start_s = task, drive, hold, self._clock.now()
            task.start()
        except BaseException:
            self._task = self._drive = self._hold = None
            with contextlib.suppress(BenchError):
                task.release()
            raise

    def _stop_where_it_is(self, task: OutputTask, drive: Drive, refused: AcquisitionError) -> None:
        """Release a drive that cannot be rewritten: the output keeps the present sample, which is then measured.

        Raises:
            InstrumentError: its output cannot be measured, and it plays to its end; or it is not steady afterwards.
        """
        played = task.generated()  # raises if the card itself does not answer
        self.holds_rewrites_back = True
        waits = bool(task.trigger) and played == 0
        amplitude_v = (drive.high_v - drive.low_v) / 2
        if not waits and not self._readback.follows(
            task, lambda first, count: render_samples(drive, task.rate_hz, first, count), amplitude_v
        ):
            raise InstrumentError(
                f"{self._description} plays on to the end of its drive, in {(task.total - played) / task.rate_hz:.3g} s: {refused}. "
                "To be stopped now it would have to be measured, and the card's drive channel does not show it; switch high "
                "voltage off at the amplifier, and check the cable from the output to the card's drive channel"
            ) from refused
        self._release_task()
        self._level_v = None
        self._write_level(self._readback.steady_v(drive.low_v, drive.high_v))

    def _await_level(self, task: OutputTask, level_v: float) -> None:
        """Wait until the output is measured at a level, if it is measurable, before its task is released.

        Raises:
            InstrumentError: the output is not at the level; the task is kept.
        """
        deadline_s = self._clock.now() + RELEASE_TIMEOUT_S
        while True:
            seen = self._readback.volts(RELEASE_TIMEOUT_S)  # as long as the level is certainly played
            if seen is None or np.abs(seen - level_v).max() <= RELEASE_TOLERANCE_V or task.is_done():
                return
            if self._clock.now() > deadline_s:
                self._level_v = None
                raise InstrumentError(
                    f"{self._description} was stopped and should idle at {level_v:.3f} V, but measures "
                    f"{float(seen.min()):.3f} to {float(seen.max()):.3f} V (limit {RELEASE_TOLERANCE_V:g} V); check the cable "
                    "from the output to the card's drive channel"
                )
            self._clock.sleep(0.01)

    def _expected_v(self) -> float | None:
        """Return the volts of the task's present sample, or of its last one before its connection broke; None if unknown."""
        task, drive, hold = self._task, self._drive, self._hold
        if task is None:
            return self._level_v
        try:
            played = task.generated()
        except BenchError:
            played = math.floor((self._clock.now() - self._start_s) * task.rate_hz)
        last = min(max(played - 1, 0), task.total - 1)
        if hold is not None:
            return float(hold.samples(last, 1)[0])
        return None if drive is None else float(render_samples(drive, task.rate_hz, last, 1)[0])

    def _is_playing(self) -> bool:
        return self._task is not None and not self._task.is_done()

    def _release_task(self) -> None:
        task, self._task, self._drive, self._hold = self._task, None, None, None
        if task is not None:
            task.release()

    def _write_level(self, level_v: float) -> None:
        write_level(self._connection, self._physical_channel, self._description, level_v)
        self._level_v = level_v
