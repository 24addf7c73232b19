"""Sine fit with harmonics: amplitude, phase and frequency of a periodic response.

Sign and phase: a component of order k is `|F_k| sin(2 pi k f t + arg F_k)` with t = 0 at the first sample.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from model import Array, Complex

NYQUIST_SHARE = 0.45
"""Largest frequency of a fitted harmonic as a share of the sample rate: higher ones cannot be distinguished from aliases."""

CHUNK_SAMPLES = 1 << 16
"""Number of samples of a basis held in memory at a time."""
BLOCK_SAMPLES = 1 << 11
"""Number of samples whose sines share one table, which stays in the processor's cache."""
SMALL_ANGLE = 1e-3
"""Angle of a whole record, in radians, below which a sum of cosines is computed from the first terms of its series."""
MIN_MISFIT_SHARE = 1e-10
"""Smallest misfit as a share of the energy of the samples; a smaller one is lost by rounding in the difference of energies."""


@dataclass(frozen=True, slots=True)
class LineFit:
    """Least-squares spectral lines with offset and linear drift.

    Attributes:
        frequencies_hz: (J,).
        components: complex amplitudes, (J,), in the unit of the samples.
        offset, drift_per_s: value at the middle of the record and slope of the straight line.
        misfit: sum of the squared residuals.
    """

    frequencies_hz: Array
    components: Complex
    offset: float
    drift_per_s: float
    misfit: float


@dataclass(frozen=True, slots=True)
class SineFit(LineFit):
    """Least-squares sine with harmonics, F_1..F_K, offset and linear drift.

    Attributes:
        noise: standard deviation of the residual.
        standard_error: standard error of the modulus of each component (and of its phase times its modulus).
    """

    noise: float
    standard_error: float

    @property
    def frequency_hz(self) -> float:
        """Frequency of the fundamental."""
        return float(self.frequencies_hz[0])

    @property
    def fundamental(self) -> complex:
        """Complex amplitude of the fundamental, in the unit of the samples."""
        return complex(self.components[0])

    @property
    def thd(self) -> float:
        """Total harmonic distortion: rms of the harmonics over the fundamental."""
        return float(np.linalg.norm(self.components[1:]) / abs(self.components[0]))


def fit_sine(samples: Array, rate_hz: float, frequency_hz: float, harmonics: int = 1) -> SineFit:
    """Fit a sine of known frequency (IEEE Std 1057, three-parameter fit, with drift and harmonics added).

    Args:
        samples: (N,), evenly spaced.
        rate_hz: samples per second.
        frequency_hz: of the fundamental.
        harmonics: number of components, the fundamental included; fewer if they exceed the Nyquist frequency.

    Raises:
        ValueError: fewer samples than unknowns.
    """
    orders = max(min(harmonics, int(NYQUIST_SHARE * rate_hz / frequency_hz)), 1)
    unknowns = 2 + 2 * orders
    n = len(samples)
    if n <= unknowns:
        raise ValueError(f"a sine fit with {orders} harmonics needs more than {unknowns} samples, not {n}")
    lines = fit_lines(samples, rate_hz, frequency_hz * np.arange(1.0, orders + 1))
    noise = float(np.sqrt(lines.misfit / (n - unknowns)))
    line = lines.offset, lines.drift_per_s
    return SineFit(lines.frequencies_hz, lines.components, *line, lines.misfit, noise, noise * float(np.sqrt(2 / n)))


def fitted_samples(fit: SineFit, count: int, rate_hz: float) -> tuple[Array, Array]:
    """Return the straight line and the periodic waveform of a fit at its samples, (count,) each."""
    waveform = line_samples(fit.components, fit.frequencies_hz, count, rate_hz)
    return _straight_line(fit.offset, fit.drift_per_s, count, rate_hz), waveform


def fit_frequency(samples: Array, rate_hz: float, frequency_hz: float) -> float:
    """Return the frequency of a sine near `frequency_hz` (IEEE Std 1057, four-parameter fit), in hertz.

    The source and the card have clocks of their own, up to 50 ppm apart.
    """
    x = np.ascontiguousarray(samples, float)
    n = x.size
    line, squares = 2 / (n - 1), n * (n * n - 1) / 12
    for _ in range(4):
        omega = np.array([2 * np.pi * frequency_hz / rate_hz])
        moments = _line_moments(x, omega, weighted=True)
        even_gram, odd_gram = _grams(n, omega)
        even, odd = np.linalg.solve(even_gram, moments.even), np.linalg.solve(odd_gram, moments.odd)
        s, c = float(odd[1]), float(even[1])
        # A further column is the derivative by omega, index (s cos - c sin): its sums with the others, its square, and the samples.
        _, slope, curvature = _even_sums(np.append(omega, 2 * omega), n)
        even_mixed = c * np.array([slope[0], 0.5 * slope[1]])
        odd_mixed = -s * np.array([line * curvature[0], 0.5 * slope[1]])
        own = 0.5 * (s * s * (squares - curvature[1]) + c * c * (squares + curvature[1]))
        moment = float((complex(s, c) * moments.weighted[0]).real)
        left = moment - even_mixed @ even - odd_mixed @ odd
        square = (
            own - even_mixed @ np.linalg.solve(even_gram, even_mixed) - odd_mixed @ np.linalg.solve(odd_gram, odd_mixed)
        )
        step = float(left / square) * rate_hz / (2 * np.pi)
        frequency_hz += step
        if abs(step) < 1e-9 * frequency_hz:
            break
    return frequency_hz


def fit_lines(samples: Array, rate_hz: float, frequencies_hz: Array) -> LineFit:
    """Fit sines of known frequencies together.

    Args:
        samples: (N,), evenly spaced.
        rate_hz: samples per second.
        frequencies_hz: (J,), separate and below half the sample rate.
    """
    x = np.ascontiguousarray(samples, float)
    n = x.size
    omega = 2 * np.pi / rate_hz * np.asarray(frequencies_hz, float)
    moments = _line_moments(x, omega)
    even_gram, odd_gram = _grams(n, omega)
    even, odd = np.linalg.solve(even_gram, moments.even), np.linalg.solve(odd_gram, moments.odd)
    # Sine and cosine refer to the middle of the record; t = 0 is at the first sample.
    components = (odd[1:] + 1j * even[1:]) * np.exp(-0.5j * (n - 1) * omega)
    fit = LineFit(
        np.asarray(frequencies_hz, float), components, float(even[0]), float(odd[0]) * 2 * rate_hz / (n - 1), 0.0
    )
    energy = float(x @ x)
    misfit = energy - float(even @ moments.even) - float(odd @ moments.odd)
    if misfit < MIN_MISFIT_SHARE * energy:
        residual = x - line_fit_samples(fit, n, rate_hz)
        misfit = float(residual @ residual)
    return replace(fit, misfit=misfit)


def line_fit_samples(fit: LineFit, count: int, rate_hz: float) -> Array:
    """Return lines, offset and drift of a fit at its samples, (count,)."""
    lines = line_samples(fit.components, fit.frequencies_hz, count, rate_hz)
    lines += _straight_line(fit.offset, fit.drift_per_s, count, rate_hz)
    return lines


def line_samples(components: Complex, frequencies_hz: Array, count: int, rate_hz: float) -> Array:
    """Return the sum of lines at samples, (count,); blocks of samples share one table of sines."""
    omega = 2 * np.pi / rate_hz * frequencies_hz
    length = min(count, BLOCK_SAMPLES)
    table = np.exp(1j * np.multiply.outer(omega, np.arange(length)))
    starts = length * np.arange(-(-count // length))
    turned = components * np.exp(1j * np.multiply.outer(starts, omega))
    blocks = np.hstack([turned.imag, turned.real]) @ np.vstack([table.real, table.imag])
    samples: Array = blocks.reshape(-1)[:count]
    return samples


def _straight_line(offset: float, drift_per_s: float, count: int, rate_hz: float) -> Array:
    """Return a straight line with its offset at the middle of the record."""
    middle = 0.5 * (count - 1)
    return offset + drift_per_s / rate_hz * np.linspace(-middle, middle, count)


class _Moments(NamedTuple):
    """Sums of the samples times the basis, relative to the middle of the record."""

    even: Array
    """(1 + J,): times 1, and cosines."""
    odd: Array
    """(1 + J,): times the straight line from -1 to 1, and sines."""
    weighted: Complex
    """(J,): times the index from the middle and exp(i omega index); empty unless requested."""


def _line_moments(x: Array, omega: Array, weighted: bool = False) -> _Moments:
    """Return the moments of samples (N,) at angular frequencies (J,), in radians a sample, in one pass over the samples.

    Blocks share one table of cosines and sines: the sums of a block are rotated by the phase of its first sample.
    """
    n = x.size
    length = min(n, BLOCK_SAMPLES)
    index = np.arange(length)
    table = np.exp(1j * np.multiply.outer(index, omega))
    lines = np.hstack([table, index[:, None] * table]) if weighted else table
    columns = np.column_stack([np.ones(length), index, lines.real, lines.imag])
    whole = n // length
    sums = x[: whole * length].reshape(whole, length) @ columns
    if rest := n - whole * length:
        sums = np.vstack([sums, x[whole * length :] @ columns[:rest]])
    from_middle = length * np.arange(len(sums)) - 0.5 * (n - 1)
    plain, by_index = sums[:, 0], sums[:, 1]
    waves = sums[:, 2 : 2 + lines.shape[1]] + 1j * sums[:, 2 + lines.shape[1] :]
    turn = np.exp(1j * np.multiply.outer(from_middle, omega))
    moment = (turn * waves[:, : omega.size]).sum(0)
    ramp = (by_index.sum() + from_middle @ plain) * 2 / (n - 1)
    turned = np.empty(0, complex)
    if weighted:
        turned = (turn * (waves[:, omega.size :] + from_middle[:, None] * waves[:, : omega.size])).sum(0)
    return _Moments(np.array([plain.sum(), *moment.real]), np.array([ramp, *moment.imag]), turned)


def _grams(n: int, omega: Array) -> tuple[Array, Array]:
    """Return the Gram matrices (1 + J, 1 + J) of the even and of the odd functions, which are orthogonal to each other."""
    sums, derivatives, _ = _even_sums(omega, n)
    difference, total = (_even_sums(each, n)[0] for each in (omega[:, None] - omega, omega[:, None] + omega))
    even, odd = np.empty((2, 1 + omega.size, 1 + omega.size))
    even[0, 0], odd[0, 0] = n, n * (n + 1) / (3 * (n - 1))
    even[0, 1:] = even[1:, 0] = sums
    odd[0, 1:] = odd[1:, 0] = -derivatives * 2 / (n - 1)
    even[1:, 1:], odd[1:, 1:] = 0.5 * (difference + total), 0.5 * (difference - total)
    return even, odd


def _even_sums(angle: Array, n: int) -> tuple[Array, Array, Array]:
    """Return the sum of cos(angle c) over the n indices c about the middle of a record, and its two derivatives by the angle.

    The sum is a geometric series, sin(n angle / 2) / sin(angle / 2); angles are below 2 pi.
    """
    half = 0.5 * np.where(np.abs(angle) * n < SMALL_ANGLE, 1.0, angle)
    top, bottom = np.sin(n * half), np.sin(half)
    top_slope, bottom_slope = 0.5 * n * np.cos(n * half), 0.5 * np.cos(half)
    value = top / bottom
    slope = (top_slope - value * bottom_slope) / bottom
    curvature = (0.25 * (1 - n * n) * top - 2 * slope * bottom_slope) / bottom
    small = np.abs(angle) * n < SMALL_ANGLE
    squares = n * (n * n - 1) / 12
    return (
        np.where(small, n - 0.5 * squares * angle**2, value),
        np.where(small, -squares * angle, slope),
        np.where(small, -squares, curvature),
    )


def sine_basis(n: int, rate_hz: float, frequencies_hz: Array) -> Iterator[tuple[slice, Array]]:
    """Yield the basis of a fit in pieces, to limit the memory of a long record at a high rate.

    Rows of a piece: 1, t scaled to -1..1 over the whole record, then sin and cos of each frequency.
    """
    step = 2j * np.pi * frequencies_hz / rate_hz
    first = np.exp(np.multiply.outer(step, np.arange(min(n, CHUNK_SAMPLES))))
    for start in range(0, n, CHUNK_SAMPLES):
        part = slice(start, min(start + CHUNK_SAMPLES, n))
        length = part.stop - part.start
        # A later piece is the first one with a rotated phase: one multiplication in place of a sine.
        turned = first[:, :length] * np.exp(step * start)[:, np.newaxis]
        basis = np.empty((2 + 2 * len(frequencies_hz), length))
        basis[0] = 1.0
        basis[1] = 2 * np.arange(part.start, part.stop) / (n - 1) - 1
        basis[2::2] = turned.imag
        basis[3::2] = turned.real
        yield part, basis
