"""The instruments of one bench, and the only way to use them live: `with bench.armed(...)`.

Arming brings the source to rest with high voltage disabled, measures that rest through the card, and only then has
high voltage enabled. Whatever ends the `with` block - success, an exception, a closed generator, Ctrl-C - the source is
ramped to rest with its output on, and that is *measured* before anybody says so.
"""

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.amplifier import HvAmplifier
from drivers.clock import Clock
from drivers.drive import Drive
from drivers.errors import AcquisitionError, BenchError, UnsafeError
from drivers.ports import Block, Digitizer, Meter, Scale, Stream
from drivers.rest import Rest, see_rest
from drivers.sensor import LaserSensor
from drivers.watch import NoWatchdog, Watchdog

DRIVE, DISPLACEMENT = 0, 1
"""Rows of a block."""

PATIENCE_S = 2.0
LONGEST_WAIT_S = 10.0
"""How long a drive that no longer obeys is given to end by itself, at most."""

WAY_OUT_S = 8.0
"""How long the way to rest may be silent before the watchdog takes over: wires opened anew, a second stream."""

BY_HAND = (
    "UNSAFE: rest could not be confirmed. The specimen may carry high voltage. By hand, now: switch the high voltage OFF "
    "at the amplifier itself; do not touch the specimen or the generator's cable before the amplifier's display reads 0 V"
)


class HighVoltageSwitch(Protocol):
    """Who switches the amplifier's high voltage: a person who is asked, or a simulated operator."""

    def disable(self) -> None: ...

    def enable(self) -> None: ...


@dataclass
class Armed:
    """The live bench: play a drive, read blocks. Every block read goes to the sink first."""

    amplifier: HvAmplifier
    stream: Stream
    sink: Callable[[Block], None]
    watchdog: Watchdog
    measure_rest: Callable[[], Rest]
    energised: bool = False
    """Whether high voltage may be on: from then on, every way out must measure rest."""
    before: Rest | None = None
    """What the card saw when rest was measured before the first drive."""
    rest: Rest | None = None
    """What was measured on the way out; None while live, or where high voltage never came on."""

    @property
    def rate_hz(self) -> float:
        return self.stream.rate_hz

    @property
    def scales(self) -> tuple[Scale, ...]:
        return self.stream.scales

    def play(self, drive: Drive) -> None:
        self.amplifier.play(drive)

    def to_rest(self) -> Rest:
        """Go to rest and see it there.

        Raises:
            BenchError: the card does not see rest; leaving the `with` block then tries everything else.
        """
        self.amplifier.to_rest()
        rest = self.measure_rest()
        if not rest.confirmed:
            raise BenchError(f"the source was told to rest, but {rest.words}")
        return rest

    @contextlib.contextmanager
    def hands_on(self, switch: HighVoltageSwitch) -> Iterator[None]:
        """Let a person touch the specimen: rest measured, high voltage off; and both again before anything moves."""
        self.to_rest()
        switch.disable()
        yield
        if not (rest := self.measure_rest()).confirmed:
            raise BenchError(f"high voltage stays off: {rest.words}")
        switch.enable()
        if not (rest := self.measure_rest()).confirmed:
            raise BenchError(f"after high voltage was enabled, {rest.words}")

    def read(self) -> Block:
        block = self.skip()
        self.sink(block)
        return block

    def skip(self) -> Block:
        """Read a block that nobody keeps: while a person takes their time, the card must be emptied all the same."""
        block = self.stream.read()
        self.watchdog.beat()
        self.watchdog.check()
        return block


@dataclass
class Bench:
    """The instruments of one bench.

    Args:
        record: the complete configuration as plain values, copied into every run.
    """

    amplifier: HvAmplifier
    digitizer: Digitizer
    sensor: LaserSensor
    clock: Clock
    block_s: float = 0.05
    simulated: bool = False
    record: Mapping[str, Any] = field(default_factory=dict)
    meters: Mapping[str, Meter] = field(default_factory=dict)
    name: str = "bench"
    watchdog: Watchdog = field(default_factory=NoWatchdog)
    _switched_on: bool = field(default=False, init=False)
    """Whether somebody has switched high voltage on since this bench was opened."""

    def close(self) -> None:
        """Let go of all instruments; the source's output stays at rest, on."""
        instruments: list[HvAmplifier | Digitizer | Meter] = [self.amplifier, self.digitizer, *self.meters.values()]
        for instrument in instruments:
            with contextlib.suppress(BenchError):
                instrument.close()
        self.watchdog.close()

    def open_stream(self, rate_hz: float) -> Stream:
        return self.digitizer.stream(rate_hz, max(round(rate_hz * self.block_s), 1))

    @contextlib.contextmanager
    def armed(
        self,
        rate_hz: float,
        sink: Callable[[Block], None],
        switch: HighVoltageSwitch,
        started: Callable[[Armed], None] = lambda _: None,
        high_voltage: bool = True,
    ) -> Iterator[Armed]:
        """The bench at rest and live, with the card running.

        Args:
            rate_hz: scans per second.
            sink: receives every block, in order, before anybody else sees it.
            switch: asked to disable high voltage before the output comes up, and to enable it when rest is measured.
            started: told before the first block, when the card runs (its true rate and scales are known).
            high_voltage: whether it shall come on; where not, it is switched off, and the drive is seen at rest.

        Raises:
            BenchError: an instrument is absent or refuses; high voltage was not enabled, or rest was confirmed.
            UnsafeError: rest could not be confirmed; the sentence says what to do by hand.
        """
        with contextlib.ExitStack() as stack:
            stream = stack.enter_context(self.open_stream(rate_hz))
            armed = Armed(self.amplifier, stream, sink, self.watchdog, lambda: self._see_rest(armed))
            started(armed)
            failure: BaseException | None = None
            try:
                self._arm(armed, switch, high_voltage)
                yield armed
            except BaseException as error:
                failure = error
                raise
            finally:
                lost = None
                if armed.energised:
                    armed.rest, lost = self._make_safe(armed)
                    self.watchdog.disarm()  # not where even that was broken off: then its turn has come
                    if not armed.rest.confirmed:
                        raise UnsafeError(f"{BY_HAND}. What was measured: {armed.rest.words}") from failure
                if failure is None and lost is not None:
                    raise lost

    def _see_rest(self, armed: Armed) -> Rest:
        return self._watch(armed.skip, armed.stream, PATIENCE_S, armed.before)

    def _arm(self, armed: Armed, switch: HighVoltageSwitch, high_voltage: bool) -> None:
        armed.energised = (
            self._switched_on
        )  # an earlier run left it on: then any failure from here on must measure rest
        says_rest = self.amplifier.source_at_rest()
        if says_rest:  # an earlier run may have left high voltage on
            armed.energised = True
            self.watchdog.arm()
        else:
            switch.disable()
            armed.energised = self._switched_on = False
            self.amplifier.prepare()
        rest = self._watch(armed.read, armed.stream, PATIENCE_S)
        if not rest.confirmed and says_rest:
            raise BenchError(f"the generator says it is at rest, but {rest.words}")
        if not rest.confirmed:
            raise BenchError(
                f"not armed, high voltage stays disabled: {rest.words}. Check the cable from the generator to the amplifier "
                "and to the card's drive channel"
            )
        if not high_voltage:
            if says_rest:
                switch.disable()
            armed.energised = self._switched_on = False
            self.watchdog.disarm()
            armed.before = rest
            return
        # Before every run, also where the source rests from the last one: nobody may be surprised by a drive, and whoever
        # was told to switch high voltage off has to be told to switch it on.
        armed.energised = self._switched_on = True
        self.watchdog.arm()
        switch.enable()
        rest = self._watch(armed.read, armed.stream, PATIENCE_S)
        if not rest.confirmed:
            raise BenchError(f"after high voltage was enabled, {rest.words}")
        armed.before = rest

    def _make_safe(self, armed: Armed) -> tuple[Rest, BaseException | None]:
        """Go to rest and measure it. Never raises; a sink that fails on the way does not stop it."""
        with self.watchdog.allow(WAY_OUT_S):
            trouble = self._command_rest()
            left_s = min(self.amplifier.seconds_left, LONGEST_WAIT_S) if trouble else 0.0
            rest, lost = self._measure_rest(armed, left_s + PATIENCE_S)
        if trouble or not rest.confirmed:
            rest = replace(rest, words=f"{rest.words}.{trouble}")
        if not rest.confirmed:
            self.watchdog.note(f"the program could not confirm rest: {rest.words}")
        return rest, lost

    def _command_rest(self) -> str:
        """Tell the source to rest, over its wire, over a new one, and by the watchdog's; what failed, empty if it obeyed."""
        trouble = ""
        for attempt in (self.amplifier.to_rest, self.amplifier.recover):
            try:
                attempt()
            except Exception as error:  # noqa: BLE001 - make-safe: whatever fails, measuring rest comes next
                trouble = f" The source did not obey: {error}."
            else:
                return ""
        told = self.watchdog.rescue(trouble.strip(" ."))
        return f"{trouble} The watchdog says: {told}." if told else trouble

    def _measure_rest(self, armed: Armed, patience_s: float) -> tuple[Rest, BaseException | None]:
        """What the card sees of the drive, and what a sink that failed on the way raised."""
        lost: list[BaseException] = []

        def read(stream: Stream) -> Block:
            block = stream.read()
            if not lost:
                try:
                    armed.sink(block)
                except Exception as error:  # noqa: BLE001 - make-safe: a full disk must not keep us from rest
                    lost.append(error)
            return block

        try:
            rest = self._watch(lambda: read(armed.stream), armed.stream, patience_s, armed.before)
        except Exception:  # noqa: BLE001 - make-safe: the stream is broken; a fresh one may still see the drive
            armed.stream.__exit__(None, None, None)
            try:
                with self.open_stream(armed.rate_hz) as second:
                    rest = self._watch(second.read, second, patience_s, armed.before)
            except Exception as again:  # noqa: BLE001 - make-safe: nothing left to measure with
                rest = Rest(False, math.nan, f"the card cannot see the drive: {again}")
        return rest, (lost[0] if lost else None)

    def _watch(self, read: Callable[[], Block], stream: Stream, patience_s: float, before: Rest | None = None) -> Rest:
        def next_volts() -> tuple[int, NDArray[np.float64]]:
            block = read()
            self.watchdog.beat()
            return block.start, drive_volts(block, stream.scales)

        return see_rest(
            next_volts, self.clock, stream.started_s, stream.rate_hz, self.amplifier.map.rest_v, patience_s, before
        )


def drive_volts(block: Block, scales: tuple[Scale, ...]) -> NDArray[np.float64]:
    """Volts at the amplifier's input, one per scan."""
    return scales[DRIVE].volts(block.raw[DRIVE])


def check_rate(asked_hz: float, actual_hz: float) -> None:
    """Refuse a sample clock that is not what was asked for to within 0.1 %.

    Raises:
        AcquisitionError: the card cannot run at that rate.
    """
    if abs(actual_hz - asked_hz) > 1e-3 * asked_hz:
        raise AcquisitionError(
            f"the card runs at {actual_hz:g} Hz where {asked_hz:g} Hz was asked; choose a rate it can make"
        )
