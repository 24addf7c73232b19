"""Order of arming and shutdown: when the operator is asked, what the watchdog and the monitor see, what a warning costs."""

# ruff: noqa: PT012 - what a live bench does is asked within its `with`

import contextlib
import math
from collections.abc import Iterator
from itertools import count
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from app.session.bench_connection import BenchConnection
from drivers.bench.armed_bench import LEFT_REST_LIMIT_S
from drivers.bench.bench import ArmedBench, LiveWarning
from drivers.bench.interlock import Interlock
from drivers.bench.rest import SafeShutdown, drive_voltage
from drivers.bench.watchdog_interface import NoWatchdog
from drivers.drive_shapes import Drive, Hold, Sine, Steps
from drivers.errors import (
    MANUAL_SHUTDOWN_INSTRUCTIONS,
    AcquisitionError,
    BenchError,
    CardInUseError,
    DriveRejectedError,
    LinkError,
    UnsafeError,
)
from drivers.interfaces import Block, Scale
from sim_hardware.bench import SimulatedBench
from sim_hardware.testing.safe_volts import assert_safe_voltage
from tests.helpers.simulated_bench import laboratory

RATE_HZ = 2000.0


class Journal(NoWatchdog):
    """Operator, watchdog and monitor in one list, with the volts at the amplifier's input at each entry."""

    def __init__(self, world: SimulatedBench) -> None:
        super().__init__()
        self._world = world
        self.lines: list[str] = []
        self.volts: list[float] = []
        self.heartbeats = 0
        self.ended = self.help = ""

    def note(self, line: str) -> None:
        self.lines.append(line)
        self.volts.append(self._world.report().end_v)

    # the operator
    def disable(self) -> None:
        self.note("operator: off")
        self._world.disable_hv()

    def enable(self) -> None:
        self.note("operator: on")
        self._world.enable_hv()

    # the watchdog
    def arm(self) -> None:
        self.note("watchdog: armed")

    def disarm(self) -> None:
        self.note("watchdog: disarmed")

    def send_heartbeat(self) -> None:
        self.heartbeats += 1

    def raise_for_status(self) -> None:
        if self.ended:
            raise BenchError(self.ended)

    def request_rest(self, reason: str, /) -> str:
        self.note(f"asked for help: {reason}")
        return self.help

    def log(self, message: str) -> None:
        self.note(f"log: {message}")

    def close(self) -> None:
        self.note("watchdog: closed")

    # the monitor
    def drive_commanded(self) -> None: ...

    def drive_changed(self, drive: Drive | None, level_remaining_s: float = math.inf) -> None:
        del level_remaining_s
        self.note(f"drive: {drive.kind if drive else 'none'}")

    def block_read(self, block: Block) -> None:
        self.note(f"block of {block.raw.shape[1]}")


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch) -> Iterator[BenchConnection]:
    monkeypatch.setattr("drivers.bench.armed_bench.CATCH_UP_S", 60.0)  # a busy computer is no card that is not read
    with laboratory() as lab:
        yield lab


@pytest.fixture
def journal(lab: BenchConnection) -> Journal:
    journal = Journal(lab.control)
    lab.bench.watchdog = lab.bench.amplifier._watchdog = journal
    return journal


@contextlib.contextmanager
def armed_bench(
    lab: BenchConnection, journal: Journal, warnings: list[LiveWarning] | None = None, **options: Any
) -> Iterator[ArmedBench]:
    sink = options.pop("sink", lambda _: None)
    seen = warnings if warnings is not None else []
    with lab.bench.armed(RATE_HZ, sink, journal, on_warning=seen.append, **options) as armed:
        yield armed


def measured(unsafe: UnsafeError) -> str:
    """Return what an unsafe end tells of its measurement, behind the manual steps."""
    steps, _, told = str(unsafe).partition(" Measured: ")
    assert steps == f"{MANUAL_SHUTDOWN_INSTRUCTIONS}."
    return told


def leave_live(lab: BenchConnection, journal: Journal, volts: float = 1.2) -> None:
    """Leave the bench as a program that was killed in mid-run leaves it: high voltage on, the source off rest."""
    with armed_bench(lab, journal):
        pass
    lab.bench.amplifier._source.ramp_to(volts, 0.3)
    lab.bench._high_voltage_enabled = False
    journal.lines.clear()
    journal.volts.clear()


# -- order ---------------------------------------------------------------------------------------------------------------


def test_the_watchdog_watches_before_the_operator_switches_on_and_until_rest_was_measured(
    lab: BenchConnection, journal: Journal
) -> None:
    with armed_bench(lab, journal) as armed:
        assert journal.lines == ["operator: off", "watchdog: armed", "operator: on"]
        assert journal.volts[1:] == pytest.approx([2.5] * 2, abs=0.01)  # its output was off before
        assert armed.predicted_rest_s > 0
        armed.start_drive(Hold(3.5, 9.0))
    assert journal.lines[3:] == ["watchdog: disarmed"]
    assert journal.volts[3] == pytest.approx(2.5, abs=0.01)
    journal.lines.clear()
    with armed_bench(lab, journal):
        pass
    # The source rests since the last run: high voltage may still be on while it is measured.
    assert journal.lines == ["watchdog: armed", "watchdog: armed", "operator: on", "watchdog: disarmed"]


def test_the_operator_is_asked_at_rest_where_an_earlier_program_left_the_source_live(
    lab: BenchConnection, journal: Journal
) -> None:
    leave_live(lab, journal)
    warnings: list[LiveWarning] = []
    with armed_bench(lab, journal, warnings):
        assert len(warnings) == 1
        assert "watchdog: armed" in journal.lines[: journal.lines.index("operator: on")]
        volts = dict(zip(journal.lines, journal.volts, strict=True))
        assert volts["operator: on"] == pytest.approx(2.5, abs=0.01)
        assert volts.get("operator: off", 2.5) == pytest.approx(2.5, abs=0.01)
        assert volts["watchdog: armed"] in (pytest.approx(1.2, abs=0.01), pytest.approx(2.5, abs=0.01))
    assert journal.lines[0] == "watchdog: armed"  # while the source was being ramped
    assert journal.volts[0] == pytest.approx(1.2, abs=0.01)


@pytest.mark.parametrize(("volts", "left"), [(2.54, False), (2.6, True), (0.0, True)])
def test_a_source_that_another_hand_moves_from_rest_is_warned_of_while_the_operator_is_waited_for(
    lab: BenchConnection, journal: Journal, volts: float, left: bool
) -> None:
    warnings: list[LiveWarning] = []
    clock, source = lab.bench.clock, lab.bench.amplifier._source

    def waited(armed: ArmedBench, seconds: float) -> None:
        until_s = clock.now() + seconds
        while clock.now() < until_s:
            armed.read_block()

    blocks: list[int] = []
    with (
        pytest.raises(BenchError) if left else contextlib.nullcontext(),
        armed_bench(lab, journal, warnings, sink=lambda block: blocks.append(block.start)) as armed,
    ):
        waited(armed, 1.0)
        source.ramp_to(volts, 0.1)
        moved_s = clock.now()
        while left and not warnings:
            armed.read_block()
            assert clock.now() - moved_s < 0.6
        waited(armed, 3.0)  # the operator may look first
        if left:
            assert len(warnings) == 1
            assert warnings[0].low_v == pytest.approx(volts, abs=0.01)
        waited(armed, 3.0)
    assert len(warnings) == left
    assert blocks == sorted(blocks)
    assert lab.control.report().end_v == pytest.approx(2.5, abs=0.01 if left else 0.05)


def test_a_source_that_is_moved_after_a_return_to_rest_is_warned_of(lab: BenchConnection, journal: Journal) -> None:
    warnings: list[LiveWarning] = []
    with armed_bench(lab, journal, warnings) as armed:
        armed.start_drive(Hold(3.5, 9.0))
        armed.return_to_verified_rest()
        lab.bench.amplifier._source.ramp_to(2.7, 0.1)
        moved_s = lab.bench.clock.now()
        while not warnings:
            armed.read_block()
            assert lab.bench.clock.now() - moved_s < 0.6
    assert warnings[0].high_v == pytest.approx(2.7, abs=0.01)


@pytest.mark.parametrize(("amplitude_v", "left"), [(0.006, False), (0.009, True)])
def test_a_small_sine_is_a_source_that_has_left_rest_although_its_mean_has_not(
    lab: BenchConnection, journal: Journal, monkeypatch: pytest.MonkeyPatch, amplitude_v: float, left: bool
) -> None:
    def played(block: Block, scales: tuple[Scale, ...]) -> NDArray[np.float64]:
        scans = block.start + np.arange(block.raw.shape[1])
        return drive_voltage(block, scales) + amplitude_v * np.sin(2 * np.pi * 100.0 * scans / RATE_HZ)

    warnings: list[LiveWarning] = []
    with armed_bench(lab, journal, warnings) as armed, monkeypatch.context() as patch:
        patch.setattr("drivers.bench.armed_bench.drive_voltage", played)
        for _ in range(20):
            armed.read_block()
    assert len(warnings) == left


def test_a_source_at_rest_that_is_moved_while_rest_is_measured_is_warned_of_before_that_has_failed(
    lab: BenchConnection, journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    """High voltage is on since an earlier run; this one is armed long after the bench was opened."""
    with armed_bench(lab, journal):
        pass
    clock, amplifier = lab.bench.clock, lab.bench.amplifier
    clock.sleep(30.0)
    says_rest, moved_s, warned_s = amplifier.is_source_at_rest, math.nan, list[float]()

    def moved() -> bool:
        nonlocal moved_s
        rests = says_rest()
        amplifier._source.ramp_to(2.7, 0.1)
        moved_s = clock.now()
        return rests

    monkeypatch.setattr(amplifier, "is_source_at_rest", moved)
    with (
        pytest.raises(BenchError),
        lab.bench.armed(RATE_HZ, lambda _: None, journal, on_warning=lambda _: warned_s.append(clock.now())),
    ):
        raise AssertionError("it was armed")
    assert len(warned_s) == 1
    assert warned_s[0] - moved_s < 0.6
    assert lab.control.report().end_v == pytest.approx(2.5, abs=0.01)


def test_a_spike_in_every_block_is_not_a_source_that_has_left_rest(
    lab: BenchConnection, journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    def spiky(block: Block, scales: tuple[Scale, ...]) -> NDArray[np.float64]:
        volts = drive_voltage(block, scales).copy()
        volts[0] += 0.06
        return volts

    monkeypatch.setattr("drivers.bench.armed_bench.drive_voltage", spiky)
    lab.bench.block_s = 0.2
    warnings: list[LiveWarning] = []
    with armed_bench(lab, journal, warnings) as armed:
        for _ in range(20):
            armed.read_block()
    assert warnings == []


def test_a_source_that_leaves_rest_during_a_run_with_abort_levels_is_warned_of_and_ends_it(
    lab: BenchConnection, journal: Journal
) -> None:
    warnings: list[LiveWarning] = []
    with pytest.raises(BenchError, match=r"2\.7"), armed_bench(lab, journal, warnings) as armed:
        armed.monitor = journal
        lab.bench.amplifier._source.ramp_to(2.7, 0.1)
        for _ in range(200):
            armed.read_block()
    assert len(warnings) == 1


def test_the_measurement_of_rest_sends_a_heartbeat_with_every_block(lab: BenchConnection, journal: Journal) -> None:
    """The rest measurement reads the stream directly, which does not report to the watchdog by itself."""
    with armed_bench(lab, journal) as armed:
        shutdown = SafeShutdown(lab.bench.amplifier, lab.bench.clock, journal, lab.bench.open_stream)
        blocks: list[Block] = []

        def read() -> Block:
            blocks.append(armed.stream.read())
            return blocks[-1]

        before = journal.heartbeats
        assert shutdown.measure_rest(read, armed.stream, 2.0).confirmed
        assert journal.heartbeats - before == len(blocks) > 1


@pytest.mark.parametrize("returns", [True, False])
def test_short_excursions_with_rest_between_them_are_not_added_up(
    lab: BenchConnection, journal: Journal, monkeypatch: pytest.MonkeyPatch, returns: bool
) -> None:
    seen = count()

    def moved(block: Block, scales: tuple[Scale, ...]) -> NDArray[np.float64]:
        return drive_voltage(block, scales) + (0.2 if not returns or next(seen) % 2 else 0.0)

    warnings: list[LiveWarning] = []
    with armed_bench(lab, journal, warnings) as armed, monkeypatch.context() as patch:
        patch.setattr("drivers.bench.armed_bench.drive_voltage", moved)
        for _ in range(20):
            armed.read_block()
    assert len(warnings) == (not returns)


def test_a_commanded_level_is_not_a_source_that_has_left_rest(lab: BenchConnection, journal: Journal) -> None:
    warnings: list[LiveWarning] = []
    with armed_bench(lab, journal, warnings) as armed:
        for _ in range(2):
            armed.start_drive(Hold(3.5, 9.0))
            until_s = lab.bench.clock.now() + 5.0
            while lab.bench.clock.now() < until_s:
                armed.read_block()
            armed.return_to_verified_rest()
            armed.read_block()
    assert warnings == []


def test_a_burst_that_ended_before_this_program_began_is_nothing_to_be_warned_of(
    lab: BenchConnection, journal: Journal
) -> None:
    leave_live(lab, journal, 2.5)
    lab.bench.amplifier._source.start_drive(Sine(100.0, 1.0, 2.5, 20))
    lab.bench.clock.sleep(1.0)
    assert lab.bench.amplifier.is_left_live()  # its amplitude is still set
    warnings: list[LiveWarning] = []
    with armed_bench(lab, journal, warnings):
        pass
    assert warnings == []


def test_a_burst_that_ends_while_the_source_is_asked_is_nothing_to_be_warned_of(
    lab: BenchConnection, journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The card has sampled it when the source says that it is at rest, and its blocks are read afterwards."""
    with armed_bench(lab, journal):
        pass
    amplifier, warnings = lab.bench.amplifier, list[LiveWarning]()
    says_rest = amplifier.is_source_at_rest

    def asked_under_a_burst() -> bool:
        amplifier.start_drive(Sine(100.0, 1.0, 2.5, 40))
        lab.bench.clock.sleep(1.0)
        amplifier.return_to_rest()
        return says_rest()

    monkeypatch.setattr(amplifier, "is_source_at_rest", asked_under_a_burst)
    with armed_bench(lab, journal, warnings):
        pass
    assert warnings == []


@pytest.mark.parametrize("side", [-1, 1])
def test_a_drive_to_one_side_of_rest_that_was_left_is_warned_of(
    lab: BenchConnection, journal: Journal, side: int
) -> None:
    leave_live(lab, journal, 2.5)
    lab.bench.amplifier._source.start_drive(Steps((*(2.5, 2.5 + side) * 200, 2.5), 0.02, 0.002))
    lab.bench.clock.sleep(0.2)
    warnings: list[LiveWarning] = []
    with armed_bench(lab, journal, warnings):
        pass
    (warning,) = warnings
    assert sorted((warning.low_v, warning.high_v)) == pytest.approx(sorted((2.5, 2.5 + side)), abs=0.03)


def test_a_level_that_was_left_within_the_tolerance_of_rest_is_nothing_to_be_warned_of(
    lab: BenchConnection, journal: Journal
) -> None:
    leave_live(lab, journal, 2.54)
    warnings: list[LiveWarning] = []
    with armed_bench(lab, journal, warnings) as armed:
        assert armed.initial_rest is not None
        assert armed.initial_rest.measured_v == pytest.approx(2.5, abs=0.01)
    assert warnings == []


# -- without high voltage ------------------------------------------------------------------------------------------------


def test_without_high_voltage_the_operator_switches_it_off_and_nothing_is_watched_afterwards(
    lab: BenchConnection, journal: Journal
) -> None:
    with armed_bench(lab, journal, high_voltage=False) as armed:
        assert journal.lines == ["operator: off", "watchdog: disarmed"]
        assert not armed.high_voltage_may_be_on
        assert armed.initial_rest is not None
        assert armed.initial_rest.confirmed
    assert armed.final_rest is None
    assert lab.control.report().live_s == 0
    with armed_bench(lab, journal):
        pass
    journal.lines.clear()
    warnings: list[LiveWarning] = []
    with armed_bench(
        lab, journal, warnings, high_voltage=False
    ) as armed:  # the source rests, high voltage is on since the last run
        assert journal.lines == ["watchdog: armed", "operator: off", "watchdog: disarmed"]
        live_s = lab.control.report().live_s
        lab.bench.amplifier._source.ramp_to(1.2, 0.3)
        until_s = lab.bench.clock.now() + 2 * LEFT_REST_LIMIT_S
        while lab.bench.clock.now() < until_s:
            armed.read_block()
        lab.bench.amplifier._source.ramp_to(2.5, 0.3)
    assert (armed.final_rest, warnings) == (None, [])
    assert lab.control.report().live_s == live_s
    lab.control.inject("card-unplugged")
    with pytest.raises(AcquisitionError), armed_bench(lab, journal):  # only failed: high voltage is known to be off
        pass


@pytest.mark.parametrize("fails", [False, True])
def test_a_source_is_exercised_with_high_voltage_off_and_left_at_rest(
    lab: BenchConnection, journal: Journal, fails: bool
) -> None:
    with armed_bench(lab, journal):
        pass
    journal.lines.clear()
    live_s = lab.control.report().live_s
    lab.bench.clock.sleep(0.3)
    assert lab.control.report().live_s > live_s, "high voltage is on since the last run"
    with (
        contextlib.suppress(LinkError),
        lab.bench.exercised(RATE_HZ, lambda _: None, journal) as exercised,
    ):
        assert journal.lines == ["operator: off"]
        assert not lab.bench.high_voltage_enabled
        live_s = lab.control.report().live_s
        exercised.start_drive(Hold(3.5, 9.0))
        assert lab.control.report().end_v == pytest.approx(3.5, abs=0.01)
        if fails:
            raise LinkError("no answer")
    lab.bench.clock.sleep(0.3)
    report = lab.control.report()
    assert report.end_v == pytest.approx(2.5, abs=1e-3)
    assert report.live_s == live_s
    assert "operator: on" not in journal.lines


# -- warnings ------------------------------------------------------------------------------------------------------------


def test_a_warning_takes_no_time_and_shows_volts_of_the_last_block(lab: BenchConnection, journal: Journal) -> None:
    blocks: list[Block] = []
    at_s: list[float] = []
    clock = lab.bench.clock
    with (
        pytest.raises(LinkError),
        lab.bench.armed(RATE_HZ, blocks.append, journal, on_warning=lambda _: at_s.append(clock.now())) as armed,
    ):
        armed.start_drive(Hold(3.0, 10.0))
        stream = armed.stream
        clock.sleep(0.72)
        begin_s = clock.now()
        stored = len(blocks)
        raise LinkError("no answer")
    assert at_s == [begin_s]
    until = [stream.start_time_s + (block.start + block.raw.shape[1]) / RATE_HZ for block in blocks]
    latest_s = max(end_s for end_s in until if end_s <= begin_s)
    assert begin_s - latest_s < lab.bench.block_s
    assert len(blocks) > stored + 13
    assert [b.start for b in blocks] == [sum(b.raw.shape[1] for b in blocks[:i]) for i in range(len(blocks))]


def test_every_run_may_be_warned_of_once_while_arming_and_once_while_live(
    lab: BenchConnection, journal: Journal
) -> None:
    leave_live(lab, journal)
    warnings: list[LiveWarning] = []
    with pytest.raises(LinkError), armed_bench(lab, journal, warnings) as armed:
        armed.start_drive(Hold(3.0, 10.0))
        lab.bench.amplifier.on_failure(LinkError("error-1"))
        raise LinkError("error-2")
    while_arming, while_live = warnings
    assert while_arming.low_v == pytest.approx(1.2, abs=0.02)
    assert "error" not in while_arming.message
    assert while_live.low_v >= 2.4, "the level that was left is at rest"
    assert "error-1" in while_live.message
    assert "error-2" not in while_live.message


def test_a_source_that_does_not_tell_what_was_left_on_it_is_measured_and_unsafe_if_it_is_not_at_rest(
    lab: BenchConnection, journal: Journal
) -> None:
    leave_live(lab, journal)
    lab.control.inject("scpi-silent")
    warnings: list[LiveWarning] = []
    with pytest.raises(UnsafeError, match=r"By hand, now: .*the card sees 1\.2"), armed_bench(lab, journal, warnings):
        raise AssertionError("the bench went live")
    assert len(warnings) == 1
    assert warnings[0].low_v == pytest.approx(1.2, abs=0.02)
    assert "operator: on" not in journal.lines


def test_a_refusal_to_arm_is_no_danger_and_a_failure_to_arm_is(lab: BenchConnection, journal: Journal) -> None:
    with armed_bench(lab, journal):
        pass
    warnings: list[LiveWarning] = []
    amplifier = lab.bench.amplifier
    check = amplifier.check_way_to_rest

    def fail(error: Exception) -> Any:
        def raises() -> float:
            raise error

        return raises

    amplifier.check_way_to_rest = fail(DriveRejectedError("not armed: too slow"))  # type: ignore[method-assign]
    with pytest.raises(DriveRejectedError), armed_bench(lab, journal, warnings):
        raise AssertionError("the bench went live")
    assert warnings == []
    failure = BenchError("something else")
    amplifier.check_way_to_rest = fail(failure)  # type: ignore[method-assign]
    with pytest.raises(BenchError) as failed, armed_bench(lab, journal, warnings):
        raise AssertionError("the bench went live")
    assert failed.value is failure
    assert len(warnings) == 1
    amplifier.check_way_to_rest = check  # type: ignore[method-assign]


# -- the card ------------------------------------------------------------------------------------------------------------


def test_a_card_that_a_running_program_uses_is_left_alone_with_its_drive(
    lab: BenchConnection, journal: Journal
) -> None:
    leave_live(lab, journal)
    stream = lab.bench.digitizer.stream

    def in_use(*_: float) -> Any:
        raise CardInUseError("another program has its analogue input")

    lab.bench.digitizer.stream = in_use  # type: ignore[method-assign]
    warnings: list[LiveWarning] = []
    with pytest.raises(CardInUseError), armed_bench(lab, journal, warnings):
        raise AssertionError("the bench went live")
    assert (warnings, journal.lines) == ([], [])
    assert lab.control.report().end_v == pytest.approx(1.2, abs=0.01)
    lab.bench.digitizer.stream = stream  # type: ignore[method-assign]


def test_without_a_card_the_way_to_rest_is_in_the_log_of_the_watchdog(lab: BenchConnection, journal: Journal) -> None:
    leave_live(lab, journal)
    lab.control.inject("card-unplugged")
    with pytest.raises(UnsafeError) as failed, armed_bench(lab, journal):
        raise AssertionError("the bench went live")
    (line,) = journal.lines
    assert line.startswith("log: ")
    assert line.endswith(f": {measured(failed.value)}")
    assert isinstance(failed.value.__cause__, AcquisitionError)
    assert str(failed.value.__cause__) in line


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("factor", "refused"), [(0.9892, True), (0.9931, False), (1.0, False), (1.0068, False), (1.0121, True)]
)
def test_the_rate_of_the_card_may_differ_by_a_hundredth(lab: BenchConnection, factor: float, refused: bool) -> None:
    left: list[object] = []
    stream = SimpleNamespace(
        rate_hz=factor * RATE_HZ, scales=(), start_time_s=0.0, __exit__=lambda *_: left.append(None)
    )
    lab.bench.digitizer.stream = lambda rate_hz, scans: left.append((rate_hz, scans)) or stream  # type: ignore[method-assign, assignment, return-value]
    if refused:
        with pytest.raises(AcquisitionError, match=rf"{factor * RATE_HZ:g} Hz.* {RATE_HZ:g} Hz"):
            lab.bench.open_stream(RATE_HZ)
        assert left == [(RATE_HZ, 100), None]
    else:
        assert lab.bench.open_stream(RATE_HZ).rate_hz == stream.rate_hz
        assert left == [(RATE_HZ, 100)]


def test_a_block_is_a_twentieth_of_a_second_and_a_scan_at_least(lab: BenchConnection) -> None:
    asked: list[int] = []

    def stream(rate_hz: float, scans: int) -> Any:
        asked.append(scans)
        return SimpleNamespace(rate_hz=rate_hz, scales=(), start_time_s=0.0)

    lab.bench.digitizer.stream = stream  # type: ignore[method-assign]
    for rate_hz in (2000.0, 50_000.0, 2.0):
        lab.bench.open_stream(rate_hz)
    assert asked == [100, 2500, 1]


# -- while live ----------------------------------------------------------------------------------------------------------


def test_the_monitor_sees_every_drive_and_every_block_until_the_shutdown(
    lab: BenchConnection, journal: Journal
) -> None:
    stored: list[Block] = []
    with armed_bench(lab, journal, sink=stored.append) as armed:
        armed.monitor = journal
        journal.lines.clear()
        stored.clear()
        armed.start_drive(Hold(3.0, 9.0))
        first, second = armed.read_block(), armed.discard_block()
        assert stored == [first]
        assert armed.last_block is second
        assert journal.lines == ["drive: Hold", "block of 100", "block of 100"]
        rest = armed.return_to_verified_rest()
        assert rest.confirmed
        assert journal.lines[3] == "drive: none"
        assert set(journal.lines[4:]) == {"block of 100"}
        armed.start_drive(Hold(3.0, 9.0))
        seen = len(journal.lines)
    assert journal.lines[seen:] == ["watchdog: disarmed"]


def test_every_block_is_a_heartbeat_and_shows_a_watchdog_that_ended(
    lab: BenchConnection, journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(BenchError, match="the watchdog has ended"), armed_bench(lab, journal) as armed:
        before = journal.heartbeats
        monkeypatch.setattr(lab.bench.amplifier, "renew_hold", lambda: journal.note("renewed"))
        for _ in range(5):
            armed.read_block()
        assert journal.heartbeats - before >= 5
        assert journal.lines.count("renewed") == 5, "a level that is not renewed returns to rest"
        journal.ended = "the watchdog has ended"
        try:
            armed.read_block()
        finally:
            journal.ended = ""
    assert armed.final_rest is not None
    assert armed.final_rest.confirmed


def test_a_block_after_the_interlock_has_dropped_ends_the_run(
    lab: BenchConnection, journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    def dropped() -> None:
        raise BenchError("its relay is open")

    with pytest.raises(BenchError, match="its relay is open"), armed_bench(lab, journal) as armed:
        armed.read_block()
        monkeypatch.setattr(armed.interlock, "raise_for_status", dropped)
        armed.read_block()


def test_rest_that_is_not_reached_between_two_drives_ends_the_run(lab: BenchConnection, journal: Journal) -> None:
    with (
        pytest.raises(BenchError, match=r"\b2\.6\d\d V") as failed,
        armed_bench(lab, journal) as armed,
    ):
        link = lab.control.link()
        link.write("VOLT:OFFS 2.54;:VOLT:OFFS 2.58;:VOLT:OFFS 2.6;*IDN?")
        link.read()
        armed.return_to_verified_rest()
    assert type(failed.value) is BenchError, "rest was confirmed in the end"
    assert_safe_voltage_at_end(lab)


def assert_safe_voltage_at_end(lab: BenchConnection) -> None:
    lab.bench.clock.sleep(0.05)
    assert lab.control.report().ends_at_rest


# -- shutdown ------------------------------------------------------------------------------------------------------------


def test_the_error_of_a_run_is_not_replaced_by_that_of_its_full_disk(lab: BenchConnection, journal: Journal) -> None:
    full = False

    def sink(_: Block) -> None:
        if full:
            raise OSError("no space left on device")

    failure = ValueError("no such column")
    with pytest.raises(ValueError, match="column") as failed, armed_bench(lab, journal, sink=sink) as armed:
        armed.start_drive(Hold(3.0, 9.0))
        full = True
        raise failure
    assert failed.value is failure


def test_blocks_of_the_shutdown_are_stored_until_the_disk_is_full(lab: BenchConnection, journal: Journal) -> None:
    stored: list[Block] = []
    tries: list[Block] = []
    room = 1000

    def sink(block: Block) -> None:
        tries.append(block)
        if len(stored) == room:
            raise OSError("no space left on device")
        stored.append(block)

    with pytest.raises(OSError, match="no space"), armed_bench(lab, journal, sink=sink) as armed:
        armed.start_drive(Hold(3.0, 9.0))
        before, room = len(stored), len(stored) + 3
    assert len(stored) == before + 3
    assert len(tries) == len(stored) + 1
    assert np.abs(armed.scales[0].to_volts(stored[-1].raw[0]) - 2.5).max() < 0.6  # on its way to rest


def test_a_quiet_run_sends_nothing_to_the_source_at_its_end(lab: BenchConnection, journal: Journal) -> None:
    source = lab.bench.amplifier._source
    stops: list[str] = []
    stop, end_level = source.stop, source.end_level
    source.stop = lambda: stops.append("stop") or stop()  # type: ignore[method-assign, func-returns-value]
    source.end_level = lambda s: stops.append("end") or end_level(s)  # type: ignore[method-assign, func-returns-value]
    with armed_bench(lab, journal):
        stops.clear()
    assert stops == []
    with armed_bench(lab, journal) as armed:
        stops.clear()
        armed.start_drive(Hold(3.0, 9.0))
    assert stops == ["end"]
    source.stop, source.end_level = stop, end_level  # type: ignore[method-assign]


def test_an_unsafe_end_says_when_the_interlock_switches_off(
    lab: BenchConnection, journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = "; the interlock switches high voltage off 0.5 s after its last heartbeat"
    monkeypatch.setattr(Interlock, "statement", words)
    with pytest.raises(UnsafeError) as failed, armed_bench(lab, journal) as armed:
        armed.start_drive(Hold(3.0, 99.0))
        lab.control.inject("scpi-dropped")
    assert str(failed.value).startswith(f"{MANUAL_SHUTDOWN_INSTRUCTIONS}{words}. Measured: ")


@pytest.mark.parametrize(
    ("drive", "least_s", "most_s"),
    [(Hold(3.0, 99.0), 2.0, 8.0), pytest.param(Sine(100.0, 1.0, 2.5, 6000), 10.0, 20.0, marks=pytest.mark.deep)],
)
def test_an_unsafe_end_is_reported_without_waiting_for_a_level_and_ten_seconds_for_a_burst(
    lab: BenchConnection, journal: Journal, drive: Drive, least_s: float, most_s: float
) -> None:
    clock = lab.bench.clock
    journal.help = "the source does not answer it either"
    with pytest.raises(UnsafeError) as failed, armed_bench(lab, journal) as armed:
        armed.start_drive(drive)
        lab.control.inject("scpi-dropped")
        begin_s = clock.now()
    assert least_s <= clock.now() - begin_s <= most_s
    (asked,) = (line.removeprefix("asked for help: ") for line in journal.lines if line.startswith("asked for help: "))
    assert "33511B" in asked
    assert asked in str(failed.value)
    assert f"{journal.help}." in str(failed.value)
    assert journal.lines[-2].startswith("log: ")
    assert journal.lines[-2].endswith(f": {measured(failed.value)}")
    assert journal.lines[-1] == "watchdog: disarmed"


def test_the_whole_way_to_rest_is_within_the_silence_that_the_watchdog_allows(
    lab: BenchConnection, journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextlib.contextmanager
    def allowed(seconds: float | None = None) -> Iterator[None]:
        journal.note(f"allowed {seconds}")
        yield
        journal.note(f"over {seconds}")

    with armed_bench(lab, journal) as armed:
        armed.start_drive(Hold(3.5, 9.0))
        monkeypatch.setattr(journal, "allow_silence", allowed)
        begin = len(journal.lines)
    lines = journal.lines[begin:]
    assert (lines[0], lines[-2], lines[-1]) == ("allowed 8.0", "over 8.0", "watchdog: disarmed")
    assert journal.volts[begin] == pytest.approx(3.5, abs=0.01)
    assert journal.volts[-2] == pytest.approx(2.5, abs=0.01)


def test_an_interrupted_shutdown_leaves_the_watchdog_armed(lab: BenchConnection, journal: Journal) -> None:
    """Two presses of Ctrl-C: the program gives up, and silence then makes the watchdog act."""
    source = lab.bench.amplifier._source
    stop = source.stop

    def interrupted() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), armed_bench(lab, journal) as armed:
        armed.start_drive(Sine(100.0, 1.0, 2.5, 900))
        source.stop = interrupted  # type: ignore[method-assign]
    assert "watchdog: disarmed" not in journal.lines
    source.stop = stop  # type: ignore[method-assign]
    source.stop()
    source.ramp_to(2.5, 0.2)


def test_closing_reaches_every_instrument_although_one_fails(lab: BenchConnection, journal: Journal) -> None:
    closed: list[str] = []

    class Instrument:
        def __init__(self, name: str) -> None:
            self.name = name

        def close(self) -> None:
            closed.append(self.name)
            raise BenchError(f"{self.name} does not close")

    bench = lab.bench
    amplifier, digitizer, meters = bench.amplifier, bench.digitizer, bench.meters
    bench.amplifier, bench.digitizer = Instrument("amplifier"), Instrument("card")  # type: ignore[assignment]
    bench.meters = {"balance": Instrument("balance")}  # type: ignore[dict-item]
    bench.close()
    assert closed == ["amplifier", "card", "balance"]
    assert journal.lines == ["watchdog: closed"]
    bench.amplifier, bench.digitizer, bench.meters = amplifier, digitizer, meters


def test_the_heartbeat_of_the_interlock_ends_at_rest_before_the_operator_is_asked(
    lab: BenchConnection, journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    with armed_bench(lab, journal) as armed:
        armed.start_drive(Hold(3.0, 10.0))
        monkeypatch.setattr(armed.interlock, "end", lambda: journal.note("interlock: ended"))
        monkeypatch.setattr(armed.interlock, "begin", lambda _: journal.note("interlock: begun"))
        begin = len(journal.lines)
        with armed.specimen_access(journal):
            assert journal.lines[begin:][-2:] == ["interlock: ended", "operator: off"]
            assert journal.volts[-2] == pytest.approx(2.5, abs=1e-3)
        begun = [line for line in journal.lines if line.startswith(("operator", "interlock"))]
        assert begun[-2:] == ["operator: on", "interlock: begun"]


def test_the_heartbeat_of_the_interlock_lasts_from_the_operators_on_until_rest_was_measured(
    lab: BenchConnection, journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lab.bench.interlock, "end", lambda: journal.note("interlock: ended"))
    monkeypatch.setattr(lab.bench.interlock, "begin", lambda _: journal.note("interlock: begun"))
    with armed_bench(lab, journal, high_voltage=False):
        assert "interlock: begun" not in journal.lines, "without high voltage"
    journal.lines.clear()
    journal.volts.clear()
    with armed_bench(lab, journal) as armed:
        assert journal.lines[-2:] == ["operator: on", "interlock: begun"]
        armed.start_drive(Hold(3.5, 9.0))
    assert journal.lines[-2:] == ["watchdog: disarmed", "interlock: ended"]
    assert journal.volts[-4:] == pytest.approx([2.5] * 4, abs=0.01)
    journal.lines.clear()
    lab.control.inject("drive-cable-off")
    with pytest.raises(UnsafeError), armed_bench(lab, journal):
        raise AssertionError("it was armed")
    assert "interlock: begun" not in journal.lines, "rest was not measured"


@pytest.mark.parametrize("moved", ["off", "on"])
def test_rest_is_measured_on_both_sides_of_high_voltage_after_access_to_the_specimen(
    lab: BenchConnection, journal: Journal, monkeypatch: pytest.MonkeyPatch, moved: str
) -> None:
    """Somebody turns the offset at the generator's front panel meanwhile: nothing is driven from there."""

    def turn_offset() -> None:
        link = lab.control.link()
        link.write("VOLT:OFFS 2.54;:VOLT:OFFS 2.58;:VOLT:OFFS 2.6;*IDN?")
        link.read()

    with (
        pytest.raises(BenchError, match=r"\b2\.6\d\d V") as failed,
        armed_bench(lab, journal) as armed,
    ):
        if moved == "on":
            enable = journal.enable
            monkeypatch.setattr(journal, "enable", lambda: (enable(), turn_offset()))
        with armed.specimen_access(journal):
            if moved == "off":
                turn_offset()
    assert type(failed.value) is BenchError, "rest was confirmed in the end"
    assert journal.lines.count("operator: on") == (2 if moved == "on" else 1)
    assert_safe_voltage_at_end(lab)


def test_every_run_of_this_file_was_safe_at_the_amplifier(lab: BenchConnection, journal: Journal) -> None:
    with armed_bench(lab, journal) as armed:
        with armed.specimen_access(journal):
            assert journal.lines[-1] == "operator: off"
        assert journal.lines[-1] == "operator: on"
        armed.start_drive(Sine(100.0, 2.0, 2.5, 20))
        armed.read_block()
    lab.bench.clock.sleep(0.05)
    assert_safe_voltage(lab.control.report())
