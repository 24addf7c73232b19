"""Analogue output of the card: samples on their way to the converter, release at a measured level, leases of held levels."""

import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import pytest

from drivers.bench.drive_limits import DriveLimits, HvAmplifier
from drivers.clock import WallClock
from drivers.drive_shapes import Hold, LinearSweep, Sine, Steps
from drivers.errors import AcquisitionError, InstrumentError
from drivers.nidaq.analog_input import NiDigitizer
from drivers.nidaq.analog_output import NiAnalogOutput
from drivers.nidaq.output_task import OutputTask, PlaybackProgress
from drivers.nidaq.rendering import MAX_SAMPLES, QUEUE_S, SAMPLE_RATES_HZ, sample_count, sample_rate_for
from model.amplifier_map import AmplifierMap
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.nidaq.task import SimulatedNiDevice
from sim_hardware.plant.parameters import CardParameters, SimulationParameters
from sim_hardware.service.served_bench import ServedBench
from tests.helpers.simulated_bench import assert_safe_voltage, installed
from tests.wires.ni_library import NiLibrary

QUEUES = [
    CardParameters(usb_requests=4, usb_request_bytes=32_768, usb_adjustable=False),
    CardParameters(usb_requests=4, usb_request_bytes=32_768, usb_adjustable=True),
    CardParameters(usb_requests=8, usb_request_bytes=65_536, usb_adjustable=False),
    CardParameters(usb_requests=1, usb_request_bytes=8192, usb_adjustable=True),
]


@contextmanager
def live(card: CardParameters | None = None, **options) -> Iterator[tuple[NiAnalogOutput, SimulatedBench]]:
    """A source at rest with high voltage on; its driver's C library is the simulated card's."""
    parameters = SimulationParameters(source="ao0", card=card or CardParameters())
    bench = SimulatedBench(parameters, VirtualClock())
    with installed(NiLibrary(SimulatedNiDevice(bench.card, bench.clock, bench.faults))):
        source = NiAnalogOutput("Dev1", "ao0", bench.clock, **options)
        source.initialize_at_rest(2.5, 0.0, 5.0)
        bench.enable_hv()
        try:
            yield source, bench
        finally:
            source.close()


class SlowLibrary(NiLibrary):
    """NI's functions over a wire on which every reply takes `reply_s`, and 200 000 samples `write_s` more."""

    reply_s = write_s = 0.0

    def _function(self, name: str, call: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        def delayed(*values: Any) -> Any:
            samples = int(values[1]) if name == "WriteAnalogF64" else 0
            self.device.clock.sleep(self.reply_s / 2 + self.write_s * samples / 200_000)
            try:
                return call(*values)
            finally:
                self.device.clock.sleep(self.reply_s / 2)

        return super()._function(name, delayed, arguments)


@contextmanager
def slow(lease_s: float = 5.0) -> Iterator[tuple[NiAnalogOutput, SimulatedBench, SlowLibrary]]:
    """A source at rest on a wire that can become slow."""
    bench = SimulatedBench(SimulationParameters(source="ao0", card=QUEUES[0]), VirtualClock())
    library = SlowLibrary(SimulatedNiDevice(bench.card, bench.clock, bench.faults))
    with installed(library):
        source = NiAnalogOutput("Dev1", "ao0", bench.clock, lease_s=lease_s)
        source.initialize_at_rest(2.5, 0.0, 5.0)
        bench.enable_hv()
        yield source, bench, library
        assert_safe_voltage(bench.report())
        assert bench.report().largest_jump_v < 0.01
        source.close()


@pytest.mark.parametrize("reply_s", [0.1, 0.3, 0.6, 0.9])
def test_a_level_on_a_wire_that_becomes_slow_is_renewed_or_returns_to_rest(reply_s: float) -> None:
    """A renewal that arrived after its samples were on their way made the output jump back from rest to the level."""
    with slow() as (source, bench, library):
        source.ramp_to(4.0, 0.4)
        library.reply_s = reply_s
        with suppress(InstrumentError):
            while bench.clock.now() < 15.0:
                bench.clock.sleep(0.05)
                source.renew_hold()
        source.ramp_to(2.5, 0.4)
        assert bench.report().end_v == pytest.approx(2.5, abs=1e-3)


def test_a_held_level_is_at_rest_by_itself_before_a_slow_wire_has_sent_a_ramp() -> None:
    with slow() as (source, bench, library):
        source.ramp_to(4.0, 0.4)
        begin_s = bench.clock.now()
        library.reply_s = 0.6
        source.stop()
        source.ramp_to(2.5, 0.4)
        t = np.arange(begin_s, bench.clock.now(), 1e-3)
        at_rest_s = t[np.abs(bench.history.volts(t) - 2.5) > 0.01][-1] - begin_s
        assert 5.0 < at_rest_s < 5.5


def test_a_drive_from_a_level_that_has_returned_to_rest_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with slow() as (source, bench, _):
        source.ramp_to(4.0, 0.4)
        ending = source._end_hold

        def late() -> None:
            bench.clock.sleep(6.0)
            ending()

        monkeypatch.setattr(source, "_end_hold", late)
        with pytest.raises(InstrumentError, match="the level of 4 V has returned to rest by itself"):
            source.start_drive(Steps((4.0, 3.0, 2.5), 0.5, 0.2))
        monkeypatch.undo()


@pytest.mark.parametrize("reply_s", [0.1, 0.6])
def test_a_drive_is_stopped_without_a_jump_on_a_wire_that_became_slow(reply_s: float) -> None:
    with slow() as (source, bench, library):
        source.start_drive(Sine(40.0, 2.0, 2.5, 800))
        bench.clock.sleep(0.2)
        library.reply_s = reply_s
        source.stop()
        assert source.is_at_rest(2.5, 0.0, 5.0)


@pytest.mark.deep
def test_an_acquisition_that_falls_behind_on_a_slow_wire_does_not_delay_the_release() -> None:
    """The blocks were read until the card's buffer was full; meanwhile the remainder of the drive followed the fade."""
    with slow() as (source, bench, library), acquiring(bench).stream(5000.0, 250):
        source.start_drive(Sine(40.0, 2.0, 2.5, 4000))
        bench.clock.sleep(0.37)
        begin_s = bench.clock.now()
        library.reply_s = 0.1
        source.stop()
        assert bench.clock.now() - begin_s < 15.0
        library.reply_s = 0.0
        assert source.is_at_rest(2.5, 0.0, 5.0)


def test_a_network_on_which_samples_take_their_time_does_not_delay_a_fade_unnoticed() -> None:
    """200 000 samples are 1.6 MB, 0.13 s at 100 Mbit/s: the fade arrived when its samples were already on their way."""
    with slow() as (source, bench, library):
        library.write_s = 0.13
        source.start_drive(Sine(200.0, 2.0, 2.5, 2000))
        bench.clock.sleep(0.37)
        source.stop()
        assert source.is_at_rest(2.5, 0.0, 5.0)


def hold_up(monkeypatch: pytest.MonkeyPatch, bench: SimulatedBench, *pauses_s: float) -> None:
    """Stop the program, as SIGSTOP or a busy computer does, once for each pause: after the card has counted its samples."""
    left, changeable = list(pauses_s), PlaybackProgress.first_changeable

    def first_changeable(progress: PlaybackProgress, samples: int = 1) -> int:
        first = changeable(progress, samples)
        bench.clock.sleep(left.pop(0) if left else 0.0)
        return first

    monkeypatch.setattr(PlaybackProgress, "first_changeable", first_changeable)


@pytest.mark.one_in(1)
@pytest.mark.parametrize("pause_s", [0.3, 1.0, 3.0, 4.5, 6.0])
def test_a_program_that_is_held_up_in_a_renewal_does_not_make_the_output_jump(
    pause_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    with slow() as (source, bench, _):
        source.ramp_to(4.0, 0.4)
        hold_up(monkeypatch, bench, 0.0, pause_s)
        with suppress(InstrumentError):
            while bench.clock.now() < 15.0:
                bench.clock.sleep(0.05)
                source.renew_hold()
        source.ramp_to(2.5, 0.4)
        assert bench.report().end_v == pytest.approx(2.5, abs=1e-3)


def test_a_program_that_is_held_up_in_a_stop_stops_later(monkeypatch: pytest.MonkeyPatch) -> None:
    with slow() as (source, bench, _):
        source.start_drive(Sine(40.0, 2.0, 2.5, 800))
        bench.clock.sleep(0.2)
        hold_up(monkeypatch, bench, 0.5, 0.15)
        source.stop()
        assert source.is_at_rest(2.5, 0.0, 5.0)


def acquiring(bench: SimulatedBench) -> NiDigitizer:
    return NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock)


@pytest.mark.parametrize("card", QUEUES, ids=lambda card: f"{card.usb_requests}x{card.usb_request_bytes}")
@pytest.mark.parametrize("frequency_hz", [40.0, 400.0])
def test_stop_fades_out_however_many_samples_are_on_their_way(card: CardParameters, frequency_hz: float) -> None:
    with live(card) as (source, bench), acquiring(bench).stream(5000.0, 250):
        source.start_drive(Sine(frequency_hz, 2.0, 2.5, round(4 * frequency_hz)))
        bench.clock.sleep(0.2003)
        begin_s = bench.clock.now()
        source.stop()
        assert bench.clock.now() - begin_s < source.predict_rest_s(0.0, 5.0)
        assert source.is_at_rest(2.5, 0.0, 5.0)
        report = bench.report()
        assert_safe_voltage(report)
        assert report.largest_jump_v < 0.01


def test_the_queue_is_drawn_from_the_seed() -> None:
    queues = {
        (queue.requests, queue.request_bytes, queue.adjustable)
        for seed in range(20)
        for queue in [
            SimulatedBench(SimulationParameters(source="ao0", seed=seed), VirtualClock()).card.new_output_queue()
        ]
    }
    assert len(queues) > 8


@pytest.mark.parametrize("card", QUEUES, ids=lambda card: f"{card.usb_requests}x{card.usb_request_bytes}")
def test_way_to_rest_is_predicted_from_the_farthest_level(card: CardParameters) -> None:
    with live(card) as (source, bench), acquiring(bench).stream(5000.0, 250):
        amplifier = HvAmplifier(source, AmplifierMap(), DriveLimits(), bench.clock)
        predicted_s = amplifier.check_way_to_rest()
        amplifier.start_drive(Hold(5.0, 10.0))
        begin_s = bench.clock.now()
        amplifier.return_to_rest()
        assert 0.5 < bench.clock.now() - begin_s < predicted_s < 2.2
        assert_safe_voltage(bench.report())


def test_a_task_is_kept_while_its_output_is_not_measured_at_rest() -> None:
    """The drive's cable to the card is off: the reading contradicts the level, and nothing is released or moved."""
    with live() as (source, bench), acquiring(bench).stream(5000.0, 250):
        source.start_drive(Sine(40.0, 1.0, 2.5, 160))
        bench.clock.sleep(0.2)
        cable = bench.card._history.volts
        bench.card._history.volts = lambda t: np.zeros(np.shape(t))  # type: ignore[method-assign]
        try:
            with pytest.raises(InstrumentError, match=r"should idle at 2\.500 V, but measures .*check the cable"):
                source.stop()
            with pytest.raises(InstrumentError, match="prepare"):
                source.ramp_to(2.5, 0.5)
        finally:
            bench.card._history.volts = cable  # type: ignore[method-assign]
        report = bench.report()
        assert report.largest_jump_v < 0.01
        assert report.end_v == pytest.approx(2.5, abs=1e-3)
        source.reconnect()
        assert source.is_at_rest(2.5, 0.0, 5.0)


@pytest.mark.parametrize("level_v", [4.0, 1.0])
def test_closing_at_a_level_goes_to_rest_first_and_no_drive_begins_elsewhere(level_v: float) -> None:
    with live() as (source, bench):
        source.ramp_to(level_v, 0.4)
        before = bench.report().end_v
        for beginning_v in (level_v - 0.3, level_v + 0.3):
            with pytest.raises(InstrumentError):
                source.start_drive(Sine(40.0, 0.2, beginning_v, 4))
        assert bench.report().end_v == before
    report = bench.report()
    assert report.end_v == pytest.approx(2.5, abs=1e-3)
    assert report.largest_jump_v < 0.05


@pytest.mark.parametrize("off_v", [0.1, -0.1])
def test_an_output_that_is_not_at_rest_after_its_set_up_is_refused(
    off_v: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    with live() as (source, _):
        inside_v = source._readback.inside_v
        monkeypatch.setattr(source._readback, "inside_v", lambda: (inside_v() or 0.0) + off_v)
        with pytest.raises(InstrumentError):
            source.initialize_at_rest(2.5, 0.0, 5.0)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("drive", "served_s"), [(Hold(4.0, 1.0), 5.3), (Hold(1.0, 1.0), 5.3), (Sine(40.0, 1.0, 2.5, 80), 2.0)]
)
def test_the_time_to_rest_without_a_program_is_of_a_server_and_none_of_this_computer(
    drive: Hold | Sine, served_s: float
) -> None:
    with live() as (source, _):
        assert source.unattended_rest_s(drive, 2.5) == math.inf
        source._server = "localhost:1"
        assert source.unattended_rest_s(drive, 2.5) == pytest.approx(served_s)


def test_a_drive_that_plays_on_after_its_stop_is_not_released_although_its_mean_is_the_idle_level(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The samples of the fade were lost on their way: a block shows whole cycles around the idle level."""
    monkeypatch.setattr(OutputTask, "rewrite", lambda *_: True)
    with live() as (source, bench), acquiring(bench).stream(5000.0, 250):
        source.start_drive(Sine(40.0, 1.0, 2.5, 400))
        bench.clock.sleep(0.2)
        with pytest.raises(InstrumentError, match=r"\b2\.500 V\b.*\b1\.\d\d\d to 3\.\d\d\d V"):
            source.stop()
        bench.clock.sleep(10.0)
        report = bench.report()
        assert report.largest_jump_v < 0.05
        assert report.end_v == pytest.approx(2.5, abs=1e-3)


@pytest.mark.parametrize("cable_off_v", [0.0, 0.4], ids=["cable", "cable off"])
def test_a_task_that_was_lost_is_continued_from_its_present_sample_if_the_card_sees_that(
    monkeypatch: pytest.MonkeyPatch, cable_off_v: float
) -> None:
    """The converter is busy with the run's acquisition, so that the level cannot be measured inside the card."""
    with live() as (source, bench), acquiring(bench).stream(5000.0, 250):
        source.start_drive(Sine(0.5, 2.0, 2.5, 5))
        bench.clock.sleep(0.3)

        def lost() -> int:
            raise AcquisitionError("the server does not answer")

        monkeypatch.setattr(source._task, "generated", lost)
        cable = bench.card._history.volts
        monkeypatch.setattr(bench.card._history, "volts", lambda t: cable(t) - cable_off_v)
        source.reconnect()
        monkeypatch.undo()
        stuck_v = bench.report().end_v
        assert stuck_v > 3.0
        if cable_off_v:
            with pytest.raises(InstrumentError, match="prepare"):
                source.ramp_to(2.5, 0.5)
        else:
            assert source.idle_level_v() == pytest.approx(stuck_v, abs=0.02)
            source.ramp_to(2.5, 0.5)
            assert source.is_at_rest(2.5, 0.0, 5.0)
        assert bench.report().largest_jump_v < 0.05


def test_what_is_left_of_a_stopped_drive_does_not_follow_its_fade(monkeypatch: pytest.MonkeyPatch) -> None:
    """A program that dies behind a gRPC server before it releases the task leaves the whole buffer to be played."""
    with live() as (source, bench):
        source.start_drive(Sine(40.0, 2.0, 2.5, 240))
        bench.clock.sleep(0.2)
        monkeypatch.setattr(source, "_await_level", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            source.stop()
        begin_s = bench.clock.now()
        bench.clock.sleep(7.0)
        assert np.abs(bench.history.volts(np.arange(begin_s, bench.clock.now(), 1e-3)) - 2.5).max() < 1e-3


def test_a_level_that_is_not_renewed_returns_to_rest_in_a_line() -> None:
    with live(lease_s=2.0) as (source, bench):
        source.ramp_to(4.5, 0.4)
        held_s = bench.clock.now()
        bench.clock.sleep(1.8)
        assert bench.report().end_v == pytest.approx(4.5, abs=1e-3)
        bench.clock.sleep(0.8)
        report = bench.report()
        assert report.end_v == pytest.approx(2.5, abs=1e-3)
        assert report.steepest_v_per_s < 20.0  # a count between two samples
        assert bench.clock.now() - held_s < 2.0 + 2.0 / 5.0 + 0.3
        assert source.idle_level_v() == pytest.approx(2.5, abs=1e-3)
        assert source.is_at_rest(2.5, 0.0, 5.0)
        assert_safe_voltage(bench.report())


def test_a_level_is_held_as_long_as_it_is_renewed_beyond_one_buffer() -> None:
    with live(lease_s=2.0) as (source, bench):
        source.ramp_to(4.5, 0.4)
        begin_s = bench.clock.now()
        while bench.clock.now() - begin_s < 30.0:  # two buffers
            bench.clock.sleep(0.2)
            source.renew_hold()
        held = bench.history.volts(np.arange(begin_s, bench.clock.now(), 1e-3))
        assert np.abs(held - 4.5).max() < 1e-3
        assert source.idle_level_v() == pytest.approx(4.5)
        source.ramp_to(2.5, 0.4)
        assert source.is_at_rest(2.5, 0.0, 5.0)
        bench.clock.sleep(5.0)
        report = bench.report()
        assert report.end_v == pytest.approx(2.5, abs=1e-3)
        assert_safe_voltage(report)


def test_a_renewal_that_comes_too_late_says_so_and_the_output_is_at_rest() -> None:
    with live(lease_s=2.0) as (source, bench):
        source.ramp_to(4.5, 0.4)
        bench.clock.sleep(2.2)
        with pytest.raises(InstrumentError, match=r"4\.5 V was not renewed for 2 s.*returns to rest by itself"):
            source.renew_hold()
        source.stop()
        assert source.idle_level_v() == pytest.approx(2.5, abs=1e-3)
        assert_safe_voltage(bench.report())


def test_the_bench_renews_what_it_holds_and_a_level_at_rest_needs_none() -> None:
    with live(lease_s=2.0) as (source, bench):
        amplifier = HvAmplifier(source, AmplifierMap(), DriveLimits(), bench.clock)
        for level_v in (4.0, 2.5):
            amplifier.start_drive(Hold(level_v, 10.0))
            for _ in range(40):
                bench.clock.sleep(0.2)
                amplifier.renew_hold()
            assert source.idle_level_v() == pytest.approx(level_v, abs=1e-3)
        amplifier.return_to_rest()
        assert_safe_voltage(bench.report())


def test_the_papers_sweep_fits_in_one_piece() -> None:
    sweep = LinearSweep(25.0, 525.0, 300.0, 2.5, 2.5)
    for card in QUEUES:
        with live(card) as (source, _):
            assert source.reason_unsupported(sweep) == ""
            rate = source._rate_for(sweep)
    assert rate == 250e3
    assert sample_count(sweep, rate) <= MAX_SAMPLES


def test_the_sample_rate_keeps_the_queue_short() -> None:
    slow = Steps((2.5, 3.0, 2.5), 5.0, 0.5)
    assert sample_rate_for(slow) == SAMPLE_RATES_HZ[0]
    assert sample_rate_for(slow, 60e3) == 100e3
    for card in QUEUES[:2]:
        with live(card) as (source, _):
            rate = source._rate_for(slow)
            assert source._queue().samples_at(rate) <= QUEUE_S * rate


LEASE_S = 3.0
"""Longer than a busy computer keeps the program from renewing it."""

PROGRAM = """
import sys, time
from drivers.clock import WallClock
from drivers.nidaq.analog_output import NiAnalogOutput
clock = WallClock()
source = NiAnalogOutput("Dev1", "ao0", clock, server=sys.argv[1], lease_s=float(sys.argv[2]))
source.initialize_at_rest(2.5, 0.0, 5.0)
source.ramp_to(4.5, 0.4)
print("holds", flush=True)
while True:
    time.sleep(0.05)
    source.renew_hold()
"""


@pytest.mark.deep
def test_a_killed_program_leaves_a_level_that_returns_to_rest_by_itself() -> None:
    """SIGKILL of the only process beside the server: nobody is left who could command the output."""
    bench = SimulatedBench(SimulationParameters(source="ao0"), WallClock())
    with ServedBench(bench) as served:
        program = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, served.card.address, str(LEASE_S)], stdout=subprocess.PIPE
        )
        assert program.stdout is not None
        assert program.stdout.readline() == b"holds\n"
        bench.enable_hv()  # the report is of the way from here to rest
        bench.clock.sleep(LEASE_S + 1.0)
        assert bench.report().end_v == pytest.approx(4.5, abs=1e-3)
        program.kill()
        program.wait()
        program.stdout.close()
        killed_s = bench.clock.now()
        bench.clock.sleep(LEASE_S + 0.4 + 0.3)
        after = bench.history.volts(np.arange(killed_s, bench.clock.now() - 0.01, 1e-3))
        at_rest = np.flatnonzero(np.abs(after - 2.5) > 0.01)[-1] * 1e-3
        assert at_rest < LEASE_S + 0.4 + 0.1
        assert after[-1] == pytest.approx(2.5, abs=1e-3)
        assert np.abs(np.diff(after)).max() < 0.05
        assert math.isfinite(at_rest)
