"""Peak of a displacement spectrum or frequency response: the paper's resonance (Sec. IV-1), with error.

The paper filters at 600 Hz, transforms and takes the highest bin in 125..500 Hz. This module differs in three ways:
- A low-pass at 600 Hz does not move a peak below 300 Hz, so none is computed.
- The highest of 10^5 bins is random: the amplifier's second harmonic sweeps at twice the rate and beats with the
  fundamental by 15 % at random phase. Hann-weighted sums over bins remove the beat, and raise all lines equally by 2 %.
- A curve through the lines is fitted: 1 / |H|^2 of a single mode is exactly a polynomial of second degree in f^2, and near almost
any peak a polynomial of third degree. Creep of a share k per natural logarithm of time multiplies it by f^2k.
  The minimum of the product is the peak, accurate to a small fraction of the lines' distance.

A spectrum of the whole record is |H(f)| |X(f)| exactly: the shift of a swept peak, sweep rate over decay rate, belongs to
envelopes in time and does not occur here. The standard error is the polynomial's, scaled by the scatter of the lines about it; it
includes noise and residual ripple, but not the deviation from this curve over the half-power width (0.0005 Hz for the tactor of
the paper with any of its masses and creep up to 3 % a decade; without the factor of creep 0.27 Hz).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from model import Array
from protocols.signals.checks import check_positive, check_samples
from protocols.signals.response import FrequencyResponse
from protocols.signals.spectral_blocks import (
    OVERLAP_CORRELATION,
    BlockAverager,
    band_spectrum,
    fast_length,
    make_block_averager,
)

PEAK_BAND_HZ = (125.0, 500.0)
"""Band in which the paper searches for the peak."""

DEGREE = 3
MIN_LINES = 10
"""Number of lines within the half-power width; 5 unknowns are fitted to them."""

CREEP_EXPONENT = 0.05
"""Prior standard deviation of 2k, from creep of 6 % a decade: narrow peaks do not show it by themselves."""

MOST_DWELL_POINTS = 5
"""Number of points around the peak of a dwell: four for its curve, and one for the error of the curve."""

MIN_BINS_PER_LINE = 8
"""Fewest bins under a line for a Hann window."""


@dataclass(frozen=True, slots=True)
class SpectralPeak:
    """A maximum of a spectrum or of a response.

    Attributes:
        frequency_hz: frequency of the maximum, Hz.
        standard_error_hz: of the frequency.
        degrees_of_freedom: of the standard error.
        height: modulus at the maximum; of a spectrum per hertz and in the unit of the samples, of a response in its unit.
        band_hz: half-power frequencies on both sides, within the search band.
    """

    frequency_hz: float
    standard_error_hz: float
    degrees_of_freedom: float
    height: float
    band_hz: tuple[float, float]


class DwellPeak(NamedTuple):
    """Frequency of a maximum between the points of a dwell, with its standard error."""

    frequency_hz: float
    frequency_error_hz: float


def joined_spectrum_peak(
    displacements: Sequence[ArrayLike],
    rate_hz: float,
    shares_hz: Sequence[tuple[float, float]],
    band_hz: tuple[float, float] = PEAK_BAND_HZ,
    resolution_hz: float = 0.5,
    drives: Sequence[ArrayLike] = (),
) -> SpectralPeak:
    """Return the peak of the displacement's spectrum under a linear sweep in pieces of equal rate and amplitude.

    The energy of a swept displacement per hertz depends only on rate and amplitude, so that the spectra of the pieces, each over
    its own share of the band, form one spectrum. A generator's samples weaken the drive towards higher frequencies, by up to a
    percent: the spectra are divided by those of the recorded drives.

    Args:
        displacements: (N,) each, one piece after the other.
        rate_hz: samples per second.
        shares_hz: the share of the band of each piece, rising and without gaps; every piece reaches a little beyond its own.
        band_hz: band that is searched for the peak.
        resolution_hz: of the lines; taken finer where the peak is narrow.
        drives: recorded drives, (N,) each; none: equal energy at all frequencies.

    Raises:
        ValueError: too short, not finite, or no distinct peak in the band.
    """
    check_positive(rate_hz=rate_hz, resolution_hz=resolution_hz)
    if not (shares_hz and shares_hz[0][0] <= band_hz[0] and band_hz[1] <= shares_hz[-1][1]):
        raise ValueError(f"the sweep does not cover the band {band_hz[0]:g}..{band_hz[1]:g} Hz")
    divisors: Sequence[ArrayLike | None] = drives or [None] * len(shares_hz)
    pieces = [
        _PieceSpectrum(displacement, drive, rate_hz, max(low, band_hz[0]), min(high, band_hz[1]))
        for displacement, drive, (low, high) in zip(displacements, divisors, shares_hz, strict=True)
        if low < band_hz[1] and high > band_hz[0]
    ]
    finest = MIN_BINS_PER_LINE * max(piece.bin_hz for piece in pieces)
    resolution, beyond = max(resolution_hz, finest), len(pieces) > 1
    while True:
        parts = [piece.lines(resolution, beyond) for piece in pieces]
        f, lines = (np.concatenate(values) for values in zip(*parts, strict=True))
        peak = _half_power_lines(f, lines, band_hz, "spectrum of the displacement")
        if peak.stop - peak.start >= 2 * MIN_LINES or resolution / 2 < finest:
            return _fit_peak(f[peak], lines[peak], OVERLAP_CORRELATION)
        resolution /= 2


class _PieceSpectrum:
    """Return the energy spectrum of one piece of a swept displacement over its share of the band."""

    def __init__(
        self, displacement: ArrayLike, drive: ArrayLike | None, rate_hz: float, low_hz: float, high_hz: float
    ) -> None:
        self._samples = check_samples("the displacement", displacement, 256)
        self._drive = None if drive is None else check_samples("the drive", drive, self._samples.size)
        self._rate_hz, self._low_hz, self._high_hz = rate_hz, low_hz, high_hz
        self._n = fast_length(self._samples.size)
        self.bin_hz = rate_hz / self._n

    def lines(self, resolution_hz: float, beyond: bool) -> tuple[Array, Array]:
        """Return frequencies and energies of the lines; `beyond` averages also over the share's edges."""
        low, high = self._low_hz, self._high_hz
        if beyond:
            low, high = max(low - resolution_hz, self.bin_hz), min(high + resolution_hz, self._rate_hz / 2)
        blocks = make_block_averager((low, high), resolution_hz, self.bin_hz, self._rate_hz / 2)
        f, lines = blocks.frequency_hz, self._energies(self._samples, blocks)
        if self._drive is not None:
            lines = lines / self._energies(self._drive, blocks)
        own = (f >= self._low_hz) & (f < self._high_hz) if beyond else np.ones(f.size, bool)
        return f[own], lines[own]

    def _energies(self, samples: Array, blocks: BlockAverager) -> Array:
        """Return the energies of samples in the lines, (count,)."""
        bins = band_spectrum(samples, self._n, blocks)
        power = (bins.real**2 + bins.imag**2) / np.float32(self._rate_hz) ** 2
        return np.asarray(blocks.windows(power) @ blocks.window, float)


def response_peak(response: FrequencyResponse, band_hz: tuple[float, float] = PEAK_BAND_HZ) -> SpectralPeak:
    """Return the peak of |H| in a band: as `joined_spectrum_peak`, but divided by the recorded drive.

    Raises:
        ValueError: no distinct peak in the band, or lines too coarse to fit it.
    """
    part = response.within(*band_hz)
    peak = _half_power_lines(part.x, part.plotted**2, band_hz, "response")
    return _fit_peak(part.x[peak], part.plotted[peak] ** 2, part.correlation)


def _half_power_lines(f: Array, power: Array, band_hz: tuple[float, float], quantity_name: str) -> slice:
    """Return the lines within the half-power width of the largest."""
    band = f"{band_hz[0]:g}..{band_hz[1]:g} Hz"
    if f.size < MIN_LINES:
        raise ValueError(
            f"{band} holds {f.size} lines of the {quantity_name}, at least {MIN_LINES} are needed: widen the band or record longer"
        )
    top = int(power.argmax())
    if not power[top] > 0:
        raise ValueError(f"the {quantity_name} is zero in {band}: check the sensor's cable and the drive")
    below = power < power[top] / 2
    if not below.any():
        raise ValueError(f"no distinct peak in {band}: the {quantity_name} nowhere falls to half of its largest power")
    before, after = np.flatnonzero(below[:top]), np.flatnonzero(below[top:])
    start = int(before[-1]) + 1 if before.size else 0
    stop = top + int(after[0]) if after.size else f.size
    if top - start < 2 or stop - top < 3:
        if stop - start < MIN_LINES and start > 0 and stop < f.size:
            raise ValueError(
                f"the {quantity_name} is largest at {f[top]:.6g} Hz, in a peak only {stop - start} lines wide: "
                "use a finer resolution, or check for a line of the mains"
            )
        raise ValueError(
            f"no peak within {band}: the {quantity_name} is largest at its edge, {f[top]:.6g} Hz; move the band"
        )
    return slice(start, stop)


def _fit_peak(f: Array, power: Array, correlation: float) -> SpectralPeak:
    """Fit log power = -log q(u) - b log f, q of third degree in u = f^2, by Gauss and Newton; the maximum of the fit is the peak."""
    freedom = f.size - DEGREE - 2
    if f.size < MIN_LINES:
        raise ValueError(
            f"only {f.size} lines lie within the peak at {f[power.argmax()]:.6g} Hz, {MIN_LINES} are needed: resolve finer"
        )
    u = f * f
    middle, half = 0.5 * (u[0] + u[-1]), 0.5 * (u[-1] - u[0])
    basis = np.vander((u - middle) / half, DEGREE + 1, increasing=True)
    logarithm = 0.5 * np.log(u / middle)
    inverse = power.max() / power
    q, b = np.linalg.lstsq(basis / inverse[:, None], np.ones(f.size), rcond=None)[0], 0.0
    for _ in range(12):
        curve = basis @ q
        if curve.min() <= 0:
            break
        left = np.log(inverse / curve) - b * logarithm
        prior = float(np.sqrt(left @ left / freedom)) / CREEP_EXPONENT
        jacobian = np.vstack((np.column_stack((basis / curve[:, None], logarithm)), [0.0] * (DEGREE + 1) + [prior]))
        step = np.linalg.lstsq(jacobian, np.append(left, -prior * b), rcond=None)[0]
        q, b = q + step[:-1], b + float(step[-1])
        if np.abs(step).max() < 1e-12 * np.abs(q).max():
            break
    curve = basis @ q
    polynomial, below = np.polynomial.Polynomial(q), np.polynomial.Polynomial([middle / half, 1.0])  # u / half
    # d(log q + b/2 log u) / dv = 0: the numerator is a polynomial
    condition = polynomial.deriv() * below + 0.5 * b * polynomial
    bend = condition.deriv()
    inside = [r.real for r in condition.roots() if abs(r.imag) < 1e-9 and abs(r.real) < 1 and bend(r.real) > 0]
    if curve.min() <= 0 or not inside:
        raise ValueError(f"the curve between {f[0]:.6g} and {f[-1]:.6g} Hz has no maximum inside: widen the band")
    v = min(inside, key=lambda r: float(polynomial(r) * below(r) ** (0.5 * b)))
    left = np.log(inverse / curve) - b * logarithm
    # Neighbouring lines share noise: a smooth function of them has (1 + 2 rho) times its variance.
    covariance = np.linalg.inv(jacobian.T @ jacobian) * float(left @ left) / freedom * (1 + 2 * correlation)
    # The condition at v moves with the coefficients: dv = -(d condition) / bend.
    powers = np.arange(DEGREE + 1)
    rising = powers * v ** np.maximum(powers - 1, 0) * below(v) + 0.5 * b * v**powers
    gradient = -np.append(rising, 0.5 * polynomial(v)) / bend(v)
    error_v = float(np.sqrt(gradient @ covariance @ gradient))
    frequency = float(np.sqrt(middle + half * v))
    height = power.max() / polynomial(v) * (frequency / np.sqrt(middle)) ** -b
    return SpectralPeak(
        frequency_hz=frequency,
        standard_error_hz=error_v * half / (2 * frequency),
        degrees_of_freedom=freedom / (1 + 2 * correlation**2),
        height=float(np.sqrt(height)),
        band_hz=(float(f[0]), float(f[-1])),
    )


def dwell_peak(f: Array, y: Array, errors: Array) -> DwellPeak | None:
    """Return the resonance through the four highest amplitudes around the highest of a dwell; None if the highest is at an end.

    For a single resonance 1 / y^2 is a parabola over f^2; its third degree takes up the other modes (without it the frequency is
    0.001 to 0.01 Hz too high for points 20 Hz apart). The errors combine the errors of the points and the change by a fifth point, or,
    without one, the change to the curve through one point less; of three points to the paper's parabola of y over f.

    Args:
        f: frequencies in any order, Hz; (N,), as the others.
        y: amplitudes.
        errors: standard errors of the amplitudes.
    """
    f, index = np.unique(f, return_index=True)
    y, errors = y[index], errors[index]
    top = int(y.argmax()) if y.size else 0
    if not 0 < top < y.size - 1:
        return None
    used = [top - 1, top, top + 1]
    while len(used) < min(y.size, MOST_DWELL_POINTS):
        used.append(max((i for i in (min(used) - 1, max(used) + 1) if 0 <= i < y.size), key=lambda i: float(y[i])))
    f, y, errors = f[used], y[used], errors[used]
    curves = [count for count in range(3, len(used) + 1) if math.isfinite(_vertex(f[:count] ** 2, y[:count] ** -2))]
    if 3 not in curves:
        return None
    main = 4 if 4 in curves else 3
    other = next((count for count in (main + 1, main - 1) if count in curves), 0)

    def vertices(heights: Array) -> Array:
        """Return the frequency of the maximum, and its change by the other curve."""
        centre, changed = (
            math.sqrt(_vertex(f[:count] ** 2, heights[:count] ** -2)) if count else _vertex(f[:3], -heights[:3])
            for count in (main, other)
        )
        return np.array([centre, changed - centre])

    centre, change = vertices(y)
    moved = np.array([vertices(y + 1e-3 * step) - (centre, change) for step in np.diag(errors)]) / 1e-3
    noise, of_change = np.linalg.norm(moved, axis=0)
    return DwellPeak(float(centre), float(np.sqrt(noise**2 + max(change**2 - of_change**2, 0.0))))


def _vertex(x: Array, y: Array) -> float:
    """Return the minimum of the polynomial through all points that is nearest to the first three's middle one; NaN without one."""
    slope = np.polynomial.Polynomial.fit(x, y, x.size - 1).deriv()
    slope = slope.trim(1e-8 * float(np.abs(slope.coef).max()))  # a degree that is only rounding spoils the roots
    bend = slope.deriv()
    level = (roots := np.asarray(slope.roots(), complex)).real[np.abs(roots.imag) < 1e-9 * np.abs(roots)]
    minima = level[(bend(level) > 0) & (x[0] < level) & (level < x[2])].tolist()
    return min(minima, key=lambda r: float(abs(r - x[1])), default=math.nan)
