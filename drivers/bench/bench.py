"""Bench: the instruments of one bench, its abort levels, and arming, the only way to high voltage.

Arming brings the source to rest with high voltage disabled, measures rest by the card, and only then has high voltage enabled.
Whatever ends the `with bench.armed(...)` block - success, an exception, a closed generator, Ctrl-C - the source is ramped to rest
with its output on, and rest is reported only after it was *measured*.
"""

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import StrEnum
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Interval, Unit

from drivers.bench.armed_bench import ArmedBench, HighVoltageSwitch
from drivers.bench.card_reading import DISPLACEMENT_CHANNEL, CardReading, WatchedStream
from drivers.bench.drive_limits import HvAmplifier
from drivers.bench.interlock import Interlock
from drivers.bench.rest import REST_NOISE_V, REST_TIMEOUT_S, REST_TOLERANCE_V, LiveWarning, SafeShutdown, live_warning
from drivers.bench.watchdog_interface import NoWatchdog, Watchdog
from drivers.clock import Clock
from drivers.deadlines import Deadline, in_progress
from drivers.errors import (
    MANUAL_SHUTDOWN_INSTRUCTIONS,
    AcquisitionError,
    BenchError,
    CardInUseError,
    DriveRejectedError,
    InstrumentError,
    ScanOrderError,
    UnsafeError,
)
from drivers.interfaces import Block, Digitizer, InputChannel, Meter, ScanLister, Stream
from drivers.sensors import LaserSensor

if TYPE_CHECKING:
    from drivers.sensors import EnvironmentSensor

RATE_TOLERANCE = 0.01
"""Largest relative deviation of the card's sample rate from the requested one: its divider makes the nearest rate."""


class LevelAction(StrEnum):
    """Action beyond an abort level. The texts are stored in run files and bench files; they never change."""

    OFF = "off"
    WARNING = "warning"
    """A report; the points of the entry are flagged, and the run continues."""
    ASK = "ask"
    """The source returns to rest, and the operator decides."""
    REST = "rest"
    """The run ends at rest."""


@dataclass(frozen=True, slots=True)
class LevelSettings:
    """Abort levels, evaluated in every block, and the clearance of the specimen: tables [levels] and [specimen] of a bench file."""

    gap_m: Annotated[
        float,
        Unit("m"),
        Interval(gt=0, le=0.1),
        "clear distance from the specimen at rest to the nearest obstacle; the paper's spacers leave 0.77 mm (Sec. II)",
    ] = 0.77e-3
    stroke: Annotated[LevelAction, "action if the displacement from rest exceeds stroke_m"] = LevelAction.ASK
    stroke_m: Annotated[
        float, Unit("m"), Interval(ge=0, le=0.1), "largest displacement from rest; 0 is gap_m of [specimen]"
    ] = 0.0
    rate: Annotated[LevelAction, "action if the displacement rate exceeds rate_m_per_s"] = LevelAction.ASK
    rate_m_per_s: Annotated[
        float, Unit("m/s"), Interval(gt=0, le=1000), "largest displacement rate; 5 Vpp at resonance reach 0.6 m/s"
    ] = 2.0
    laser_lost: Annotated[LevelAction, "action if the sensor is out of range for longer than laser_lost_s"] = (
        LevelAction.ASK
    )
    laser_lost_s: Annotated[
        float, Unit("s"), Interval(ge=0.001, le=60), "longest time out of the sensor's range under a drive"
    ] = 0.05
    drive: Annotated[LevelAction, "action if the recorded drive differs from the commanded one"] = LevelAction.REST
    drive_tolerance: Annotated[
        float, Unit("1"), Interval(ge=0.02, le=1), "largest deviation of the drive, relative to its amplitude"
    ] = 0.1
    voltage: Annotated[LevelAction, "action if a voltage monitor exceeds voltage_v"] = LevelAction.ASK
    voltage_v: Annotated[
        float, Unit("V"), Interval(gt=0, le=100_000), "largest magnitude at the specimen; the amplifier gives +1500 V"
    ] = 1650.0
    current: Annotated[LevelAction, "action if a current monitor exceeds current_a"] = LevelAction.ASK
    current_a: Annotated[float, Unit("A"), Interval(gt=0, le=100), "largest magnitude of the amplifier's current"] = (
        0.022
    )
    no_response: Annotated[LevelAction, "action after no_response_points points without response"] = LevelAction.ASK
    no_response_points: Annotated[int, Unit("1"), Interval(ge=1, le=1000), "points in succession without response"] = 3

    @property
    def asking(self) -> tuple[str, ...]:
        """Names of the levels with the action "ask"."""
        return tuple(each.name for each in fields(self) if getattr(self, each.name) is LevelAction.ASK)

    @property
    def stroke_limit_m(self) -> float:
        """The largest displacement from rest."""
        return self.stroke_m or self.gap_m


@dataclass
class Bench:
    """The instruments of one bench.

    Args:
        configuration: the complete configuration as plain values, copied into every run.
    """

    amplifier: HvAmplifier
    digitizer: Digitizer
    sensor: LaserSensor
    clock: Clock
    block_s: float = 0.05
    hold_s: float = 0.0
    """Longest real time for which blocks are held before they are written to the run file, on a virtual clock."""
    simulated: bool = False
    configuration: Mapping[str, Any] = field(default_factory=dict)
    meters: Mapping[str, Meter] = field(default_factory=dict)
    name: str = "bench"
    watchdog: Watchdog = field(default_factory=NoWatchdog)
    interlock: Interlock = field(default_factory=Interlock)
    levels: LevelSettings = field(default_factory=LevelSettings)
    channels: tuple[InputChannel, ...] = ()
    """Further inputs of the card, in the order of a block's rows from the third on."""
    environment: "EnvironmentSensor | None" = None
    """Sensor of temperature and humidity, or None."""
    suspend_warning: str = ""
    """Reason why the computer may suspend; empty if suspension is inhibited."""
    panel_warning: str = ""
    """Reason why the generator's front panel is not locked despite the bench file; empty if it is locked, or need not be."""
    high_voltage_refusal: str = ""
    """Reason why high voltage must stay off, with the remedy: the source is not commissioned. Empty if high voltage is allowed."""
    commissioning_note: str = ""
    """Remark on the commissioning of the source for the log of each run; may be empty."""
    notice: str = ""
    """Command that reports the end of each run to a person elsewhere; empty without one."""
    answered_s: dict[str, float] = field(default_factory=dict)
    """Time (time.monotonic) of the last reply of the instruments that answer by messages, by role."""
    _high_voltage_enabled: bool = field(default=False, init=False)
    """Whether high voltage was on since this bench was opened."""
    _source_tested: bool = field(default=False, init=False)
    """Whether the source has played as commanded since this bench was opened."""
    _stream: WatchedStream | None = field(default=None, init=False)
    """The acquisition that was opened last."""

    @property
    def reading(self) -> CardReading | None:
        """The card's last reading, from any thread; None before its first block."""
        return None if self._stream is None else self._stream.reading

    @property
    def high_voltage_enabled(self) -> bool:
        """Whether high voltage was switched on since this bench was opened."""
        return self._high_voltage_enabled

    def close(self) -> None:
        """Close all instruments; the source's output stays on, at rest."""
        instruments: list[HvAmplifier | Digitizer | Meter | EnvironmentSensor | Interlock] = [
            self.interlock,
            self.amplifier,
            self.digitizer,
            *self.meters.values(),
            *([self.environment] if self.environment else []),
        ]
        for instrument in instruments:
            with contextlib.suppress(BenchError):
                instrument.close()
        self.watchdog.close()

    def open_stream(self, rate_hz: float, block_s: float = 0.0) -> WatchedStream:
        """Start an acquisition, which is read from now on; `block_s` where its blocks are longer than the bench's.

        Raises:
            AcquisitionError: the card is absent or in use, or has another sample rate than requested.
        """
        block_s = max(block_s, self.block_s)
        stream = self.digitizer.stream(rate_hz, max(round(rate_hz * block_s), 1))
        if abs(stream.rate_hz - rate_hz) > RATE_TOLERANCE * rate_hz:
            stream.__exit__(None, None, None)
            raise AcquisitionError(
                f"the card runs at {stream.rate_hz:g} Hz instead of the requested {rate_hz:g} Hz; choose a rate that it supports"
            )
        return self._watch(stream, block_s)

    def open_scan(self, order: Sequence[int], rate_hz: float) -> WatchedStream:
        """Start an acquisition of the card's channels in this order, which is read from now on.

        Raises:
            ScanOrderError: the card cannot convert a channel several times in a scan.
            AcquisitionError: the card is absent or in use.
        """
        if not isinstance(self.digitizer, ScanLister):
            raise ScanOrderError(f"the driver of {self.digitizer.identity} takes each input once in a scan")
        return self._watch(self.digitizer.scan(order, rate_hz, max(round(rate_hz * self.block_s), 1)), self.block_s)

    def _watch(self, stream: Stream, block_s: float) -> WatchedStream:
        self._stream = WatchedStream(
            stream,
            self.clock,
            block_s,
            self.sensor,
            self.channels,
            self.reading,
            lambda age_s: self.interlock.beat(age_s, self.watchdog.overdue_s),
        )
        return self._stream

    @contextlib.contextmanager
    def armed(
        self,
        rate_hz: float,
        block_sink: Callable[[Block], None],
        switch: HighVoltageSwitch,
        on_started: Callable[[ArmedBench], None] = lambda _: None,
        high_voltage: bool = True,
        on_warning: Callable[[LiveWarning], None] = lambda _: None,
    ) -> Iterator[ArmedBench]:
        """Arm the bench: at rest, high voltage on, the card acquiring.

        Args:
            rate_hz: scans per second.
            block_sink: receives every block, in order, before its caller does.
            switch: disables high voltage before the output comes up, and enables it when rest has been measured.
            on_started: callback before the first block, with the card running (its actual rate and scales are available).
            high_voltage: whether to enable high voltage; if not, it is disabled and the drive is measured at rest.
            on_warning: callback, at most once, before the source is brought to rest: a start, arming or an answer failed while
                high voltage may be on, or the source was left live, or has left rest.

        Raises:
            BenchError: an instrument is absent or rejects a command; high voltage was not enabled, or rest was confirmed.
            UnsafeError: rest could not be confirmed; the message gives the manual steps.
        """
        shutdown = SafeShutdown(self.amplifier, self.clock, self.watchdog, self.open_stream)
        try:
            stream = self.open_stream(rate_hz)
        except Exception as error:
            self._leave_unmeasured(shutdown, error, on_warning)
            raise
        with self.interlock, stream:
            # An earlier run may have left high voltage on: then any failure from here must measure rest.
            armed = ArmedBench(
                self.amplifier,
                stream,
                block_sink,
                self.watchdog,
                lambda: shutdown.measure_rest(armed.discard_block, stream, REST_TIMEOUT_S, armed.initial_rest),
                self.interlock,
                high_voltage_may_be_on=self._high_voltage_enabled,
            )
            warned: list[object] = []

            def warn(reason: object, catches_up: bool = True) -> None:
                if armed.high_voltage_may_be_on and not warned:
                    warned.append(reason)
                    if catches_up and not isinstance(reason, AcquisitionError):
                        armed.catch_up(self.clock.now())
                    on_warning(live_warning(reason, self.reading, self.amplifier.map))

            self.amplifier.on_failure, armed.on_left_rest = warn, partial(warn, catches_up=False)
            failure: BaseException | None = None
            is_armed = False
            try:
                on_started(armed)
                self._bring_earlier_drive_to_rest(armed, warn)
                self._arm(armed, switch, shutdown, high_voltage)
                is_armed = True
                warned.clear()
                yield armed
            except BaseException as error:
                failure = error
                if isinstance(error, InstrumentError) or (
                    isinstance(error, BenchError) and not (is_armed or isinstance(error, DriveRejectedError))
                ):
                    warn(error)
                raise
            finally:
                lost = None
                if armed.high_voltage_may_be_on:
                    armed.final_rest, lost = shutdown.run(stream, block_sink, armed.initial_rest)
                    self.watchdog.disarm()  # except after an interrupted shutdown: then the watchdog must act
                    if not armed.final_rest.confirmed:
                        by_hand = MANUAL_SHUTDOWN_INSTRUCTIONS + self.interlock.statement
                        raise UnsafeError(f"{by_hand}. Measured: {armed.final_rest.message}") from failure
                if failure is None and lost is not None:
                    raise lost

    @contextlib.contextmanager
    def exercised(
        self, rate_hz: float, block_sink: Callable[[Block], None], switch: HighVoltageSwitch, order: Sequence[int] = ()
    ) -> Iterator[ArmedBench]:
        """Set the source up with high voltage off and leave it at rest, at any measured level: for its commissioning.

        Args:
            rate_hz: scans per second.
            block_sink: receives every block, in order, before its caller does.
            switch: disables high voltage before anything is sent to the source; it is never enabled.
            order: numbers of the card's channels in a scan, the drive first; default: each once, in order.

        Raises:
            ScanOrderError: the card cannot convert a channel several times in a scan.
            BenchError: an instrument is absent or rejects a command.
        """
        switch.disable()
        self._high_voltage_enabled = False
        # Before the card runs, because it may take longer than the card's buffer.
        if not self.amplifier.is_source_at_rest():
            self.amplifier.initialize_at_rest()
        shutdown = SafeShutdown(self.amplifier, self.clock, self.watchdog, self.open_stream)
        with self.open_scan(order, rate_hz) if order else self.open_stream(rate_hz) as stream:
            exercised = ArmedBench(
                self.amplifier,
                stream,
                block_sink,
                self.watchdog,
                lambda: shutdown.measure_rest(exercised.discard_block, stream, REST_TIMEOUT_S),
                self.interlock,
            )
            try:
                yield exercised
            finally:
                self.amplifier.force_rest()

    def _leave_unmeasured(
        self, shutdown: SafeShutdown, error: Exception, on_warning: Callable[[LiveWarning], None]
    ) -> None:
        """Command rest if the source may be live while its level cannot be measured; otherwise return.

        Raises:
            UnsafeError: the source may be live; it was commanded to rest.
        """
        if not self._high_voltage_enabled and (
            isinstance(error, CardInUseError)  # by a running program, which owns the drive
            or not self.amplifier.may_be_left_live()
        ):
            return
        on_warning(live_warning(AcquisitionError(f"the card cannot be had: {error}"), self.reading, self.amplifier.map))
        trouble = shutdown.command_rest(self.amplifier.force_rest)
        message = f"the card cannot see the drive: {error}.{trouble}"
        self.watchdog.log(f"the program could not confirm rest: {message}")
        raise UnsafeError(f"{MANUAL_SHUTDOWN_INSTRUCTIONS}. Measured: {message}") from error

    def _bring_earlier_drive_to_rest(self, armed: ArmedBench, warn: Callable[[object], None]) -> None:
        """Bring a source left live by an earlier program to rest immediately; the operator is prompted afterwards."""
        try:
            if not self.amplifier.is_left_live():
                return
        except InstrumentError:
            armed.high_voltage_may_be_on = True  # the drive of the source can only be measured
            raise
        armed.high_voltage_may_be_on = True
        self.watchdog.arm()
        armed.catch_up(self.clock.now())
        reading = self.reading
        # An ended burst leaves its amplitude set, with the output at rest: no reason for a warning.
        if reading is None or max(abs(v - self.amplifier.map.rest_v) for v in reading.block_v) > REST_TOLERANCE_V:
            warn("an earlier program left a drive or a level on the source, which is ramped to rest now")
        self.amplifier.force_rest()

    def _test_source(self, armed: ArmedBench, switch: HighVoltageSwitch) -> None:
        """Test the source before its first drive, with high voltage off where a wrong waveform would be as large as a drive."""
        one_amplitude = self.amplifier.plays_to_the_end
        if armed.high_voltage_may_be_on and one_amplitude and not self._source_tested:
            switch.disable()
            armed.high_voltage_may_be_on = self._high_voltage_enabled = False
        self._source_tested = False
        with in_progress(Deadline.SOURCE_SETUP):
            armed.test_source(self.clock)
        self._source_tested = True

    def _exchanged_inputs(self, armed: ArmedBench) -> str:
        """Return a further sentence if the displacement's input shows the drive at rest; empty otherwise."""
        if armed.last_block is None:
            return ""
        volts = armed.scales[DISPLACEMENT_CHANNEL].to_volts(armed.last_block.raw[DISPLACEMENT_CHANNEL])
        if abs(float(volts.mean()) - self.amplifier.map.rest_v) > REST_TOLERANCE_V or volts.std() > REST_NOISE_V:
            return ""
        return (
            f". The card's displacement channel reads {volts.mean():.3f} V, the rest of the drive: the two cables at the card, or "
            "drive_channel and displacement_channel in the bench file, may be exchanged"
        )

    def _arm(self, armed: ArmedBench, switch: HighVoltageSwitch, shutdown: SafeShutdown, high_voltage: bool) -> None:
        if high_voltage and self.high_voltage_refusal:
            raise BenchError(f"not armed, high voltage is not switched on: {self.high_voltage_refusal}")
        says_rest = self.amplifier.is_source_at_rest()
        if says_rest:  # an earlier run may have left high voltage on
            armed.high_voltage_may_be_on = True
            armed.expect_rest(self.clock.now())  # blocks from before may show a burst that has ended meanwhile
            self.watchdog.arm()
        else:
            switch.disable()
            armed.high_voltage_may_be_on = self._high_voltage_enabled = False
            self.amplifier.initialize_at_rest()
        rest = shutdown.measure_rest(armed.read_block, armed.stream, REST_TIMEOUT_S)
        if not rest.confirmed and says_rest:
            raise BenchError(
                f"the generator reports that it is at rest, but {rest.message}{self._exchanged_inputs(armed)}"
            )
        if not rest.confirmed:
            raise BenchError(
                f"not armed, high voltage stays disabled: {rest.message}. Check the cable from the generator to the amplifier "
                f"and to the card's drive channel{self._exchanged_inputs(armed)}"
            )
        if not high_voltage:
            if says_rest:
                switch.disable()
            armed.high_voltage_may_be_on = self._high_voltage_enabled = False
            self.watchdog.disarm()
            armed.initial_rest = rest
            return
        armed.predicted_rest_s = self.amplifier.check_way_to_rest()
        self._test_source(armed, switch)
        # Before every run, even if the source has been at rest since the last one: a drive must not surprise the operator, and an
        # operator who was asked to switch high voltage off must be asked to switch it on.
        armed.high_voltage_may_be_on = self._high_voltage_enabled = True
        armed.expect_rest()
        self.watchdog.arm()
        switch.enable()
        armed.stream.high_voltage_on = True
        self.interlock.begin(armed.read_block)
        rest = shutdown.measure_rest(armed.read_block, armed.stream, REST_TIMEOUT_S)
        if not rest.confirmed:
            raise BenchError(f"after high voltage was enabled, {rest.message}")
        armed.initial_rest = rest
