"""Sequence of a commissioning: the exercises of a source in their order, and the resulting checks."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from drivers import (
    OTHER_BYTE_ORDER,
    ArmedBench,
    Bench,
    Clock,
    Drive,
    HighVoltageSwitch,
    Hold,
    InstrumentError,
    ScanOrderError,
    ScansLostError,
    Sine,
    Steps,
)
from drivers.evidence import OutputCheck
from protocols.commissioning.card_inputs import NAME as CARD_INPUTS_NAME
from protocols.commissioning.card_inputs import SCAN_RATE_HZ, exercise_inputs, scan_order
from protocols.commissioning.checks import (
    HELD_V,
    LEVEL_LIMIT_V,
    REST_LIMIT_V,
    SHAPE_LIMIT,
    check_crosstalk,
    check_offset,
    check_start_route,
    check_stop_duration,
    check_transients,
    check_waveforms,
    check_wire,
    with_jump_at_stop,
    with_rewrites_held_back,
    worst_deviation,
)
from protocols.commissioning.evaluation import Evaluation
from protocols.commissioning.exercise import Exerciser, Trace
from protocols.commissioning.long_level import (
    EARLY_HELD_S,
    EARLY_STOP_AFTER_S,
    LEVEL_V,
    check_long_level,
    hastened_stop_s,
    is_reached,
)
from protocols.commissioning.long_level import HELD_S as LONG_HELD_S
from protocols.commissioning.messages import MessageKind, MessageLog
from protocols.commissioning.verdict import CheckedOutput, CommandTime, MeasuredTimes

FREQUENCY_HZ = 10.0
SMALL_V, LARGER_V = 0.25, 0.6
"""Peaks of the sines: small enough for a source with a fourfold output, and in two attenuator ranges."""
CYCLES = 4
UNSTOPPED_S = 3.0
"""Duration of a stopped sine."""
STOP_AFTER_S = 0.5
HELD_S = 0.3
SPAN_SHARE = 0.96
"""Share of the amplifier's range of the drive with a timed Stop."""

HARMLESS = (OutputCheck.CROSSTALK, OutputCheck.START_ROUTE)
"""Deviations that do not prevent the largest drive."""

PLANNED_S = {
    "sine": 1.0,
    "uneven waveform": 1.0,
    "sine again": 1.0,
    "larger sine": 1.0,
    "level above rest": 1.0,
    "level below rest": 1.0,
    "Stop in mid-drive": 2.0,
    "wire cut in mid-drive": 2.0,
    "longest upload": 5.0,
    "long level": 13.0,
    "Stop in mid-level": 7.0,
    "Stop from the largest drive": 2.0,
    "second connection": 1.0,
    CARD_INPUTS_NAME: 3.0,
}
"""Exercises in order with approximate durations, for the progress."""

ProgressListener = Callable[[str, float], object]
"""Callback with the name of the present measurement, and the completed fraction, 0 to 1."""


@dataclass(frozen=True, slots=True)
class Commissioned:
    """Result of a commissioning: checks in order, times, traces, whether the source plays more than levels, reply times.

    `byte_order` is the order of the played waveforms; empty if the source has only one.
    """

    checks: tuple[CheckedOutput, ...]
    times: MeasuredTimes
    traces: tuple[Trace, ...]
    errors: tuple[str, ...]
    plays_bursts: bool = True
    commands: tuple[CommandTime, ...] = ()
    byte_order: str = ""


class Commissioning:
    """Exercises the source of a bench, with high voltage off.

    Args:
        bench: bench with high voltage off, see `Bench.exercised`.
        clock: bench time.
        messages, progress, second_client, check_stop: as in `commission_bench`.
    """

    def __init__(
        self,
        bench: ArmedBench,
        clock: Clock,
        messages: MessageLog,
        progress: ProgressListener,
        second_client: Callable[[], float] | None,
        check_stop: Callable[[], object],
    ) -> None:
        self._bench, self._clock, self._progress, self._second_client = bench, clock, progress, second_client
        self._exerciser, self._messages = Exerciser(bench, clock, messages, check_stop), messages
        self._rest_v = bench.amplifier.map.rest_v
        self._traces: list[Trace] = []
        self._started = self._lost = 0
        self._plays_bursts = False
        self._errors: list[str] = []
        self._begun: set[str] = set()

    def run(self) -> Commissioned:
        """Exercise the source; return the result.

        Raises:
            BenchError: the card does not answer.
        """
        rest_v = self._rest_v
        small = Sine(FREQUENCY_HZ, SMALL_V, rest_v, CYCLES)
        forms: dict[str, Drive] = {
            "sine": small,
            "uneven waveform": Steps((rest_v, rest_v + 0.3, rest_v), 0.12, 0.005),
            "sine again": small,
            "larger sine": Sine(FREQUENCY_HZ, LARGER_V, rest_v, CYCLES),
        }
        self._choose_byte_order(small)
        sine, uneven, again, larger = played = [self._burst(name, drive) for name, drive in forms.items()]
        bursts = [b for b in played if b is not None]
        above, below = (
            self._record(f"level {side} rest", Hold(rest_v + d, HELD_S))
            for side, d in (("above", HELD_V), ("below", -HELD_V))
        )
        long = Sine(FREQUENCY_HZ, SMALL_V, rest_v, math.ceil(UNSTOPPED_S * FREQUENCY_HZ))
        stopped = self._burst("Stop in mid-drive", long, stop_after_s=STOP_AFTER_S)
        cut = self._burst("wire cut in mid-drive", Sine(FREQUENCY_HZ, SMALL_V, rest_v, 10), in_mid_drive=self._cut_wire)
        uploaded, upload_s = self._upload()
        everything = [b for b in (*bursts, above, below, stopped, cut, uploaded) if b is not None]
        # A card that stops too late cannot renew a level either; a generator may have to wait for the end of its drive.
        too_long = None if self._bench.amplifier.plays_to_the_end else check_stop_duration(stopped)
        steady = check_long_level(None) if too_long else self._long_level()
        level_stop_s = self._hastened_stop_s()
        rest, after = self._levels(bursts, everything)
        offset = check_offset(above, below)
        if not self._plays_bursts:  # a DC supply: levels only
            transients = check_transients(everything, None, {OutputCheck.SETTINGS: tuple(MessageKind)})
            times = MeasuredTimes(math.nan, math.nan, math.nan, self._messages.reply_s)
            return self._commissioned([rest, offset, steady, *transients], times)
        checks = [rest, after, offset, steady, *check_waveforms(sine or again, uneven, larger)]
        checks += [
            *check_transients(everything, stopped),
            self._starts(),
            *check_wire(cut, bursts),
            check_crosstalk(bursts),
        ]
        if self._bench.amplifier.starts_on_scan:
            checks.append(check_start_route(bursts, self._errors))
        if too_long is not None:
            checks = [too_long if check.check is OutputCheck.STOP else check for check in checks]
        largest = self._largest_stop(checks)
        times = replace(self._times(largest or stopped, bursts), level_stop_s=level_stop_s, upload_s=upload_s)
        return self._commissioned([*map(partial(self._with_remarks, largest), checks)], times)

    def _commissioned(self, checks: Sequence[CheckedOutput], times: MeasuredTimes) -> Commissioned:
        return Commissioned(
            tuple(checks),
            times,
            tuple(self._traces),
            tuple(self._errors),
            self._plays_bursts,
            self._messages.command_times(),
            self._bench.amplifier.byte_order(),
        )

    def _play(self, name: str, drive: Drive, **options: Any) -> Trace | None:
        """Play and record a drive, with the options of `Exerciser.record`."""
        self._announce(name)
        trace = self._exerciser.record(name, drive, **options)
        if trace is not None:
            self._traces.append(trace)
            if trace.error:
                self._errors.append(f"{name}: {trace.error}")
        return trace

    def _record(self, name: str, drive: Drive, **options: Any) -> Evaluation | None:
        trace, stop_after_s = self._play(name, drive, **options), options.get("stop_after_s")
        return None if trace is None else Evaluation(trace, None if stop_after_s is None else stop_after_s - 0.1)

    def _burst(self, name: str, drive: Drive, **options: Any) -> Evaluation | None:
        """Play a burst, again if it did not start; return its evaluation, None if it could not be recorded."""
        for _ in range(2):
            trace = self._record(name, drive, **options)
            if trace is None:
                return None
            self._plays_bursts = True
            self._started += 1
            if trace.seen:
                return trace
            self._lost += 1
        return None

    def _choose_byte_order(self, sine: Sine) -> None:
        """Let a source whose documents disagree use the byte order in which it plays a sine."""
        order = self._bench.amplifier.byte_order()
        for each in (order, OTHER_BYTE_ORDER[order]) if order else ():
            self._bench.amplifier.byte_order(each)
            played = self._burst(f"sine, {each}", sine)
            if played is not None and played.residual < SHAPE_LIMIT:
                return
        self._bench.amplifier.byte_order(order)

    def _announce(self, name: str) -> None:
        done_s = sum(seconds for each, seconds in PLANNED_S.items() if each in self._begun and each != name)
        self._begun.add(name)
        self._progress(name, min(done_s / sum(PLANNED_S.values()), 1.0))

    def _level(self, name: str, held_s: float, **options: Any) -> Trace | None:
        """Hold a level as in a run, again if it was not reached; return its recording, or None."""
        for _ in range(2):
            trace = self._play(name, Hold(self._rest_v + LEVEL_V, held_s), as_waveform=True, **options)
            if trace is None or is_reached(trace):
                return trace
        return None

    def _long_level(self) -> CheckedOutput:
        held_s = EARLY_HELD_S if self._bench.amplifier.plays_to_the_end else LONG_HELD_S
        return check_long_level(self._level("long level", held_s))

    def _hastened_stop_s(self) -> float:
        """Return the duration of Stop from a level with a hastened end; NaN if this is not needed or not possible."""
        amplifier = self._bench.amplifier
        if not amplifier.plays_to_the_end:
            return math.nan
        amplifier.holds_by_offset = False
        planned_s = amplifier.unattended_rest_s(Hold(self._rest_v + LEVEL_V, EARLY_HELD_S))
        if not math.isfinite(planned_s):
            return math.nan
        before, amplifier.hastens_levels = amplifier.hastens_levels, True
        try:
            trace = self._level("Stop in mid-level", EARLY_HELD_S, stop_after_s=EARLY_STOP_AFTER_S, observe_s=planned_s)
        finally:
            amplifier.hastens_levels = before
        ends_s = math.nan if trace is None else trace.started_s + planned_s
        return hastened_stop_s(trace, ends_s)

    def _upload(self) -> tuple[Evaluation | None, float]:
        """Upload the driver's longest waveform without playing it; return the recorded output, and the duration."""
        upload = self._bench.amplifier.upload_longest
        if upload is None:
            return None, math.nan
        name, took_s = "longest upload", [math.nan]

        def timed() -> None:
            begin_s = self._clock.now()
            upload()
            took_s[0] = self._clock.now() - begin_s

        try:
            trace = self._record(name, Hold(self._rest_v, HELD_S), instead=timed)
        except ScansLostError as error:  # on a slow connection the upload takes longer than the card's buffer lasts
            self._errors.append(f"{name}: took {took_s[0]:.1f} s; the output meanwhile was not recorded: {error}")
            return None, took_s[0]
        return trace, math.nan if trace is None else took_s[0]

    def _cut_wire(self) -> None:
        with suppress(InstrumentError):
            self._bench.amplifier.reconnect()

    def _levels(self, bursts: Sequence[Evaluation], everything: Sequence[Evaluation]) -> Iterator[CheckedOutput]:
        off = [(b.before_v - self._rest_v, f"before '{b.trace.name}'") for b in everything]
        off += [(b.armed_v - b.before_v, f"armed for '{b.trace.name}'") for b in bursts]
        yield worst_deviation(OutputCheck.REST, off, REST_LIMIT_V)
        later = [(b.after_v - b.armed_v, f"after '{b.trace.name}'") for b in bursts]
        yield worst_deviation(OutputCheck.AFTER, later, LEVEL_LIMIT_V)

    def _starts(self) -> CheckedOutput:
        lost = float(self._lost) if self._started else math.nan
        return CheckedOutput(OutputCheck.START, lost, "drives lost", 0.0, 0.0, f"of {self._started}")

    def _largest_stop(self, checks: Sequence[CheckedOutput]) -> Evaluation | None:
        """Stop the largest drive; only for a source that fulfils the assumptions."""
        if not all(check.passed for check in checks if check.check not in HARMLESS):
            return None
        span_v = SPAN_SHARE * min(
            self._bench.amplifier.map.high_v - self._rest_v, self._rest_v - self._bench.amplifier.map.low_v
        )
        drive = Sine(FREQUENCY_HZ, span_v, self._rest_v, math.ceil(UNSTOPPED_S * FREQUENCY_HZ))
        return self._record("Stop from the largest drive", drive, stop_after_s=STOP_AFTER_S, timed_stop=True)

    def _with_remarks(self, largest: Evaluation | None, check: CheckedOutput) -> CheckedOutput:
        """Return a check with remarks on the Stop of the largest drive and on NI's driver."""
        if largest is not None and not largest.trace.messages:  # a card's output has no messages
            check = with_jump_at_stop(check, largest)
        return with_rewrites_held_back(check) if self._bench.amplifier.holds_rewrites_back else check

    def _times(self, stopped: Evaluation | None, bursts: Sequence[Evaluation]) -> MeasuredTimes:
        """Return the measured times."""
        stop_s = math.nan if stopped is None else stopped.stop_duration_s
        delays = [b.start_s - b.trigger_s for b in bursts]
        second_s = math.nan
        if self._second_client is not None:
            self._announce("second connection")
            with suppress(InstrumentError):
                second_s = self._second_client()
        return MeasuredTimes(stop_s, max(delays, default=math.nan), second_s, self._messages.reply_s)


def commission_bench(
    bench: Bench,
    switch: HighVoltageSwitch,
    rate_hz: float,
    messages: MessageLog,
    progress: ProgressListener = lambda _name, _fraction: None,
    second_client: Callable[[], float] | None = None,
    check_stop: Callable[[], object] = lambda: None,
) -> Commissioned:
    """Exercise the instruments of a bench; return the result.

    Args:
        bench: the bench; its source is always brought to rest at the end.
        switch: switch that disables high voltage; it is never enabled.
        rate_hz: scans per second while the source is exercised.
        messages: notes the messages to the source.
        progress: callback with the name of each exercise at its begin, and the completed fraction.
        second_client: function that opens a second connection to the instrument and returns the time of its reply; None without
            such a connection.
        check_stop: called with every block that is read; raises to abandon, with the source brought to rest.

    Raises:
        BenchError: an instrument is absent, or rejects its set-up.
    """
    with bench.exercised(rate_hz, lambda _: None, switch) as exercised:
        result = Commissioning(exercised, bench.clock, messages, progress, second_client, check_stop).run()
    if not result.plays_bursts:
        return result
    progress(CARD_INPUTS_NAME, 1 - PLANNED_S[CARD_INPUTS_NAME] / sum(PLANNED_S.values()))
    order = scan_order(2 + len(bench.channels))
    try:
        with bench.exercised(SCAN_RATE_HZ, lambda _: None, switch, order) as scanned:
            inputs = exercise_inputs(scanned, bench.clock, order, bench.amplifier.map.rest_v, check_stop)
    except ScanOrderError:  # one converter per input: no skew and no settling
        return result
    return replace(result, checks=(*result.checks, *inputs.checks), traces=(*result.traces, *inputs.traces))
