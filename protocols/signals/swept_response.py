"""Swept response: frequency response from one long linear sweep.

A sweep does not repeat, but it is known: the whole record is transformed in one piece (so there is no segment whose ends cut the
response off, and no bias from the sweep's rate), Y X* is summed over bins under a Hann window, and what arrives at other lags
than a response can is the noise (see `lines`). Welch's averages, segment by segment, would count the harmonics of the two-slope
amplifier and the whole record's noise against every line, and their segments cut off what rings over their ends.

The start, end and direction of the sweep are found in the recorded drive; a recording without a sweep is rejected.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from model import Array, Complex
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
"""Samples looked at in one go."""


def sweep_extent(drive: Array) -> slice:
    """From where to where the drive, (N,), is away from the middle of its range.

    Raises:
        ValueError: it does not move at all.
    """
    low, high = float(drive.min()), float(drive.max())
    if not high > low:
        raise ValueError(f"the drive is constant at {low:g}: check the drive channel's cable")
    middle, least = 0.5 * (low + high), 0.05 * (high - low)

    def first(samples: Array) -> int:
        """Return the first sample outside the limits; searched piece by piece, since it is mostly near the end."""
        for start in range(0, samples.size, SEARCH_CHUNK):
            away = np.abs(samples[start : start + SEARCH_CHUNK] - middle) > least
            if away.any():
                return start + int(away.argmax())
        return samples.size

    return slice(first(drive), drive.size - first(drive[::-1]))


def is_rising(X: NDArray[np.complex64]) -> bool:
    """Whether the sweep goes up: whether its upper half of bins arrives later than its lower half (group delay)."""
    few = slice(None, None, 16)
    delay = np.mod(-np.angle(X[1:][few] * X[:-1][few].conj()), 2 * np.pi)
    half = delay.size // 2
    return bool(np.median(delay[half:]) >= np.median(delay[:half]))


def check_drive_in_band(drive: Array, power: float, band_share: float, n: int, band_hz: tuple[float, float]) -> None:
    """Reject a drive that is not stronger in the band than noise.

    Args:
        drive: (N,), as it was transformed.
        power: sum of its squared bins within the band.
        band_share: of the band, as a share of half the sample rate; noise has that share of its power there.
        n: length of the transform.
        band_hz: for the sentence.

    Raises:
        ValueError: less than twice that share of the drive's power lies in the band.
    """
    centred = drive - drive.mean()
    share = 2 * power / (n * float(centred @ centred))
    if band_share < 0.4 and share < 2 * band_share:
        raise ValueError(
            f"only {100 * share:.2g} % of the recorded drive's power lies between {band_hz[0]:g} and {band_hz[1]:g} Hz, "
            "as with noise: check the drive channel's cable, and that the sweep went through this band"
        )


MIN_BINS_PER_LINE = 32
"""Bins under one line of a sweep: fewer leave no lags outside the gate for the noise."""

TAPER_CYCLES = 6
"""Cycles of the lowest frequency over which a sweep is faded in and out."""

NOISE_LAGS = np.arange(3, 11)
"""Lags, in units of 1 / resolution, at which the noise is seen: beyond the Hann window's main lobe, which ends at 2."""

HARMONIC_LAGS = -np.arange(2, 9)
"""Lags on the other side, where the harmonics arrive; under a fast sweep some come close and leak through the gate."""

SWEEP_DEGREES_OF_FREEDOM = 40.0
"""Degrees of freedom of a sweep's standard error: 8 gates of which 4.4 are independent, times 4.8 lines, times 2."""

CURVATURE_BIAS = 2 * (1 / 12 - 1 / (2 * np.pi**2))
"""What a Hann line adds to a response that bends, as a share of its second difference over the lines: taken out again."""

CORRECTED_VARIANCE = (
    (1 + 2 * CURVATURE_BIAS) ** 2
    + 2 * CURVATURE_BIAS**2
    - 4 * CURVATURE_BIAS * (1 + 2 * CURVATURE_BIAS) * OVERLAP_CORRELATION
)
"""By how much that raises the variance of a line."""

CORRECTED_CORRELATION = ((1 + 2 * OVERLAP_CORRELATION) / CORRECTED_VARIANCE - 1) / 2
"""Of neighbouring lines then: their mean is as noisy as before."""


def estimate_swept_response(
    drive: ArrayLike,
    displacement: ArrayLike,
    rate_hz: float,
    band_hz: tuple[float, float],
    resolution_hz: float | None = None,
    delay_s: float = 0.0,
) -> FrequencyResponse:
    """Response to one long linear sweep.

    Args:
        drive: (N,), the whole sweep and, better, a moment of rest after it.
        displacement: (N,), of the same scans.
        rate_hz: samples per second.
        band_hz: where lines are computed; those at which the sweep was not are left out.
        resolution_hz: full width of a line; lines are half of it apart. None: 0.5 Hz, or what a short record allows.
        delay_s: by how much the displacement's record is late (sensor delay minus the card's channel skew).

    Raises:
        ValueError: records that differ in length, are too short for the resolution, or hold no drive in the band.
    """
    x, y = check_pair(drive, displacement, 4 * MIN_BINS_PER_LINE, rate_hz)
    swept = sweep_extent(x)
    duration = swept.stop - swept.start
    if duration < 4 * MIN_BINS_PER_LINE:
        raise ValueError(f"the drive moves for {duration} of {x.size} samples only: check the drive channel's cable")
    # With the sweep begins the mean that the amplifier's two slopes make: a step, as broad as the band. Faded in over a few
    # cycles of the lowest frequency it has nothing in the band; the response, which lasts milliseconds, does not notice.
    faded = min(round(TAPER_CYCLES * rate_hz / max(band_hz[0], 1.0)), duration // 20)
    n = fast_length(duration)
    bin_hz = rate_hz / n
    least_hz = MIN_BINS_PER_LINE * bin_hz
    width = max(0.5, least_hz) if resolution_hz is None else resolution_hz
    if width < least_hz * (1 - 1e-9):
        raise ValueError(
            f"a sweep of {duration / rate_hz:.3g} s gives lines of {least_hz:.3g} Hz, not {width:g} Hz: "
            "use a coarser resolution or a longer sweep"
        )
    blocks = make_block_averager(band_hz, width, bin_hz, rate_hz / 2)
    if blocks.count < POOLED_LINES:
        raise ValueError(
            f"the band {band_hz[0]:g}..{band_hz[1]:g} Hz holds {blocks.count} lines of {width:g} Hz, at least {POOLED_LINES} are needed"
        )
    X, Y = band_spectrum(x[swept], n, blocks, faded), band_spectrum(y[swept], n, blocks, faded)
    cross, power = Y * X.conj(), X.real**2 + X.imag**2
    check_drive_in_band(x[swept], float(power.sum()), blocks.size / (n / 2), n, band_hz)
    S_xx = np.asarray(blocks.windows(power) @ blocks.window)
    # Outside its band, and where it fades, the sweep is weak, which affects the outermost lines through their window.
    strong = np.flatnonzero(S_xx > 0.8 * np.median(S_xx[S_xx > 0.1 * S_xx.max()]))
    used = np.zeros(S_xx.size, bool)
    used[strong[0] + 2 : strong[-1] - 1] = True
    with np.errstate(divide="ignore", invalid="ignore"):
        H = np.asarray(blocks.windows(cross) @ blocks.window) / S_xx
    # Beyond the outermost of the strong lines the response is taken as it is there.
    H = H[np.clip(np.arange(H.size), strong[0] + 1, strong[-1] - 1)]
    variance = _noise_variance(cross, power, H, blocks, is_rising(X)) / np.where(used, S_xx, np.inf) ** 2
    S_nn = variance * S_xx / np.sum(blocks.window**2)
    signal = np.abs(H) ** 2 * S_xx
    f = blocks.frequency_hz
    H[1:-1] -= CURVATURE_BIAS * (H[2:] - 2 * H[1:-1] + H[:-2])
    with np.errstate(divide="ignore", invalid="ignore"):
        coherence = signal / (signal + S_nn)
    turn = np.exp(2j * np.pi * f * delay_s)
    return FrequencyResponse(
        frequency_hz=f[used],
        response=(H * turn)[used],
        standard_error=np.sqrt(CORRECTED_VARIANCE * variance / 2)[used],
        coherence=np.nan_to_num(coherence[used]),
        degrees_of_freedom=SWEEP_DEGREES_OF_FREEDOM,
        resolution_hz=blocks.length * bin_hz,
        correlation=CORRECTED_CORRELATION,
    )


def _noise_variance(
    cross: NDArray[np.complex64], power: NDArray[np.float32], H: Complex, blocks: BlockAverager, rising: bool
) -> Array:
    """Variance of each line's S_yx, from the gates next to it on the side on which no harmonic arrives."""
    # Linear interpolation between the lines, which are half a block apart; beyond the outermost the response is taken as it is there.
    hop = blocks.length // 2
    ends = np.concatenate((H[:1], H, H[-1:])).astype(np.complex64)
    share = np.arange(hop, dtype=np.float32) / np.float32(hop)
    straight = (ends[:-1, None] + np.multiply.outer(np.diff(ends), share)).ravel()
    within = slice(0, straight.size)
    left = cross[within] - straight * power[within]
    # A harmonic passes a frequency before the fundamental does when the sweep rises: at negative lags.
    side = 1 if rising else -1
    gates = np.concatenate((NOISE_LAGS, HARMONIC_LAGS))
    shift = np.exp(2j * np.pi * side * np.outer(np.arange(blocks.length), gates) / blocks.length)
    seen = blocks.windows(left) @ (blocks.window[:, None] * shift).astype(np.complex64)
    at_gates, at_harmonics = np.split(np.asarray(seen.real**2 + seen.imag**2), [NOISE_LAGS.size], axis=1)
    # A component at lag m leaks into the line, and its neighbours, as far as the side lobes of the Hann window allow.
    m = np.abs(HARMONIC_LAGS)
    leaked = (at_harmonics / (np.pi * m * (m**2 - 1)) ** 2).max(1)
    reach = np.pad(leaked, POOLED_LINES, "edge")
    return np.asarray(
        pool_lines(at_gates.mean(1), POOLED_LINES) + sliding_window_view(reach, 2 * POOLED_LINES + 1).max(1)
    )
