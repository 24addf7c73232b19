"""Analogue output of the card: hazards that a generator does not have, and how the driver prevents them."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from app.config.bench_file import BenchConfig
from app.session.instruments import source_options
from drivers.bench.drive_limits import HvAmplifier
from drivers.bench.rest import drive_voltage
from drivers.drive_shapes import LinearSweep, Sine, Steps
from drivers.errors import InstrumentError
from drivers.nidaq.analog_input import NiDigitizer
from drivers.nidaq.analog_output import NiAnalogOutput
from drivers.nidaq.output_readback import OutputReadback
from drivers.nidaq.output_task import PlaybackProgress
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.nidaq.analog_output import VOLTS_PER_COUNT
from sim_hardware.nidaq.task import SimulatedNiDevice
from sim_hardware.plant.parameters import CardParameters, SimulationParameters
from sim_hardware.plant.segments import ConstantSegment
from tests.helpers.simulated_bench import assert_safe_voltage, installed
from tests.wires.ni_library import NiLibrary


@pytest.fixture
def bench() -> SimulatedBench:
    return SimulatedBench(
        SimulationParameters(source="ao0", card=CardParameters(traits="start-route=present")), VirtualClock()
    )


@pytest.fixture(autouse=True)
def library(bench: SimulatedBench) -> Iterator[NiLibrary]:
    library = NiLibrary(SimulatedNiDevice(bench.card, bench.clock, bench.faults))
    with installed(library):
        yield library


def output(bench: SimulatedBench, **options) -> NiAnalogOutput:
    return NiAnalogOutput("Dev1", "ao0", bench.clock, **options)


def live(bench: SimulatedBench, **options) -> NiAnalogOutput:
    source = output(bench, **options)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    bench.enable_hv()
    return source


def test_what_another_program_left_is_measured_and_left_along_a_line(bench: SimulatedBench) -> None:
    bench.card.outputs[0].hold(3.1)
    bench.enable_hv()
    source = output(bench)
    assert source.idle_level_v() == pytest.approx(3.1, abs=2e-3)
    assert not source.is_at_rest(2.5, 0.0, 5.0)
    source.ramp_to(2.5, 0.2)
    assert source.is_at_rest(2.5, 0.0, 5.0)
    report = bench.report()
    assert report.largest_jump_v < 0.01
    assert report.steepest_v_per_s < 50


def test_a_level_that_cannot_be_measured_is_not_guessed(bench: SimulatedBench) -> None:
    """The converter is busy with the run's own acquisition: only `prepare`, with high voltage off, may set the output."""
    with NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock).stream(5000.0, 250):
        source = output(bench)
        assert not source.is_at_rest(2.5, 0.0, 5.0)
        with pytest.raises(InstrumentError, match="its level is not known; prepare it with high voltage disabled"):
            source.ramp_to(2.5, 0.1)
        source.initialize_at_rest(2.5, 0.0, 5.0)
        assert source.is_at_rest(2.5, 0.0, 5.0)


def test_a_killed_program_leaves_a_sample_and_its_watchdog_takes_it_from_there(
    bench: SimulatedBench, library: NiLibrary
) -> None:
    source = live(bench)
    with NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock).stream(5000.0, 250):
        source.start_drive(Sine(2.0, 2.0, 2.5, 200))
        bench.clock.sleep(0.2)
        library.end_process()
        stuck_v = bench.report().end_v
        assert abs(stuck_v - 2.5) > 0.5
        config = BenchConfig.model_validate({"source": {"kind": "card-output"}})
        again = NiAnalogOutput(clock=bench.clock, **source_options(config, 1.0))
        HvAmplifier(again, config.amplifier.amplifier_map, config.amplifier.drive_limits, bench.clock).force_rest()
    assert again.is_at_rest(2.5, 0.0, 5.0)
    assert_safe_voltage(bench.report())
    source.close()  # what a killed program cannot do; its task is gone all the same
    again.close()


def test_the_last_act_is_rest_written_without_a_clock(bench: SimulatedBench) -> None:
    source = live(bench)
    source.start_drive(Sine(40.0, 2.0, 2.5, 2000))
    bench.clock.sleep(0.2)
    source.close()
    last = bench.history.entries()[-1].segment
    assert isinstance(last, ConstantSegment)
    assert last.level_v == pytest.approx(2.5, abs=VOLTS_PER_COUNT)
    assert_safe_voltage(bench.report())


def test_stopping_later_than_the_card_has_fetched_would_jump(
    bench: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The simulated card does what the margin is there for: samples in its own memory are played whatever is written."""
    monkeypatch.setattr(PlaybackProgress, "reaches", lambda *_: True)
    source = live(bench, margin_s=-0.1)
    source.start_drive(Sine(40.0, 2.5, 2.5, 2000))
    bench.clock.sleep(0.2003)
    source.stop()
    source.close()
    assert bench.report().largest_jump_v > 0.05


@pytest.mark.parametrize(
    "drive",
    [
        LinearSweep(20.0, 60.0, 0.5, 2.5, 2.5),
        Steps((2.5, 3.5, 1.5, 2.5), 0.05, 0.02),
    ],
    ids=lambda drive: drive.kind,
)
def test_any_drive_is_played_and_ends_by_itself(drive, bench: SimulatedBench) -> None:
    source = live(bench)
    source.start_drive(drive)
    bench.clock.sleep(drive.duration_s + 0.1)
    report = bench.report()
    assert report.highest_v == pytest.approx(drive.high_v, abs=0.01)
    assert report.lowest_v == pytest.approx(drive.low_v, abs=0.01)
    assert report.ends_at_rest
    assert source.is_at_rest(2.5, 0.0, 5.0)
    assert_safe_voltage(report)


def test_steps_that_are_stopped_stay_at_their_level_until_they_are_moved(bench: SimulatedBench) -> None:
    source = live(bench)
    source.start_drive(Steps((2.5, 4.0, 2.5), 4.0, 0.1))
    bench.clock.sleep(4.5)
    source.stop()
    assert source.idle_level_v() == pytest.approx(4.0, abs=1e-3)
    source.ramp_to(2.5, 0.3)
    assert_safe_voltage(bench.report())


def phases(bench: SimulatedBench, source: NiAnalogOutput, plays: int) -> list[float]:
    """Phase of each of some equal sines on the grid of the scans of one acquisition, in turns."""
    seen = []
    with NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock).stream(5000.0, 100) as stream:
        for k in range(plays):
            source.start_drive(Sine(40.0, 1.0, 2.5, 20))
            bench.clock.sleep(0.8 + 0.0017 * k)
            assert source.is_at_rest(2.5, 0.0, 5.0)
        count = int((bench.clock.now() - stream.start_time_s) * stream.rate_hz) // 100
        volts = np.concatenate([drive_voltage(stream.read(), stream.scales) for _ in range(count)])
    loud = np.abs(volts - 2.5) > 0.01
    begins = [i for i in np.flatnonzero(loud) if not loud[max(i - 500, 0) : i].any()]
    for i in begins:
        t = np.arange(i + 125, i + 1375) / stream.rate_hz
        tone = np.sum((volts[i + 125 : i + 1375] - 2.5) * np.exp(-2j * np.pi * 40.0 * t))
        seen.append(float(np.angle(tone) / (2 * np.pi) * 125) % 1.0)  # in scans: 125 to the cycle
    return seen


def test_started_by_a_scan_the_phase_is_the_same_each_time(bench: SimulatedBench) -> None:
    source = live(bench, start_trigger="ai/SampleClock")
    fractions = np.array(phases(bench, source, 4))
    assert fractions.size == 4
    spread = np.abs((fractions - fractions[0] + 0.5) % 1.0 - 0.5)
    assert spread.max() < 0.02  # of a scan: 4 us, the noise of the fit
    source.close()


def test_started_freely_the_phase_falls_anywhere_between_two_scans(bench: SimulatedBench) -> None:
    source = live(bench)
    fractions = np.array(phases(bench, source, 4))
    spread = np.abs((fractions - fractions[0] + 0.5) % 1.0 - 0.5)
    assert spread.max() > 0.02
    source.close()


def test_a_trigger_that_never_comes_does_not_keep_us_from_rest(bench: SimulatedBench) -> None:
    source = live(bench, start_trigger="ai/SampleClock")
    source.start_drive(Sine(40.0, 1.0, 2.5, 20))  # no acquisition runs
    assert not source.is_at_rest(2.5, 0.0, 5.0)
    source.stop()
    assert source.is_at_rest(2.5, 0.0, 5.0)
    source.ramp_to(3.0, 0.1)
    source.ramp_to(2.5, 0.1)
    assert bench.report().highest_v == pytest.approx(3.0, abs=1e-3)
    source.close()


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("options", "drive", "says"),
    [
        ({"start_trigger": "PFI7"}, Sine(40.0, 1.0, 2.5, 20), "leave start_trigger empty in the bench file"),
        ({}, Sine(5000.0, 0.1, 2.5, 10_000_000), "takes 1000000001 samples, the limit is 80000000; shorten it"),
        ({}, Sine(40.0, 1.0, 3.0, 20), "idles at 2.5000 V where the drive begins at 3.0000 V; nothing was sent"),
    ],
)
def test_what_it_cannot_play_is_a_sentence_and_nothing_moves(options, drive, says, bench: SimulatedBench) -> None:
    source = live(bench, **options)
    with pytest.raises(InstrumentError, match=says):
        source.start_drive(drive)
    bench.clock.sleep(0.1)
    assert bench.report().outside_rest_s == 0
    assert source.is_at_rest(2.5, 0.0, 5.0)
    source.close()


def test_playing_over_a_drive_is_refused(bench: SimulatedBench) -> None:
    source = live(bench)
    source.start_drive(Sine(40.0, 1.0, 2.5, 400))
    with pytest.raises(InstrumentError, match="still plays; stop that first"):
        source.start_drive(Sine(40.0, 1.0, 2.5, 20))
    source.close()
    assert_safe_voltage(bench.report())


def test_an_output_that_is_not_there_is_a_sentence(bench: SimulatedBench) -> None:
    source = NiAnalogOutput("Dev1", "ao7", bench.clock)
    with pytest.raises(InstrumentError, match="output ao7: no such channel on this card; correct it in the bench file"):
        source.initialize_at_rest(2.5, 0.0, 5.0)
    source.close()


def test_more_channels_are_raw_integers_each_with_its_own_scale(bench: SimulatedBench) -> None:
    bench.card.parameters = replace(bench.card.parameters, noise_v=0.0)
    source = live(bench)
    with NiDigitizer("Dev1", ("ai0", "ai1", "ai5"), bench.clock).stream(5000.0, 100) as stream:
        block = stream.read()
    assert block.raw.shape == (3, 100)
    assert len(stream.scales) == 3
    assert stream.scales[0].to_volts(block.raw[0]).mean() == pytest.approx(2.5, abs=1e-3)
    assert stream.scales[2].to_volts(block.raw[2]).mean() == pytest.approx(0.0, abs=1e-3)
    source.close()


@pytest.mark.one_in(1)
@pytest.mark.parametrize(("level_v", "rests"), [(2.5, True), (2.495, True), (2.4, False), (2.6, False), (None, False)])
def test_a_level_that_is_not_known_is_no_rest(bench: SimulatedBench, level_v: float | None, rests: bool) -> None:
    source = live(bench)
    source._level_v = level_v
    assert source.is_left_live(2.5, 0.0, 5.0) is not rests


def test_a_level_is_steady_where_three_readings_agree(bench: SimulatedBench, monkeypatch: pytest.MonkeyPatch) -> None:
    """One reading of a wave, or two, may be any level between its ends."""
    readings, source = iter((3.0, 2.0, 3.0, 2.6, 2.6, 3.0, 2.7, 2.7, 2.7)), live(bench)
    monkeypatch.setattr(OutputReadback, "inside_v", lambda _: next(readings))
    assert source._readback.steady_v(0.0, 5.0) == pytest.approx(2.7)
