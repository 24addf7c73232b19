"""Rest of a live bench: the way of the source to rest, and the criteria by which the card confirms that it is there."""

import contextlib
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.bench.card_reading import DISPLACEMENT_CHANNEL, DRIVE_CHANNEL, LEVEL_V, CardReading
from drivers.bench.drive_limits import HvAmplifier
from drivers.bench.watchdog_interface import Watchdog
from drivers.clock import Clock
from drivers.deadlines import Deadline
from drivers.errors import AcquisitionError, BenchError, InstrumentError
from drivers.interfaces import Block, Scale, Stream
from model import AmplifierMap

REST_TOLERANCE_V = 0.05
"""Largest measured deviation from rest: noise and gain error of the card, offset error of the generator."""

REST_REPEATABILITY_V = 0.01
"""Largest deviation of rest from its level at arming. The errors of generator and card are equal at both times, so that a
remaining level of some 30 mV is detected and not attributed to an instrument error."""

REST_NOISE_V = 0.005
"""Largest noise at rest, rms: 2 V on the specimen. The smallest sine of a generator, 10 mV, has 7 mV and the mean of rest."""

MAX_NOISE_RATIO, NOISE_MARGIN_V = 2.0, 0.002
"""Largest noise relative to the noise at arming: a small playing sine has the right mean."""

REST_DURATION_S = 0.1
"""Duration for which the card must measure rest without interruption."""

EXTREMES_WINDOW_S = 1.0
"""Time before the timeout over which lowest and highest volts are reported if rest is not confirmed."""

STALE_SAMPLES_S = 0.1
"""Time after a command in which samples may still show the previous state."""

REST_TIMEOUT_S = 2.0
MAX_DRIVE_WAIT_S = 10.0
"""Longest wait for the natural end of a drive that cannot be stopped any more."""

SHUTDOWN_SILENCE_S = 8.0
"""Longest silence during a shutdown before the watchdog takes over: reconnecting, opening a second stream."""

RETRY_INTERVAL_S = 0.25
"""Bench time between two attempts."""

SWITCH_OFF_NOW = "By hand, now: switch the high voltage OFF at the amplifier itself; do not touch the specimen or the generator's cable"

BlockSink = Callable[[Block], None]


@dataclass(frozen=True, slots=True)
class LiveWarning:
    """Warning that the specimen may be live, published before the program acts.

    Attributes:
        message: the reason, the last volts at the card with their age, and the manual steps.
        low_v, high_v: lowest and highest volts at the amplifier's input in the card's last block; NaN if there was none, or if
            it is older than PRESENT_S.
        age_s: age of that block in real seconds; infinite if there was none.
        part: the instrument that failed, `generator` or `card`; empty if it was neither.
    """

    message: str
    low_v: float = math.nan
    high_v: float = math.nan
    age_s: float = math.inf
    part: str = ""


PRESENT_S = 0.3
"""Largest age of a block whose volts a warning names."""


def live_warning(reason: object, reading: CardReading | None, amplifier_map: AmplifierMap) -> LiveWarning:
    """Return the warning for a reason, an error or a text, with the card's last reading."""
    part = (
        "card" if isinstance(reason, AcquisitionError) else "generator" if isinstance(reason, InstrumentError) else ""
    )
    begin = f"The specimen may be live: {str(reason).rstrip('.')}."
    if reading is None:
        return LiveWarning(f"{begin} The card has not seen the amplifier's input yet. {SWITCH_OFF_NOW}", part=part)
    age_s = reading.age_s(time.monotonic())
    if age_s > PRESENT_S:
        unread = f"The card has not been read for {age_s:.1f} s: do not rely on volts that were shown before"
        return LiveWarning(f"{begin} {unread}. {SWITCH_OFF_NOW}", age_s=age_s, part=part)
    when = f", {age_s:.1f} s before this warning; rest is {amplifier_map.rest_v:g} V"
    seen = f"The card last saw {describe_volts(reading.block_v, amplifier_map, when)}"
    return LiveWarning(f"{begin} {seen}. {SWITCH_OFF_NOW}", *reading.block_v, age_s, part)


def describe_volts(volts: tuple[float, float], amplifier_map: AmplifierMap, when: str = "") -> str:
    """Return lowest and highest volts at the amplifier's input, when they were measured, and those at the specimen, as text."""
    low_v, high_v = volts
    ends = volts if high_v - low_v > LEVEL_V else ((low_v + high_v) / 2,)
    seen = " to ".join(f"{v:z.3f}" for v in ends)
    means = " to ".join(f"{v:z.0f}" for v in amplifier_map.specimen_v(ends))
    return f"{seen} V at the amplifier's input{when}: about {means} V on the specimen if the high voltage is on"


@dataclass(frozen=True, slots=True)
class RestMeasurement:
    """Result of a rest verification."""

    confirmed: bool
    measured_v: float
    message: str
    noise_v: float = math.nan


@dataclass(frozen=True, slots=True)
class SafeShutdown:
    """Brings a bench to rest and verifies it.

    Args:
        amplifier: commands the source.
        clock: bench time.
        watchdog: watchdog, which does not take over meanwhile; it is requested to act if the source does not respond.
        open_stream: function that opens a second stream at a rate if the first one is broken.
    """

    amplifier: HvAmplifier
    clock: Clock
    watchdog: Watchdog
    open_stream: Callable[[float], Stream]

    def run(
        self, stream: Stream, block_sink: BlockSink, initial_rest: RestMeasurement | None
    ) -> tuple[RestMeasurement, BaseException | None]:
        """Go to rest and measure it; return also the error of `block_sink`. Errors are returned, not raised, and do not stop it."""
        with self.watchdog.allow_silence(SHUTDOWN_SILENCE_S):
            is_over = self._retry_time()
            trouble = self.command_rest(self.amplifier.return_to_rest)
            is_over = is_over if trouble else self._retry_time()
            remaining_s = self.amplifier.remaining_s
            # Waiting for a held level that lasts longer, or does not end by itself, would only delay the report.
            lasts = math.isfinite(self.amplifier.level_remaining_s) and remaining_s > MAX_DRIVE_WAIT_S
            waits = trouble and math.isfinite(remaining_s) and not lasts
            left_s = min(remaining_s, MAX_DRIVE_WAIT_S) if waits else 0.0
            rest, lost = self._measure_with_fallback(stream, block_sink, left_s + REST_TIMEOUT_S, initial_rest, is_over)
            if not rest.confirmed and not trouble and not math.isnan(rest.measured_v):
                # The source obeyed, or had nothing to do, but the card measures another level: the assumed state is wrong.
                trouble = self.command_rest(self.amplifier.force_rest)
                rest, again = self._measure_with_fallback(stream, block_sink, REST_TIMEOUT_S, initial_rest, is_over)
                lost = lost or again
        if trouble or not rest.confirmed:
            rest = replace(rest, message=f"{rest.message}.{trouble}")
        if not rest.confirmed:
            self.watchdog.log(f"the program could not confirm rest: {rest.message}")
        return rest, lost

    def command_rest(self, first_attempt: Callable[[], None]) -> str:
        """Command rest over the link, over new links, then by the watchdog; return the failure as text, empty if the source obeyed."""
        attempt, is_over = first_attempt, self._retry_time()
        while True:
            try:
                attempt()
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # noqa: BLE001 - make-safe: rest is measured next after any failure
                trouble = f" The source did not obey: {error}."
            else:
                return ""
            if attempt != first_attempt and not self._pause_before(is_over):
                break
            attempt = self.amplifier.reconnect_and_force_rest
        outcome = self.watchdog.request_rest(trouble.strip(" ."))
        return f"{trouble} The watchdog reports: {outcome}." if outcome else trouble

    def measure_rest(
        self,
        read_block: Callable[[], Block],
        stream: Stream,
        timeout_s: float,
        initial_rest: RestMeasurement | None = None,
    ) -> RestMeasurement:
        """Verify rest by the card (see `verify_rest`)."""

        def next_volts() -> tuple[int, NDArray[np.float64]]:
            block = read_block()
            self.watchdog.send_heartbeat()
            return block.start, drive_voltage(block, stream.scales)

        return verify_rest(
            next_volts,
            self.clock,
            stream.start_time_s,
            stream.rate_hz,
            self.amplifier.map.rest_v,
            timeout_s,
            initial_rest,
        )

    def _retry_time(self) -> Callable[[], bool]:
        """Return whether the time in which an operation that fails from now on is repeated is over, of the bench or of the computer.

        A virtual clock stands still while an instrument does not answer.
        """
        seconds, clock = Deadline.WAY_TO_REST.seconds, self.clock
        bench_s, real_s = clock.now() + seconds * max(getattr(clock, "speed", 1.0), 1.0), time.monotonic() + seconds
        return lambda: clock.now() > bench_s or time.monotonic() > real_s

    def _pause_before(self, is_over: Callable[[], bool]) -> bool:
        """Wait before the next attempt; return whether there is one."""
        if is_over():
            return False
        with contextlib.suppress(BenchError):  # the watchdog took over meanwhile
            self.clock.sleep(RETRY_INTERVAL_S)
        return True

    def _measure_with_fallback(
        self,
        stream: Stream,
        block_sink: BlockSink,
        timeout_s: float,
        initial_rest: RestMeasurement | None,
        is_over: Callable[[], bool],
    ) -> tuple[RestMeasurement, BaseException | None]:
        """Verify rest, on new streams until `is_over` if the first one is broken; return also the error of a failing sink."""
        lost: list[BaseException] = []

        def read() -> Block:
            block = stream.read()
            if not lost:
                try:
                    block_sink(block)
                except Exception as error:  # noqa: BLE001 - make-safe: a full disk must not prevent rest
                    lost.append(error)
            return block

        try:
            rest = self.measure_rest(read, stream, timeout_s, initial_rest)
        except KeyboardInterrupt:
            raise
        except BaseException:  # noqa: BLE001 - make-safe: the stream is broken; a new one may still measure the drive
            stream.__exit__(None, None, None)
            rest = self._measure_anew(stream.rate_hz, timeout_s, initial_rest, is_over)
        return rest, (lost[0] if lost else None)

    def _measure_anew(
        self, rate_hz: float, timeout_s: float, initial_rest: RestMeasurement | None, is_over: Callable[[], bool]
    ) -> RestMeasurement:
        """Verify rest on a fresh stream, or on a fresher one until `is_over`."""
        while True:
            try:
                with self.open_stream(rate_hz) as second:
                    return self.measure_rest(second.read, second, timeout_s, initial_rest)
            except KeyboardInterrupt:
                raise
            except BaseException as again:  # noqa: BLE001 - make-safe: the card may answer again
                rest = RestMeasurement(False, math.nan, f"the card cannot see the drive: {again}")
            if not self._pause_before(is_over):
                return rest


def verify_rest(
    read_drive_volts: Callable[[], tuple[int, NDArray[np.float64]]],
    clock: Clock,
    start_time_s: float,
    rate_hz: float,
    rest_v: float,
    timeout_s: float,
    initial_rest: RestMeasurement | None = None,
) -> RestMeasurement:
    """Read until the drive has been at rest for REST_DURATION_S, in samples taken after this call.

    Every sample must lie near rest. With `initial_rest`, mean and noise must also agree with the measurement at arming.

    Args:
        read_drive_volts: function that returns the index of the first scan of the next block, and its volts at the amplifier's
            input.
        clock: bench time.
        start_time_s: bench time of scan 0.
        rate_hz: scans per second.
        rest_v: nominal rest level.
        timeout_s: longest wait for rest.
        initial_rest: the measurement at arming.
    """
    expected_v, limit_v, noise_limit_v = rest_v, REST_TOLERANCE_V, REST_NOISE_V
    if initial_rest is not None:
        expected_v, limit_v = initial_rest.measured_v, REST_REPEATABILITY_V
        noise_limit_v = MAX_NOISE_RATIO * initial_rest.noise_v + NOISE_MARGIN_V
    begin_s = clock.now()
    fresh = math.ceil((begin_s - start_time_s + STALE_SAMPLES_S) * rate_hz)
    needed = math.ceil(REST_DURATION_S * rate_hz)
    still, mean_v, noise_v = np.empty(0), math.nan, math.nan
    extremes: deque[tuple[int, float, float]] = deque()
    while True:
        start, block = read_drive_volts()
        volts = block[max(fresh - start, 0) :]
        if volts.size:
            extremes.append((start + block.size, float(volts.min()), float(volts.max())))
            while extremes[0][0] < start - EXTREMES_WINDOW_S * rate_hz:
                extremes.popleft()
            away = np.flatnonzero(np.abs(volts - rest_v) > REST_TOLERANCE_V)
            still = np.concatenate([still, volts]) if not away.size else volts[int(away[-1]) + 1 :]
            still = still[-needed:]
            seen = still if still.size == needed else volts
            mean_v, noise_v = float(seen.mean()), float(seen.std())
            if still.size == needed and abs(mean_v - expected_v) <= limit_v and noise_v <= noise_limit_v:
                return RestMeasurement(
                    True, mean_v, f"the card sees {mean_v:z.3f} V at the amplifier's input: rest", noise_v
                )
        if start + block.size >= fresh + needed and clock.now() - begin_s > timeout_s:
            noise = f", noise {noise_v:.2g} V" if noise_v > noise_limit_v else ""
            lowest_v, highest_v = min(e[1] for e in extremes), max(e[2] for e in extremes)
            message = (
                f"the card sees {mean_v:z.3f} V (lowest {lowest_v:z.3f} V, highest {highest_v:z.3f} V) at the amplifier's input where rest is {expected_v:.4g} V "
                f"(limit {limit_v:g} V{noise}, watched for {timeout_s:.1f} s)"
            )
            return RestMeasurement(False, mean_v, message, noise_v)


def drive_voltage(block: Block, scales: tuple[Scale, ...]) -> NDArray[np.float64]:
    """Return the volts at the amplifier's input, one per scan."""
    return scales[DRIVE_CHANNEL].to_volts(block.raw[DRIVE_CHANNEL])


def channel_skew_s(scales: Sequence[Scale]) -> float:
    """Return the delay of the displacement's conversion after the drive's in a scan, which makes the sensor appear faster."""
    return scales[DISPLACEMENT_CHANNEL].skew_s - scales[DRIVE_CHANNEL].skew_s
