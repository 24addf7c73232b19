"""Spectral block averaging: a long spectrum over overlapping Hann-windowed frequency blocks.

A product of spectra Y X* summed under a Hann window over bins is the cross-correlation of the two records inside a window of
lags. Under a linear sweep this window is a gate: the harmonics of a non-linear amplifier, the offset and the mains arrive at
other lags, seconds away. The block outside the gate shows the noise at the time of the sweep.
"""

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from model import Array

Bin = TypeVar("Bin", bound=np.inexact[Any])

INTERLEAVED_ROWS = 8

POOLED_LINES = 5
"""Number of neighbouring lines with pooled noise."""

OVERLAP_CORRELATION = 1 / 6
"""Correlation of neighbouring lines: Hann blocks that overlap by half."""


@dataclass(frozen=True, slots=True)
class BlockAverager:
    """Hann blocks of `length` bins (even) that overlap by half, over bins `first` .. `first + size`."""

    first: int
    size: int
    length: int
    bin_hz: float

    @property
    def window(self) -> Array:
        """The window, (length,), sum 1."""
        return np.asarray((1 - np.cos(2 * np.pi * np.arange(self.length) / self.length)) / self.length)

    @property
    def count(self) -> int:
        """Number of lines."""
        return max((self.size - self.length) // (self.length // 2) + 1, 0)

    @property
    def frequency_hz(self) -> Array:
        """(count,), the lines' frequencies; the window is symmetric about its bin length / 2."""
        return np.asarray((self.first + self.length // 2 * (1 + np.arange(self.count))) * self.bin_hz)

    def windows(self, bins: NDArray[Bin]) -> NDArray[Bin]:
        """(count, length) view of the bins `first` .. `first + size`."""
        return sliding_window_view(bins, self.length)[:: self.length // 2]


def band_spectrum(samples: Array, n: int, blocks: BlockAverager, taper_samples: int = 0) -> NDArray[np.complex64]:
    """Return the blocks' bins of the spectrum of the samples without their mean, padded with zeros to n = `fast_length`; (size,).

    The first and last `taper_samples` samples are faded in and out by half a cosine.

    Every eighth sample is a row; the rows' spectra fit the processor's cache, and only the used bins are combined from them (the
    first step of any fast transform): two thirds of the time of a complete transform. Single precision: its rounding, 3e-7 of the
    largest bin, is far below half a count of a 16-bit converter.
    """
    from scipy.fft import rfft

    x = np.zeros(n, np.float32)
    np.subtract(samples, samples.mean(), out=x[: samples.size], casting="same_kind")
    if taper_samples:
        edge = 0.5 - 0.5 * np.cos(np.pi * (np.arange(taper_samples) + 0.5) / taper_samples)
        x[:taper_samples] *= edge
        x[samples.size - taper_samples : samples.size] *= edge[::-1]
    rows = rfft(np.ascontiguousarray(x.reshape(-1, INTERLEAVED_ROWS).T))
    period, start, stop = n // INTERLEAVED_ROWS, blocks.first, blocks.first + blocks.size
    turn = np.exp(-2j * np.pi / n * np.arange(start, stop)).astype(np.complex64)
    whole = np.empty(blocks.size, np.complex64)
    while start < stop:
        q = start % period  # a row's spectrum continues periodically with its mirror image
        if q <= period // 2:
            end = min(stop, start + period // 2 - q + 1)
            part = rows[:, q : q + end - start]
        else:
            end = min(stop, start + period - q)
            part = rows[:, period - q - (end - start) + 1 : period - q + 1][:, ::-1].conj()
        piece = slice(start - blocks.first, end - blocks.first)
        total = part[-1].copy()
        for row in part[-2::-1]:
            total *= turn[piece]
            total += row
        whole[piece] = total
        start = end
    return whole


def fast_length(size: int) -> int:
    """Return a length of at least `size` with a fast transform by `band_spectrum`."""
    from scipy.fft import next_fast_len

    return INTERLEAVED_ROWS * int(next_fast_len(-(-size // INTERLEAVED_ROWS), real=True))


def make_block_averager(
    band_hz: tuple[float, float], resolution_hz: float, bin_hz: float, nyquist_hz: float
) -> BlockAverager:
    """Return blocks of `resolution_hz` within a band.

    Raises:
        ValueError: the band is empty, negative, or beyond half the sample rate.
    """
    low, high = band_hz
    if not 0 <= low < high <= nyquist_hz:
        raise ValueError(
            f"the band {low:g}..{high:g} Hz must rise and lie within 0..{nyquist_hz:g} Hz, half the sample rate"
        )
    first, last = int(np.ceil(low / bin_hz)), int(np.floor(high / bin_hz))
    length = max(2 * round(resolution_hz / bin_hz / 2), 2)
    return BlockAverager(first, last - first + 1, length, bin_hz)


def pool_lines(noise: Array, count: int) -> Array:
    """Return the mean of each line and its neighbours, (F,); at the ends over fewer lines."""
    pool = np.ones(count)
    return np.asarray(np.convolve(noise, pool, "same") / np.convolve(np.ones(noise.size), pool, "same"))
