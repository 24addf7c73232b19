"""Frequency response H1 = S_yx / S_xx of displacement over drive, with coherence and a standard error per line.

Two excitations, two ways to an error bar. Periods that repeat show their noise by not repeating. A long linear sweep does not
repeat, but it is known: the whole record is transformed at once (so there is no segment whose ends cut the response off, and
no bias from the sweep's rate), Y X* is summed over bins under a Hann window, and what arrives at other lags than a response can is
the noise (see `lines`). Welch's averages, segment by segment, would count the harmonics of the two-slope amplifier and the whole
record's noise against every line, and their segments cut off what rings over their ends.

H1 is the right one of the two here: the noise is the laser's; the recorded drive has a thousandth of it. H2 would take
the harmonics for response.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from protocols.signals.lines import OVERLAP_CORRELATION, Blocks, bins_of, blocks_for, padded
from protocols.signals.recorded_sweep import driven, rises, stands_out
from protocols.signals.repeating import repeating_share
from protocols.signals.samples import check_positive, check_samples, coverage_factor

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

LEAST_BINS = 32
"""Bins under one line of a sweep: fewer leave no room beside the gate to see the noise."""

FADED_CYCLES = 6
"""Cycles of the lowest frequency over which a sweep is faded in and out."""

GATES = np.arange(3, 11)
"""Lags, in units of 1 / resolution, at which the noise is seen: beyond the Hann window's main lobe, which ends at 2."""

HARMONIC_GATES = -np.arange(2, 9)
"""Lags on the other side, where the harmonics arrive; under a fast sweep some come close and leak through the gate."""

POOLED_LINES = 5
"""Neighbouring lines whose noise is taken together."""

SWEEP_FREEDOM = 40.0
"""Degrees of freedom of a sweep's standard error: 8 gates of which 4.4 are independent, times 4.8 lines, times 2."""

BLUNTED = 2 * (1 / 12 - 1 / (2 * np.pi**2))
"""What a Hann line adds to a response that bends, as a share of its second difference over the lines: taken out again."""

SHARP_VARIANCE = (1 + 2 * BLUNTED) ** 2 + 2 * BLUNTED**2 - 4 * BLUNTED * (1 + 2 * BLUNTED) * OVERLAP_CORRELATION
"""By how much that raises the variance of a line."""

SHARP_CORRELATION = ((1 + 2 * OVERLAP_CORRELATION) / SHARP_VARIANCE - 1) / 2
"""Of neighbouring lines then: their mean is as noisy as before."""

EXCITED = 1e-4
"""Share of the strongest line's power from which a line counts as excited."""


@dataclass(frozen=True, slots=True)
class FrequencyResponse:
    """Displacement per drive, at lines.

    Attributes:
        frequency_hz: (F,), Hz, rising.
        response: (F,), complex, unit of displacement over unit of drive; delay removed.
        standard_error: (F,), of its real and of its imaginary part, hence of its modulus and of modulus times phase.
        coherence: (F,), share of the displacement's power at the line that follows the drive, 0..1.
        degrees_of_freedom: of the standard errors; see `coverage_factor`.
        resolution_hz: full width over which a line averages (Hann for a sweep, what that blunts being taken out).
        correlation: of the errors of neighbouring lines.
    """

    frequency_hz: Array
    response: Complex
    standard_error: Array
    coherence: Array
    degrees_of_freedom: float
    resolution_hz: float
    correlation: float

    @property
    def modulus(self) -> Array:
        """(F,), response per drive."""
        return np.abs(self.response)

    @property
    def phase(self) -> Array:
        """Radians, -pi..pi."""
        return np.angle(self.response)

    def half_width(self, level: float = 0.95) -> Array:
        """(F,), to either side of the modulus: holds the truth with probability `level`, line by line."""
        return coverage_factor(self.degrees_of_freedom, level) * self.standard_error

    def within(self, low_hz: float, high_hz: float) -> Self:
        """The lines of a band."""
        keep = (self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz)
        rows = {name: getattr(self, name)[keep] for name in ("frequency_hz", "response", "standard_error", "coherence")}
        return replace(self, **rows)


def sweep_response(
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
        band_hz: where lines are wanted; those at which the sweep was not are left out.
        resolution_hz: full width of a line; lines stand half of it apart. None: 0.5 Hz, or what a short record allows.
        delay_s: by how much the displacement's record is late (sensor delay minus the card's channel skew).

    Raises:
        ValueError: records that differ in length, are too short for the resolution, or hold no drive in the band.
    """
    x, y = _both(drive, displacement, 4 * LEAST_BINS, rate_hz)
    swept = driven(x)
    duration = swept.stop - swept.start
    if duration < 4 * LEAST_BINS:
        raise ValueError(f"the drive moves for {duration} of {x.size} samples only: check the drive channel's cable")
    # With the sweep begins the mean that the amplifier's two slopes make: a step, as broad as the band. Faded in over a few
    # cycles of the lowest frequency it has nothing in the band; the response, which lasts milliseconds, does not notice.
    faded = min(round(FADED_CYCLES * rate_hz / max(band_hz[0], 1.0)), duration // 20)
    n = padded(duration)
    bin_hz = rate_hz / n
    least_hz = LEAST_BINS * bin_hz
    width = max(0.5, least_hz) if resolution_hz is None else resolution_hz
    if width < least_hz * (1 - 1e-9):
        raise ValueError(
            f"a sweep of {duration / rate_hz:.3g} s gives lines of {least_hz:.3g} Hz, not {width:g} Hz: "
            "ask for a coarser resolution or sweep longer"
        )
    blocks = blocks_for(band_hz, width, bin_hz, rate_hz / 2)
    if blocks.count < POOLED_LINES:
        raise ValueError(
            f"the band {band_hz[0]:g}..{band_hz[1]:g} Hz holds {blocks.count} lines of {width:g} Hz, at least {POOLED_LINES} are needed"
        )
    X, Y = bins_of(x[swept], n, blocks, faded), bins_of(y[swept], n, blocks, faded)
    cross, power = Y * X.conj(), X.real**2 + X.imag**2
    stands_out(x[swept], float(power.sum()), blocks.size / (n / 2), n, band_hz)
    S_xx = np.asarray(blocks.of(power) @ blocks.window)
    # Outside its band, and where it fades, the sweep is weak; the outermost lines feel that through their window.
    strong = np.flatnonzero(S_xx > 0.8 * np.median(S_xx[S_xx > 0.1 * S_xx.max()]))
    used = np.zeros(S_xx.size, bool)
    used[strong[0] + 2 : strong[-1] - 1] = True
    with np.errstate(divide="ignore", invalid="ignore"):
        H = np.asarray(blocks.of(cross) @ blocks.window) / S_xx
    # Beyond the outermost of the strong lines the response is taken as it is there.
    H = H[np.clip(np.arange(H.size), strong[0] + 1, strong[-1] - 1)]
    variance = _noise(cross, power, H, blocks, rises(X)) / np.where(used, S_xx, np.inf) ** 2
    S_nn = variance * S_xx / np.sum(blocks.window**2)
    signal = np.abs(H) ** 2 * S_xx
    f = blocks.frequency_hz
    H[1:-1] -= BLUNTED * (H[2:] - 2 * H[1:-1] + H[:-2])
    with np.errstate(divide="ignore", invalid="ignore"):
        coherence = signal / (signal + S_nn)
    turn = np.exp(2j * np.pi * f * delay_s)
    return FrequencyResponse(
        frequency_hz=f[used],
        response=(H * turn)[used],
        standard_error=np.sqrt(SHARP_VARIANCE * variance / 2)[used],
        coherence=np.nan_to_num(coherence[used]),
        degrees_of_freedom=SWEEP_FREEDOM,
        resolution_hz=blocks.length * bin_hz,
        correlation=SHARP_CORRELATION,
    )


def periodic_response(
    drive: ArrayLike,
    displacement: ArrayLike,
    rate_hz: float,
    period_s: float,
    band_hz: tuple[float, float],
    dropped: int = 1,
    delay_s: float = 0.0,
) -> FrequencyResponse:
    """Response to several periods of a multisine or a repeated sweep, at the lines that the drive excites.

    The spread over the periods gives the noise, with two degrees of freedom a period less one, pooled over neighbouring lines;
    the scatter of the lines beyond it gives what repeats with every period (see `repeating`). A clock of the source that runs
    away from the card's turns drive and displacement alike, and drops out.

    Args:
        drive: (N,); an incomplete last period is left out.
        displacement: (N,), of the same scans.
        rate_hz: samples per second.
        period_s: a whole number of samples.
        band_hz: where lines are wanted.
        dropped: periods left out at the beginning, while the response becomes periodic.
        delay_s: see `sweep_response`.

    Raises:
        ValueError: fewer than two periods remain, a period is no whole number of samples, or nothing is driven.
    """
    x, y = _both(drive, displacement, 2, rate_hz)
    check_positive(period_s=period_s)
    n = round(period_s * rate_hz)
    if n < 4 or abs(period_s * rate_hz - n) > 1e-3:
        raise ValueError(
            f"a period of {period_s:g} s is {period_s * rate_hz:g} samples at {rate_hz:g} Hz: it must be a whole number"
        )
    periods = x.size // n - dropped
    if dropped < 0 or periods < 2:
        raise ValueError(
            f"{x.size // n} whole periods were recorded and {dropped} are dropped: at least two must remain to see their spread"
        )
    from scipy.fft import rfft

    kept = slice(dropped * n, (dropped + periods) * n)
    X, Y = rfft(x[kept].reshape(periods, n)), rfft(y[kept].reshape(periods, n))
    blocks = blocks_for(band_hz, 2 * rate_hz / n, rate_hz / n, rate_hz / 2)
    lines = blocks.first + np.arange(blocks.size)
    power = (np.abs(X[:, lines]) ** 2).sum(0)
    if not power.size or not power.max() > 0:
        raise ValueError(
            f"there is no drive between {band_hz[0]:g} and {band_hz[1]:g} Hz: check the drive channel's cable"
        )
    lines, power = lines[power > EXCITED * power.max()], power[power > EXCITED * power.max()]
    X, Y = X[:, lines], Y[:, lines]
    cross = (Y * X.conj()).sum(0)
    H = cross / power
    # The displacement's noise is alike at neighbouring lines; what follows the drive is not, and is left out of it.
    pooled = min(POOLED_LINES, lines.size)
    left = _pooled((np.abs(Y - H * X) ** 2).sum(0) / (periods - 1), pooled)
    modulus = np.abs(H)
    noise = np.maximum(np.sqrt(left / power / 2), np.finfo(float).eps * modulus.max())
    moved = (np.abs(Y) ** 2).sum(0)
    f = lines * rate_hz / n
    return FrequencyResponse(
        frequency_hz=f,
        response=H * np.exp(2j * np.pi * f * delay_s),
        standard_error=np.hypot(noise, repeating_share(f, H, noise) * modulus),
        coherence=np.divide(np.abs(cross) ** 2, power * moved, out=np.zeros(f.size), where=moved > 0),
        degrees_of_freedom=2.0 * (periods - 1) * pooled,
        resolution_hz=rate_hz / n,
        correlation=0.0,
    )


def _noise(cross: NDArray[np.complex64], power: NDArray[np.float32], H: Complex, blocks: Blocks, rising: bool) -> Array:
    """Variance of each line's S_yx, from the gates beside it on the side on which no harmonic arrives."""
    # Straight lines between the lines, which stand half a block apart; beyond the outermost the response is taken as it is there.
    hop = blocks.length // 2
    ends = np.concatenate((H[:1], H, H[-1:])).astype(np.complex64)
    share = np.arange(hop, dtype=np.float32) / np.float32(hop)
    straight = (ends[:-1, None] + np.multiply.outer(np.diff(ends), share)).ravel()
    within = slice(0, straight.size)
    left = cross[within] - straight * power[within]
    # A harmonic passes a frequency before the fundamental does when the sweep rises: at negative lags.
    side = 1 if rising else -1
    gates = np.concatenate((GATES, HARMONIC_GATES))
    shift = np.exp(2j * np.pi * side * np.outer(np.arange(blocks.length), gates) / blocks.length)
    seen = blocks.of(left) @ (blocks.window[:, None] * shift).astype(np.complex64)
    at_gates, at_harmonics = np.split(np.asarray(seen.real**2 + seen.imag**2), [GATES.size], axis=1)
    # What stands at lag m leaks into the line, and its neighbours, as far as the side lobes of the Hann window let it.
    m = np.abs(HARMONIC_GATES)
    leaked = (at_harmonics / (np.pi * m * (m**2 - 1)) ** 2).max(1)
    reach = np.pad(leaked, POOLED_LINES, "edge")
    return np.asarray(_pooled(at_gates.mean(1), POOLED_LINES) + sliding_window_view(reach, 2 * POOLED_LINES + 1).max(1))


def _pooled(noise: Array, lines: int) -> Array:
    """Each line's mean with its neighbours'; at the ends over those that are there."""
    pool = np.ones(lines)
    return np.asarray(np.convolve(noise, pool, "same") / np.convolve(np.ones(noise.size), pool, "same"))


def _both(drive: ArrayLike, displacement: ArrayLike, least: int, rate_hz: float) -> tuple[Array, Array]:
    check_positive(rate_hz=rate_hz)
    x, y = check_samples("the drive", drive, least), check_samples("the displacement", displacement, least)
    if x.size != y.size:
        raise ValueError(
            f"the drive has {x.size} samples and the displacement {y.size}: they must be of the same scans"
        )
    return x, y


def joined(parts: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """Responses of one resolution over bands that follow each other, as one."""
    if len(parts) == 1:
        return parts[0]

    def every(name: str) -> Any:
        return np.concatenate([getattr(part, name) for part in parts])

    return replace(
        parts[0],
        frequency_hz=every("frequency_hz"),
        response=every("response"),
        standard_error=every("standard_error"),
        coherence=every("coherence"),
        resolution_hz=max(part.resolution_hz for part in parts),
    )
