"""NI analogue output as a `Source`: renders drives to samples, on the same timebase as the input.

A drive is rendered and written to the card completely before it starts, so that a drive ends by itself if the program
hangs. Input and output divide one 100 MHz timebase: a frequency that is exact in one is exact in the other.

Never done here: a device reset (it puts 0 V on every output, -500 V on the specimen), a zero "to be safe", and stopping a
task in mid-wave (the output would stay at the sample it had reached). A drive is stopped by rewriting the samples not yet
played as a fade-out; only then is its task released.

Sources: X Series User Manual ch. 5 (FIFO, reference); NI-DAQmx help: regeneration, states after a reset, internal
channels. Rewriting a running buffer was not tested on a real card: see docs/decisions/0014-analogue-output.md.
"""

import contextlib
import math
from typing import Any

import numpy as np
from nidaqmx.constants import AcquisitionType, WriteRelativeTo
from nidaqmx.stream_writers import AnalogSingleChannelWriter
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.deprecated import SOURCE_METHODS, renamed
from drivers.drive import Drive, Hold, LinearSweep, PeriodicSweep, Ramp, Sine
from drivers.errors import BenchError, CardInUseError, InstrumentError
from drivers.nidaq.analog_input import INPUT, OUTPUT, READBACK, NiConnection
from drivers.nidaq.errors import translate_errors

SAMPLE_RATES_HZ = (10e3, 20e3, 50e3, 100e3, 200e3, 500e3)
"""Integer parts of an NI card's 100 MHz timebase; the slowest that is fine enough is taken."""

STEP_V = 0.02
"""Largest step between two samples: 12 V on the specimen."""

SAMPLES_PER_CYCLE = 100
FADE_S = 0.05
HOLD_AFTER_FADE_S = 1.0
"""Rest after a fade: longer than it takes anybody to let go of the card."""

Array = NDArray[np.float64]


def sample_rate_for(drive: Drive) -> float:
    """Samples per second."""
    fine = drive.slew_v_per_s / STEP_V
    if isinstance(drive, Sine):
        fine = max(fine, SAMPLES_PER_CYCLE * drive.frequency_hz)
    if isinstance(drive, LinearSweep | PeriodicSweep):
        fine = max(fine, SAMPLES_PER_CYCLE * max(drive.start_hz, drive.stop_hz))
    return next((rate for rate in SAMPLE_RATES_HZ if rate >= fine), SAMPLE_RATES_HZ[-1])


def sample_count(drive: Drive, rate_hz: float) -> int:
    """Samples of the whole drive; the last one is where it ends."""
    return math.ceil(drive.duration_s * rate_hz) + 1


def render_samples(drive: Drive, rate_hz: float, first: int, count: int) -> Array:
    """Samples `first` to `first + count`, shape (count,); beyond its end the drive stays where it ended."""
    t = np.arange(first, first + count) / rate_hz
    return np.ascontiguousarray(drive.volts(np.minimum(t, drive.duration_s)))


def idle_level_after_stop_v(drive: Drive, rate_hz: float, first: int) -> float:
    """Where a drive idles that is stopped at sample `first`: at its offset, or at the level it has reached."""
    last = sample_count(drive, rate_hz) - 1
    if isinstance(drive, Sine | LinearSweep | PeriodicSweep) and first <= last:
        return drive.offset_v
    return float(render_samples(drive, rate_hz, min(first, last), 1)[0])


def fade_out(drive: Drive, rate_hz: float, first: int) -> tuple[Array, int]:
    """Return what to play from sample `first` on instead of the drive, and how many of these samples are the fade."""
    left = sample_count(drive, rate_hz) - first
    fade = min(math.ceil(FADE_S * rate_hz), left)
    level_v = idle_level_after_stop_v(drive, rate_hz, first)
    wave = np.full(fade, level_v)
    if isinstance(drive, Sine | LinearSweep | PeriodicSweep):
        wave += np.linspace(1.0, 0.0, fade) * (render_samples(drive, rate_hz, first, fade) - level_v)
    return np.concatenate((wave, np.full(min(math.ceil(HOLD_AFTER_FADE_S * rate_hz), left - fade), level_v))), fade


LEVEL_TOLERANCE_V = 5e-3
MAX_SAMPLES = 50_000_000
SAMPLES_PER_WRITE = 200_000
"""Samples in one message: below the 4 MB that a gRPC server takes by default."""

FIFO_SAMPLES = 8191
"""Samples that the card may have fetched already and will play whatever is written over them."""


@renamed(SOURCE_METHODS)
class NiAnalogOutput:
    """One analogue output as a `Source` (see drivers.interfaces).

    Args:
        device: the card's name, e.g. `Dev1`.
        channel: the output, e.g. `ao0`.
        clock: bench time, which paces the waits.
        server: `host:port` of a gRPC device server, or None for the local driver.
        start_trigger: empty, or the signal that starts a drive, e.g. `ai/SampleClock`: the drive's first sample then
            falls on a scan of the running input, whose phase is so the same each time.
        margin_s: how far ahead of the sample being played a stopped drive is rewritten: the time that the computer and
            the bus have for it.

    Raises:
        InstrumentError: the driver, the server or the card is not there.
    """

    def __init__(
        self,
        device: str,
        channel: str,
        clock: Clock,
        *,
        server: str | None = None,
        start_trigger: str = "",
        margin_s: float = 0.1,
    ) -> None:
        self._connection = NiConnection(device, server)
        self._physical_channel, self._readback_channel = f"{device}/{channel}", f"{device}/_{channel}_vs_aognd"
        self._trigger = f"/{device}/{start_trigger}" if start_trigger else ""
        self._clock, self._margin_s = clock, margin_s
        self._description = f"{self._connection.description} output {channel}"
        self.identity = self._connection.identity
        self._task: Any = None
        self._drive: Drive | None = None
        self._rate_hz, self._samples = SAMPLE_RATES_HZ[0], 0
        self._start_s = 0.0
        self._rest_v: float | None = None
        with contextlib.suppress(CardInUseError):  # by a program that runs: starting the acquisition reports it
            self._connection.clear_abandoned(INPUT, OUTPUT, READBACK)
        self._level_v = self._read_back_v()

    def is_at_rest(self, rest_v: float, low_v: float, high_v: float) -> bool:
        del low_v, high_v  # the card's output range is fixed at +-10 V; HvAmplifier checks the amplifier's
        if self._task is not None and not self._is_done():
            return False
        rests = self._level_v is not None and abs(self.idle_level_v() - rest_v) <= LEVEL_TOLERANCE_V
        self._rest_v = rest_v if rests else self._rest_v
        return rests

    def is_left_live(self, rest_v: float, low_v: float, high_v: float) -> bool:
        del low_v, high_v
        playing = self._task is not None and not self._is_done()
        return playing or self._level_v is None or abs(self._level_v - rest_v) > LEVEL_TOLERANCE_V

    def initialize_at_rest(self, rest_v: float, low_v: float, high_v: float) -> None:
        del low_v, high_v
        self._release_task()
        self._rest_v = rest_v
        measured = self._read_back_v()
        self._level_v = self._level_v if measured is None else measured
        if self._level_v is None:
            self._write_level(rest_v)  # the level is not known; high voltage is disabled here
        else:
            self.ramp_to(rest_v, 0.5)
        seen = self._read_back_v()
        if seen is not None and abs(seen - rest_v) > LEVEL_TOLERANCE_V:
            raise InstrumentError(
                f"{self._description} was set to {rest_v:g} V and measures {seen:.4f} V inside the card "
                f"(limit ±{LEVEL_TOLERANCE_V:g} V); check what is connected to it"
            )

    def start_drive(self, drive: Drive) -> None:
        begins_v, _ = drive.end_levels_v
        idle_v = self.idle_level_v()
        if self._task is not None:
            raise InstrumentError(f"{self._description} still plays; stop that first. Nothing was sent")
        if abs(idle_v - begins_v) > LEVEL_TOLERANCE_V:
            raise InstrumentError(
                f"{self._description} idles at {idle_v:.4f} V where the drive begins at {begins_v:.4f} V; nothing was sent"
            )
        if not isinstance(drive, Hold):
            self._start(drive, self._trigger)

    def stop(self) -> None:
        task, drive = self._task, self._drive
        if task is None or drive is None or self._is_done():
            self.idle_level_v()
            return
        rate = self._rate_hz
        with translate_errors(self._description):
            first = task.out_stream.total_samp_per_chan_generated + FIFO_SAMPLES + math.ceil(self._margin_s * rate)
            total = self._samples
            end = self._rewrite_with_fade(task, drive, first) if first < total else total
            began = self._clock.now()
            patience_s = (end - first + FIFO_SAMPLES) / rate + 2 * self._margin_s + 2.0
            while (played := task.out_stream.total_samp_per_chan_generated) < end:
                waited_s = self._clock.now() - began
                if played == 0 and self._trigger and waited_s > self._margin_s:
                    break  # armed, but the trigger never came: nothing has moved
                if waited_s > patience_s:
                    raise InstrumentError(
                        f"{self._description} plays no further; check the card's power and its USB cable"
                    )
                self._clock.sleep(min((end - played) / rate, 0.02))
            level_v = drive.end_levels_v[0] if played == 0 else idle_level_after_stop_v(drive, rate, first)
        self._release_task()
        self._write_level(level_v)

    def ramp_to(self, level_v: float, duration_s: float) -> None:
        idle_v = self.idle_level_v()
        if abs(level_v - idle_v) > STEP_V / 4:
            # Never triggered: a ramp to rest must not wait for a clock that may have stopped.
            self._start(Ramp(idle_v, level_v, duration_s), "")
            began = self._clock.now()
            while not self._is_done():
                if self._clock.now() - began > duration_s + 2.0:
                    raise InstrumentError(
                        f"{self._description} did not reach {level_v:g} V within {duration_s + 2:.1f} s; check the card"
                    )
                self._clock.sleep(min(max(began + duration_s - self._clock.now(), 1e-3), 0.02))
            self._release_task()
        self._write_level(level_v)

    def idle_level_v(self) -> float:
        if self._is_done() and self._drive is not None:
            level_v = self._drive.end_levels_v[1]
            self._release_task()
            self._write_level(level_v)
        if self._level_v is None:
            raise InstrumentError(f"{self._description}: its level is not known; prepare it with high voltage disabled")
        return self._level_v

    def reconnect(self) -> None:
        drive, elapsed_s = self._drive, self._clock.now() - self._start_s
        with contextlib.suppress(BenchError):
            self._release_task()  # with a lost connection the task is gone, too
        self._connection.reopen()
        self._drive = None
        measured = self._read_back_v()
        if measured is not None:
            self._level_v = measured
        elif drive is not None:
            # The input is busy. The output is at the level of the drive when its task died, or when it ended.
            self._level_v = float(drive.volts(np.array([min(elapsed_s, drive.duration_s)]))[0])

    def close(self) -> None:
        """Release the card. A playing drive is brought to its offset, and rest is written last."""
        with contextlib.suppress(BenchError):
            if self._rest_v is not None and self._level_v is not None:
                self.stop()
                self.ramp_to(self._rest_v, 0.5)
        with contextlib.suppress(BenchError):
            self._release_task()
        self._connection.close()

    def _start(self, drive: Drive, trigger: str) -> None:
        rate = sample_rate_for(drive)
        samples = sample_count(drive, rate)
        if samples > MAX_SAMPLES:
            raise InstrumentError(
                f"{self._description}: a {drive.kind} of {drive.duration_s:g} s takes {samples} samples, the limit is "
                f"{MAX_SAMPLES}; shorten it or lower its frequency. Nothing was sent"
            )
        self._release_task()
        task = self._connection.new_task(OUTPUT)
        try:
            with translate_errors(self._description):
                task.ao_channels.add_ao_voltage_chan(self._physical_channel, min_val=-10.0, max_val=10.0)
                task.timing.cfg_samp_clk_timing(rate, sample_mode=AcquisitionType.FINITE, samps_per_chan=samples)
                if trigger:
                    task.triggers.start_trigger.cfg_dig_edge_start_trig(trigger)
                task.out_stream.output_buf_size = samples
                self._rate_hz, self._samples = float(task.timing.samp_clk_rate), samples
                writer = AnalogSingleChannelWriter(task.out_stream, auto_start=False)
                for first in range(0, samples, SAMPLES_PER_WRITE):
                    count = min(SAMPLES_PER_WRITE, samples - first)
                    writer.write_many_sample(render_samples(drive, self._rate_hz, first, count))
                # Set before the task starts: if the reply is lost, the drive must be assumed to play.
                self._task, self._drive, self._start_s = task, drive, self._clock.now()
                task.start()
        except BaseException:
            self._task = self._drive = None
            with contextlib.suppress(BenchError):
                self._connection.close_task(task, OUTPUT)
            raise

    def _rewrite_with_fade(self, task: Any, drive: Drive, first: int) -> int:
        """Rewrite the drive from sample `first` on as a fade-out; return the sample at which it ends."""
        wave, fade = fade_out(drive, self._rate_hz, first)
        writer = AnalogSingleChannelWriter(task.out_stream, auto_start=False)
        task.out_stream.relative_to = WriteRelativeTo.FIRST_SAMPLE
        for k in range(0, wave.size, SAMPLES_PER_WRITE):
            task.out_stream.offset = first + k
            writer.write_many_sample(np.ascontiguousarray(wave[k : k + SAMPLES_PER_WRITE]))
        return first + fade

    def _is_done(self) -> bool:
        if self._task is None:
            return False
        with translate_errors(self._description):
            return bool(self._task.is_task_done())

    def _release_task(self) -> None:
        task, self._task, self._drive = self._task, None, None
        if task is not None:
            self._connection.close_task(task, OUTPUT)

    def _write_level(self, level_v: float) -> None:
        """Write one level immediately, without a clock."""
        task = self._connection.new_task(OUTPUT)
        try:
            with translate_errors(self._description):
                task.ao_channels.add_ao_voltage_chan(self._physical_channel, min_val=-10.0, max_val=10.0)
                task.write(level_v, auto_start=True)
        finally:
            self._connection.close_task(task, OUTPUT)
        self._level_v = level_v

    def _read_back_v(self) -> float | None:
        """Return the output as measured inside the card; None if its converter is busy or has no such channel."""
        task: Any = None
        try:
            task = self._connection.new_task(READBACK)
            with translate_errors(self._description):
                task.ai_channels.add_ai_voltage_chan(self._readback_channel, min_val=-10.0, max_val=10.0)
                return float(task.read())
        except InstrumentError:
            return None
        finally:
            if task is not None:
                with contextlib.suppress(InstrumentError):
                    self._connection.close_task(task, READBACK)
