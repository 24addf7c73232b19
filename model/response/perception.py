"""Perception: thresholds by body site, margin over the skin's discrimination threshold, and the usable frequency bands."""

import math
from dataclasses import dataclass

import numpy as np
from annotated_types import Interval
from numpy.typing import ArrayLike

from model import Array, ParameterError, ParameterSpec
from model.parameter_spec import PERIODIC_FREQUENCY_SPEC as PERIODIC_FREQUENCY_SPEC

THRESHOLD_M = 50e-6
"""Discrimination threshold of the skin on the abdomen below 250 Hz (paper, Sec. I)."""

UNCOMFORTABLE_HZ = 200.0, 250.0
"""Range of the frequency above which vibration tends to be uncomfortable (paper, Sec. I, ref. [22])."""

THRESHOLD_SPEC = ParameterSpec("threshold", "m", Interval(gt=0), "deflection that can be felt", THRESHOLD_M)

THRESHOLD_AMPLITUDE = ParameterSpec(
    "threshold amplitude", "m", Interval(gt=0), "smallest amplitude that is felt", THRESHOLD_M
)


@dataclass(frozen=True, slots=True)
class PerceptionThreshold:
    """Threshold of max - min against frequency: straight lines in log-log between the points, constant beyond them.

    Attributes:
        frequency_hz, amplitude_m: the points, rising in frequency.
        label: body site.
        source: origin of the points.
        unproven: part of the points without a source; empty if there is none.

    Raises:
        ParameterError: no points, lengths that differ, frequencies that do not rise, or a value that is not positive.
    """

    frequency_hz: tuple[float, ...]
    amplitude_m: tuple[float, ...]
    label: str = ""
    source: str = ""
    unproven: str = ""

    @property
    def marked_label(self) -> str:
        """Label, with a mark if a part is unproven."""
        return self.label + (" (UNPROVEN)" if self.unproven else "")

    @property
    def line_label(self) -> str:
        """Label of its line in a plot."""
        return f"Felt: {self.marked_label}"

    @property
    def description(self) -> str:
        """Label, source, and unproven part."""
        doubt = f"; UNPROVEN: {self.unproven}" if self.unproven else ""
        return f"{self.label} ({self.source}{doubt})"

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


ABDOMEN_THRESHOLD = PerceptionThreshold(
    (1.0,),
    (THRESHOLD_M,),
    f"{1e6 * THRESHOLD_M:g} µm on the abdomen",
    "paper, Sec. I, ref. [33]: almost constant below 250 Hz",
)


UNCOMFORTABLE_SOURCE = "paper, Sec. I, ref. [22]: over about 200 to 250 Hz"
"""A band of frequencies without amplitude: no published amplitude is known."""


def _sloped(frequency_hz: tuple[float, ...], db: tuple[float, ...], lowest_m: float) -> tuple[float, ...]:
    """Return the curve whose corners lie so many decibels above its lowest point."""
    return tuple(lowest_m * 10 ** (level / 20) for level, _ in zip(db, frequency_hz, strict=True))


_THENAR_HZ, _FOREARM_HZ = (40.0, 250.0), (40.0, 220.0, 500.0)
_THENAR_DB = (12 * math.log2(250 / 40), 0.0)
_FOREARM_DB = (12 * math.log2(220 / 40), 0.0, 9 * math.log2(500 / 220))

SITES = {
    "abdomen": ABDOMEN_THRESHOLD,
    "thenar": PerceptionThreshold(
        _THENAR_HZ,
        _sloped(_THENAR_HZ, _THENAR_DB, 2e-7),
        "thenar eminence, contactor of 2.9 cm²",
        "Gescheider and Verrillo, doi:10.1007/978-1-4613-3039-4_10: flat up to 40 Hz, then 12 dB per octave down to 250 Hz",
        "the level, 0.1 µm peak at 250 Hz, uncertain by a factor of ten",
    ),
    "forearm": PerceptionThreshold(
        _FOREARM_HZ,
        _sloped(_FOREARM_HZ, _FOREARM_DB, 2e-6),
        "volar forearm, hairy skin",
        "Verrillo 1966, 'Vibrotactile thresholds for hairy skin': 12 dB per octave down to 220 Hz, then 9 dB per octave up",
        "the level, 1 µm peak at 220 Hz, and the course below 40 Hz",
    ),
}
"""Thresholds by body site. A level without a source is marked; a laboratory provides its own curve as a file."""


def perception_margin(
    frequency_hz: ArrayLike, amplitude_m: ArrayLike, threshold: PerceptionThreshold = ABDOMEN_THRESHOLD
) -> Array:
    """Amplitude over threshold, 1 at the limit of perception; shape of `frequency_hz`.

    The paper compares its measured amplitude, max - min, with 50 um; give max - min for the other sites, too.
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
