"""Perception: margin over the skin's discrimination threshold, and the usable frequency bands."""

from dataclasses import dataclass

import numpy as np
from annotated_types import Interval
from numpy.typing import ArrayLike

from model import THRESHOLD_M as THRESHOLD_M
from model import Array, ParameterError, ParameterSpec
from model.response.harmonic_response import PERIODIC_FREQUENCY_SPEC

THRESHOLD_AMPLITUDE = ParameterSpec(
    "threshold amplitude", "m", Interval(gt=0), "smallest amplitude that is felt", THRESHOLD_M
)


@dataclass(frozen=True, slots=True)
class PerceptionThreshold:
    """Discrimination threshold against frequency: straight lines in log-log between the points, constant beyond them.

    Raises:
        ParameterError: no points, lengths that differ, frequencies that do not rise, or a value that is not positive.
    """

    frequency_hz: tuple[float, ...]
    amplitude_m: tuple[float, ...]

    def __post_init__(self) -> None:
        f, a = PERIODIC_FREQUENCY_SPEC.check(self.frequency_hz), THRESHOLD_AMPLITUDE.check(self.amplitude_m)
        if f.size == 0 or f.shape != a.shape:
            raise ParameterError(
                f"threshold curve has {f.size} frequencies and {a.size} amplitudes: give one amplitude per frequency"
            )
        if (np.diff(f) <= 0).any():
            raise ParameterError(f"threshold frequencies {self.frequency_hz} do not rise: sort them")

    def amplitude_at(self, frequency_hz: ArrayLike) -> Array:
        """Threshold in m at each frequency (> 0), shape kept."""
        f = np.log(PERIODIC_FREQUENCY_SPEC.check(frequency_hz))
        return np.exp(np.interp(f, np.log(self.frequency_hz), np.log(self.amplitude_m)))


ABDOMEN_THRESHOLD = PerceptionThreshold((1.0,), (THRESHOLD_M,))
"""50 um on the abdomen, almost constant below 250 Hz (paper, ref. [33])."""


def perception_margin(
    frequency_hz: ArrayLike, amplitude_m: ArrayLike, threshold: PerceptionThreshold = ABDOMEN_THRESHOLD
) -> Array:
    """Amplitude over threshold, 1 where it is just felt; shape of `frequency_hz`.

    The paper sets its measured amplitude, max - min, against the 50 um; give whichever amplitude the threshold is for.
    """
    return np.asarray(np.abs(amplitude_m) / threshold.amplitude_at(frequency_hz))


def usable_bands(
    frequency_hz: ArrayLike, amplitude_m: ArrayLike, threshold: PerceptionThreshold = ABDOMEN_THRESHOLD
) -> tuple[tuple[float, float], ...]:
    """Intervals of frequency (Hz) where the margin is at least 1, within the frequencies given, which must rise.

    Ends between two frequencies are interpolated, linearly in the logarithm of the margin.

    Raises:
        ParameterError: frequencies that do not rise, or are not positive.
    """
    f = PERIODIC_FREQUENCY_SPEC.check(frequency_hz)
    if f.ndim != 1 or (np.diff(f) <= 0).any():
        raise ParameterError("frequencies of a usable band must be one rising row: sort them")
    level = np.log(np.maximum(perception_margin(f, amplitude_m, threshold), np.finfo(float).tiny))
    felt = level >= 0
    edges = np.flatnonzero(felt[1:] != felt[:-1])
    cross = f[edges] + (f[edges + 1] - f[edges]) * level[edges] / (level[edges] - level[edges + 1])
    ends = np.concatenate((f[:1] if felt[0] else [], cross, f[-1:] if felt[-1] else []))
    return tuple((float(a), float(b)) for a, b in ends.reshape(-1, 2))
