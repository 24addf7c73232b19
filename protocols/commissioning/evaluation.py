"""Evaluation of a recorded output: fit of the commanded waveform, levels, and transients with their cause."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drivers import Hold, Sine
from model import Array
from protocols.commissioning.exercise import LEAD_S, Trace
from protocols.commissioning.messages import MessageKind

EARLIEST_START_S, LATEST_START_S = -0.005, 0.04
"""Latest begin of a burst after its trigger was sent and after the driver had its reply: a busy computer delays both."""

IDLE_S = 0.005
"""Time before the drive for the measurement of the idle level."""

TRANSIENT_V = 0.04
"""Smallest significant transient: above the card's noise and twice the idle amplitude of an armed burst, 20 mVpp."""

CLOCK_MARGIN_S = 2e-3
"""Largest difference between the card's time and the time of the messages."""

EDGE_S = 3e-4
SMOOTHING_S = 1e-4
SEEN_V = 0.02
JUMP_S = 2e-4


@dataclass(frozen=True, slots=True)
class Transient:
    """A departure of the output: lowest or highest level, and the kind of the message that caused it."""

    time_s: float
    volts: float
    away_v: float
    cause: MessageKind
    text: str


class Evaluation:
    """Figures of one recorded output; NaN for a figure that the trace does not have.

    Args:
        trace: the recorded output.
        fitted_s: duration of the fit of a waveform that was stopped before its end.
    """

    def __init__(self, trace: Trace, fitted_s: float | None = None) -> None:
        self.trace = trace
        drive = trace.drive
        self.idle_v = drive.end_levels_v[0]
        self._fitted_s = drive.duration_s if fitted_s is None else min(fitted_s, drive.duration_s)
        self.peak_v = max(drive.high_v - self.idle_v, self.idle_v - drive.low_v)
        triggers = [m.time_s for m in trace.messages if m.kind is MessageKind.TRIGGER]
        self.trigger_s = triggers[-1] if triggers else trace.started_s
        self.gain = self.residual = self.misfit = self.mean_v = self.crosstalk = math.nan
        self.start_s = self.trigger_s
        self._fit()

    def _fit(self) -> None:
        from scipy.signal import correlate  # imported here: takes as long to load as all other modules

        trace, rate = self.trace, self.trace.rate_hz
        times = np.arange(round(self._fitted_s * rate)) / rate
        form = trace.drive.volts(times) - self.idle_v
        centred = form - form.mean()
        begin_s = self.trigger_s + EARLIEST_START_S
        latest_s = max(self.trigger_s, trace.started_s) + LATEST_START_S
        seen = trace.span(begin_s, latest_s + self._fitted_s)
        if seen.size <= form.size or not np.any(centred):
            return
        idle = np.concatenate([[0.0], np.cumsum((seen - _mean(trace.span(begin_s - IDLE_S, begin_s))) ** 2)])
        # Least squares at all lags: the residual of the samples is smallest at the begin of the waveform after the idle level.
        seen = seen - seen.mean()
        match = correlate(seen, centred, "valid")
        sums = np.concatenate([[0.0], np.cumsum(seen)])
        squares = np.concatenate([[0.0], np.cumsum(seen**2)])
        size = form.size
        energy = squares[size:] - squares[:-size] - (sums[size:] - sums[:-size]) ** 2 / size
        left = idle[: energy.size] + energy - match**2 / (centred @ centred)
        if self._fitted_s == trace.drive.duration_s:  # and any level follows
            count = np.maximum(seen.size - np.arange(size, seen.size + 1), 1)
            left += squares[-1] - squares[size:] - (sums[-1] - sums[size:]) ** 2 / count
        best = int(np.argmin(left))
        self.gain = float(match[best] / (centred @ centred))
        self.start_s = begin_s + best / rate
        played = trace.span(self.start_s, self.start_s + 2 * self._fitted_s)[:size]
        self.mean_v = float(played.mean() - self.gain * form.mean())
        edge = round(EDGE_S * rate)
        rest = _smoothed(played - self.mean_v - self.gain * form, rate)[edge:-edge]
        peak_v = max(abs(self.gain) * self.peak_v, 1e-9)
        first = round((self.start_s - trace.start_s) * rate)
        others = trace.others[:, first : first + size]
        if others.shape[1] == size:
            gains = others @ centred / (centred @ centred)
            self.crosstalk = float(np.abs(gains / self.gain).max(initial=0.0)) if self.gain else math.nan
        self.residual = float(np.abs(rest).max()) / peak_v
        # By the median: a surge at the start is a departure of the form, and leaves amplitude and polarity measurable.
        self.misfit = 1.4826 * float(np.median(np.abs(rest - np.median(rest)))) / peak_v

    @property
    def seen(self) -> bool:
        """Whether a drive was recorded."""
        return abs(self.gain) * self.peak_v > SEEN_V

    @property
    def end_s(self) -> float:
        """Bench time at which the burst ends by itself."""
        return self.start_s + self.trace.drive.duration_s

    @property
    def stop_duration_s(self) -> float:
        """Duration of Stop; if it waits for the burst, from the end of the burst."""
        messages = self.trace.messages  # a card's output has no bursts, and never has to wait
        aborts = any(m.kind is MessageKind.ABORT for m in messages)
        waits = self.end_s < self.trace.rest_s and bool(messages) and not aborts
        return self.trace.rest_s - (self.end_s if waits else self.trace.stop_s)

    @property
    def start_in_scans(self) -> float:
        """Start of a sine between two scans, as a fraction of their interval; NaN for other drives."""
        drive, rate = self.trace.drive, self.trace.rate_hz
        if not isinstance(drive, Sine) or drive.cycles < 3 or not self.seen:
            return math.nan
        first = round((self.start_s - self.trace.start_s + 1 / drive.frequency_hz) * rate)
        count = round((min(self._fitted_s, drive.cycles / drive.frequency_hz) - 2 / drive.frequency_hz) * rate)
        turning = np.exp(-2j * np.pi * drive.frequency_hz / rate * np.arange(first, first + count))
        played = self.trace.volts[first : first + count]
        tone = complex(np.sum((played - played.mean()) * turning)) if played.size == count else complex(math.nan)
        return -math.atan2(tone.imag, tone.real) / (2 * math.pi) * rate / drive.frequency_hz % 1.0

    @cached_property
    def before_v(self) -> float:
        """Level before the first message."""
        return _mean(self.trace.span(self.trace.start_s, self.trace.start_s + LEAD_S))

    @cached_property
    def armed_v(self) -> float:
        """Level with everything set, before the burst begins."""
        return _mean(self.trace.span(self.start_s - 0.008, self.start_s - 0.001))

    @cached_property
    def after_v(self) -> float:
        """Level after the burst has ended, before Stop."""
        return _mean(self.trace.span(self.end_s + 0.005, self.trace.stop_s - CLOCK_MARGIN_S))

    @cached_property
    def final_v(self) -> float:
        """Level after Stop."""
        return _mean(self.trace.volts[-round(0.05 * self.trace.rate_hz) :])

    @cached_property
    def held_v(self) -> float:
        """Level during a held level; NaN for other drives."""
        return _mean(self.trace.span(self.trace.started_s + 0.01, self.trace.stop_s - CLOCK_MARGIN_S))

    @property
    def stop_jump_v(self) -> float:
        """Largest change of the output within 0.2 ms after Stop, beyond the drive's own change."""
        smoothed = _smoothed(self.trace.volts, self.trace.rate_hz)
        begin, count = (round(t * self.trace.rate_hz) for t in (self.trace.stop_s - self.trace.start_s, JUMP_S))
        after = smoothed[begin : -round(EDGE_S * self.trace.rate_hz)]
        if after.size <= count or not math.isfinite(self.gain):
            return math.nan
        own_v = abs(self.gain) * self.trace.drive.slew_v_per_s * JUMP_S
        return float(np.abs(after[count:] - after[:-count]).max()) - own_v

    def transients(self) -> list[Transient]:
        """Return the departures of the output from its levels before and after the burst, and during Stop."""
        trace, ended_s = self.trace, math.inf
        end_s = trace.start_s + trace.volts.size / trace.rate_hz
        if isinstance(trace.drive, Hold):  # a ramp, a level and a ramp: all between both levels
            return self._departures(trace.start_s, end_s, (self.before_v, self.held_v, self.final_v))
        swing_v = abs(self.gain) * self.peak_v if self.seen else self.peak_v
        # Range of a running sine while it is stopped; an ended burst only idles.
        running = isinstance(trace.drive, Sine) and self.end_s > trace.stop_s
        stopping: tuple[float, ...] = (self.mean_v - swing_v, self.mean_v + swing_v) if running else (self.after_v,)
        if running and not any(m.kind is MessageKind.ABORT for m in trace.messages):
            # Stop waits for the end of the burst, and a level after a burst follows.
            ended_s = self.end_s - CLOCK_MARGIN_S
        rest = (self.before_v, self.armed_v)
        begin_s = self.start_s if self.seen else self.trigger_s
        return [
            *self._departures(trace.start_s, begin_s - EDGE_S, rest),
            *self._departures(trace.stop_s, min(end_s, ended_s), (*stopping, self.final_v)),
        ]

    def _departures(self, begin_s: float, end_s: float, levels: tuple[float, ...]) -> list[Transient]:
        finite = [level for level in levels if math.isfinite(level)]
        volts = self.trace.span(begin_s, end_s)
        if not finite or volts.size < 2:
            return []
        away = np.maximum(volts - max(finite), min(finite) - volts)
        if len(levels) == 2 and begin_s == self.trace.start_s:  # idle levels: values between them are no levels
            away = np.min([np.abs(volts - level) for level in finite], axis=0)
        limit_v = TRANSIENT_V * max(1.0, 0.5 * abs(self.gain)) if self.seen else TRANSIENT_V
        outside = np.flatnonzero(np.diff(np.concatenate([[0], (away > limit_v).astype(np.int8), [0]])))
        departures = []
        for first, last in outside.reshape(-1, 2):
            if last - first < 2:
                continue  # one sample of noise
            peak = first + int(np.argmax(away[first:last]))
            time_s = max(begin_s, self.trace.start_s) + first / self.trace.rate_hz
            departures.append(self._attributed(time_s, float(volts[peak]), float(away[peak])))
        return departures

    def _attributed(self, time_s: float, volts: float, away_v: float) -> Transient:
        sent = [m for m in self.trace.messages if m.time_s <= time_s + CLOCK_MARGIN_S]
        sent = [m for m in sent if m.kind is not MessageKind.OTHER][-1:] or sent[-1:]
        cause, text = (sent[0].kind, sent[0].text) if sent else (MessageKind.OTHER, "")
        return Transient(time_s, volts, away_v, cause, text)


def _mean(volts: Array) -> float:
    return float(volts.mean()) if volts.size else math.nan


def _smoothed(volts: Array, rate_hz: float) -> Array:
    size = max(round(SMOOTHING_S * rate_hz), 1)
    return np.convolve(volts, np.full(size, 1 / size), "same")
