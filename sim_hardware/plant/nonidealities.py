"""Nonidealities that the model lacks: creep, hysteresis, drift, a compliant clamp. All off by default.

They test whether a measurement detects them.
"""

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from model import Array, Complex

N = TypeVar("N", Array, Complex)

VOLTAGE_SPAN_V = 2000.0
"""The whole stroke of the specimen's voltage, of which a loop's width is a share."""
BACKLASH_V = 250.0
"""Half the voltage that must be turned back before the hysteresis has turned its own way."""
HUM_HARMONICS = {1: 1.0, 2: 0.3, 3: 0.5, 5: 0.2}
"""Amplitude of each order of the mains hum over that of the first."""
CREEP_TIME_CONSTANTS_S = np.logspace(-1, 5, 13)
"""Time constants of the creep, two a decade: their sum follows the logarithm of time from 0.1 s to a day."""


@dataclass(frozen=True, slots=True)
class Nonidealities:
    """What lies beyond the model; 0 leaves it out.

    Attributes:
        creep_per_decade: what a step of voltage or weight gains per decade of time, as a share of the step.
        hysteresis_width: width of the displacement's loop against the voltage, as a share of the whole stroke.
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


def linear_recursion(advance: N, state: N, inputs: Any) -> N:
    """Return all states of z' = advance z + input, shape (n + 1, m), from `state` on: by doubling, in log2 n steps."""
    states = np.concatenate((state[None], inputs))
    reach, power = 1, advance
    while reach < len(states):
        states[reach:] += power * states[:-reach]
        reach, power = 2 * reach, power * power
    return states


class CreepModel:
    """Logarithmic creep of one drive: it gains a share of every step per decade of time, block by block."""

    def __init__(self, per_decade: float, block_s: float) -> None:
        self._step_share = per_decade * float(np.log10(CREEP_TIME_CONSTANTS_S[1] / CREEP_TIME_CONSTANTS_S[0]))
        self._block_decay = np.exp(-block_s / CREEP_TIME_CONSTANTS_S)
        self._lag_states = np.zeros(CREEP_TIME_CONSTANTS_S.size)

    def process(self, blocks: Array) -> Array:
        """The drive (n, BLOCK) with what has crept on so far."""
        if not self._step_share or not (blocks.any() or self._lag_states.any()):
            return blocks
        crept = self._advance_blocks(blocks.mean(axis=1))
        rise = (np.arange(blocks.shape[1]) + 1) / blocks.shape[1]
        return np.asarray(blocks + self._step_share * (crept[:-1, None] + np.diff(crept)[:, None] * rise))

    def crept(self, drive: float) -> float:
        """Return a drive with what has crept on until now."""
        return drive + self._step_share * float(self._lag_states.sum())

    def hold(self, drive: float, blocks: int) -> Array:
        """Return a constant drive with what has crept on at the edges of the next blocks, (blocks + 1,)."""
        if not self._step_share or not (drive or self._lag_states.any()):
            return np.full(blocks + 1, drive)
        return drive + self._step_share * self._advance_blocks(np.full(blocks, drive))

    def _advance_blocks(self, means: Array) -> Array:
        """Return the sum of the lags at the edges of blocks with these mean drives, (n + 1,)."""
        states = linear_recursion(self._block_decay, self._lag_states, (1 - self._block_decay) * means[:, None])
        self._lag_states = states[-1].copy()
        return np.asarray(states.sum(axis=1))

    def advance(self, drive: float, gap_s: float) -> None:
        """Advance by `gap_s` of constant drive."""
        self._lag_states = drive + (self._lag_states - drive) * np.exp(-gap_s / CREEP_TIME_CONSTANTS_S)


class HysteresisModel:
    """One play: the part of the voltage that follows only after `BACKLASH_V` either way."""

    def __init__(self, width: float) -> None:
        self._backlash_share = width * VOLTAGE_SPAN_V / (2 * BACKLASH_V)
        self._backlash_output_v = 0.0

    def process(self, volts: Array) -> Array:
        """The voltage (n,) as the specimen answers to it."""
        if not self._backlash_share:
            return volts
        out = np.empty_like(volts)
        turns = np.flatnonzero(np.diff(np.sign(np.diff(volts)))) + 1
        begin = 0
        for end in [*(turns + 1).tolist(), volts.size]:  # one way only from turn to turn
            part = volts[begin:end]
            if part.size:
                first = min(max(self._backlash_output_v, part[0] - BACKLASH_V), part[0] + BACKLASH_V)
                out[begin:end] = np.maximum(np.minimum(first, part + BACKLASH_V), part - BACKLASH_V)
                self._backlash_output_v = float(out[end - 1])
            begin = end
        return volts + self._backlash_share * (out - volts)
