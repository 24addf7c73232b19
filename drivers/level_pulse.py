"""Level pulse: a held level as a finite waveform, which begins and ends at rest."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, slots=True)
class LevelPulse:
    """A level reached from rest by a straight line in `rise_s`, held for `hold_s`, and left for rest in `rise_s`.

    The form of a `Hold` that must end at rest without a further command.
    """

    kind: ClassVar[str] = "Hold"
    rest_v: float
    level_v: float
    hold_s: float
    rise_s: float

    @property
    def duration_s(self) -> float:
        """Duration, s."""
        return self.hold_s + 2 * self.rise_s

    @property
    def low_v(self) -> float:
        """Lowest level."""
        return min(self.rest_v, self.level_v)

    @property
    def high_v(self) -> float:
        """Highest level."""
        return max(self.rest_v, self.level_v)

    @property
    def end_levels_v(self) -> tuple[float, float]:
        """Levels at the start and at the end."""
        return self.rest_v, self.rest_v

    @property
    def slew_v_per_s(self) -> float:
        """Largest slope, V/s."""
        return abs(self.level_v - self.rest_v) / self.rise_s

    def volts(self, t: ArrayLike) -> NDArray[np.float64]:
        """Return the volts at the times `t` after the start, an array of the shape of `t`; 0 to `duration_s`."""
        knots = [0.0, self.rise_s, self.rise_s + self.hold_s, self.duration_s]
        return np.asarray(
            np.interp(np.asarray(t, float), knots, [self.rest_v, self.level_v, self.level_v, self.rest_v])
        )
