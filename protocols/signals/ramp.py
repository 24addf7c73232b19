"""The ramp from one held level to another, found in the recorded drive: when it began, when it ended, and between what."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEAR_SHARE = 0.01
"""Of the step: as near as that counts as there, if noise is less."""

NOISE_FACTOR = 5.0


@dataclass(frozen=True, slots=True)
class Ramped:
    """A ramp in a record; times from its first sample.

    Attributes:
        begin_s, end_s: the last moment at the old level, the first at the new one. Equal where nothing moved.
        before_v, level_v: the two levels.
    """

    begin_s: float
    end_s: float
    before_v: float
    level_v: float

    @property
    def duration_s(self) -> float:
        """How long the way took."""
        return self.end_s - self.begin_s

    def effective_s(self, since_s: Array) -> Array:
        """Times since an ideal step that would have crept as far as the ramp did by `since_s` after its end.

        What creeps as the logarithm of time under a step, creeps under a straight ramp as its average over the ramp:
        ln t_eff = ((t + T) ln (t + T) - t ln t) / T - 1 for a ramp of T that ended t ago.
        """
        ramp = self.duration_s
        if ramp <= 0:
            return since_s
        whole = since_s + ramp
        return np.asarray(np.exp((whole * np.log(whole) - since_s * np.log(since_s)) / ramp - 1))


def find_ramp(drive_v: Array, rate_hz: float, held_s: float, rest_s: float) -> Ramped:
    """The one ramp of a record that begins with at least `rest_s` at one level and ends with `held_s` at another.

    Args:
        drive_v: (N,), volts.
        rate_hz: samples per second.
        held_s: how much of its end surely is at a level.
        rest_s: how much of its begin surely is.

    Raises:
        ValueError: the record is shorter than that.
    """
    first, last = round(rest_s * rate_hz), round(held_s * rate_hz)
    if first < 2 or last < 4 or first + last > drive_v.size:
        raise ValueError(
            f"a record of {drive_v.size / rate_hz:g} s holds no {rest_s:g} s of rest and {held_s:g} s of level"
        )
    before, after = drive_v[:first], drive_v[-(last // 2) :]
    before_v, level_v = float(before.mean()), float(after.mean())
    step_v = level_v - before_v
    noise_v = max(float(before.std()), float(after.std()))
    near_v = max(NOISE_FACTOR * noise_v, NEAR_SHARE * abs(step_v))
    if abs(step_v) <= 2 * near_v:  # a level that is rest itself: taken to begin where the hold does
        at_s = (drive_v.size - last) / rate_hz
        return Ramped(at_s, at_s, before_v, level_v)
    half = int(np.argmax(np.sign(step_v) * (drive_v - before_v) > abs(step_v) / 2))
    left = np.flatnonzero(np.abs(drive_v[:half] - before_v) <= near_v)
    reached = np.flatnonzero(np.abs(drive_v[half:] - level_v) <= near_v)
    begin_s, end_s = float(left[-1] + 1) / rate_hz, float(half + reached[0]) / rate_hz
    # As near as can be told from noise is a little inside the ramp: the straight line is drawn out to its ends.
    inside_s = (end_s - begin_s) * near_v / (abs(step_v) - 2 * near_v)
    return Ramped(max(begin_s - inside_s, 0.0), end_s + inside_s, before_v, level_v)
