"""Band of a long spectrum, against numpy's transform of the whole record."""

import numpy as np
import pytest

from protocols.signals.spectral_blocks import band_spectrum, fast_length, make_block_averager


@pytest.mark.one_in(1)
@pytest.mark.parametrize("size", [1000, 4096, 29_999, 99_997])
@pytest.mark.parametrize("band", [(0.0, 2500.0), (25.0, 525.0), (1200.0, 2400.0)])
def test_a_band_in_rows_is_the_band_of_the_whole(size: int, band: tuple[float, float]) -> None:
    x = 3 + np.random.default_rng(1).standard_normal(size)
    n = fast_length(size)
    assert n >= size
    blocks = make_block_averager(band, 10.0, 5000.0 / n, 2500.0)
    whole = np.fft.rfft(x - x.mean(), n)[blocks.first : blocks.first + blocks.size]
    assert np.abs(band_spectrum(x, n, blocks) - whole).max() < 2e-6 * np.abs(whole).max()


def test_faded_ends_are_faded() -> None:
    x, n = np.random.default_rng(2).standard_normal(2000), fast_length(2000)
    blocks = make_block_averager((0.0, 2500.0), 10.0, 5000.0 / n, 2500.0)
    edge = np.sin(np.pi * (np.arange(300) + 0.5) / 600) ** 2
    by_hand = (x - x.mean()) * np.concatenate((edge, np.ones(1400), edge[::-1]))
    assert np.abs(band_spectrum(x, n, blocks, 300) - np.fft.rfft(by_hand, n)).max() < 1e-4
