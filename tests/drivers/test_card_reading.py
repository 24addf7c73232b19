"""What the card measured last: volts, their age, and the thread that reads the card while the program waits."""

import queue
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.bench.card_reading import CardReading, WatchedStream
from drivers.clock import Clock, SharedTime, WallClock
from drivers.errors import AcquisitionError, ScansLostError
from drivers.interfaces import Block, InputChannel, Scale
from drivers.sensors import LaserSensor
from sim_hardware.clock import VirtualClock
from tests.helpers.waiting import wait_until

pytestmark = pytest.mark.one_in(1)

RATE_HZ, BLOCK = 1000.0, 50
SCALE = Scale((0.0, 0.001))
SENSOR = LaserSensor("laser", 1e-4, valid_low_v=-10.0, valid_high_v=10.0)
GONE = AcquisitionError("the card is unplugged")
LOST = ScansLostError("scans were lost")


class Card:
    """A stream whose blocks a test delivers; `restarts` counts how often it acquired again."""

    rate_hz, scales, start_time_s = RATE_HZ, (SCALE, SCALE, SCALE), 0.0

    def __init__(self) -> None:
        self.delivered: queue.SimpleQueue[Block | Exception] = queue.SimpleQueue()
        self.next_scan = self.restarts = 0
        self.closed = False

    def deliver(self, *rows: float | tuple[float, ...] | Exception, skip: int = 0) -> None:
        """Deliver a block of levels or of swings from low to high, one for each channel; or an error."""
        if isinstance(rows[0], Exception):
            self.delivered.put(rows[0])
            return
        self.next_scan += skip
        ends = [row if isinstance(row, tuple) else (row, row) for row in (*rows, 0.0, 0.0)[:3]]
        counts = [np.resize(np.round(np.array(low_high) * 1000), BLOCK) for low_high in ends]
        self.delivered.put(Block(self.next_scan, np.array(counts).astype(np.int16)))
        self.next_scan += BLOCK

    def read(self) -> Block:
        item = self.delivered.get()
        if isinstance(item, Exception):
            raise item
        return item

    def restart(self) -> None:
        self.restarts += 1

    def __enter__(self) -> "Card":
        return self

    def __exit__(self, *_: object) -> None:
        self.closed = True


class SetClock(WallClock):
    """Bench time as a test sets it."""

    time_s = 0.0

    def now(self) -> float:
        return self.time_s


@contextmanager
def watched(
    clock: Clock, channels: tuple[InputChannel, ...] = (), heartbeat: Callable[[float], object] = lambda _: None
) -> Iterator[tuple[Card, WatchedStream]]:
    card = Card()
    stream = WatchedStream(card, clock, BLOCK / RATE_HZ, SENSOR, channels, heartbeat=heartbeat)
    try:
        yield card, stream
    finally:
        card.deliver(GONE)  # a read that waits for ever would keep the thread
        stream.close()
    assert card.closed


def reading_of(stream: WatchedStream) -> CardReading:
    assert stream.reading is not None
    return stream.reading


def test_the_card_is_read_while_the_program_does_not_ask_and_no_block_is_lost() -> None:
    with watched(WallClock()) as (card, stream):
        for volts in (2.5, 3.0, 0.0):
            card.deliver(volts)
        assert wait_until(lambda: stream.reading is not None and stream.reading.block_v == (0.0, 0.0))
        assert [stream.read().start for _ in range(3)] == [0, 50, 100]


def test_the_present_volts_are_those_of_the_last_three_blocks() -> None:
    with watched(VirtualClock()) as (card, stream):
        for rows in ((0.0, 5.0), (2.0, 3.0), 2.5, (2.6, 2.7)):
            card.deliver(rows)
            stream.read()
        assert reading_of(stream).drive_v == (2.0, 3.0)
        assert reading_of(stream).block_v == (2.6, 2.7)


@pytest.mark.parametrize(
    ("levels", "moves"),
    [
        ([2.5] * 3, True),
        ([2.5] * 4, False),
        ([0.0] + [0.019] * 3, False),
        ([0.0] + [0.021] * 3, True),
        ([(0.0, 5.0)] * 10, False),
        ([(0.0, 5.0)] + [(0.05, 5.0)] * 3, True),
        ([(0.0, 5.0)] + [(0.0, 4.9)] * 3, True),
    ],
    ids=["too young to know", "a level", "noise", "a ramp", "a sine", "a fading sine, below", "a fading sine, above"],
)
def test_volts_move_if_lowest_or_highest_have_changed_within_three_blocks(
    levels: list[float | tuple[float, float]], moves: bool
) -> None:
    with watched(VirtualClock()) as (card, stream):
        for rows in levels:
            card.deliver(rows)
            stream.read()
        assert reading_of(stream).moves is moves


def test_after_lost_scans_the_card_is_read_on_and_the_loss_is_raised_once() -> None:
    with watched(WallClock()) as (card, stream):
        card.deliver(2.5)
        card.deliver(LOST)
        card.deliver(LOST)
        assert wait_until(lambda: stream.reading is not None and stream.reading.unread)
        card.deliver(0.0, skip=1000)
        assert wait_until(lambda: reading_of(stream).block_v == (0.0, 0.0))
        assert not reading_of(stream).unread
        assert stream.read().start == 0
        with pytest.raises(ScansLostError):
            stream.read()
        assert stream.read().start == 1050
        assert card.restarts == 2


def test_a_program_that_reads_the_card_itself_acquires_again_after_lost_scans() -> None:
    with watched(VirtualClock()) as (card, stream):
        card.deliver(LOST)
        card.deliver(2.5, skip=1000)
        with pytest.raises(ScansLostError):
            stream.read()
        assert card.restarts == 1
        assert stream.read().start == 1000


def test_every_loss_is_raised_although_nobody_has_read_since_the_one_before() -> None:
    with watched(WallClock()) as (card, stream):
        for _ in range(2):
            card.deliver(2.5)
            card.deliver(LOST)
        card.deliver(2.5)
        assert wait_until(lambda: card.delivered.empty() and not reading_of(stream).unread)
        for _ in range(2):
            assert stream.read().start in (0, BLOCK)
            with pytest.raises(ScansLostError):
                stream.read()
        assert stream.read().start == 2 * BLOCK


def test_the_heartbeat_has_the_age_of_its_block() -> None:
    clock, ages = SetClock(2.0), list[float]()
    with watched(clock, heartbeat=ages.append) as (card, stream):
        for late_s in (0.0, 0.0, 1.2, 0.0):
            clock.time_s = (card.next_scan + BLOCK) / RATE_HZ + late_s
            card.deliver(2.5)
            stream.read()
    assert ages == pytest.approx([0.0, 0.0, 0.6, 0.0], abs=1e-4)  # real seconds, at twice the speed


def test_an_error_is_raised_behind_the_blocks_before_it_and_the_next_read_tries_again() -> None:
    with watched(WallClock()) as (card, stream):
        card.deliver(2.5)
        card.deliver(GONE)
        assert stream.read().start == 0
        with pytest.raises(AcquisitionError, match="unplugged"):
            stream.read()
        card.deliver(2.5)
        assert stream.read().start == 50


def test_a_card_that_falls_silent_is_an_error_and_not_an_endless_wait() -> None:
    with (
        watched(WallClock()) as (_, stream),
        pytest.raises(AcquisitionError, match="delivered"),
    ):
        stream.read_within(0.1)


@pytest.mark.parametrize("speed", [1.0, 5.0])
def test_the_age_is_that_of_the_sample_and_not_of_its_arrival(speed: float) -> None:
    """A program that was suspended for 20 s reads old samples: they are not present because they have just arrived."""
    clock = SetClock(speed)
    with watched(clock) as (card, stream):
        clock.time_s = 20.05
        card.deliver(2.5)
        stream.read()
        assert reading_of(stream).age_s(time.monotonic()) >= 20.0 / speed
        clock.time_s = 20.1
        card.deliver(2.0, skip=20_000)
        stream.read()
        assert reading_of(stream).age_s(reading_of(stream).measured_s + 0.25) == pytest.approx(0.25)
        assert reading_of(stream).measured_s == pytest.approx(time.monotonic(), abs=5.0)


@pytest.mark.parametrize("ppm", [-50, 50])
def test_the_clocks_of_card_and_computer_may_drift_for_a_day(ppm: int) -> None:
    clock = SetClock()
    with watched(clock) as (card, stream):
        for _ in range(25):
            clock.time_s = (card.next_scan + BLOCK) / RATE_HZ * (1 + 1e-6 * ppm)
            before_s = time.monotonic()
            card.deliver(2.5)
            stream.read()
            assert reading_of(stream).age_s(before_s) == 0, "a block that is as late as all are is present"
            card.next_scan += 3600 * round(RATE_HZ)
    assert abs(clock.time_s - card.next_scan / RATE_HZ) > 1.0


def test_on_a_clock_that_stands_still_a_reading_is_present_until_the_card_fails_or_time_is_let_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = VirtualClock()
    with watched(clock) as (card, stream):
        card.deliver(2.5)
        clock.sleep(0.05)
        stream.read()
        assert reading_of(stream).age_s(time.monotonic()) < 0.05
        clock.sleep(4.0)
        assert 4.0 <= reading_of(stream).age_s(time.monotonic()) < 4.05
        card.deliver(GONE)
        with pytest.raises(AcquisitionError):
            stream.read()
        failed_s = time.monotonic()
        assert reading_of(stream).age_s(failed_s + 3.0) >= 7.0
        monkeypatch.setattr("drivers.bench.card_reading.time.monotonic", lambda: failed_s + 100.0)
        card.deliver(GONE)
        with pytest.raises(AcquisitionError):
            stream.read()
        assert reading_of(stream).age_s(failed_s + 100.0) >= 104.0, "an attempt that fails makes it no younger"


def test_a_voltage_monitor_shows_volts_at_the_specimen() -> None:
    channels = (InputChannel("monitor", "ai2", "V", -200.0, 10.0, kind="voltage-monitor"),)
    with watched(VirtualClock(), channels) as (card, stream):
        card.deliver(2.5, 0.0, (0.0, 2.0))
        stream.read()
        assert reading_of(stream).monitor_v == pytest.approx((-390.0, 10.0))
        card.deliver(2.5, 0.0, 0.5)
        stream.read()
        assert reading_of(stream).monitor_v == pytest.approx((-390.0, 10.0))  # within the last 0.15 s, as the input's
    with watched(VirtualClock(), (InputChannel("current", "ai2", kind="current-monitor"),)) as (card, stream):
        card.deliver(2.5, 0.0, 1.0)
        stream.read()
        assert reading_of(stream).monitor_v is None


@pytest.mark.parametrize(
    ("drive", "sensor", "high_voltage_on", "still"),
    [
        ((2.25, 2.75), (0.0, 0.015), True, True),
        ((0.0, 2.5), 0.0, False, False),  # the source comes up with high voltage off
        ((2.25, 2.75), (0.0, 0.016), True, False),
        ((2.25, 2.74), 0.0, True, False),
        ((0.0, 5.0), (-1.0, 1.0), True, False),
        (2.5, 0.0, True, False),
    ],
)
@pytest.mark.one_in(1)
def test_a_sensor_that_does_not_follow_a_drive_of_the_specimen_stands_still(
    drive: tuple[float, float], sensor: tuple[float, float], high_voltage_on: bool, still: bool
) -> None:
    with watched(VirtualClock()) as (card, stream):
        stream.high_voltage_on = high_voltage_on
        card.deliver(drive, sensor)
        stream.read()
        assert not reading_of(stream).sensor_still, "its noise is not known"
        for rows in (*[(2.5, (0.0, 0.02))] * 4, *[(2.5, (0.0, 0.01))] * 4, *[(drive, sensor)] * 4):
            card.deliver(*rows)
            stream.read()
            reading = reading_of(stream)
        assert reading.sensor_still is still


@pytest.mark.parametrize(("sensor", "in_range"), [(0.0, True), (10.3, False), ((9.9, 10.3), True)])
def test_a_sensor_without_a_target_is_out_of_range(sensor: tuple[float, float], in_range: bool) -> None:
    with watched(VirtualClock()) as (card, stream):
        card.deliver(2.5, sensor)
        stream.read()
        assert reading_of(stream).sensor_in_range is in_range


def test_a_new_acquisition_keeps_the_last_reading_until_its_first_block_and_mixes_none() -> None:
    with watched(VirtualClock()) as (card, stream):
        card.deliver((0.0, 5.0))
        stream.read()
        other = Card()
        with WatchedStream(other, VirtualClock(), BLOCK / RATE_HZ, SENSOR, (), stream.reading) as again:
            assert reading_of(again).drive_v == (0.0, 5.0)
            other.deliver(2.5)
            again.read()
            assert reading_of(again).drive_v == (2.5, 2.5)


def test_nothing_was_measured_before_the_first_block() -> None:
    with watched(VirtualClock()) as (_, stream):
        assert stream.reading is None


class BusyCard(Card):
    """A card that always has another block, a hundredth of a second later."""

    reading = stopped_while_reading = False

    def read(self) -> Block:
        self.reading = True
        time.sleep(0.01)
        self.reading = False
        self.next_scan += BLOCK
        return Block(self.next_scan - BLOCK, np.zeros((3, BLOCK), np.int16))

    def __exit__(self, *_: object) -> None:
        self.stopped_while_reading = self.reading


def test_a_card_is_stopped_when_nothing_reads_it_any_more() -> None:
    for _ in range(5):
        card = BusyCard()
        with WatchedStream(card, WallClock(), BLOCK / RATE_HZ, SENSOR) as stream:
            stream.read()
        assert not card.stopped_while_reading


def test_a_program_that_is_held_up_at_raised_speed_holds_the_card_up(tmp_path: Path) -> None:
    """Bench time waits for the card's reader: one that runs ahead would leave the program behind."""
    clock = WallClock(20.0, SharedTime(tmp_path / "time", 20.0, new=True))
    card = BusyCard()
    with WatchedStream(card, clock, 0.4, SENSOR) as stream:
        assert wait_until(stream._arrived.full)
        assert card.next_scan <= 4 * BLOCK


def test_one_sample_of_a_target_is_enough_wherever_it_lies() -> None:
    with watched(VirtualClock()) as (card, stream):
        stream._sensor = replace(SENSOR, valid_low_v=1.0, valid_high_v=4.0)
        for volts, sees in (((0.0, 2.0), True), ((0.0, 5.0), False), ((0.0, 2.0, 5.0), True), (2.0, True)):
            card.deliver(2.5, volts)
            stream.read()
            assert reading_of(stream).sensor_in_range is sees
