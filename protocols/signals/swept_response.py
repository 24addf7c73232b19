"""Swept response: frequency response from one long linear sweep.

A sweep does not repeat, but its drive is known: the whole record is transformed in one piece (so that no segment ends cut off the
response, and the sweep's rate causes no bias), Y X* is summed over bins under a Hann window, and the power at lags outside any
response is the noise (see `lines`). Welch's averages, segment by segment, would count the harmonics of the two-slope amplifier
and the whole record's noise against every line, and their segments cut off the ringing at their ends.

The start, end and direction of the sweep are found in the recorded drive; a recording without a sweep is rejected.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from model import Array, Complex
from protocols.base import InterferenceLine
from protocols.signals.checks import check_pair
from protocols.signals.response import FrequencyResponse
from protocols.signals.spectral_blocks import (
    OVERLAP_CORRELATION,
    POOLED_LINES,
    BlockAverager,
    band_spectrum,
    fast_length,
    make_block_averager,
    pool_lines,
)

SEARCH_CHUNK = 1 << 14
"""Number of samples per search step."""


def sweep_extent(drive: Array, beyond: int = 0) -> slice:
    """Return the first and last sample at which the drive, (N,), is away from the middle of its range, and `beyond` samples more.

    Beyond them are the weak ends of a faded sweep, and the free vibration after it.

    Raises:
        ValueError: a constant drive.
    """
    low, high = float(drive.min()), float(drive.max())
    if not high > low:
        raise ValueError(f"the drive is constant at {low:g}: check the drive channel's cable")
    middle, least = 0.5 * (low + high), 0.05 * (high - low)

    def first(samples: Array) -> int:
        """Return the first sample outside the limits, searched piece by piece, because it is mostly near the end."""
        for start in range(0, samples.size, SEARCH_CHUNK):
            away = np.abs(samples[start : start + SEARCH_CHUNK] - middle) > least
            if away.any():
                return start + int(away.argmax())
        return samples.size

    return slice(max(first(drive) - beyond, 0), drive.size - max(first(drive[::-1]) - beyond, 0))


def is_rising(X: NDArray[np.complex64]) -> bool:
    """Return whether the sweep goes up: its upper half of bins arrives later than its lower half (group delay)."""
    few = slice(None, None, 16)
    delay = np.mod(-np.angle(X[1:][few] * X[:-1][few].conj()), 2 * np.pi)
    half = delay.size // 2
    return bool(np.median(delay[half:]) >= np.median(delay[:half]))


def check_drive_in_band(drive: Array, power: float, band_share: float, n: int, band_hz: tuple[float, float]) -> None:
    """Reject a drive that is not stronger in the band than noise.

    Args:
        drive: (N,), the transformed drive.
        power: sum of its squared bins within the band.
        band_share: width of the band as a share of half the sample rate, which is the share of noise in it.
        n: length of the transform.
        band_hz: band, for the message.

    Raises:
        ValueError: less than twice `band_share` of the drive's power lies in the band.
    """
    centred = drive - drive.mean()
    share = 2 * power / (n * float(centred @ centred))
    if band_share < 0.4 and share < 2 * band_share:
        raise ValueError(
            f"only {100 * share:.2g} % of the recorded drive's power lies between {band_hz[0]:g} and {band_hz[1]:g} Hz, "
            "as with noise: check the drive channel's cable, and that the sweep went through this band"
        )


MIN_BINS_PER_LINE = 32
"""Fewest bins under one line of a sweep: fewer leave no lags outside the gate for the noise."""

TAPER_CYCLES = 6
"""Number of cycles of the lowest frequency over which a sweep is faded in and out."""

NOISE_LAGS = np.arange(3, 11)
"""Lags of the noise, in units of 1 / resolution: beyond the Hann window's main lobe, which ends at 2."""

HARMONIC_LAGS = -np.arange(2, 9)
"""Lags on the side of the harmonics; under a fast sweep some come close and leak through the gate."""

FAST_SWEEP_BINS = 128
"""Bins under one line below which a sweep is fast: harmonics then arrive within some ten units of lag and are removed."""

HARMONIC_GATE = -2.2
"""Lag, in units of 1 / resolution, before which harmonics are removed from a fast sweep: outside the Hann window's main lobe."""

EDGE_WIDTHS = 2.0
"""Distance of a usable line from the ends of a sweep, in units of the inverse root of the sweep's rate: the width of its edges."""

HARMONIC_PASSES = 3
"""Number of rounds of the removal of harmonics: their leakage bends the first response."""

SWEEP_DEGREES_OF_FREEDOM = 40.0
"""Degrees of freedom of a sweep's standard error: 8 gates, 4.4 of them independent, times 4.8 lines, times 2."""

CURVATURE_BIAS = 2 * (1 / 12 - 1 / (2 * np.pi**2))
"""Bias of a Hann line for a bent response, as a share of its second difference over the lines, which is removed."""

CORRECTED_VARIANCE = (
    (1 + 2 * CURVATURE_BIAS) ** 2
    + 2 * CURVATURE_BIAS**2
    - 4 * CURVATURE_BIAS * (1 + 2 * CURVATURE_BIAS) * OVERLAP_CORRELATION
)
"""Factor on the variance of a line by the removal of the bias."""

CORRECTED_CORRELATION = ((1 + 2 * OVERLAP_CORRELATION) / CORRECTED_VARIANCE - 1) / 2
"""Correlation of neighbouring lines after it: the noise of their mean is unchanged."""


@dataclass(frozen=True, slots=True)
class _SweptSpectra:
    """Spectra of one sweep in a band.

    Attributes:
        cross, power: Y X* and |X|² of the bins, (size,).
        S_xx: power of the drive in the lines, (count,).
        arrival_s: time of the sweep at the lines from its first sample, (count,).
        strong: first and last line that the drive fills; outside its band, and where it fades, a sweep is weak.
        rising: whether the sweep goes up.
        fast: whether harmonics arrive near the response.
    """

    blocks: BlockAverager
    cross: NDArray[np.complex64]
    power: NDArray[np.float32]
    S_xx: Array
    arrival_s: Array
    strong: tuple[int, int]
    rising: bool
    fast: bool

    def response(self, cross: NDArray[np.complex64]) -> Complex:
        """Return the response of the lines, (count,), of products of bins; beyond the outermost strong lines it is continued as a constant."""
        with np.errstate(divide="ignore", invalid="ignore"):
            H = np.asarray(self.blocks.windows(cross) @ self.blocks.window) / self.S_xx
        return np.asarray(H[np.clip(np.arange(H.size), self.strong[0] + 1, self.strong[1] - 1)], complex)

    def cleaned_response(self) -> tuple[Complex, NDArray[np.complex64]]:
        """Return the response, and the products of the bins, without the harmonics of a fast sweep."""
        H, cleaned = self.response(self.cross), self.cross
        for _ in range(HARMONIC_PASSES if self.fast else 0):
            cleaned = self.cross - self._harmonics(H)
            H = self.response(cleaned)
        return H, cleaned

    def noise_variance(self, cleaned: NDArray[np.complex64], H: Complex, duration_s: float) -> Array:
        """Return the variance of each line's S_yx, from the neighbouring gates on the side without harmonics."""
        at_gates, at_harmonics = np.split(
            self._power_at_lags(self._residuals(cleaned, H), np.concatenate((NOISE_LAGS, HARMONIC_LAGS))),
            [NOISE_LAGS.size],
            axis=1,
        )
        # A component at lag m leaks into the line, and its neighbours, as far as the side lobes of the Hann window allow.
        m = np.abs(HARMONIC_LAGS)
        leaked = (at_harmonics / (np.pi * m * (m**2 - 1)) ** 2).max(1)
        reach = np.pad(leaked, POOLED_LINES, "edge")
        noise = np.asarray(
            pool_lines(at_gates.mean(1), POOLED_LINES) + sliding_window_view(reach, 2 * POOLED_LINES + 1).max(1)
        )
        if not self.fast:
            return noise
        # At the end of a fast sweep, lags on this side lie beyond its samples; the harmonics are far away on the other side.
        reach_s = (NOISE_LAGS[-1] + 1) / (self.blocks.length * self.blocks.bin_hz)
        beyond = self.arrival_s + reach_s > duration_s if self.rising else self.arrival_s < reach_s
        before = self._power_at_lags(self._residuals(self.cross, H), -NOISE_LAGS[:4])
        return np.where(beyond, pool_lines(before.mean(1), POOLED_LINES), noise)

    def remove_bias(self, H: Complex) -> None:
        """Remove the slope and the bend of the response, (count,), over its windows from it, in place.

        The drive's power in a window is the weight, with its first and second moment about the line in units of the lines' distance.
        """
        blocks = self.blocks
        away = 2 * np.arange(blocks.length) / blocks.length - 1
        weights = np.stack((blocks.window * away, blocks.window * away**2), 1)
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second = ((blocks.windows(self.power) @ weights) / self.S_xx[:, None])[1:-1].T
        H[1:-1] -= 0.5 * first * (H[2:] - H[:-2]) + 0.5 * second * (H[2:] - 2 * H[1:-1] + H[:-2])

    def interference_errors(self, line: InterferenceLine, rate_hz: float) -> Array:
        """Return the standard error by one interference line of unknown phase, (count,), of real and imaginary part, in one window."""
        width = self.blocks.length * self.blocks.bin_hz
        distance = np.abs(self.blocks.frequency_hz - line.frequency_hz)
        under = np.where(line.significant & (distance < width / 2), 1 + np.cos(2 * np.pi * distance / width), 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            errors = line.amplitude_m / np.sqrt(2) * rate_hz * under / (2 * width * np.sqrt(self.S_xx))
        return np.asarray(np.nan_to_num(errors))

    def _residuals(self, cross: NDArray[np.complex64], H: Complex) -> NDArray[np.complex64]:
        """Return the products of the bins less a response interpolated between the lines."""
        # The lines are half a block apart; beyond the outermost the response is continued as a constant.
        hop = self.blocks.length // 2
        ends = np.concatenate((H[:1], H, H[-1:])).astype(np.complex64)
        share = np.arange(hop, dtype=np.float32) / np.float32(hop)
        straight = (ends[:-1, None] + np.multiply.outer(np.diff(ends), share)).ravel()
        within = slice(0, straight.size)
        return np.asarray(cross[within] - straight * self.power[within])

    def _harmonics(self, H: Complex) -> NDArray[np.complex64]:
        """Return the part of the products of the bins earlier than any response: the harmonics, which pass a frequency before it."""
        from scipy.fft import fft, fftfreq, ifft

        left = self._residuals(self.cross, H)
        lag = fftfreq(left.size, 1 / left.size) * self.blocks.length / left.size  # in units of 1 / resolution
        lags = ifft(left)
        lags[(lag if self.rising else -lag) > HARMONIC_GATE] = 0
        return np.concatenate((fft(lags), np.zeros(self.cross.size - left.size, np.complex64)))

    def _power_at_lags(self, residuals: NDArray[np.complex64], lags: NDArray[np.int_]) -> Array:
        """Return the power of the residuals at lags in units of 1 / resolution, (count, lags)."""
        # In a rising sweep a harmonic passes a frequency before the fundamental: at negative lags.
        blocks, side = self.blocks, 1 if self.rising else -1
        shift = np.exp(2j * np.pi * side * np.outer(np.arange(blocks.length), lags) / blocks.length)
        seen = blocks.windows(residuals) @ (blocks.window[:, None] * shift).astype(np.complex64)
        return np.asarray(seen.real**2 + seen.imag**2)


def estimate_swept_response(
    drive: ArrayLike,
    displacement: ArrayLike,
    rate_hz: float,
    band_hz: tuple[float, float],
    resolution_hz: float | None = None,
    delay_s: float = 0.0,
    interference: Sequence[InterferenceLine] = (),
    fade_s: float = 0.0,
) -> FrequencyResponse:
    """Response to one long linear sweep.

    Args:
        drive: (N,), the whole sweep, preferably with some rest after it.
        displacement: (N,), of the same scans.
        rate_hz: samples per second.
        band_hz: band of the lines; lines outside the sweep are left out.
        resolution_hz: full width of a line; lines are half of it apart. None: 0.5 Hz, or more for a short record.
        delay_s: by how much the displacement's record is late (sensor delay minus the card's channel skew).
        interference: lines measured at rest, counted in the errors of the affected lines of the response.
        fade_s: duration of the fade of the drive itself; 0: none, the records of the sweep are faded instead.

    Raises:
        ValueError: records that differ in length, are too short for the resolution, or hold no drive in the band.
    """
    x, y = check_pair(drive, displacement, 4 * MIN_BINS_PER_LINE, rate_hz)
    swept = sweep_extent(x, round(fade_s * rate_hz))
    duration = swept.stop - swept.start
    if duration < 4 * MIN_BINS_PER_LINE:
        raise ValueError(f"the drive moves for {duration} of {x.size} samples only: check the drive channel's cable")
    # The mean by the amplifier's two slopes begins with the sweep: a step, as broad as the band. Faded in over a few cycles
    # of the lowest frequency it vanishes in the band. The lines passed during the fade are left out.
    faded = min(round(TAPER_CYCLES * rate_hz / max(band_hz[0], 1.0)), duration // 20)
    spectra = _transform(x[swept], y[swept], rate_hz, band_hz, resolution_hz, faded)
    used = _undisturbed(spectra, x[swept], rate_hz, faded)
    if not used.any():
        raise ValueError(
            f"a sweep of {duration / rate_hz:.3g} s has no line between {band_hz[0]:g} and {band_hz[1]:g} Hz that its beginning and end "
            "leave undisturbed: use a longer sweep"
        )
    H, cleaned = spectra.cleaned_response()
    variance = spectra.noise_variance(cleaned, H, duration / rate_hz) / np.where(used, spectra.S_xx, np.inf) ** 2
    n = round(rate_hz / spectra.blocks.bin_hz)  # length of the transform
    S_nn = variance * spectra.S_xx / np.sum(spectra.blocks.window**2) * fast_length(duration) / n
    signal = np.abs(H) ** 2 * spectra.S_xx
    spectra.remove_bias(H)
    with np.errstate(divide="ignore", invalid="ignore"):
        coherence = signal / (signal + S_nn)
    hum = np.sqrt(sum((spectra.interference_errors(line, rate_hz) ** 2 for line in interference), np.zeros(1)))
    f = spectra.blocks.frequency_hz
    return FrequencyResponse(
        f[used],
        (H * np.exp(2j * np.pi * f * delay_s))[used],
        errors=np.hypot(np.sqrt(CORRECTED_VARIANCE * variance / 2), hum)[used],
        coherence=np.nan_to_num(coherence[used]),
        degrees_of_freedom=SWEEP_DEGREES_OF_FREEDOM,
        resolution_hz=spectra.blocks.length * spectra.blocks.bin_hz,
        correlation=CORRECTED_CORRELATION,
    )


def _transform(
    drive: Array,
    displacement: Array,
    rate_hz: float,
    band_hz: tuple[float, float],
    resolution_hz: float | None,
    faded: int,
) -> _SweptSpectra:
    """Return the spectra of drive and displacement during a sweep, (N,), with the first and last `faded` samples tapered.

    Raises:
        ValueError: the sweep is too short for the resolution, or the band too narrow, or without drive.
    """
    least_hz = MIN_BINS_PER_LINE * rate_hz / fast_length(drive.size)
    width = max(0.5, least_hz) if resolution_hz is None else resolution_hz
    if width < least_hz * (1 - 1e-9):
        raise ValueError(
            f"a sweep of {drive.size / rate_hz:.3g} s gives lines of {least_hz:.3g} Hz, not {width:g} Hz: "
            "use a coarser resolution or a longer sweep"
        )
    # Lags of a transform of the sweep's length wrap: early harmonics would arrive late, among the noise.
    fast = width * fast_length(drive.size) / rate_hz < FAST_SWEEP_BINS
    n = fast_length(2 * drive.size if fast else drive.size)
    blocks = make_block_averager(band_hz, width, rate_hz / n, rate_hz / 2)
    if blocks.count < POOLED_LINES:
        raise ValueError(
            f"the band {band_hz[0]:g}..{band_hz[1]:g} Hz holds {blocks.count} lines of {width:g} Hz, at least {POOLED_LINES} are needed"
        )
    X, Y = band_spectrum(drive, n, blocks, faded), band_spectrum(displacement, n, blocks, faded)
    power = X.real**2 + X.imag**2
    check_drive_in_band(drive, float(power.sum()), blocks.size / (n / 2), n, band_hz)
    S_xx = np.asarray(blocks.windows(power) @ blocks.window)
    strong = np.flatnonzero(S_xx > 0.8 * np.median(S_xx[S_xx > 0.1 * S_xx.max()]))
    ends = int(strong[0]), int(strong[-1])
    return _SweptSpectra(blocks, Y * X.conj(), power, S_xx, _arrival_s(X, blocks), ends, is_rising(X), fast)


def _undisturbed(spectra: _SweptSpectra, drive: Array, rate_hz: float, faded: int) -> NDArray[np.bool_]:
    """Return the lines, (count,), that lie within the sweep's band and away from its two ends in time."""
    used = np.zeros(spectra.S_xx.size, bool)
    used[spectra.strong[0] + 2 : spectra.strong[1] - 1] = True
    edge_s = _edge_s(drive, spectra.S_xx, rate_hz) + faded / rate_hz
    return used & (spectra.arrival_s > edge_s) & (spectra.arrival_s < drive.size / rate_hz - edge_s)


def _arrival_s(X: NDArray[np.complex64], blocks: BlockAverager) -> Array:
    """Return the time of the sweep at each line, (count,), from the first sample: the group delay."""
    turn = np.append(X[1:] * X[:-1].conj(), np.complex64(0))
    return np.mod(-np.angle(blocks.windows(turn) @ blocks.window), 2 * np.pi) / (2 * np.pi * blocks.bin_hz)


def _edge_s(drive: Array, S_xx: Array, rate_hz: float) -> Array:
    """Return the undisturbed distance of each line from the ends of a sweep, (count,): a multiple of the inverse root of its rate."""
    amplitude = 0.5 * float(np.ptp(drive))
    with np.errstate(divide="ignore"):
        return EDGE_WIDTHS * 2 * np.sqrt(S_xx) / (amplitude * rate_hz)
