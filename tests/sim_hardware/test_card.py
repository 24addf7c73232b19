"""Simulated card: a sample depends on plant, history, seed and index only."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.errors import AcquisitionError
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.nidaq.card import SampleRateError, actual_rate, convert_interval_s
from sim_hardware.plant.parameters import CardParameters, SensorParameters, SimulationParameters

PLAY = (
    "OUTP:LOAD INF;:VOLT 5;:VOLT:OFFS 2.5;:BURS:NCYC 100;:TRIG:SOUR BUS;:BURS:STAT ON;:OUTP ON",
    "FREQ 160",
    "*TRG",
)


def playing(truth: SimulationParameters | None = None) -> SimulatedBench:
    bench = SimulatedBench(truth or SimulationParameters(), VirtualClock())
    bench.enable_hv()
    for message in PLAY:
        bench.link().write(message)
    return bench


def samples(bench: SimulatedBench, block: int, scans: int = 3000, rate_hz: float = 5e3) -> np.ndarray:
    with bench.digitizer().stream(rate_hz, block) as stream:
        return np.concatenate([stream.read().raw for _ in range(scans // block)], axis=1)


@pytest.mark.parametrize("block", [pytest.param(1, marks=pytest.mark.deep), 7, 75, 2100])
def test_samples_do_not_depend_on_the_portions(block):
    assert np.array_equal(samples(playing(), block, 2100), samples(playing(), 300, 2100))


def test_the_same_seed_repeats_and_another_does_not():
    one, two, other = (samples(playing(SimulationParameters(seed=s)), 500) for s in (3, 3, 4))
    assert np.array_equal(one, two)
    assert not np.array_equal(one[0], other[0])


def test_two_streams_of_a_run_have_different_noise():
    bench = playing()
    bench.clock.sleep(2.0)  # the burst is over: noise alone
    assert not np.array_equal(samples(bench, 500)[0], samples(bench, 500)[0])


def test_counts_scale_back_to_the_volts_that_went_in():
    card = SimulatedBench(SimulationParameters(), VirtualClock()).card
    volts = np.linspace(-10, 10, 4001)
    assert np.abs(card.scale.to_volts(card.quantize(volts)) - volts).max() < 0.6 * 3.2054e-4
    assert card.scale.is_clipped(card.quantize(np.array([-11.0, 0.0, 11.0]))).tolist() == [True, False, True]


def test_noise_has_the_declared_strength():
    truth = SimulationParameters(card=CardParameters(noise_v=5e-3), sensor=SensorParameters(noise_m=1e-6))
    bench = SimulatedBench(truth, VirtualClock())
    volts = bench.card.scale.to_volts(samples(bench, 5000, 20_000))
    assert volts[0].std() == pytest.approx(5e-3, rel=0.03)
    assert volts[1].std() == pytest.approx(np.hypot(5e-3, 1e-2), rel=0.03)


def test_displacement_comes_late_by_the_sensors_delay():
    quiet = SimulationParameters(card=CardParameters(noise_v=0), sensor=SensorParameters(noise_m=0, delay_s=0))
    prompt = samples(playing(quiet), 500)[1]
    late = samples(playing(replace(quiet, sensor=SensorParameters(noise_m=0, delay_s=2e-3))), 500)[1]
    assert np.array_equal(late[10:], prompt[:-10])  # 2 ms at 5 kS/s


def test_beyond_its_range_the_sensor_shows_its_voltage_for_it():
    bench = playing(SimulationParameters(sensor=SensorParameters(range_m=2e-4, invalid_v=9.0)))
    volts = bench.card.scale.to_volts(samples(bench, 500)[1])
    assert np.count_nonzero(np.abs(volts - 9.0) < 0.01) > 100
    assert np.abs(volts[np.abs(volts - 9.0) > 0.1]).max() < 2.01


def test_out_of_range_fault_touches_only_samples_of_its_time():
    bench = playing()
    with bench.digitizer().stream(5e3, 500) as stream:
        bench.clock.sleep(0.1)
        bench.inject("sensor-out-of-range")  # the first 500 samples were taken before, but are read after
        bench.clock.sleep(0.1)
        bench.clear("sensor-out-of-range")
        volts = np.concatenate([bench.card.scale.to_volts(stream.read().raw[1]) for _ in range(3)])
    broken = np.abs(volts - 10.3) < 0.05
    assert not broken[:500].any()
    assert broken[501:1000].all()
    assert not broken[1001:].any()


def test_channels_may_be_skewed():
    sensor = SensorParameters(noise_m=0, delay_s=0)
    truth = SimulationParameters(card=CardParameters(noise_v=0, convert_s=1e-4), sensor=sensor)
    straight = SimulationParameters(card=CardParameters(noise_v=0, convert_s=0.0), sensor=sensor)
    skewed = samples(playing(truth), 1000, 1000, rate_hz=5e3)
    plain = samples(playing(straight), 2000, 2000, rate_hz=10e3)
    assert np.array_equal(skewed[1], plain[1, 1::2])  # 100 us is half a scan at 5 kS/s
    assert np.array_equal(skewed[0], plain[0, ::2])


def test_conversion_interval_shrinks_to_fit_the_scan():
    truth = CardParameters()
    assert convert_interval_s(truth, 5e3, 2) == 12e-6
    assert convert_interval_s(truth, 250e3, 2) == pytest.approx(2e-6)
    assert convert_interval_s(CardParameters(convert_s=0.0), 250e3, 2) == 0


@pytest.mark.parametrize(("asked", "got"), [(5e3, 5e3), (44_100, 100e6 / 2267), (3e3, 100e6 / 33333), (250e3, 250e3)])
def test_the_divider_makes_the_next_higher_rate(asked, got):
    assert actual_rate(CardParameters(), asked, 2) == pytest.approx(got, rel=1e-12)


@pytest.mark.parametrize("rate_hz", [250_001, 6e5, 0, -5])
def test_too_fast_for_two_channels_is_refused(rate_hz):
    with pytest.raises(SampleRateError):
        actual_rate(CardParameters(), rate_hz, 2)


def test_digitizer_reads_gapless_blocks_and_moves_the_clock_as_far_as_it_must(bench):
    with bench.digitizer().stream(5e3, 250) as stream:
        starts = [stream.read().start for _ in range(4)]
        assert starts == [0, 250, 500, 750]
        assert bench.clock.now() == pytest.approx(0.2, abs=2e-3)


def test_reading_too_late_loses_samples_and_says_so(bench):
    with bench.digitizer(buffer_s=1.0).stream(5e3, 250) as stream:
        stream.read()
        bench.clock.sleep(1.0)
        stream.read()
        bench.clock.sleep(1.2)
        with pytest.raises(AcquisitionError, match="overwritten"):
            stream.read()


def test_every_input_goes_on_after_scans_were_lost(bench):
    with bench.digitizer(terminals=("ai0", "ai1", "ai2")).stream(5e3, 100) as stream:
        assert len(stream.read().raw) == 3
        stream.restart()
        assert len(stream.read().raw) == 3


def test_card_faults_are_sentences(bench):
    card = bench.digitizer()
    with pytest.raises(AcquisitionError, match=r"\b300000\b.*; lower the sample rate$"):
        card.stream(300e3, 100)
    with card.stream(5e3, 100) as stream:
        with pytest.raises(AcquisitionError, match="already acquiring"):
            card.stream(5e3, 100)
        bench.inject("card-overrun")
        with pytest.raises(AcquisitionError, match="lost samples: they were read too late"):
            stream.read()
        bench.clear()
        bench.inject("card-unplugged")
        with pytest.raises(AcquisitionError, match="does not answer any more; check its USB cable"):
            stream.read()
    with pytest.raises(AcquisitionError, match="does not answer; check its USB cable"):
        card.stream(5e3, 100)
    bench.clear()
    card.stream(5e3, 100).read()
    card.close()
