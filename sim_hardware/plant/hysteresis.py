"""Hysteresis of the specimen's voltage: plays of evenly spaced widths (Prandtl-Ishlinskii), a Rayleigh loop.

Macro fiber composites are described by Preisach's model (Xue et al. 2016, "Hysteresis and the nonlinear equivalent piezoelectric
coefficient of MFCs for actuation") and by plays in parallel, the generalized Maxwell slip model (doi:10.1177/1045389X12460337). With
an even distribution of the widths both are Rayleigh's law: from each turning point on the response is a parabola, and a closed loop
is forgotten.
"""

from typing import Any

import numpy as np

from model import Array

PLAY_SPACING_V = 25.0
"""Of the half widths of the plays, which are 12.5 V, 37.5 V and so on: half the voltage that must be turned back before each turns."""
PLAY_COUNT = 50


class HysteresisModel:
    """Plays in parallel beside what follows the voltage at once.

    After a turning point each play rests until the voltage has changed by its width, and then follows, until the voltage is
    back at the turning point before and the loop is closed. At the start the specimen has been driven over its whole range
    before, and came to rest from the lower end, as a sine does.

    Args:
        width: of the loop in the middle of the whole stroke, as a share of the stroke.
        low_v, high_v: the whole range of the specimen's voltage.
    """

    def __init__(self, width: float, low_v: float, high_v: float) -> None:
        # from a turning point on a loop is weight * (change of voltage)^2 / (4 * spacing), so its width in the middle is
        # weight * ((high - low) / 2)^2 / (2 * spacing)
        span_v = high_v - low_v
        self._weight = width * span_v * 2 * PLAY_SPACING_V / (span_v / 2) ** 2
        self._turned = [(high_v, 0.0), (low_v, -float(_sum_of_plays(np.float64(span_v))))]
        """Turning points not forgotten, with the sum of the plays there; the last began the present branch."""
        self._way, self._last_v = 1.0, 0.0
        self._offset_v = self._weight * self._plays_at(0.0)

    def process(self, volts: Array) -> Array:
        """Return the voltage (n,) to which the specimen answers."""
        if not self._weight:
            return volts
        change = np.diff(volts, prepend=self._last_v)
        moves = np.flatnonzero(change)
        turns = moves[1:][np.diff(np.sign(change[moves])) != 0]
        branches: list[tuple[int, float, float, float]] = []  # first sample, turning point, plays there, way
        begin = 0
        for end in [*turns.tolist(), volts.size]:  # one way only from turn to turn
            last = float(volts[end - 1])
            way = self._way if last == self._last_v else 1.0 if last > self._last_v else -1.0
            if way != self._way:
                self._turned.append((self._last_v, self._plays_at(self._last_v)))
                self._way = way
            while len(self._turned) > 2 and way * last > way * self._turned[-2][0]:
                branches.append((begin, *self._turned[-1], way))
                begin += int(np.searchsorted(way * volts[begin:end], way * self._turned[-2][0], side="right"))
                del self._turned[-2:]  # the loop is closed and forgotten
            branches.append((begin, *self._turned[-1], way))
            self._last_v, begin = last, end
        starts, turned_v, plays, ways = np.array(branches).T
        counts = np.diff(np.append(starts, volts.size)).astype(int)
        moved = _sum_of_plays(np.abs(volts - np.repeat(turned_v, counts)))
        return np.asarray(
            volts + self._weight * (np.repeat(plays, counts) + np.repeat(ways, counts) * moved) - self._offset_v
        )

    def _plays_at(self, volts: float) -> float:
        """Return the sum of the plays on the present branch."""
        turned_v, plays = self._turned[-1]
        return plays + self._way * float(_sum_of_plays(np.float64(abs(volts - turned_v))))


def _sum_of_plays(change_v: Any) -> Any:
    """Return the sum of what the plays have moved since the voltage turned and changed by so much."""
    following = np.minimum(np.rint(change_v / (2 * PLAY_SPACING_V)), PLAY_COUNT)
    return following * (change_v - PLAY_SPACING_V * following)
