"""Sine fit with harmonics: amplitude, phase and frequency of a periodic response.

Sign and phase: a component of order k is `|F_k| sin(2 pi k f t + arg F_k)` with t = 0 at the first sample.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from model import Array, Complex

NYQUIST_SHARE = 0.45
"""Harmonics above this share of the sample rate are not fitted: they cannot be distinguished from aliases."""

CHUNK_SAMPLES = 1 << 16
"""Samples of a basis held in memory at a time."""


@dataclass(frozen=True, slots=True)
class SineFit:
    """Least-squares sine with harmonics, offset and linear drift.

    Attributes:
        frequency_hz: of the fundamental.
        components: complex amplitudes F_1..F_K, (K,), in the unit of the samples.
        offset, drift_per_s: of the straight line underneath, at the middle of the record.
        noise: standard deviation of the residual.
        standard_error: of the modulus of each component (and of its phase times its modulus).
    """

    frequency_hz: float
    components: Complex
    offset: float
    drift_per_s: float
    noise: float
    standard_error: float

    @property
    def fundamental(self) -> complex:
        """Its complex amplitude, in the unit of the samples."""
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
        harmonics: number of components, the fundamental included; fewer where they pass Nyquist.

    Raises:
        ValueError: fewer samples than unknowns.
    """
    orders = max(min(harmonics, int(NYQUIST_SHARE * rate_hz / frequency_hz)), 1)
    unknowns = 2 + 2 * orders
    n = len(samples)
    if n <= unknowns:
        raise ValueError(f"a sine fit with {orders} harmonics needs more than {unknowns} samples, not {n}")
    # The basis is nearly orthogonal over whole cycles, so the normal equations lose nothing.
    gram, moment = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    for part, basis in sine_basis(n, rate_hz, _harmonics_hz(frequency_hz, orders)):
        gram += basis @ basis.T
        moment += basis @ samples[part]
    solution = np.linalg.solve(gram, moment)
    left = 0.0
    for part, basis in sine_basis(n, rate_hz, _harmonics_hz(frequency_hz, orders)):
        residual = samples[part] - solution @ basis
        left += float(residual @ residual)
    noise = float(np.sqrt(left / (n - unknowns)))
    sines, cosines = solution[2::2], solution[3::2]
    return SineFit(
        frequency_hz=frequency_hz,
        components=sines + 1j * cosines,
        offset=float(solution[0]),
        drift_per_s=float(solution[1]) * 2 * rate_hz / (n - 1),  # basis 1 runs from -1 to 1 over n - 1 steps
        noise=noise,
        standard_error=noise * float(np.sqrt(2 / n)),
    )


def fitted_samples(fit: SineFit, count: int, rate_hz: float) -> tuple[Array, Array]:
    """Return the straight line and the periodic waveform of a fit at its samples, (count,) each."""
    line, waveform = np.empty(count), np.empty(count)
    for part, basis in sine_basis(count, rate_hz, _harmonics_hz(fit.frequency_hz, len(fit.components))):
        line[part] = fit.offset + fit.drift_per_s * (count - 1) / (2 * rate_hz) * basis[1]
        waveform[part] = fit.components.real @ basis[2::2] + fit.components.imag @ basis[3::2]
    return line, waveform


def fit_frequency(samples: Array, rate_hz: float, frequency_hz: float) -> float:
    """The frequency of a sine near `frequency_hz` (IEEE Std 1057, four-parameter fit), in hertz.

    The source and the card have clocks of their own, up to 50 ppm apart.
    """
    n = len(samples)
    for _ in range(4):
        amplitude = fit_sine(samples, rate_hz, frequency_hz).fundamental
        s, c = amplitude.real, amplitude.imag
        gram, moment = np.zeros((5, 5)), np.zeros(5)
        for part, basis in sine_basis(n, rate_hz, np.array([frequency_hz])):
            centred = (np.arange(part.start, part.stop) - 0.5 * (n - 1)) / rate_hz
            slope = 2 * np.pi * centred * (s * basis[3] - c * basis[2])
            extended = np.vstack([basis, slope])
            gram += extended @ extended.T
            moment += extended @ samples[part]
        step = float(np.linalg.solve(gram, moment)[4])
        frequency_hz += step
        if abs(step) < 1e-9 * frequency_hz:
            break
    return frequency_hz


def sine_basis(n: int, rate_hz: float, frequencies_hz: Array) -> Iterator[tuple[slice, Array]]:
    """Yield the basis of a fit in pieces, so that a long record at a high rate costs no memory.

    Rows of a piece: 1, t scaled to -1..1 over the whole record, then sin and cos of each frequency.
    """
    step = 2j * np.pi * frequencies_hz / rate_hz
    first = np.exp(np.multiply.outer(step, np.arange(min(n, CHUNK_SAMPLES))))
    for start in range(0, n, CHUNK_SAMPLES):
        part = slice(start, min(start + CHUNK_SAMPLES, n))
        length = part.stop - part.start
        # A later piece is the first one turned on: one multiplication in place of a sine.
        turned = first[:, :length] * np.exp(step * start)[:, np.newaxis]
        basis = np.empty((2 + 2 * len(frequencies_hz), length))
        basis[0] = 1.0
        basis[1] = 2 * np.arange(part.start, part.stop) / (n - 1) - 1
        basis[2::2] = turned.imag
        basis[3::2] = turned.real
        yield part, basis


def _harmonics_hz(frequency_hz: float, orders: int) -> Array:
    return frequency_hz * np.arange(1.0, orders + 1)
