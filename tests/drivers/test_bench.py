"""Arming and safe shutdown with faults: actions of the bench, messages, and voltage meanwhile."""

import itertools
import math
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest

from app.session.bench_connection import BenchConnection
from drivers.bench import armed_bench, rest
from drivers.bench.armed_bench import ArmedBench, longest_unmoved_s
from drivers.bench.bench import Bench
from drivers.bench.card_reading import CardReading
from drivers.bench.rest import LiveWarning, live_warning
from drivers.bench.watchdog_interface import NoWatchdog
from drivers.drive_shapes import Hold, Sine
from drivers.errors import (
    MANUAL_SHUTDOWN_INSTRUCTIONS,
    AcquisitionError,
    BenchError,
    LinkError,
    ScansLostError,
    UnsafeError,
)
from drivers.interfaces import Block
from model.amplifier_map import AmplifierMap
from sim_hardware.bench import SimulatedBench
from sim_hardware.testing.safe_volts import assert_safe_voltage
from tests.helpers.simulated_bench import laboratory

RATE_HZ = 2000.0


@dataclass
class Hand:
    """The person at the amplifier; `slip` is what else they do when they have switched it on."""

    world: SimulatedBench
    slip: Any = None
    told: list[str] = field(default_factory=list)

    def disable(self) -> None:
        self.told.append("off")
        self.world.disable_hv()

    def enable(self) -> None:
        self.told.append("on")
        self.world.enable_hv()
        if self.slip:
            self.slip()


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch) -> Iterator[BenchConnection]:
    monkeypatch.setattr("drivers.bench.armed_bench.CATCH_UP_S", 60.0)  # a busy computer is no card that is not read
    with laboratory() as lab:
        yield lab


def panel(world: SimulatedBench, command: str) -> None:
    link = world.link()
    link.write(f"{command};*IDN?")
    link.read()


@contextmanager
def live(lab: BenchConnection, hand: Hand | None = None, sink: Any = lambda _: None) -> Iterator[ArmedBench]:
    with lab.bench.armed(RATE_HZ, sink, hand or Hand(lab.control)) as armed:
        yield armed


def ended_well(lab: BenchConnection) -> None:
    lab.bench.clock.sleep(0.05)
    assert_safe_voltage(lab.control.report())


# -- arming --------------------------------------------------------------------------------------------------------------


def test_high_voltage_is_off_during_setup_and_on_at_measured_rest(lab: BenchConnection) -> None:
    hand = Hand(lab.control)
    seen: list[Block] = []
    with live(lab, hand, seen.append) as armed:
        assert hand.told == ["off", "on"]
        assert armed.initial_rest is not None
        assert armed.initial_rest.measured_v == pytest.approx(2.5, abs=0.01)
        assert armed.high_voltage_may_be_on
        assert seen  # whatever is read while arming is kept as well
    assert armed.final_rest is not None
    assert armed.final_rest.confirmed
    ended_well(lab)


def test_a_source_that_rests_is_not_set_up_again_and_the_person_is_told_on_only(lab: BenchConnection) -> None:
    with live(lab):
        pass
    hand = Hand(lab.control)
    with live(lab, hand):
        pass
    assert hand.told == ["on"]
    ended_well(lab)


def test_source_changed_between_runs_is_set_up_again_with_high_voltage_off(lab: BenchConnection) -> None:
    with live(lab):
        pass
    panel(lab.control, "BURS:PHAS 45")
    hand = Hand(lab.control)
    with live(lab, hand):
        pass
    assert hand.told == ["off", "on"]
    ended_well(lab)


@pytest.mark.parametrize("again", [False, True])
def test_a_refusal_of_high_voltage_holds_for_a_source_at_rest_too(lab: BenchConnection, again: bool) -> None:
    hand = Hand(lab.control)
    if again:
        with live(lab):
            pass
    lab.bench.high_voltage_refusal = "the source is not commissioned"
    with pytest.raises(BenchError, match="commissioned"), live(lab, hand):
        pass
    assert "on" not in hand.told


@pytest.mark.parametrize("again", [False, True])
def test_rest_that_is_not_there_keeps_high_voltage_off(lab: BenchConnection, again: bool) -> None:
    world = lab.control
    world.inject("drive-cable-off")
    hand = Hand(world)
    with (
        pytest.raises(BenchError, match=r"not armed, high voltage stays disabled: the card sees 0\.\d+ V"),
        live(lab, hand),
    ):
        pass
    assert hand.told == ["off"]
    assert world.report().live_s == 0
    if again:  # the source now reports rest, which does not count; whether the voltage is off is unknown
        with pytest.raises(UnsafeError) as failed, live(lab, hand):
            pass
        assert str(failed.value.__cause__).startswith("the generator reports that it is at rest, but the card sees")
        assert hand.told == ["off"]


def test_inputs_that_are_exchanged_at_the_card_are_named() -> None:
    """The drive at rest is seen where the sensor should be; a cable that is off shows nothing there."""
    for fault, named in (("", True), ("drive-cable-off", False)):
        with laboratory() as lab:
            lab.bench.digitizer = lab.control.digitizer(terminals=("ai1", "ai0"))
            if fault:
                lab.control.inject(fault)
            with pytest.raises(BenchError, match="disabled") as failed, live(lab):
                pass
            assert ("exchanged" in str(failed.value)) is named
            assert lab.control.report().live_s == 0


def test_rest_that_is_lost_when_high_voltage_comes_on_ends_the_run_there(lab: BenchConnection) -> None:
    """The level that the hand brushed at the front panel is 0.2 V away: it is brought back, and nothing is driven."""
    hand = Hand(lab.control, lambda: panel(lab.control, "VOLT:OFFS 2.52;:VOLT:OFFS 2.56;:VOLT:OFFS 2.6"))
    with pytest.raises(BenchError, match=r"after high voltage was enabled, the card sees 2\.6"), live(lab, hand):
        raise AssertionError("the bench went live")
    lab.bench.clock.sleep(0.05)
    report = lab.control.report()
    assert report.ends_at_rest
    assert report.outside_rest_s < 5.0


def test_unrecoverable_rest_is_unsafe_with_measured_voltages(lab: BenchConnection) -> None:
    hand = Hand(lab.control, lambda: lab.control.inject("drive-cable-off"))
    with (
        pytest.raises(UnsafeError, match=r"By hand, now: .*lowest -?0\.\d+ V, highest 0\.\d+ V") as failed,
        live(lab, hand),
    ):
        raise AssertionError("the bench went live")
    assert type(failed.value.__cause__) is BenchError
    assert hand.told == ["off", "on"], "it was lost when high voltage came on"


class Kept(NoWatchdog):
    """Keeps what is written into the log."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def log(self, message: str) -> None:
        self.lines.append(message)


def test_rest_that_is_not_confirmed_is_written_into_the_watchdogs_log(lab: BenchConnection) -> None:
    lab.bench.watchdog = kept = Kept()
    with pytest.raises(UnsafeError), live(lab):
        lab.control.inject("drive-cable-off")
    (line,) = kept.lines
    assert re.fullmatch(r"the program could not confirm rest: the card sees 0\.000 V \(.*", line)


def test_a_level_moved_by_the_hands_on_the_specimen_keeps_high_voltage_off(lab: BenchConnection) -> None:
    hand = Hand(lab.control)
    with pytest.raises(BenchError, match=r"high voltage stays off: the card sees 2\.6"), live(lab, hand) as armed:  # noqa: PT012
        with armed.specimen_access(hand):
            panel(lab.control, "VOLT:OFFS 2.54;:VOLT:OFFS 2.58;:VOLT:OFFS 2.6")
        raise AssertionError("high voltage came on")
    assert hand.told == ["off", "on", "off"]
    assert armed.final_rest is not None
    assert armed.final_rest.confirmed


# -- the card that cannot be opened --------------------------------------------------------------------------------------


def test_without_a_card_nothing_is_touched_and_the_run_has_failed_only(lab: BenchConnection) -> None:
    lab.control.inject("card-unplugged")
    hand = Hand(lab.control)
    with pytest.raises(AcquisitionError), live(lab, hand):
        pass
    assert hand.told == []


def test_missing_card_with_high_voltage_left_on_is_unsafe(lab: BenchConnection) -> None:
    with live(lab):
        pass
    lab.control.inject("card-unplugged")
    panel(lab.control, "VOLT:OFFS 2.54;:VOLT:OFFS 2.58")  # a hand at the front panel, meanwhile
    with (
        pytest.raises(
            UnsafeError, match=rf"^{re.escape(MANUAL_SHUTDOWN_INSTRUCTIONS)}.*the card cannot see the drive: .*cable"
        ),
        live(lab),
    ):
        pass
    lab.bench.clock.sleep(0.05)
    assert lab.control.report().ends_at_rest  # it was commanded to rest nevertheless
    lab.control.clear()
    with live(lab):
        pass


def test_a_missing_card_with_high_voltage_left_on_is_unsafe_whatever_the_source_says(
    lab: BenchConnection, monkeypatch: pytest.MonkeyPatch
) -> None:
    with live(lab):
        pass
    lab.control.inject("card-unplugged")
    monkeypatch.setattr(lab.bench.amplifier, "may_be_left_live", lambda: False)
    with pytest.raises(UnsafeError), live(lab):
        pass


def test_run_file_that_cannot_be_created_with_high_voltage_on_ends_at_rest(lab: BenchConnection) -> None:
    with live(lab):
        pass
    kept: list[ArmedBench] = []

    def started(armed: ArmedBench) -> None:
        kept.append(armed)
        raise OSError("no space left on device")

    with pytest.raises(OSError, match="no space"), lab.bench.armed(RATE_HZ, lambda _: None, Hand(lab.control), started):
        pass
    assert kept[0].final_rest is not None
    assert kept[0].final_rest.confirmed


def test_a_sample_clock_that_is_not_the_one_asked_for_is_a_sentence(lab: BenchConnection) -> None:
    bench: Bench = lab.bench
    stream = bench.digitizer.stream

    def slow(rate_hz: float, block_scans: int) -> Any:
        return stream(0.98 * rate_hz, block_scans)

    bench.digitizer.stream = slow  # type: ignore[method-assign]
    with (
        pytest.raises(AcquisitionError, match=r"\b1960\.02 Hz.* 2000 Hz"),
        live(lab),
    ):
        pass
    bench.digitizer.stream = stream  # type: ignore[method-assign]
    with live(lab):  # the first one was let go
        pass


# -- the way out ---------------------------------------------------------------------------------------------------------


class Breaks:
    """A wire that is dead from `cut` on, until it is opened anew, which `refuses` may refuse."""

    def __init__(self, link: Any) -> None:
        self._link, self.name, self.cut, self.opened = link, link.name, False, 0
        self.refuses: Callable[[], bool] = lambda: False

    def write(self, message: str) -> None:
        if self.cut:
            raise LinkError(f"{self.name} cannot be reached")
        self._link.write(message)

    def read(self) -> str:
        return str(self._link.read())

    def clear(self) -> None:
        self._link.clear()

    def reopen(self) -> None:
        self.opened += 1
        if self.refuses():
            raise LinkError(f"{self.name} cannot be reached")
        self.cut = False
        self._link.reopen()

    def close(self) -> None:
        self._link.close()


def test_dead_link_during_shutdown_is_reopened_and_level_ramped_down(lab: BenchConnection) -> None:
    scpi = lab.bench.amplifier._source._scpi  # type: ignore[attr-defined]
    wire = scpi.link = Breaks(scpi.link)
    with live(lab) as armed:
        armed.start_drive(Hold(3.5, 10.0))
        begin_s = lab.bench.clock.now()
    assert wire.opened == 0  # not where the source obeys
    assert lab.bench.clock.now() - begin_s < 1.5  # reported immediately, not only after the card measured no rest
    with live(lab) as armed:
        armed.start_drive(Hold(3.5, 10.0))
        wire.cut = True
    assert wire.opened == 1
    assert armed.final_rest is not None
    assert armed.final_rest.confirmed
    assert "33511B" not in armed.final_rest.message, "the source obeyed"
    ended_well(lab)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(("back_s", "obeys"), [(4.5, True), (6.0, False)])
def test_a_link_is_opened_again_for_five_seconds(
    lab: BenchConnection, monkeypatch: pytest.MonkeyPatch, back_s: float, obeys: bool
) -> None:
    monkeypatch.setattr(rest, "time", SimpleNamespace(monotonic=lambda: 0.0))  # bench time alone
    scpi, clock = lab.bench.amplifier._source._scpi, lab.bench.clock  # type: ignore[attr-defined]
    wire = scpi.link = Breaks(scpi.link)
    with nullcontext() if obeys else pytest.raises(UnsafeError), live(lab) as armed:
        armed.start_drive(Hold(3.5, 60.0))
        wire.cut, cut_s = True, clock.now()
        wire.refuses = lambda: clock.now() - cut_s < back_s
    assert wire.opened > 10
    assert armed.final_rest is not None
    assert armed.final_rest.confirmed is obeys
    clock.sleep(0.05)
    assert lab.control.report().end_v == pytest.approx(2.5 if obeys else 3.5, abs=0.01)


def test_on_a_clock_that_stands_still_a_link_is_opened_again_for_five_real_seconds(
    lab: BenchConnection, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The watchdog has taken over, so that no wait is possible."""
    real_s, tries = itertools.count(0.0, 0.5), list[str]()

    def unreachable() -> None:
        tries.append("again")
        raise LinkError("it cannot be reached")

    def no_wait(_: float) -> None:
        raise BenchError("the watchdog took over")

    amplifier, clock = lab.bench.amplifier, SimpleNamespace(now=lambda: 7.0, sleep=no_wait)
    monkeypatch.setattr(rest, "time", SimpleNamespace(monotonic=lambda: next(real_s)))
    for way in ("force_rest", "reconnect_and_force_rest"):
        monkeypatch.setattr(amplifier, way, partial(unreachable))  # two ways
    shutdown = rest.SafeShutdown(amplifier, clock, NoWatchdog(), lab.bench.open_stream)  # type: ignore[arg-type]
    assert "reached" in shutdown.command_rest(amplifier.force_rest)
    assert 2 < len(tries) < 13


def test_a_burst_that_cannot_be_stopped_is_waited_for_before_rest_is_judged(lab: BenchConnection) -> None:
    with live(lab) as armed:
        armed.start_drive(Sine(100.0, 1.0, 2.5, 900))  # longer than the source is tried and rest is waited for
        lab.control.inject("scpi-dropped")
    assert armed.final_rest is not None
    assert armed.final_rest.confirmed
    assert "The source did not obey: generator 33511B" in armed.final_rest.message
    lab.control.clear()
    ended_well(lab)


def test_a_stream_that_is_broken_is_replaced_by_a_second_one_that_sees_the_rest(lab: BenchConnection) -> None:
    with pytest.raises(ScansLostError), live(lab) as armed:  # noqa: PT012
        armed.start_drive(Sine(100.0, 1.0, 2.5, 200))
        lab.control.inject("card-overrun")
        try:
            armed.read_block()
        finally:
            lab.control.clear("card-overrun")
            armed.stream.close()  # type: ignore[attr-defined] - what an overrun leaves of a task
    assert armed.final_rest is not None
    assert armed.final_rest.confirmed
    assert armed.final_rest.measured_v == pytest.approx(2.5, abs=0.01)
    ended_well(lab)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(("off_v", "rests"), [(0.007, True), (0.03, False), (-0.03, False)])
def test_a_second_stream_compares_with_rest_at_arming(
    lab: BenchConnection, monkeypatch: pytest.MonkeyPatch, off_v: float, rests: bool
) -> None:
    opened, streams = lab.bench.open_stream, list[Any]()

    def open_stream(rate_hz: float) -> Any:
        streams.append(stream := opened(rate_hz))
        if len(streams) == 1:
            return stream
        c0, *more = stream.scales[0].coefficients
        stream.scales = (replace(stream.scales[0], coefficients=(c0 + off_v, *more)), *stream.scales[1:])
        return stream

    monkeypatch.setattr(lab.bench, "open_stream", open_stream)
    with nullcontext() if rests else pytest.raises(UnsafeError), live(lab) as armed:
        streams[0].close()
        monkeypatch.setattr(streams[0], "read", lambda: (_ for _ in ()).throw(AcquisitionError("gone")))
    assert armed.final_rest is not None
    assert armed.final_rest.confirmed is rests
    assert armed.final_rest.measured_v == pytest.approx(2.5 + off_v, abs=2e-3)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(("back_s", "seen"), [(4.0, True), (6.0, False)])
def test_a_card_that_is_back_five_seconds_after_the_source_obeyed_sees_the_rest_and_a_later_one_does_not(
    lab: BenchConnection, monkeypatch: pytest.MonkeyPatch, back_s: float, seen: bool
) -> None:
    """However long the source took to obey."""
    bench, amplifier, obeyed_s = lab.bench, lab.bench.amplifier, math.inf
    monkeypatch.setattr(rest, "time", SimpleNamespace(monotonic=lambda: 0.0))  # bench time alone
    opened, force_rest = bench.open_stream, amplifier.force_rest

    def open_stream(rate_hz: float) -> Any:
        if bench.clock.now() > obeyed_s + back_s:
            lab.control.clear("card-unplugged")
        return opened(rate_hz)

    def force_rest_slowly() -> None:
        nonlocal obeyed_s
        bench.clock.sleep(6.0)
        force_rest()
        obeyed_s = bench.clock.now()
        lab.control.inject("card-unplugged")

    monkeypatch.setattr(bench, "open_stream", open_stream)
    with nullcontext() if seen else pytest.raises(UnsafeError), live(lab) as armed:
        armed.start_drive(Hold(3.5, 60.0))
        monkeypatch.setattr(amplifier, "force_rest", force_rest_slowly)
    assert armed.final_rest is not None
    assert armed.final_rest.confirmed is seen
    lab.control.clear()
    ended_well(lab)


def test_without_a_second_stream_it_is_unsafe_because_nobody_can_see(
    lab: BenchConnection, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[str] = []
    with pytest.raises(UnsafeError) as failed, live(lab) as armed:  # noqa: PT012
        lab.control.inject("card-unplugged")
        monkeypatch.setattr(lab.bench.amplifier, "force_rest", lambda: sent.append("rest"))
    assert sent == [], "it rests, and what cannot be seen is no reason to command it"
    assert str(failed.value).startswith(MANUAL_SHUTDOWN_INSTRUCTIONS)
    assert armed.final_rest is not None
    assert not armed.final_rest.confirmed
    assert math.isnan(armed.final_rest.measured_v)
    ended_well(lab)


def test_failing_sink_during_shutdown_does_not_prevent_rest(lab: BenchConnection) -> None:
    full = False

    def sink(_: Block) -> None:
        if full:
            raise OSError("no space left on device")

    with pytest.raises(OSError, match="no space"), live(lab, sink=sink) as armed:  # noqa: PT012
        armed.start_drive(Hold(3.5, 10.0))
        full = True
    assert armed.final_rest is not None
    assert armed.final_rest.confirmed
    ended_well(lab)


def test_unexpected_level_is_ramped_to_rest_before_reporting_unsafe(
    lab: BenchConnection,
) -> None:
    with live(lab) as armed:
        panel(lab.control, "VOLT:OFFS 2.54;:VOLT:OFFS 2.58;:VOLT:OFFS 2.62")
    assert armed.final_rest is not None
    assert armed.final_rest.confirmed
    lab.bench.clock.sleep(0.05)
    assert lab.control.report().ends_at_rest


def test_a_block_that_could_not_be_stored_is_told_although_rest_was_measured_again(lab: BenchConnection) -> None:
    fails = iter((False,))

    def sink(_: Block) -> None:
        if next(fails, False):
            raise OSError("no space left on device")

    with pytest.raises(OSError, match="no space"), live(lab, sink=sink) as armed:  # noqa: PT012
        panel(lab.control, "VOLT:OFFS 2.54;:VOLT:OFFS 2.58;:VOLT:OFFS 2.62")
        fails = iter((True,))  # once only: the blocks of the second measurement are stored
    assert armed.final_rest is not None
    assert armed.final_rest.confirmed


# -- the specimen may be live ----------------------------------------------------------------------------------------------


@contextmanager
def warned(lab: BenchConnection, warnings: list[LiveWarning]) -> Iterator[ArmedBench]:
    """A live bench; what the card saw at the moment of each warning is what it sees then."""

    def warn(warning: LiveWarning) -> None:
        assert lab.control.report().end_v == pytest.approx(warning.low_v, abs=0.05) or warning.low_v != warning.low_v
        warnings.append(warning)

    hand = Hand(lab.control)
    with lab.bench.armed(RATE_HZ, lambda _: None, hand, on_warning=warn) as armed:
        yield armed


def test_a_source_that_does_not_answer_is_told_with_the_volts_before_the_program_acts(
    lab: BenchConnection, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The age is of real time, which a busy computer may take between two lines.
    monkeypatch.setattr(rest, "PRESENT_S", 30.0)
    monkeypatch.setattr(armed_bench, "CATCH_UP_S", 30.0)
    warnings: list[LiveWarning] = []
    with pytest.raises(LinkError), warned(lab, warnings) as armed:  # noqa: PT012
        armed.start_drive(Hold(3.0, 10.0))
        for _ in range(3):
            armed.read_block()
        lab.control.inject("scpi-silent")
        try:
            armed.start_drive(Hold(3.5, 10.0))
        finally:
            lab.control.clear()
    (warning,) = warnings
    assert warning.low_v == pytest.approx(3.0, abs=0.02)
    assert "no answer to" in warning.message
    assert "The card last saw 3.0" in warning.message
    assert (
        "about 300 V on the specimen if the high voltage is on. By hand, now: switch the high voltage OFF"
        in warning.message
    )
    ended_well(lab)


def test_a_drive_that_an_earlier_program_left_is_told_and_at_rest_before_the_operator_is_asked(
    lab: BenchConnection,
) -> None:
    with live(lab):
        pass
    source = lab.bench.amplifier._source
    lab.bench._high_voltage_enabled = False  # another program than the one that switched it on
    source.ramp_to(1.2, 0.3)
    warnings: list[LiveWarning] = []
    with warned(lab, warnings):
        pass
    (warning,) = warnings
    assert warning.low_v == pytest.approx(1.2, abs=0.02)
    assert "an earlier program left a drive or a level on the source, which is ramped to rest now" in warning.message
    ended_well(lab)


def test_without_a_card_a_source_that_an_earlier_program_left_live_is_commanded_to_rest_and_unsafe(
    lab: BenchConnection,
) -> None:
    with live(lab):
        pass
    lab.bench._high_voltage_enabled = False
    lab.bench.amplifier._source.ramp_to(1.2, 0.3)
    lab.control.inject("card-unplugged")
    warnings: list[LiveWarning] = []
    with pytest.raises(UnsafeError, match=re.escape(MANUAL_SHUTDOWN_INSTRUCTIONS)) as failed, warned(lab, warnings):
        pass
    assert isinstance(failed.value.__cause__, AcquisitionError)
    assert f"The specimen may be live: the card cannot be had: {failed.value.__cause__}" in warnings[0].message
    lab.bench.clock.sleep(0.05)
    assert lab.control.report().ends_at_rest


def test_a_card_lost_in_mid_run_is_told_at_once(lab: BenchConnection) -> None:
    warnings: list[LiveWarning] = []
    with pytest.raises(UnsafeError), warned(lab, warnings) as armed:  # noqa: PT012
        armed.start_drive(Hold(3.0, 10.0))
        for _ in range(12):
            armed.read_block()
        lab.control.inject("card-unplugged")
        armed.read_block()
    assert warnings[0].low_v == pytest.approx(3.0, abs=0.02)
    ended_well(lab)


def test_what_is_no_fault_of_an_instrument_is_not_told_as_danger(lab: BenchConnection) -> None:
    warnings: list[LiveWarning] = []
    with pytest.raises(BenchError, match="meter"), warned(lab, warnings):
        raise BenchError("this bench has no meter")
    assert warnings == []


class FullDisk:
    """A sink of blocks that is full from some moment on; it counts what is brought to it."""

    def __init__(self) -> None:
        self.full, self.brought = False, 0

    def __call__(self, _block: Block) -> None:
        if self.full:
            self.brought += 1
            raise OSError("no space left on device")


def fail(lab: BenchConnection, after_s: float, fault: str = "", disk: FullDisk | None = None) -> None:
    """Let a fault begin, wait, and lose the generator's answer."""
    if fault:
        lab.control.inject(fault)
    if disk is not None:
        disk.full = True
    lab.bench.clock.sleep(after_s)
    raise LinkError("function generator: no answer")


@contextmanager
def live_at(lab: BenchConnection, volts: float, warnings: list[LiveWarning], sink: Any) -> Iterator[ArmedBench]:
    """A bench at a level that was read last when it was still at rest; its warnings show the volts at their moment."""
    with lab.bench.armed(RATE_HZ, sink, Hand(lab.control), on_warning=warnings.append) as armed:
        armed.read_block()
        armed.start_drive(Hold(volts, 60.0))
        yield armed


def test_a_disk_that_is_full_does_not_keep_the_volts_of_a_warning_at_those_of_an_earlier_block(
    lab: BenchConnection,
) -> None:
    warnings: list[LiveWarning] = []
    disk = FullDisk()
    with pytest.raises(LinkError), live_at(lab, 2.02, warnings, disk):
        fail(lab, 0.6, disk=disk)
    assert disk.brought > 0
    assert warnings[0].low_v == pytest.approx(2.02, abs=0.01)
    assert "The card last saw 2.0" in warnings[0].message


def test_scans_that_were_lost_do_not_keep_the_volts_of_a_warning_at_those_of_an_earlier_block(
    lab: BenchConnection,
) -> None:
    warnings: list[LiveWarning] = []
    with pytest.raises(LinkError), live_at(lab, 2.02, warnings, lambda _: None):
        fail(lab, 20.0)  # longer than the card's buffer
    assert warnings[0].low_v == pytest.approx(2.02, abs=0.01)
    assert warnings[0].age_s < 0.3


def test_a_warning_names_no_volts_that_are_old_and_says_for_how_long_the_card_was_not_read(
    lab: BenchConnection,
) -> None:
    warnings: list[LiveWarning] = []
    with pytest.raises(UnsafeError), live_at(lab, 2.02, warnings, lambda _: None):
        fail(lab, 20.0, "card-unplugged")
    (warning,) = warnings
    assert math.isnan(warning.low_v)
    assert math.isnan(warning.high_v)
    assert warning.age_s > 20.0
    assert warning.part == "generator"
    assert re.search(
        r"The card has not been read for 2\d\.\d s: do not rely on volts that were shown before", warning.message
    )
    assert not re.search(r"-?\d+ V", warning.message)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("reason", "part"),
    [
        (AcquisitionError("unplugged"), "card"),
        (LinkError("no answer"), "generator"),
        ("an earlier program left a drive", ""),
    ],
)
def test_a_warning_names_the_part_that_failed(lab: BenchConnection, reason: object, part: str) -> None:
    reading = CardReading((0.0, 5.0), (1.0, 1.02), time.monotonic())
    for seen in (None, reading, replace(reading, measured_s=time.monotonic() - 1.0)):
        assert live_warning(reason, seen, lab.bench.amplifier.map).part == part
    warning = live_warning(reason, reading, lab.bench.amplifier.map)
    assert (warning.low_v, warning.high_v) == (1.0, 1.02), "those of the last block"
    assert "about -298 V on the specimen" in warning.message


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("wait_s", "predicted_s", "unmoved_s"), [(0.0, math.nan, 0.0), (0.0, 0.4, 0.0), (0.0, 1.2, 0.7), (9.0, 0.6, 9.1)]
)
def test_on_a_way_to_rest_the_output_may_stay_for_the_end_of_its_drive_and_for_the_replies(
    wait_s: float, predicted_s: float, unmoved_s: float
) -> None:
    amplifier = SimpleNamespace(map=AmplifierMap(), limits=SimpleNamespace(ramp_v_per_s=5.0), stop_wait_s=wait_s)
    assert longest_unmoved_s(amplifier, predicted_s) == pytest.approx(unmoved_s)  # type: ignore[arg-type]
