"""Periodic response: frequency response and noise from several periods of one drive.

Distortion that repeats with every period shows as a scatter of lines about their neighbours in excess of the noise.

Odd orders of an amplifier or a specimen, a generator's steps and aliases of a card without a filter occur in every period alike,
so the spread over periods does not include them. They are caused by the drive, and their error is a share of the response, with a
varying sign from line to line. A response is smooth, and its inverse is smooth for any resonance: of second degree in the
frequency for one mode. (After the local polynomial method of Pintelon & Schoukens, System Identification, 2nd ed., ch. 7.)
"""

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.polynomial.legendre import legvander
from numpy.typing import ArrayLike, NDArray

from model import Array, Complex
from protocols.base import InterferenceLine
from protocols.signals.checks import check_pair, check_positive
from protocols.signals.interference import interference_at
from protocols.signals.response import FrequencyResponse
from protocols.signals.spectral_blocks import POOLED_LINES, make_block_averager, pool_lines

WINDOW_LINES, POLYNOMIAL_DEGREE = 15, 6
"""Number of lines of a piece of the response, and the degree of the polynomial fitted to its inverse."""

DEGREES_OF_FREEDOM = 2 * (WINDOW_LINES - POLYNOMIAL_DEGREE - 1)
CHI_SQUARE_MEDIAN = (1 - 2 / (9 * DEGREES_OF_FREEDOM)) ** 3
"""Median of chi square over its degrees of freedom (Wilson and Hilferty)."""

MEDIAN_WINDOW_LINES = 61
"""Number of lines of the median that gives the share."""

MIN_SIGNAL_TO_NOISE = 10.0
"""Smallest signal-to-noise ratio of a line used for the share."""

MEDIAN_WINDOW_STEP = 8
BISECTION_STEPS = 40


def repeating_error_share(frequency_hz: Array, response: Complex, noise: Array) -> Array:
    """(F,) standard deviation of the repeating distortion, of real and of imaginary part, as a share of the response's modulus.

    Args:
        frequency_hz: (F,), rising.
        response: (F,), its errors independent from line to line.
        noise: (F,), standard errors of real and imaginary part from the spread over periods; all positive.
    """
    clear = np.abs(response) > MIN_SIGNAL_TO_NOISE * noise
    if np.count_nonzero(clear) < 2 * WINDOW_LINES:
        return np.zeros(frequency_hz.size)
    inverse, error = 1 / response[clear], noise[clear] / np.abs(response[clear]) ** 2
    f, G, s = (sliding_window_view(values, WINDOW_LINES) for values in (frequency_hz[clear], inverse, error))
    place = 2 * (f - f[:, :1]) / (f[:, -1:] - f[:, :1]) - 1
    q, _ = np.linalg.qr(legvander(place, POLYNOMIAL_DEGREE) / s[..., None])
    target = (G / s)[..., None]
    left = target - q @ (q.swapaxes(1, 2) @ target)
    excess = (np.abs(left[..., 0]) ** 2).sum(1) / DEGREES_OF_FREEDOM  # 1 for noise alone
    strength = np.mean(np.abs(G / s) ** 2, axis=1)
    wide = min(MEDIAN_WINDOW_LINES, excess.size)
    at = np.arange(0, excess.size - wide + 1, MEDIAN_WINDOW_STEP)
    excess, strength = (sliding_window_view(values, wide)[at] for values in (excess, strength))
    # The share whose variance brings the median excess down to the excess of noise alone, by bisection.
    low, high = np.zeros(at.size), (excess / strength).max(1)
    for _ in range(BISECTION_STEPS):
        middle = 0.5 * (low + high)
        more = np.median(excess / (1 + middle[:, None] * strength), axis=1) > CHI_SQUARE_MEDIAN
        low, high = np.where(more, middle, low), np.where(more, high, middle)
    centre = frequency_hz[clear][at + (wide + WINDOW_LINES) // 2 - 1]
    return np.sqrt(np.interp(frequency_hz, centre, low))


EXCITED_POWER_SHARE = 1e-4
"""Smallest power of an excited line, as a share of the strongest line's power."""

HALF_WAVE_POWER_SHARE = 1e-2
"""Largest share of the even lines' power in the odd lines' power for a drive whose second half is the inverted first half."""


def _period_excess(X: Complex, lines: NDArray[np.intp]) -> float:
    """Return the excess of the drive's period over the card's as a share of it, from the phases of the lines, (periods, F)."""
    turn = (X[1:] * X[:-1].conj()).sum(0)
    weight = np.abs(turn) * lines
    return -float(weight @ np.angle(turn)) / (2 * np.pi * float(weight @ lines) or 1.0)


def _on_source_clock(samples: Array, longer: float, kept: slice) -> Array:
    """Return the samples of the kept periods at the instants of the source's clock, (K,).

    On the card's clock a line at frequency f leaks into its neighbours by f times the duration of a period times `longer`, and the
    even lines of the amplifier's second harmonic are strong: 14 ppm gave 1.5e-3 of the response.
    """
    from scipy.interpolate import CubicSpline

    at = np.arange(kept.start - kept.stop, 0) * (1 + longer) + kept.stop
    return np.asarray(CubicSpline(np.arange(samples.size), samples)(np.clip(at, 0, samples.size - 1)))


def _whole_periods(size: int, rate_hz: float, period_s: float, dropped: int) -> tuple[int, int]:
    """Return the samples of a period, and the number of periods that remain of `size` samples.

    Raises:
        ValueError: fewer than two periods remain, or a period is not a whole number of samples.
    """
    n = round(period_s * rate_hz)
    if n < 4 or abs(period_s * rate_hz - n) > 1e-3:
        raise ValueError(
            f"a period of {period_s:g} s is {period_s * rate_hz:g} samples at {rate_hz:g} Hz: it must be a whole number"
        )
    periods = size // n - dropped
    if dropped < 0 or periods < 2:
        raise ValueError(
            f"{size // n} whole periods were recorded and {dropped} are dropped: at least two must remain to see their spread"
        )
    return n, periods


def _excited(lines: NDArray[np.int_], power: Array) -> NDArray[np.bool_]:
    """Return the lines, (F,), that the drive excites, by the power of the drive in each."""
    used = power > EXCITED_POWER_SHARE * power.max()
    odd = lines % 2 == 1
    if power[~odd].sum() < HALF_WAVE_POWER_SHARE * power[odd].sum():
        # A generator's second harmonic drives even lines slightly, and the amplifier's second harmonic strongly.
        used &= odd
    return np.asarray(used)


def estimate_periodic_response(
    drive: ArrayLike,
    displacement: ArrayLike,
    rate_hz: float,
    period_s: float,
    band_hz: tuple[float, float],
    dropped: int = 1,
    delay_s: float = 0.0,
    interference: Sequence[InterferenceLine] = (),
) -> FrequencyResponse:
    """Response to several periods of a multisine or a repeated sweep, at the lines that the drive excites.

    The spread over the periods gives the noise, with two degrees of freedom a period less one, pooled over neighbouring lines;
    the lines' excess scatter gives the repeating errors (`repeating_error_share`). Both records are interpolated to the source's clock.

    Args:
        drive: (N,); an incomplete last period is left out. If its second half is the inverted first half, the odd lines are used.
        displacement: (N,), of the same scans.
        rate_hz: samples per second.
        period_s: period, a whole number of samples.
        band_hz: band of the lines.
        dropped: number of periods left out at the begin, until the response is periodic.
        delay_s: delay of the displacement's record (sensor delay minus the card's channel skew).
        interference: lines measured at rest; it repeats with the periods, and is counted in the errors of the lines near it.

    Raises:
        ValueError: fewer than two periods remain, a period is not a whole number of samples, or there is no drive.
    """
    x, y = check_pair(drive, displacement, 2, rate_hz)
    check_positive(period_s=period_s)
    n, periods = _whole_periods(x.size, rate_hz, period_s, dropped)
    from scipy.fft import rfft

    blocks = make_block_averager(band_hz, 2 * rate_hz / n, rate_hz / n, rate_hz / 2)
    lines = blocks.first + np.arange(blocks.size)
    kept = slice(dropped * n, (dropped + periods) * n)
    longer = _period_excess(rfft(x[kept].reshape(periods, n))[:, lines], lines)
    X, Y = (rfft(_on_source_clock(each, longer, kept).reshape(periods, n)) for each in (x, y))
    power = (np.abs(X[:, lines]) ** 2).sum(0)
    if not power.size or not power.max() > 0:
        raise ValueError(
            f"there is no drive between {band_hz[0]:g} and {band_hz[1]:g} Hz: check the drive channel's cable"
        )
    used = _excited(lines, power)
    lines, power = lines[used], power[used]
    X, Y = X[:, lines], Y[:, lines]
    cross = (Y * X.conj()).sum(0)
    H = cross / power
    # The displacement's noise is similar at neighbouring lines; the response to the drive is not, and is left out.
    alike = min(POOLED_LINES, lines.size)
    left = pool_lines((np.abs(Y - H * X) ** 2).sum(0) / (periods - 1), alike)
    modulus = np.abs(H)
    noise = np.maximum(np.sqrt(left / power / 2), np.finfo(float).eps * modulus.max())
    moved = (np.abs(Y) ** 2).sum(0)
    f = lines * rate_hz / n / (1 + longer)
    drive_amplitude = 2 / n * np.sqrt(power / periods)
    # Its phase is unknown: half of its power in the real part, half in the imaginary part.
    hum = interference_at(interference, f, periods * n / rate_hz) / drive_amplitude / np.sqrt(2)
    return FrequencyResponse(
        f,
        H * np.exp(2j * np.pi * f * delay_s),
        errors=np.hypot(np.hypot(noise, repeating_error_share(f, H, noise) * modulus), hum),
        coherence=np.divide(np.abs(cross) ** 2, power * moved, out=np.zeros(f.size), where=moved > 0),
        degrees_of_freedom=2.0 * (periods - 1) * alike,
        resolution_hz=rate_hz / n,
    )
