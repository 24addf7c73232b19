"""Self-test of the source before high voltage: a small burst, played twice, which the card compares with its command.

A setting that the driver neither sets nor asks for, another byte order, a broken output or a wrong cable would otherwise show in the
first drive only. The amplitude is the tolerance of rest: if high voltage is still on from an earlier run, the burst moves the
specimen no further than an offset that counts as rest.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.bench.card_reading import WatchedStream
from drivers.bench.drive_limits import HvAmplifier
from drivers.bench.rest import REST_NOISE_V, REST_TOLERANCE_V, drive_voltage
from drivers.clock import LATE_PER_SPEED_S, Clock
from drivers.drive_shapes import Sine
from drivers.errors import BenchError
from drivers.interfaces import OTHER_BYTE_ORDER, Block

Volts = NDArray[np.float64]

AMPLITUDE_V = REST_TOLERANCE_V
FREQUENCY_HZ, CYCLES = 130.0, 3
"""A burst of 23 ms at a frequency between two harmonics of the mains."""

LEAD_S, OBSERVED_S = 0.05, 0.3
"""Time before a burst for the idle level, and after it for an end that does not come and for a late begin."""

LATEST_START_S = 0.04
"""Latest begin of a burst after the driver had the reply to its trigger: a busy computer delays the reply and the time of the first
scan."""

MAX_FIT_RATE_HZ = 10_000.0
"""Rate to which a faster recording is averaged for the fit."""

AMPLITUDE_LIMIT, REPEAT_LIMIT, FORM_LIMIT = 0.2, 0.15, 0.3
"""Largest deviation of the gain from 1, of both gains from each other, and of the recording from the fitted burst (rms), relative to
the amplitude: 10, 7.5 and 15 mV, beyond the resolution of generator and card and the largest noise at rest."""

OFFSET_LIMIT_V = 0.015
"""Largest offset of a burst from the level before it, and largest level after it from there."""

MOVED_V, SEEN_GAIN = 2 * REST_NOISE_V, 0.1
"""Smallest standard deviation, over the duration of a burst, of a source that moves, and smallest gain of a burst that was played."""


@dataclass(frozen=True, slots=True)
class PlayedBurst:
    """A recorded burst.

    Attributes:
        delay_s: begin after the reply to its trigger.
        gain: fitted amplitude relative to the commanded one; negative if it is inverted.
        offset_v: level during the burst from the level before it.
        form: remainder of the fit, rms, relative to the amplitude.
        before_v: rms deviation from rest in the duration of half a cycle before its begin.
        moved_v: largest standard deviation of the recording within the duration of a burst.
        after_v: level and rms noise after the burst, whichever is farther from the level before it.
    """

    delay_s: float
    gain: float
    offset_v: float
    form: float
    before_v: float
    moved_v: float
    after_v: float

    def deviation(self, latest_s: float) -> str:
        """Return the difference from the command, with its likely causes as a remedy; empty if there is none."""
        seen = f"{1e3 * abs(self.gain) * AMPLITUDE_V:.0f} mV"
        if self.moved_v < MOVED_V and abs(self.gain) < SEEN_GAIN:
            return (
                "did not start. Look at the generator's trigger source and delay, burst, gate and sequencer settings, and at the cable "
                "from the generator to the card"
            )
        if self.form > FORM_LIMIT:
            return (
                "has another form. Look at the generator's waveform (byte order, interpolation, advance), modulation, sweep, added "
                "channel and filter settings"
            )
        if self.before_v > OFFSET_LIMIT_V >= abs(self.after_v):
            return "begins with a pulse, or follows another one. Look at the generator's trigger source and burst mode, and at its output relay"
        if self.gain < 0:
            return "is inverted. Look at the generator's polarity setting, and at the cable"
        if abs(self.gain - 1) > AMPLITUDE_LIMIT:
            return f"has {seen}. Look at the generator's load (high impedance), unit (volts peak to peak) and attenuator, and at the card's gain"
        if abs(self.offset_v) > OFFSET_LIMIT_V:
            return f"is {1e3 * self.offset_v:.0f} mV off rest. Look at the generator's added channel, and at its range"
        if abs(self.after_v) > OFFSET_LIMIT_V:
            return f"does not end at rest: {1e3 * self.after_v:.0f} mV follow. Look at the generator's burst count, mode and idle level"
        if self.delay_s > latest_s:
            return f"started {1e3 * self.delay_s:.0f} ms late. Look at the generator's trigger delay"
        return ""


@dataclass(frozen=True, slots=True)
class SelfTest:
    """Plays a burst on the armed source at rest, and compares it. A DC supply, which plays no sine and is not triggered, is not tested.

    Args:
        amplifier: amplifier with the source.
        stream: acquisition.
        read_block: reads the next block of the acquisition.
        clock: bench time.
    """

    amplifier: HvAmplifier
    stream: WatchedStream
    read_block: Callable[[], Block]
    clock: Clock

    def run(self) -> None:
        """Play twice, compare, and return to rest.

        Raises:
            BenchError: the source does not play as commanded; the message names the difference and the settings to look at.
            InstrumentError: it rejected the burst, or does not answer.
        """
        rest_v = self.amplifier.map.rest_v
        sine = Sine(min(FREQUENCY_HZ, self.stream.rate_hz / 8), AMPLITUDE_V, rest_v, CYCLES)
        if self.amplifier.reason_unsupported(sine):
            return
        why = self._burst_deviation(sine)
        if why and (order := self.amplifier.byte_order()):
            self.amplifier.byte_order(OTHER_BYTE_ORDER[order])
            if not self._burst_deviation(sine):
                return
            self.amplifier.byte_order(order)
        if why:
            raise BenchError(
                f"not armed: {self.amplifier.identity}, tested with {1e3 * AMPLITUDE_V:.0f} mV before high voltage, {why}"
            )

    def _burst_deviation(self, sine: Sine) -> str:
        latest_s = max(LATEST_START_S, LATE_PER_SPEED_S * float(getattr(self.clock, "speed", 1.0)))
        first = self._play(sine, OBSERVED_S)
        if why := first.deviation(latest_s):
            return f"plays a burst that {why}"
        second = self._play(sine, 2 * latest_s)
        if why := second.deviation(latest_s):
            return f"plays a second burst, unlike the first, that {why}"
        if abs(second.gain - first.gain) > REPEAT_LIMIT:
            return (
                f"plays two bursts of {1e3 * first.gain * AMPLITUDE_V:.0f} and {1e3 * second.gain * AMPLITUDE_V:.0f} mV. Look for a "
                "modulation, and for another program that controls the generator"
            )
        return ""

    def _play(self, sine: Sine, observed_s: float) -> PlayedBurst:
        begin_s = self.clock.now()
        before = self._record(begin_s, begin_s + LEAD_S)[0]
        called_s = self.clock.now()
        self.amplifier.start_drive(sine)
        replied_s = self.clock.now()
        seen, rate_hz = self._record(called_s, replied_s + sine.duration_s + observed_s)
        self.amplifier.return_to_rest()
        return _fit(seen - before.mean(), rate_hz, sine, replied_s - called_s)

    def _record(self, begin_s: float, end_s: float) -> tuple[Volts, float]:
        """Return the volts at the amplifier's input between two bench times, (N,), at the returned rate in Hz."""
        first, last = (round((time_s - self.stream.start_time_s) * self.stream.rate_hz) for time_s in (begin_s, end_s))
        blocks: list[Block] = []
        while not blocks or blocks[-1].stop < last:
            blocks.append(self.read_block())
        volts = np.concatenate([drive_voltage(block, self.stream.scales) for block in blocks])
        volts = volts[max(first - blocks[0].start, 0) : last - blocks[0].start]
        size = max(round(self.stream.rate_hz / MAX_FIT_RATE_HZ), 1)
        return volts[: volts.size // size * size].reshape(-1, size).mean(axis=1), self.stream.rate_hz / size


def _fit(volts: Volts, rate_hz: float, sine: Sine, replied_s: float) -> PlayedBurst:
    """Fit the burst to the volts from rest, (N,), from the begin of its messages, at the first place where they are most alike."""
    size = round(sine.duration_s * rate_hz)
    phase = 2 * np.pi * sine.frequency_hz / rate_hz * np.arange(size)
    spreads = np.lib.stride_tricks.sliding_window_view(volts, size).std(axis=1)
    likeness = np.abs(np.correlate(volts, np.sin(phase), "valid")) / np.maximum(spreads, REST_NOISE_V)
    first = int(np.argmax(likeness > 0.97 * likeness.max()))  # of a burst that does not end, its begin
    columns = np.column_stack([np.ones(size), np.sin(phase), np.cos(phase)])
    played = volts[first : first + size]
    (offset_v, *parts), *_ = np.linalg.lstsq(columns, played, rcond=None)
    remainder = played - columns @ np.array([offset_v, *parts])
    after = volts[first + size + 1 :]
    before = volts[max(first - size // (2 * CYCLES) - 1, 0) : max(first - 1, 1)]
    follows_v = max((float(after.mean()), float(after.std())), key=abs) if after.size > 1 else 0.0
    return PlayedBurst(
        delay_s=first / rate_hz - replied_s,
        gain=float(np.copysign(np.hypot(*parts), parts[0])) / sine.amplitude_v,
        offset_v=float(offset_v),
        form=float(remainder.std()) / sine.amplitude_v,
        before_v=float(np.sqrt(np.mean(before**2))),
        moved_v=float(spreads.max()),
        after_v=follows_v,
    )
