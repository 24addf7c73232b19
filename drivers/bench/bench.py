"""The instruments of one bench, and the only way to use them live: `with bench.armed(...)`.

Arming brings the source to rest with high voltage disabled, measures that rest through the card, and only then has
high voltage enabled. Whatever ends the `with` block - success, an exception, a closed generator, Ctrl-C - the source is
ramped to rest with its output on, and that is *measured* before anybody says so.
"""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from drivers.bench.amplifier import HvAmplifier
from drivers.bench.rest import Rest
from drivers.bench.shutdown import BY_HAND, DISPLACEMENT, DRIVE, PATIENCE_S, WayOut, channel_skew_s, drive_volts
from drivers.bench.watchdog_interface import NoWatchdog, Watchdog
from drivers.clock import Clock
from drivers.drive import Drive
from drivers.errors import AcquisitionError, BenchError, UnsafeError
from drivers.interfaces import Block, Digitizer, Meter, Scale, Stream
from drivers.sensors.laser_sensor import LaserSensor

__all__ = ["BY_HAND", "DISPLACEMENT", "DRIVE", "Armed", "Bench", "HighVoltageSwitch", "channel_skew_s", "drive_volts"]

RATE_TOLERANCE = 0.01
"""How far the card's sample clock may be from what was asked for: its divider makes what comes next."""


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
        """The card, running.

        Raises:
            AcquisitionError: it is absent or in use, or its sample clock is not the one that was asked for.
        """
        stream = self.digitizer.stream(rate_hz, max(round(rate_hz * self.block_s), 1))
        if abs(stream.rate_hz - rate_hz) > RATE_TOLERANCE * rate_hz:
            stream.__exit__(None, None, None)
            raise AcquisitionError(
                f"the card runs at {stream.rate_hz:g} Hz where {rate_hz:g} Hz was asked for; choose a rate it can make"
            )
        return stream

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
        way_out = WayOut(self.amplifier, self.clock, self.watchdog, self.open_stream)
        try:
            stream = self.open_stream(rate_hz)
        except Exception as error:
            if not self._switched_on:
                raise
            # An earlier run left high voltage on, and nobody can see now where the source stands.
            trouble = way_out.command(self.amplifier.force_rest)
            words = f"the card cannot see the drive: {error}.{trouble}"
            self.watchdog.note(f"the program could not confirm rest: {words}")
            raise UnsafeError(f"{BY_HAND}. What was measured: {words}") from error
        with stream:
            # An earlier run may have left high voltage on: then any failure from here on must measure rest.
            armed = Armed(
                self.amplifier,
                stream,
                sink,
                self.watchdog,
                lambda: way_out.watch(armed.skip, stream, PATIENCE_S, armed.before),
                energised=self._switched_on,
            )
            failure: BaseException | None = None
            try:
                started(armed)
                self._arm(armed, switch, way_out, high_voltage)
                yield armed
            except BaseException as error:
                failure = error
                raise
            finally:
                lost = None
                if armed.energised:
                    armed.rest, lost = way_out.take(stream, sink, armed.before)
                    self.watchdog.disarm()  # not where even that was broken off: then its turn has come
                    if not armed.rest.confirmed:
                        raise UnsafeError(f"{BY_HAND}. What was measured: {armed.rest.words}") from failure
                if failure is None and lost is not None:
                    raise lost

    def _arm(self, armed: Armed, switch: HighVoltageSwitch, way_out: WayOut, high_voltage: bool) -> None:
        says_rest = self.amplifier.source_at_rest()
        if says_rest:  # an earlier run may have left high voltage on
            armed.energised = True
            self.watchdog.arm()
        else:
            switch.disable()
            armed.energised = self._switched_on = False
            self.amplifier.prepare()
        rest = way_out.watch(armed.read, armed.stream, PATIENCE_S)
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
        rest = way_out.watch(armed.read, armed.stream, PATIENCE_S)
        if not rest.confirmed:
            raise BenchError(f"after high voltage was enabled, {rest.words}")
        armed.before = rest
