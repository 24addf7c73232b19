"""Max - min of a periodic response, corrected for the bias of noise and sampling.

The largest of n noisy samples lies above the largest value of the waveform, and the samples miss the extremes of the waveform.
Both are computed from the waveform fitted with many harmonics and from the distribution of its residuals, of any shape: the
distribution of the maximum of independent values is the product of their distributions.
"""

from dataclasses import dataclass

import numpy as np

from model import Array
from protocols.signals.sine import SineFit, fit_sine, fitted_samples

WAVEFORM_ORDERS = 24
"""Number of harmonics of the waveform; higher frequencies count as noise."""

WAVEFORM_STEPS = 4096
"""Number of steps per cycle in the search of the waveform's extremes."""

DISTRIBUTION_STEPS = 512
"""Number of steps of the noise distribution over its range."""

BIAS_UNCERTAINTY = 0.05
"""Relative standard uncertainty of the bias: the tails of the noise are estimated from one recording."""

RESOLUTION_SAMPLES = 1 << 17
"""Number of samples whose smallest step is the resolution: more than the levels of a 16-bit converter."""

MIN_ORDERS = 4
"""Fewest harmonics below the sample rate for residuals without harmonics; with fewer, the uncertainty of the bias is the bias
itself."""


@dataclass(frozen=True, slots=True)
class MaxMin:
    """Max - min of the waveform of a recording, in the unit of the samples.

    Attributes:
        value: max - min of the samples without drift, less the bias.
        scatter: standard uncertainty by noise, reduced by averaging of recordings.
        systematic: standard uncertainty by the resolution of the samples and the bias, common to recordings.
        bias: expected max - min of the samples minus max - min of the waveform: positive by noise, negative by sampling.
    """

    value: float
    scatter: float
    systematic: float
    bias: float

    @property
    def standard_error(self) -> float:
        """Standard uncertainty of the value."""
        return float(np.hypot(self.scatter, self.systematic))


def estimate_max_min(samples: Array, rate_hz: float, frequency_hz: float) -> MaxMin:
    """Estimate max - min of a periodic response without noise and in continuous time.

    Args:
        samples: (N,), evenly spaced, about whole cycles.
        rate_hz: samples per second.
        frequency_hz: fitted frequency of the fundamental.

    Raises:
        ValueError: fewer samples than unknowns of the fit.
    """
    orders = max(min(WAVEFORM_ORDERS, len(samples) // 8 - 1), 1)
    fit = fit_sine(samples, rate_hz, frequency_hz, orders)
    line, waveform = fitted_samples(fit, len(samples), rate_hz)
    moved = samples - line
    left = np.sort(moved - waveform)
    (highest, high_error), (lowest, low_error) = (
        _expected_maximum(waveform, left),
        _expected_maximum(-waveform, -left[::-1]),
    )
    bias = highest + lowest - float(np.ptp(_one_cycle(fit)))
    # Coarse steps are no independent noise: the extremes may be shifted by up to half a step, or widened by it.
    resolution = smallest_step(samples) / np.sqrt(3)
    share = BIAS_UNCERTAINTY if len(fit.components) >= MIN_ORDERS else 1 / np.sqrt(3)
    systematic = float(np.hypot(resolution, share * bias))
    return MaxMin(float(np.ptp(moved)) - bias, float(np.hypot(high_error, low_error)), systematic, bias)


def smallest_step(samples: Array) -> float:
    """Return the smallest difference between different samples: the resolution of digitized ones."""
    steps = np.diff(np.sort(samples[:RESOLUTION_SAMPLES]))
    return float(steps[steps > 0].min(initial=np.ptp(samples)))


def _one_cycle(fit: SineFit) -> Array:
    turn = 2j * np.pi * np.arange(WAVEFORM_STEPS) / WAVEFORM_STEPS
    orders = np.arange(1, len(fit.components) + 1)
    return np.asarray((fit.components @ np.exp(np.multiply.outer(orders, turn))).imag)


def _expected_maximum(waveform: Array, noise: Array) -> tuple[float, float]:
    """Return mean and standard deviation of the largest of all `waveform` + noise; `noise` is a sorted sample of it."""
    top, spread = float(waveform.max()), float(noise[-1] - noise[0])
    if spread <= 0:
        return top + float(noise[-1]), 0.0
    step = spread / DISTRIBUTION_STEPS
    below = np.rint((top - waveform[waveform > top - spread]) / step).astype(int)
    counts = np.bincount(below, minlength=DISTRIBUTION_STEPS + 1).astype(float)
    levels = noise[0] + step * np.arange(2 * DISTRIBUTION_STEPS + 1)
    # The smallest value is in the sample, so that no logarithm is infinite.
    log_share = np.log(np.maximum(np.searchsorted(noise, levels, side="right"), 1) / noise.size)
    share = np.exp(np.correlate(log_share, counts, mode="valid"))  # probability that no sample lies above top + level
    weights = np.diff(share, prepend=0.0)
    middles = levels[: DISTRIBUTION_STEPS + 1] - 0.5 * step
    mean = float(weights @ middles / weights.sum())
    return top + mean, float(np.sqrt(weights @ (middles - mean) ** 2 / weights.sum()))
