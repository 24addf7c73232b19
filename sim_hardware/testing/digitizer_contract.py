"""What every digitizer must do, seen from the blocks it yields and the bench whose volts it samples.

These are tests: they need a fixture `made` that yields a digitizer of two channels (drive and displacement) and the bench
it is wired to. `python -m sim_hardware.testing --digitizer module:factory` runs them on any driver.
"""

from collections import deque
from itertools import pairwise

import numpy as np
import pytest

from drivers.errors import AcquisitionError, BenchError
from drivers.interfaces import Digitizer
from sim_hardware.bench import SimulatedBench

DigitizerUnderTest = tuple[Digitizer, SimulatedBench]


def test_blocks_are_gapless_integers_of_both_channels(made: DigitizerUnderTest) -> None:
    card, _ = made
    with card.stream(5000.0, 250) as stream:
        blocks = [stream.read() for _ in range(8)]
    assert stream.rate_hz == pytest.approx(5000.0, rel=1e-6)
    for block in blocks:
        assert block.raw.dtype == np.int16
        assert block.raw.shape == (2, 250)
    assert blocks[0].start == 0
    assert all(b.start == a.stop for a, b in pairwise(blocks))


def test_a_block_stays_as_it_was_when_the_next_one_comes(made: DigitizerUnderTest) -> None:
    card, _ = made
    with card.stream(5000.0, 100) as stream:
        first = stream.read()
        kept = first.raw.copy()
        stream.read()
    assert np.array_equal(first.raw, kept)


def test_the_scale_gives_the_volts_that_were_there(made: DigitizerUnderTest) -> None:
    """Nothing drives the amplifier: its input is pulled to 0 V, the laser shows its zero."""
    card, bench = made
    with card.stream(5000.0, 1000) as stream:
        block = stream.read()
        volts = [scale.to_volts(raw) for scale, raw in zip(stream.scales, block.raw, strict=True)]
    for channel in volts:
        assert channel.mean() == pytest.approx(0.0, abs=2e-4)
    assert volts[0].std() == pytest.approx(bench.parameters.card.noise_v, rel=0.2)


def test_when_each_channel_is_converted_is_known(made: DigitizerUnderTest) -> None:
    """A card with one converter takes the channels of a scan one after the other; that is a phase, if nobody tells."""
    card, bench = made
    for rate_hz in (5000.0, 200e3):
        with card.stream(rate_hz, 1000) as stream:
            fits_s = min(bench.parameters.card.convert_s, 0.5 / stream.rate_hz)
            assert [scale.skew_s for scale in stream.scales] == pytest.approx([0.0, fits_s])


def test_time_of_the_first_scan_is_known(made: DigitizerUnderTest) -> None:
    card, bench = made
    before = bench.clock.now()
    with card.stream(5000.0, 100) as stream:
        assert before <= stream.start_time_s <= bench.clock.now()


def test_it_can_be_started_again(made: DigitizerUnderTest) -> None:
    card, _ = made
    for _ in range(3):
        with card.stream(2000.0, 50) as stream:
            assert stream.read().start == 0


def test_two_streams_at_once_are_refused(made: DigitizerUnderTest) -> None:
    card, _ = made
    with card.stream(2000.0, 50) as stream:
        stream.read()
        with pytest.raises(AcquisitionError, match=r"in use|already"), card.stream(2000.0, 50) as second:
            second.read()


def test_a_rate_beyond_the_card_is_refused_with_a_remedy(made: DigitizerUnderTest) -> None:
    card, _ = made
    with pytest.raises(AcquisitionError, match=r"lower the (sample )?rate"), card.stream(400_000.0, 1000) as stream:
        stream.read()


@pytest.mark.parametrize("fault", ["card-unplugged", "card-overrun"])
def test_lost_scans_and_a_lost_card_are_sentences_and_not_data(fault: str, made: DigitizerUnderTest) -> None:
    card, bench = made
    with card.stream(5000.0, 250) as stream:
        stream.read()
        bench.inject(fault)
        with pytest.raises(AcquisitionError, match=r"check its (USB )?cable|lost"):
            deque((stream.read() for _ in range(10)), maxlen=0)
    bench.clear(fault)
    with card.stream(5000.0, 250) as stream:
        assert stream.read().start == 0


def test_a_closed_stream_gives_nothing(made: DigitizerUnderTest) -> None:
    card, _ = made
    with card.stream(5000.0, 250) as stream:
        stream.read()
    with pytest.raises(BenchError, match=r"closed|stopped"):
        stream.read()
