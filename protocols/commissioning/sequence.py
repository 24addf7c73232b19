"""Sequence of a commissioning: the exercises of a source in their order, and the checks that follow from them."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

from drivers import ArmedBench, Clock, Drive, Hold, InstrumentError, Sine, Steps
from drivers.generators.assumptions import OutputCheck
from protocols.commissioning.evaluation import TRANSIENT_V, Evaluation, Transient
from protocols.commissioning.exercise import Exerciser, Trace
from protocols.commissioning.messages import MessageKind, MessageLog
from protocols.commissioning.verdict import CheckedOutput, MeasuredTimes

FREQUENCY_HZ = 10.0
SMALL_V, LARGER_V = 0.25, 0.6
"""Peaks of the sines: small enough for a source that outputs four times as much, and of two attenuator ranges."""
CYCLES = 4
UNSTOPPED_S = 3.0
"""Duration of a sine that is stopped."""
STOP_AFTER_S = 0.5
HELD_V, HELD_S = 0.2, 0.3
SPAN_SHARE = 0.96
"""Share of the amplifier's range in the drive whose Stop is timed."""

REST_LIMIT_V, LEVEL_LIMIT_V = 0.05, 0.03
CROSSTALK_LIMIT, START_ROUTE_LIMIT = 0.01, 0.1
GAIN_LIMIT, OFFSET_LIMIT, SHAPE_LIMIT = 0.03, 0.02, 0.08
FIT_LIMIT = 0.25
"""A recording that departs further (rms, in peaks) from the commanded form has no amplitude and no polarity."""

HARMLESS = (OutputCheck.CROSSTALK, OutputCheck.START_ROUTE)
"""Deviations with which the largest drive may be played nevertheless."""

CAUSES = {
    OutputCheck.SETTINGS: (MessageKind.UPLOAD, MessageKind.OTHER),
    OutputCheck.AMPLITUDE: (MessageKind.AMPLITUDE,),
    OutputCheck.STOP: (MessageKind.ABORT, MessageKind.TRIGGER),
}
"""The messages whose transients each check is of; a transient at the trigger, before Stop, belongs to the waveform."""


@dataclass(frozen=True, slots=True)
class Commissioned:
    """What a commissioning measured: checks in order, times, the recorded traces, and whether the source plays more than levels."""

    checks: tuple[CheckedOutput, ...]
    times: MeasuredTimes
    traces: tuple[Trace, ...]
    errors: tuple[str, ...]
    plays_bursts: bool = True


class Commissioning:
    """Exercises the source of a bench, with high voltage off.

    Args:
        bench: see `Bench.exercised`.
        clock: bench time.
        messages: notes the messages to the source.
        progress: called with the name of each exercise as it begins.
        second_client: connects to the instrument once more, and returns the time of its reply; None if there is none.
    """

    def __init__(
        self,
        bench: ArmedBench,
        clock: Clock,
        messages: MessageLog,
        progress: Callable[[str], object] = lambda _: None,
        second_client: Callable[[], float] | None = None,
    ) -> None:
        self._bench, self._clock, self._progress, self._second_client = bench, clock, progress, second_client
        self._exerciser, self._messages = Exerciser(bench, clock, messages), messages
        self._rest_v = bench.amplifier.map.rest_v
        self._traces: list[Trace] = []
        self._started = self._lost = 0
        self._plays_bursts = False
        self._errors: list[str] = []

    def run(self) -> Commissioned:
        """Exercise the source; return what was measured.

        Raises:
            BenchError: the card does not answer.
        """
        rest_v = self._rest_v
        small = Sine(FREQUENCY_HZ, SMALL_V, rest_v, CYCLES)
        sine = self._burst("sine", small)
        uneven = self._burst("uneven waveform", Steps((rest_v, rest_v + 0.3, rest_v), 0.12, 0.005))
        again = self._burst("sine again", small)
        larger = self._burst("larger sine", Sine(FREQUENCY_HZ, LARGER_V, rest_v, CYCLES))
        bursts = [b for b in (sine, uneven, again, larger) if b is not None]
        above, below = (
            self._held(f"level {side} rest", rest_v + d) for side, d in (("above", HELD_V), ("below", -HELD_V))
        )
        long = Sine(FREQUENCY_HZ, SMALL_V, rest_v, math.ceil(UNSTOPPED_S * FREQUENCY_HZ))
        stopped = self._burst("Stop in mid-drive", long, stop_after_s=STOP_AFTER_S)
        cut = self._burst("wire cut in mid-drive", Sine(FREQUENCY_HZ, SMALL_V, rest_v, 10), in_mid_drive=self._cut_wire)
        everything = [b for b in (*bursts, above, below, stopped, cut) if b is not None]
        if not self._plays_bursts:  # a DC supply: levels only
            rest, _ = self._levels(bursts, everything)
            checks = [
                rest,
                _offset(above, below),
                *_transients(everything, None, {OutputCheck.SETTINGS: tuple(MessageKind)}),
            ]
            return self._commissioned(checks, MeasuredTimes(math.nan, math.nan, math.nan, self._messages.reply_s))
        checks = [*self._levels(bursts, everything), _offset(above, below)]
        checks += [*_waveforms(sine or again, uneven, larger), *_transients(everything, stopped), self._starts()]
        checks += [*_wire(cut, bursts), _crosstalk(bursts)]
        if self._bench.amplifier.starts_on_scan:
            checks.append(_start_route(bursts, self._errors))
        safe = all(check.passed for check in checks if check.check not in HARMLESS)
        largest = self._largest_stop() if safe else None
        if largest is not None and not largest.trace.messages:  # a card's output, which no message explains
            checks = [_joined(check, largest) for check in checks]
        return self._commissioned(checks, self._times(largest or stopped, bursts))

    def _commissioned(self, checks: Sequence[CheckedOutput], times: MeasuredTimes) -> Commissioned:
        return Commissioned(tuple(checks), times, tuple(self._traces), tuple(self._errors), self._plays_bursts)

    def _burst(
        self,
        name: str,
        drive: Drive,
        *,
        stop_after_s: float | None = None,
        in_mid_drive: Callable[[], None] | None = None,
    ) -> Evaluation | None:
        """Play a burst, once more if it did not start; return its evaluation, None if it could not be recorded."""
        for _ in range(2):
            found = self._record(name, drive, stop_after_s, in_mid_drive)
            if found is None:
                return None
            self._plays_bursts = True
            self._started += 1
            if found.seen:
                return found
            self._lost += 1
        return None

    def _held(self, name: str, level_v: float) -> Evaluation | None:
        return self._record(name, Hold(level_v, HELD_S))

    def _record(
        self,
        name: str,
        drive: Drive,
        stop_after_s: float | None = None,
        in_mid_drive: Callable[[], None] | None = None,
        timed_stop: bool = False,
    ) -> Evaluation | None:
        self._progress(name)
        trace = self._exerciser.record(
            name, drive, stop_after_s=stop_after_s, in_mid_drive=in_mid_drive, timed_stop=timed_stop
        )
        if trace is None:
            return None
        self._traces.append(trace)
        if trace.error:
            self._errors.append(f"{name}: {trace.error}")
        return Evaluation(trace, None if stop_after_s is None else stop_after_s - 0.1)

    def _cut_wire(self) -> None:
        with suppress(InstrumentError):
            self._bench.amplifier.reconnect()

    def _levels(self, bursts: Sequence[Evaluation], everything: Sequence[Evaluation]) -> Iterator[CheckedOutput]:
        off = [(b.before_v - self._rest_v, f"before '{b.trace.name}'") for b in everything]
        off += [(b.armed_v - b.before_v, f"armed for '{b.trace.name}'") for b in bursts]
        yield _worst(OutputCheck.REST, off, REST_LIMIT_V)
        later = [(b.after_v - b.armed_v, f"after '{b.trace.name}'") for b in bursts]
        yield _worst(OutputCheck.AFTER, later, LEVEL_LIMIT_V)

    def _starts(self) -> CheckedOutput:
        lost = float(self._lost) if self._started else math.nan
        return CheckedOutput(OutputCheck.START, lost, "drives lost", 0.0, 0.0, f"of {self._started}")

    def _largest_stop(self) -> Evaluation | None:
        """Stop the largest drive; only tried on a source that did what is assumed."""
        span_v = SPAN_SHARE * min(
            self._bench.amplifier.map.high_v - self._rest_v, self._rest_v - self._bench.amplifier.map.low_v
        )
        drive = Sine(FREQUENCY_HZ, span_v, self._rest_v, math.ceil(UNSTOPPED_S * FREQUENCY_HZ))
        return self._record("Stop from the largest drive", drive, STOP_AFTER_S, timed_stop=True)

    def _times(self, stopped: Evaluation | None, bursts: Sequence[Evaluation]) -> MeasuredTimes:
        """Return the measured times."""
        stop_s = math.nan if stopped is None else stopped.stop_duration_s
        delays = [b.start_s - b.trigger_s for b in bursts]
        second_s = math.nan
        if self._second_client is not None:
            self._progress("second connection")
            with suppress(InstrumentError):
                second_s = self._second_client()
        return MeasuredTimes(stop_s, max(delays, default=math.nan), second_s, self._messages.reply_s)


def _worst(check: OutputCheck, found: Sequence[tuple[float, str]], limit: float, unit: str = "V") -> CheckedOutput:
    """Return the check of the largest deviation."""
    finite = [each for each in found if math.isfinite(each[0])]
    value, detail = max(finite, key=lambda each: abs(each[0]), default=(math.nan, ""))
    return CheckedOutput(check, value, unit, -limit, limit, detail)


def _offset(above: Evaluation | None, below: Evaluation | None) -> CheckedOutput:
    scale = math.nan if above is None or below is None else (above.held_v - below.held_v) / (2 * HELD_V)
    return CheckedOutput(OutputCheck.OFFSET, scale, "1", 1 - OFFSET_LIMIT, 1 + OFFSET_LIMIT)


def _waveforms(
    sine: Evaluation | None, uneven: Evaluation | None, larger: Evaluation | None
) -> Iterator[CheckedOutput]:
    """Yield polarity, amplitudes and form; a waveform that is no sine has neither polarity nor amplitude."""
    gain = sine.gain if sine is not None and sine.misfit < FIT_LIMIT else math.nan
    yield CheckedOutput(OutputCheck.POLARITY, math.copysign(1.0, gain) if math.isfinite(gain) else math.nan, "1", 1, 1)
    yield CheckedOutput(OutputCheck.SCALE, abs(gain), "1", 1 - GAIN_LIMIT, 1 + GAIN_LIMIT)
    ratio = abs(uneven.gain / gain) if uneven is not None and uneven.misfit < FIT_LIMIT else math.nan
    yield CheckedOutput(OutputCheck.UNEVEN, ratio, "1", 1 - GAIN_LIMIT, 1 + GAIN_LIMIT, "in parts of the sine's")
    played = [e for e in (sine, uneven, larger) if e is not None]
    found = [(e.residual, f"'{e.trace.name}'") for e in played]
    found += [
        (t.away_v / e.peak_v, f"at the start of '{e.trace.name}'")
        for e in played
        for t in e.transients()
        if _at_start(e, t)
    ]
    value, detail = max(found, default=(math.nan, ""))
    yield CheckedOutput(OutputCheck.SHAPE, value, "1", None, SHAPE_LIMIT, f"largest departure in peaks, {detail}")


def _at_start(evaluation: Evaluation, transient: Transient) -> bool:
    return transient.cause is MessageKind.TRIGGER and transient.time_s < evaluation.trace.stop_s


def _transients(
    everything: Sequence[Evaluation],
    stopped: Evaluation | None,
    causes_of: Mapping[OutputCheck, tuple[MessageKind, ...]] = CAUSES,
) -> Iterator[CheckedOutput]:
    found: list[tuple[Transient, str]] = [
        (t, e.trace.name) for e in everything for t in e.transients() if not _at_start(e, t)
    ]
    for check, causes in causes_of.items():
        caused = [(t, name) for t, name in found if t.cause in causes]
        worst = max(caused, key=lambda each: each[0].away_v, default=None)
        value = worst[0].away_v if worst else 0.0
        detail = f"{worst[0].volts:.2f} V at '{worst[0].text}' in '{worst[1]}'" if worst else ""
        if check is OutputCheck.STOP:
            left_v = abs(stopped.final_v - stopped.before_v) if stopped is not None else math.nan
            if not left_v <= value:
                value, detail = left_v, "after Stop"
        yield CheckedOutput(check, value if everything else math.nan, "V", None, TRANSIENT_V, detail)


def _joined(check: CheckedOutput, stopped: Evaluation) -> CheckedOutput:
    """Return the check of Stop with the jump by which a stopped drive was left, if that is larger."""
    if check.check is not OutputCheck.STOP or stopped.stop_jump_v <= check.value:
        return check
    return CheckedOutput(OutputCheck.STOP, stopped.stop_jump_v, "V", None, TRANSIENT_V, f"in '{stopped.trace.name}'")


def _crosstalk(bursts: Sequence[Evaluation]) -> CheckedOutput:
    """Return the check of the drive in the card's other inputs: high voltage is off, so nothing else carries it there."""
    value = max((b.crosstalk for b in bursts if math.isfinite(b.crosstalk)), default=math.nan)
    detail = "of the drive, in another input"
    return CheckedOutput(OutputCheck.CROSSTALK, value, "1", None, CROSSTALK_LIMIT, detail)


def _start_route(bursts: Sequence[Evaluation], errors: Sequence[str]) -> CheckedOutput:
    """Return the check that drives start on scans: the start of a sine lies at the same place between two of them each time."""
    starts = [b.start_in_scans for b in bursts if math.isfinite(b.start_in_scans)]
    spread = max((abs((s - starts[0] + 0.5) % 1.0 - 0.5) for s in starts), default=math.nan)
    detail = "of a scan, between the starts of sines"
    if len(starts) < 2:
        spread, detail = (1.0, errors[0]) if errors else (math.nan, "")
    return CheckedOutput(OutputCheck.START_ROUTE, spread, "1", None, START_ROUTE_LIMIT, detail)


def _wire(cut: Evaluation | None, bursts: Sequence[Evaluation]) -> list[CheckedOutput]:
    """Return the check of the level after a drive during which the wire was cut, against the other drives' levels."""
    if cut is None:
        return [CheckedOutput(OutputCheck.WIRE, math.nan, "V", -LEVEL_LIMIT_V, LEVEL_LIMIT_V)]
    others = [b.after_v - b.armed_v for b in bursts if math.isfinite(b.after_v)]
    usual_v = others[-1] if others else 0.0
    value = cut.after_v - cut.armed_v - usual_v
    return [CheckedOutput(OutputCheck.WIRE, value, "V", -LEVEL_LIMIT_V, LEVEL_LIMIT_V, "against other drives")]
