"""What real benches do and the model does not: creep, hysteresis, drift, a clamp that gives. All off by default.

So that a measurement can be tested to notice it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STROKE_V = 2000.0
"""The whole stroke of the specimen's voltage, of which a loop's width is a share."""
PLAY_V = 250.0
"""Half the voltage that must be turned back before the hysteresis has turned its own way."""
LAGS_S = np.logspace(-1, 5, 13)
"""Time constants of the creep, two a decade: their sum follows the logarithm of time from 0.1 s to a day."""


@dataclass(frozen=True, slots=True)
class BeyondTruth:
    """What lies beyond the model; 0 leaves it out.

    Attributes:
        creep_per_decade: what a step of voltage or weight gains per decade of time, as a share of the step.
        hysteresis_width: width of the displacement's loop against the voltage, as a share of the whole stroke.
        drift_m_per_s: how fast the sensor's reading wanders.
        clamp_gives_m_per_n: what the clamps give for good under the largest weight so far.
        side_difference: bending stiffness of plate and MFC, MFC up against aluminium up, as a share of their mean.
        weight_error: relative standard deviation of the weights' masses about their nominal ones.
        mass_share: share of a mass in the cylinder that moves with the centre.
        membrane_slip: share of an elongation that the membrane's clamps lose.
    """

    creep_per_decade: float = 0.0
    hysteresis_width: float = 0.0
    drift_m_per_s: float = 0.0
    clamp_gives_m_per_n: float = 0.0
    side_difference: float = 0.0
    weight_error: float = 0.0
    mass_share: float = 1.0
    membrane_slip: float = 0.0

    def __post_init__(self) -> None:
        for name, most in (
            ("creep_per_decade", 1.0),
            ("hysteresis_width", 0.2),
            ("weight_error", 0.5),
            ("mass_share", 1.0),
            ("membrane_slip", 1.0),
        ):
            if not 0 <= getattr(self, name) <= most:
                raise ValueError(f"beyond.{name} must lie between 0 and {most:g}, not {getattr(self, name):g}")
        if not -1 < self.side_difference < 1:
            raise ValueError(f"beyond.side_difference must lie between -1 and 1, not {self.side_difference:g}")

    def true_kg(self, nominal_kg: float, seed: int) -> float:
        """What a weight of a nominal mass really has."""
        if not self.weight_error:
            return nominal_kg
        by = float(np.random.default_rng((seed, round(1e9 * nominal_kg))).normal())
        return nominal_kg * (1 + self.weight_error * by)


class Creep:
    """Logarithmic creep of one drive: it gains a share of every step per decade of time, block by block."""

    def __init__(self, per_decade: float, block_s: float) -> None:
        self._share = per_decade * float(np.log10(LAGS_S[1] / LAGS_S[0]))
        self._keep = np.exp(-block_s / LAGS_S)
        self._lagging = np.zeros(LAGS_S.size)

    def feed(self, blocks: Array) -> Array:
        """The drive (n, BLOCK) with what has crept on so far."""
        if not self._share or not (blocks.any() or self._lagging.any()):
            return blocks
        crept = np.empty(len(blocks) + 1)
        crept[0] = self._lagging.sum()
        for i, mean in enumerate(blocks.mean(axis=1).tolist(), 1):
            self._lagging = mean + (self._lagging - mean) * self._keep
            crept[i] = self._lagging.sum()
        rise = (np.arange(blocks.shape[1]) + 1) / blocks.shape[1]
        return np.asarray(blocks + self._share * (crept[:-1, None] + np.diff(crept)[:, None] * rise))

    def skip(self, drive: float, gap_s: float) -> None:
        """`drive` stood for `gap_s`."""
        self._lagging = drive + (self._lagging - drive) * np.exp(-gap_s / LAGS_S)


class Hysteresis:
    """One play: the part of the voltage that follows only after `PLAY_V` either way."""

    def __init__(self, width: float) -> None:
        self._share = width * STROKE_V / (2 * PLAY_V)
        self._at = 0.0

    def feed(self, volts: Array) -> Array:
        """The voltage (n,) as the specimen answers to it."""
        if not self._share:
            return volts
        out = np.empty_like(volts)
        turns = np.flatnonzero(np.diff(np.sign(np.diff(volts)))) + 1
        begin = 0
        for end in [*(turns + 1).tolist(), volts.size]:  # one way only from turn to turn
            part = volts[begin:end]
            if part.size:
                first = min(max(self._at, part[0] - PLAY_V), part[0] + PLAY_V)
                out[begin:end] = np.maximum(np.minimum(first, part + PLAY_V), part - PLAY_V)
                self._at = float(out[end - 1])
            begin = end
        return volts + self._share * (out - volts)
