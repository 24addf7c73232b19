"""Digitizer contract tests: checks the blocks of any digitizer driver against the simulated bench.

They need a fixture `device_under_test` that yields a digitizer of two channels (drive and displacement) and its bench. `python -m
sim_hardware.testing --digitizer module:factory` runs them on any driver.
"""

from collections import deque
from itertools import pairwise

import numpy as np
import pytest

from drivers import AcquisitionError, BenchError, Digitizer
from sim_hardware.bench import SimulatedBench
from sim_hardware.nidaq import convert_interval_s

DigitizerUnderTest = tuple[Digitizer, SimulatedBench]


def test_blocks_are_gapless_int16_of_both_channels(device_under_test: DigitizerUnderTest) -> None:
    card, _ = device_under_test
    with card.stream(5000.0, 250) as stream:
        blocks = [stream.read() for _ in range(8)]
    assert stream.rate_hz == pytest.approx(5000.0, rel=1e-6)
    for block in blocks:
        assert block.raw.dtype == np.int16
        assert block.raw.shape == (2, 250)
    assert blocks[0].start == 0
    assert all(b.start == a.stop for a, b in pairwise(blocks))


def test_block_is_not_overwritten_by_the_next_one(device_under_test: DigitizerUnderTest) -> None:
    card, _ = device_under_test
    with card.stream(5000.0, 100) as stream:
        first = stream.read()
        kept = first.raw.copy()
        stream.read()
    assert np.array_equal(first.raw, kept)


def test_scale_converts_counts_to_true_volts(device_under_test: DigitizerUnderTest) -> None:
    """The amplifier is not driven: its input is pulled to 0 V, the laser is at its zero."""
    card, bench = device_under_test
    with card.stream(5000.0, 1000) as stream:
        block = stream.read()
        volts = [scale.to_volts(raw) for scale, raw in zip(stream.scales, block.raw, strict=True)]
    for channel in volts:
        assert channel.mean() == pytest.approx(0.0, abs=2e-4)
    assert volts[0].std() == pytest.approx(bench.parameters.card.noise_v, rel=0.2)


def test_scale_reports_conversion_skew_of_each_channel(device_under_test: DigitizerUnderTest) -> None:
    """A card with one converter converts the channels of a scan in turn; an unreported skew is a phase error."""
    card, bench = device_under_test
    for rate_hz in (5000.0, 0.4 * bench.parameters.card.max_rate_hz):
        with card.stream(rate_hz, 1000) as stream:
            fits_s = convert_interval_s(bench.parameters.card, stream.rate_hz, channels=2)
            assert [scale.skew_s for scale in stream.scales] == pytest.approx([0.0, fits_s])


def test_stream_reports_time_of_first_scan(device_under_test: DigitizerUnderTest) -> None:
    card, bench = device_under_test
    before = bench.clock.now()
    with card.stream(5000.0, 100) as stream:
        assert before <= stream.start_time_s <= bench.clock.now()


def test_stream_can_be_restarted(device_under_test: DigitizerUnderTest) -> None:
    card, _ = device_under_test
    for _ in range(3):
        with card.stream(2000.0, 50) as stream:
            assert stream.read().start == 0


def test_second_simultaneous_stream_is_rejected(device_under_test: DigitizerUnderTest) -> None:
    card, _ = device_under_test
    with card.stream(2000.0, 50) as stream:
        stream.read()
        with pytest.raises(AcquisitionError, match=r"in use|already"), card.stream(2000.0, 50) as second:
            second.read()


def test_excessive_rate_is_rejected_with_a_remedy(device_under_test: DigitizerUnderTest) -> None:
    card, _ = device_under_test
    with pytest.raises(AcquisitionError, match=r"lower the (sample )?rate"), card.stream(400_000.0, 1000) as stream:
        stream.read()


@pytest.mark.parametrize("fault", ["card-unplugged", "card-overrun"])
def test_lost_scans_and_lost_card_raise_acquisition_error(fault: str, device_under_test: DigitizerUnderTest) -> None:
    card, bench = device_under_test
    with card.stream(5000.0, 250) as stream:
        stream.read()
        bench.inject(fault)
        with pytest.raises(AcquisitionError, match=r"check its (USB )?cable|lost"):
            deque((stream.read() for _ in range(5000)), maxlen=0)  # those on their way come first
    bench.clear(fault)
    with card.stream(5000.0, 250) as stream:
        assert stream.read().start == 0


def test_closed_stream_raises_on_read(device_under_test: DigitizerUnderTest) -> None:
    card, _ = device_under_test
    with card.stream(5000.0, 250) as stream:
        stream.read()
    with pytest.raises(BenchError, match=r"closed|stopped"):
        stream.read()
