"""Hum and other spectral lines of the displacement at rest, and their removal from recordings under a sine.

Lines that the recording resolves from the response are fitted with it and removed. A line at the frequency of the response cannot
be separated from it, as its phase is unknown: its amplitude counts as an uncertainty.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from model import Array, Complex
from protocols.base import InterferenceLine
from protocols.signals.extremes import WAVEFORM_ORDERS
from protocols.signals.sine import NYQUIST_SHARE, fit_lines, line_fit_samples, line_samples, sine_basis

MAINS_HZ = (50.0, 60.0)
"""Mains frequencies; their harmonics are always measured."""

MAX_MAINS_LINE_HZ = 1000.0
MAX_REST_SAMPLES = 1 << 17
MAX_LINES = 16
"""Largest number of lines besides mains harmonics."""

LINE_POWER_RATIO = 20.0
"""Smallest ratio of a line's power to the mean power of the noise in a bin: noise alone reaches it once in some ten thousand
records."""

FREQUENCY_ERROR_SHARE = math.sqrt(3) / math.pi
"""Cramer-Rao bound of a frequency, in units of the inverse duration times the standard error of the amplitude over the amplitude."""

MAX_ZONES = 20
"""Multiples of the sample rate for the true frequency of a folded line."""

SEPARATION_BINS = 1.25
"""Smallest distance of two fitted lines, in units of the inverse duration."""

NEAR_ORDERS = 4
"""Orders on both sides of a line that are fitted with it."""

MAX_FREQUENCY_STEPS = 5
"""Number of Gauss-Newton iterations; two suffice from the largest bin."""

FREQUENCY_TOLERANCE_BINS = 1e-4
"""Step at convergence of a frequency: a hundredth of the standard error of a barely significant line."""


def find_lines(samples: Array, rate_hz: float) -> tuple[InterferenceLine, ...]:
    """Find the spectral lines of the displacement at rest, and the amplitudes of mains harmonics.

    Args:
        samples: (N,), metres, evenly spaced.
        rate_hz: samples per second.

    Returns:
        Lines by amplitude, the largest first, without lines of amplitude 0.
    """
    x = np.asarray(samples[:MAX_REST_SAMPLES], float)
    resolution_hz = rate_hz / x.size
    frequencies_hz: list[float] = []
    left = _without(x, rate_hz, frequencies_hz)
    while len(frequencies_hz) < MAX_LINES and (peak := _largest_peak(left, rate_hz)) is not None:
        if any(abs(peak - f) < SEPARATION_BINS * resolution_hz for f in frequencies_hz):
            break  # a peak with a width is noise, which no sine removes
        frequencies_hz = _refined(x, rate_hz, [*frequencies_hz, peak])
        left = _without(x, rate_hz, frequencies_hz)
    measured = len(frequencies_hz)
    top_hz = min(MAX_MAINS_LINE_HZ, NYQUIST_SHARE * rate_hz)
    for f in sorted({k * mains_hz for mains_hz in MAINS_HZ for k in range(1, int(top_hz / mains_hz) + 1)}):
        if all(abs(f - other) >= SEPARATION_BINS * resolution_hz for other in frequencies_hz):
            frequencies_hz.append(f)
    solution, left = _fit(x, rate_hz, frequencies_hz)
    noise = float(left.std())
    error = noise * math.sqrt(2 / x.size)
    lines = [
        # Noise adds its own power to a line's.
        InterferenceLine(
            f,
            math.sqrt(max(abs(component) ** 2 - 2 * error**2, 0.0)),
            error,
            FREQUENCY_ERROR_SHARE * error / float(abs(component)) * resolution_hz if i < measured else math.nan,
            phase_rad=float(np.angle(component)),
        )
        for i, (f, component) in enumerate(zip(frequencies_hz, solution, strict=True))
    ]
    return tuple(sorted((line for line in lines if line.amplitude_m > 0), key=lambda line: -line.amplitude_m))


def interference_at(lines: Sequence[InterferenceLine], frequency_hz: Array, duration_s: float) -> Array:
    """Return the amplitude of interference in fits at other frequencies, (F,), as the squares of unknown phases add.

    Args:
        lines: lines measured at rest.
        frequency_hz: frequencies of the fits, (F,).
        duration_s: duration of the recording; a line farther away than its inverse leaks by its side lobes.
    """
    total = np.zeros(np.shape(frequency_hz))
    for line in lines:
        distance = np.abs(np.asarray(frequency_hz) - line.frequency_hz) * duration_s
        seen = line.amplitude_m / np.maximum(1.0, math.pi * distance)
        total += np.where((distance < SEPARATION_BINS) | line.significant, seen, 0.0) ** 2
    return np.asarray(np.sqrt(total))


def resolved_lines(
    lines: Sequence[InterferenceLine], duration_s: float, rate_hz: float
) -> tuple[tuple[float, ...], float]:
    """Return the frequencies of the lines that a recording of a slow signal resolves, and the rms amplitude of the others.

    The others are slower than `SEPARATION_BINS` over the duration: they look like a level or a drift.
    """
    apart: list[float] = []
    slow = 0.0
    for line in lines:
        if not line.significant or line.frequency_hz > NYQUIST_SHARE * rate_hz:
            continue
        if line.frequency_hz * duration_s < SEPARATION_BINS:
            slow = math.hypot(slow, line.amplitude_m / math.sqrt(2))
        elif all(abs(f - line.frequency_hz) * duration_s >= SEPARATION_BINS for f in apart):
            apart.append(line.frequency_hz)
    return tuple(apart[:MAX_LINES]), slow


def remove_lines(
    samples: Array, rate_hz: float, frequency_hz: float, lines: Sequence[InterferenceLine]
) -> tuple[Array, Mapping[int, float]]:
    """Remove interference from a recording under a sine.

    Args:
        samples: (N,), metres.
        rate_hz: samples per second.
        frequency_hz: frequency of the sine.
        lines: lines measured at rest.

    Returns:
        The samples without separable lines, and the amplitude of inseparable interference by harmonic order, in metres.
    """
    resolution_hz = rate_hz / len(samples)
    orders = np.arange(1, max(min(WAVEFORM_ORDERS, int(NYQUIST_SHARE * rate_hz / frequency_hz)), 1) + 1)
    apart: list[float] = []
    coincident: dict[int, float] = {}
    for line in lines:
        bins = np.abs(orders * frequency_hz - line.frequency_hz) / resolution_hz
        nearest = int(bins.argmin())
        if bins[nearest] < SEPARATION_BINS:
            seen = line.amplitude_m * min(1.0, 1 / max(math.pi * bins[nearest], 1e-9))
            order = int(orders[nearest])
            coincident[order] = math.hypot(coincident.get(order, 0.0), seen)
        elif line.significant and all(abs(f - line.frequency_hz) >= SEPARATION_BINS * resolution_hz for f in apart):
            apart.append(line.frequency_hz)
    if not apart:
        return samples, coincident
    # Of a waveform with a kink higher orders, too, leak into a line: those next to it are fitted with it.
    near = np.round(np.array(apart)[:, None] / frequency_hz) + np.arange(-NEAR_ORDERS, NEAR_ORDERS + 1)
    high = np.unique(near[(near > orders[-1]) & (near * frequency_hz < NYQUIST_SHARE * rate_hz)]) * frequency_hz
    high = high[np.abs(high[:, None] - apart).min(axis=1) >= SEPARATION_BINS * resolution_hz]
    fit = fit_lines(samples, rate_hz, np.concatenate([apart, orders * frequency_hz, high]))
    return samples - line_samples(fit.components[: len(apart)], np.array(apart), len(samples), rate_hz), coincident


def folded_frequencies(
    lines: Sequence[InterferenceLine],
    rate_hz: float,
    seen: Sequence[InterferenceLine],
    second_rate_hz: float,
    tolerance_hz: float,
) -> dict[float, float]:
    """Return the true frequencies of lines above half the sample rate, by their sampled frequencies.

    A line is folded if it changes its frequency at a second rate, and a line of equal size has the frequencies of one true
    frequency at both rates.

    Args:
        lines: lines sampled at `rate_hz`.
        rate_hz: samples per second.
        seen: lines sampled at the second rate.
        second_rate_hz: the second rate.
        tolerance_hz: largest difference of equal frequencies.
    """
    folded: dict[float, float] = {}
    for line in lines:
        alike = [other.frequency_hz for other in seen if 0.5 < other.amplitude_m / line.amplitude_m < 2]
        if not line.significant or any(abs(f - line.frequency_hz) < tolerance_hz for f in alike):
            continue
        for zone in range(1, MAX_ZONES + 1):
            for true_hz in (zone * rate_hz - line.frequency_hz, zone * rate_hz + line.frequency_hz):
                at_second = abs(true_hz - round(true_hz / second_rate_hz) * second_rate_hz)
                if any(abs(f - at_second) < tolerance_hz for f in alike):
                    folded.setdefault(line.frequency_hz, true_hz)
    return folded


def mark_folded(
    lines: Sequence[InterferenceLine], folded_from_hz: Mapping[float, float], tolerance_hz: float = 0.0
) -> tuple[InterferenceLine, ...]:
    """Return the lines with the true frequencies of folded lines, given by their sampled frequencies.

    Frequencies within `tolerance_hz` are equal: a run file has the lines of the program version of its time.
    """
    return tuple(
        replace(
            line,
            folded_from_hz=next(
                (
                    true
                    for f, true in folded_from_hz.items()
                    if math.isclose(f, line.frequency_hz, rel_tol=1e-6, abs_tol=tolerance_hz)
                ),
                math.nan,
            ),
        )
        for line in lines
    )


def _largest_peak(samples: Array, rate_hz: float) -> float | None:
    """Return the frequency of the largest line above the noise, or None."""
    n = samples.size
    length = 4 * n
    spectrum = np.fft.rfft(samples * np.hanning(n), length)
    power = np.abs(spectrum) ** 2
    usable = slice(math.ceil(3 * length / n), max(int(0.49 * length), math.ceil(3 * length / n) + 1))
    band = power[usable]
    if not band.size or not (floor := float(np.median(band)) / math.log(2)) > 0:
        return None
    top = int(band.argmax())
    if band[top] < LINE_POWER_RATIO * floor:
        return None
    bent = 0.0
    if 0 < top < band.size - 1:
        low, middle, high = np.sqrt(band[top - 1 : top + 2])
        bent = 0.5 * (low - high) / (low - 2 * middle + high) if low - 2 * middle + high else 0.0
    return float((usable.start + top + bent) * rate_hz / length)


def _refined(samples: Array, rate_hz: float, frequencies_hz: Sequence[float]) -> list[float]:
    """Return the frequencies of lines by a joint least-squares fit with their amplitudes; none leaves its bin."""
    n, start = samples.size, np.asarray(frequencies_hz, float)
    count, resolution_hz = start.size, rate_hz / n
    frequencies = start
    for _ in range(MAX_FREQUENCY_STEPS):
        fit = fit_lines(samples, rate_hz, frequencies)
        residual = samples - line_fit_samples(fit, n, rate_hz)
        size = 2 + 3 * count
        gram, moment = np.zeros((size, size)), np.zeros(size)
        for part, basis in sine_basis(n, rate_hz, frequencies):
            centred = 2 * np.pi * (np.arange(part.start, part.stop) - 0.5 * (n - 1)) / rate_hz
            slopes = fit.components.real[:, None] * basis[3::2] - fit.components.imag[:, None] * basis[2::2]
            extended = np.concatenate((basis, slopes * centred))
            gram += extended @ extended.T
            moment += extended @ residual[part]
        # Columns of one size: columns of the frequencies carry the lines' amplitudes in metres.
        scale = 1 / np.sqrt(np.diag(gram))
        step = (scale * np.linalg.solve(gram * np.outer(scale, scale), scale * moment))[-count:]
        moved = frequencies + np.clip(step, -resolution_hz, resolution_hz)
        frequencies = np.where(abs(moved - start) < resolution_hz, moved, start)
        if np.all(abs(step) < FREQUENCY_TOLERANCE_BINS * resolution_hz):
            break
    return [float(f) for f in frequencies]


def _without(samples: Array, rate_hz: float, frequencies_hz: Sequence[float]) -> Array:
    return _fit(samples, rate_hz, frequencies_hz)[1]


def _fit(samples: Array, rate_hz: float, frequencies_hz: Sequence[float]) -> tuple[Complex, Array]:
    """Return the complex amplitudes of lines fitted together, and the residual samples."""
    fit = fit_lines(samples, rate_hz, np.array(frequencies_hz, float))
    return fit.components, samples - line_fit_samples(fit, len(samples), rate_hz)
