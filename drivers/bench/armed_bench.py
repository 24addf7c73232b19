"""Armed bench: starts drives, reads blocks and measures rest while high voltage may be on."""

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

from drivers.bench.card_reading import WatchedStream
from drivers.bench.drive_limits import HvAmplifier
from drivers.bench.interlock import Interlock
from drivers.bench.rest import REST_NOISE_V, REST_TIMEOUT_S, REST_TOLERANCE_V, RestMeasurement, drive_voltage
from drivers.bench.self_test import SelfTest
from drivers.bench.watchdog_interface import Watchdog
from drivers.clock import Clock
from drivers.drive_shapes import Drive
from drivers.errors import AcquisitionError, BenchError, ScansLostError
from drivers.interfaces import Block, Scale

CATCH_UP_S = 0.3
"""Longest wait for the present volts of a warning, real seconds."""

LEFT_REST_S, LEFT_REST_LIMIT_S = 0.3, 2 * REST_TIMEOUT_S
"""Time for which the input is away from rest while no drive is commanded, before the warning, and before the run ends; a measurement
of rest that fails ends it earlier."""


class HighVoltageSwitch(Protocol):
    """Switches the amplifier's high voltage: by prompting the operator, or through a simulated operator."""

    def disable(self) -> None: ...

    def enable(self) -> None: ...


class BlockMonitor(Protocol):
    """Evaluates every block of an armed bench before it is stored; must not raise."""

    def drive_commanded(self) -> None:
        """Note that a drive will be started."""

    def drive_changed(self, drive: Drive | None, level_remaining_s: float = math.inf) -> None:
        """Note the start of a drive, or the return of the source to rest (None).

        A level is held for `level_remaining_s` at least, and may return to rest by itself then.
        """

    def block_read(self, block: Block) -> None:
        """Evaluate a block."""


@dataclass
class ArmedBench:
    """An armed bench: starts drives and reads blocks. Every block goes to `block_sink` before it is returned."""

    amplifier: HvAmplifier
    stream: WatchedStream
    block_sink: Callable[[Block], None]
    watchdog: Watchdog
    measure_rest: Callable[[], RestMeasurement]
    interlock: Interlock
    high_voltage_may_be_on: bool = False
    """Whether high voltage may be on; then every shutdown must measure rest."""
    initial_rest: RestMeasurement | None = None
    """Rest measured before the first drive."""
    final_rest: RestMeasurement | None = None
    """Rest measured at shutdown; None while live, or without high voltage."""
    predicted_rest_s: float = math.nan
    """Predicted duration of the way to rest; NaN if the source cannot predict it."""
    last_block: Block | None = None
    """The last block that the card delivered."""
    monitor: BlockMonitor | None = None
    """Evaluates every block read from the armed bench; not during the shutdown."""
    on_left_rest: Callable[[str], None] = lambda _: None
    """Receives the reason of a warning when the input has left rest; it reads no block, because the one that shows it is stored next."""
    _rest_from: float = math.inf
    """First scan in which the input must be at rest; infinite while a drive may be played."""
    _away_since: int | None = None
    """First scan since which the input is away from rest while no drive is commanded."""

    @property
    def rate_hz(self) -> float:
        """Scans per second."""
        return self.stream.rate_hz

    @property
    def scales(self) -> tuple[Scale, ...]:
        """Scales of the channels, from counts to volts."""
        return self.stream.scales

    def start_drive(self, drive: Drive) -> None:
        """Check a drive and start it.

        Raises:
            DriveRejectedError: it exceeds the drive limits, or the source cannot play it.
            InstrumentError: the source rejected it or does not answer.
        """
        self._rest_from = math.inf
        if self.monitor is not None:
            self.monitor.drive_commanded()
        self.amplifier.start_drive(drive)
        if self.monitor is not None:
            self.monitor.drive_changed(drive, self.amplifier.level_remaining_s)

    def return_to_verified_rest(self) -> RestMeasurement:
        """Return to rest and verify it by measurement.

        Raises:
            BenchError: the card does not measure rest; leaving the `with` block then runs the safe shutdown.
        """
        self.amplifier.return_to_rest()
        if self.monitor is not None:
            self.monitor.drive_changed(None)
        rest = self.measure_rest()
        if not rest.confirmed:
            raise BenchError(f"the source was commanded to rest, but {rest.message}")
        self.expect_rest()
        return rest

    def test_source(self, clock: Clock) -> None:
        """Play a burst of 50 mV and compare it, before high voltage.

        Raises:
            BenchError: the source does not play as commanded.
        """
        self._rest_from = math.inf
        SelfTest(self.amplifier, self.stream, self.read_block, clock).run()

    def expect_rest(self, from_s: float = 0.0) -> None:
        """Expect the input at rest in all scans to be read from a bench time on, until a drive is started."""
        self._rest_from, self._away_since = (from_s - self.stream.start_time_s) * self.rate_hz, None

    @contextlib.contextmanager
    def specimen_access(self, switch: HighVoltageSwitch) -> Iterator[None]:
        """Give the operator access to the specimen: rest verified and high voltage off; on exit rest verified again, then on."""
        self.return_to_verified_rest()
        self.interlock.end()
        switch.disable()
        yield
        if not (rest := self.measure_rest()).confirmed:
            raise BenchError(f"high voltage stays off: {rest.message}")
        switch.enable()
        self.interlock.begin(self.discard_block)
        if not (rest := self.measure_rest()).confirmed:
            raise BenchError(f"after high voltage was enabled, {rest.message}")

    def read_block(self) -> Block:
        """Read the next block and pass it to `block_sink`.

        Raises:
            AcquisitionError: the card lost scans or does not answer.
            BenchError: the watchdog has ended or taken over, the interlock has switched high voltage off, or the input has left
                rest although no drive is commanded.
        """
        block = self.discard_block()
        self.block_sink(block)
        return block

    def catch_up(self, now_s: float) -> None:
        """Read and store the blocks that were sampled until `now_s`, also after lost scans and where storing fails.

        Errors are suppressed: the caller reports a warning.
        """
        stores, give_up_s = True, time.monotonic() + CATCH_UP_S
        while (
            self.last_block is None
            or self.stream.start_time_s + (self.last_block.stop + self.last_block.raw.shape[1]) / self.rate_hz < now_s
        ) and time.monotonic() < give_up_s:
            try:
                self.last_block = self.stream.read_within(CATCH_UP_S)
                if stores:
                    self.block_sink(self.last_block)
            except ScansLostError:
                continue
            except AcquisitionError:
                return
            except Exception:  # noqa: BLE001 - the disk is full: the volts are needed all the same
                stores = False

    def discard_block(self) -> Block:
        """Read a block without storing it: the card must also be read while the run waits for the operator."""
        self.last_block = block = self.stream.read()
        self.watchdog.send_heartbeat()
        self.watchdog.raise_for_status()
        self.interlock.raise_for_status()
        self.amplifier.renew_hold()
        if self.monitor is not None:
            self.monitor.block_read(block)
        if block.start >= self._rest_from and self.high_voltage_may_be_on:
            self._check_rest(block)
        return block

    def _check_rest(self, block: Block) -> None:
        """Warn if another hand or program has moved the source from rest, and end the run if it stays away."""
        rest_v = self.amplifier.map.rest_v
        volts = drive_voltage(block, self.scales)
        # Of the block as a whole: single samples may be spikes.
        if abs(float(volts.mean()) - rest_v) <= REST_TOLERANCE_V and volts.std() <= REST_NOISE_V:
            self._away_since = None
            return
        self._away_since = block.start if self._away_since is None else self._away_since
        away_s = (block.stop - self._away_since) / self.rate_hz
        words = f"no drive is commanded, and the amplifier's input, {rest_v:g} V at rest, is at {volts.min():z.3f} to {volts.max():z.3f} V"
        if away_s > LEFT_REST_S:
            self.on_left_rest(words)
        if away_s > LEFT_REST_LIMIT_S:
            raise BenchError(f"{words}; check that no other program or person controls the generator, and its output")


def safety_statement(amplifier: HvAmplifier, watchdog: Watchdog, interlock: Interlock, predicted_rest_s: float) -> str:
    """Return, for the log, the time to rest after a stop, and after the death of program and watchdog; empty if unknown.

    Args:
        amplifier: amplifier with the source.
        watchdog: watchdog of the bench.
        interlock: interlock of the bench.
        predicted_rest_s: duration of the way to rest from the farthest level, NaN if unknown.
    """
    clauses = []
    if math.isfinite(predicted_rest_s):
        measured = (
            f" (Stop measured {amplifier.measured_stop_s:.2f} s at commissioning)" if amplifier.measured_stop_s else ""
        )
        waits = ", once the drive has ended by itself" if amplifier.plays_to_the_end else ""
        clauses.append(f"the way to rest takes up to {predicted_rest_s:.1f} s{measured}{waits}")
    if math.isfinite(watchdog.notices_after_s):
        clauses.append(f"if this program dies or hangs, the watchdog takes it after {watchdog.notices_after_s:g} s")
    if amplifier.unattended_end:
        both = "program and watchdog die" if math.isfinite(watchdog.notices_after_s) else "this program dies"
        clauses.append(f"if {both}, {amplifier.unattended_end}")
    return "; ".join(clauses) + interlock.statement


def longest_unmoved_s(amplifier: HvAmplifier, predicted_rest_s: float) -> float:
    """Return the longest time without a change of the output on a way to rest: end of the drive, and replies, seconds.

    Args:
        amplifier: amplifier with the source.
        predicted_rest_s: duration of the way to rest from the farthest level, NaN if unknown.
    """
    levels = amplifier.map
    farthest_v = max(levels.high_v - levels.rest_v, levels.rest_v - levels.low_v)
    replies_s = predicted_rest_s - farthest_v / amplifier.limits.ramp_v_per_s
    return amplifier.stop_wait_s + (max(replies_s, 0.0) if math.isfinite(replies_s) else 0.0)
