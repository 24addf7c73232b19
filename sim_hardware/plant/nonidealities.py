"""Nonidealities that the model lacks: creep, hysteresis, drift, a compliant clamp. All off by default.

They test whether a measurement detects them.
"""

from dataclasses import dataclass

import numpy as np

from model import Array

HUM_HARMONICS = {1: 1.0, 2: 0.3, 3: 0.5, 5: 0.2}
"""Amplitude of each order of the mains hum divided by the first's."""


@dataclass(frozen=True, slots=True)
class Nonidealities:
    """What lies beyond the model; 0 leaves it out.

    Attributes:
        creep_per_decade: what a step of voltage or weight gains per decade of time, as a share of the step; none at the
            time constant of 100 Hz, to which the stiffness and the moment per volt of the tactor refer.
        hysteresis_width: width of the displacement's loop against the voltage in the middle of the whole stroke, as a
            share of the stroke without hysteresis.
        drift_m_per_s: how fast the sensor's reading wanders.
        clamp_gives_m_per_n: what the clamps give for good under the largest weight so far.
        side_difference: bending stiffness of plate and MFC under a load, MFC up against aluminium up, as a share of their
            mean. Without a load it is the mean: a vibration bends it both ways, whichever side is up.
        weight_error: relative standard deviation of the weights' masses about their nominal ones.
        mass_share: share of a mass in the cylinder that moves with the centre.
        membrane_slip: share of an elongation that the membrane's clamps lose.
        hum_m: peak amplitude of the mains hum on the laser's signal; its harmonics follow `HUM_HARMONICS`.
        mains_hz: frequency of the mains.
        tone_m, tone_hz: amplitude and frequency of another disturbance, e.g. of a switching supply.
    """

    creep_per_decade: float = 0.0
    hysteresis_width: float = 0.0
    drift_m_per_s: float = 0.0
    clamp_gives_m_per_n: float = 0.0
    side_difference: float = 0.0
    weight_error: float = 0.0
    mass_share: float = 1.0
    membrane_slip: float = 0.0
    hum_m: float = 0.0
    mains_hz: float = 50.02
    tone_m: float = 0.0
    tone_hz: float = 4900.0

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
        for name in ("hum_m", "mains_hz", "tone_m", "tone_hz"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"beyond.{name} must not be negative, not {getattr(self, name):g}")
        if not -1 < self.side_difference < 1:
            raise ValueError(f"beyond.side_difference must lie between -1 and 1, not {self.side_difference:g}")

    def interference_m(self, t: Array) -> Array:
        """Hum and tone on the laser's signal at bench times `t`, (n,)."""
        out = np.zeros_like(t)
        for order, share in HUM_HARMONICS.items() if self.hum_m else ():
            out += share * self.hum_m * np.sin(2 * np.pi * order * self.mains_hz * t + order)
        return out + self.tone_m * np.sin(2 * np.pi * self.tone_hz * t) if self.tone_m else out

    def actual_mass_kg(self, nominal_kg: float, seed: int) -> float:
        """What a weight of a nominal mass really has."""
        if not self.weight_error:
            return nominal_kg
        by = float(np.random.default_rng((seed, round(1e9 * nominal_kg))).normal())
        return nominal_kg * (1 + self.weight_error * by)
