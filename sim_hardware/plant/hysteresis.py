"""Hysteresis of the specimen's voltage: plays of evenly spaced widths (Prandtl-Ishlinskii), a Rayleigh loop.

Macro fiber composites are described by Preisach's model (Xue et al. 2016, "Hysteresis and the nonlinear equivalent piezoelectric
coefficient of MFCs for actuation") and by plays in parallel, the generalized Maxwell slip model (doi:10.1177/1045389X12460337). With
an even distribution of the widths both are Rayleigh's law: from each turning point on the response is a parabola, and a closed loop
is forgotten.
"""

import numpy as np

from model import Array

PLAY_SPACING_V = 5.0
"""Spacing of the half widths of the plays, 2.5 V, 7.5 V and so on: half the voltage change after which a play follows a turn."""
PLAY_COUNT = 250


class HysteresisModel:
    """Plays in parallel with an immediate response.

    After a turning point each play rests until the voltage has changed by its width, and then follows, until the voltage returns
    to the previous turning point and the loop is closed. The initial state is rest reached from the lower end of the whole range,
    like the end of a sine.

    Args:
        width: width of the loop in the middle of the whole stroke, as a share of the stroke.
        low_v, high_v: the whole range of the specimen's voltage.
    """

    def __init__(self, width: float, low_v: float, high_v: float) -> None:
        # from a turning point on a loop is weight * (change of voltage)^2 / (4 * spacing), so its width in the middle is
        # weight * ((high - low) / 2)^2 / (2 * spacing)
        span_v = high_v - low_v
        self._weight = width * span_v * 2 * PLAY_SPACING_V / (span_v / 2) ** 2
        self._turned = [(high_v, 0.0), (low_v, -_sum_of_plays(span_v))]
        """Remembered turning points with the sum of the plays; the last is the begin of the present branch."""
        self._way, self._last_v = 1.0, 0.0
        self._offset_v = self._weight * self._plays_at(0.0)

    def process(self, volts: Array) -> Array:
        """Return the voltage (n,) effective in the specimen."""
        if not self._weight:
            return volts
        if volts.size == 1:
            return np.array([self._answer(float(volts[0]))])
        starts, turned_v, plays = self._branches(volts)
        counts = np.diff(np.append(starts, volts.size))
        moved: Array = volts - np.repeat(turned_v, counts)
        following = moved * (0.5 / PLAY_SPACING_V)
        np.rint(following, out=following)
        np.clip(following, -PLAY_COUNT, PLAY_COUNT, out=following)
        moved -= PLAY_SPACING_V * following
        np.abs(following, out=following)
        moved *= following
        moved *= self._weight
        moved += np.repeat(self._weight * np.array(plays) - self._offset_v, counts)
        moved += volts
        return moved

    def _branches(self, volts: Array) -> tuple[list[int], list[float], list[float]]:
        """Advance over `volts`; return the begin of each branch, its turning point, and the plays at it."""
        starts, turned_v, plays = [], [], []
        ends = [*_turns(volts, self._last_v), volts.size]  # one direction only from turn to turn
        turned, way, last_v, begin = list(self._turned), self._way, self._last_v, 0
        top_v, top_plays = turned[-1]
        for end, next_v, before_v in zip(ends, *(volts[np.array(ends) - k].tolist() for k in (1, 2)), strict=True):
            if next_v != last_v and (next_v > last_v) != (way > 0):
                top_v, top_plays = last_v, top_plays + way * _sum_of_plays(abs(last_v - top_v))
                turned.append((top_v, top_plays))
                way = -way
            while len(turned) > 2 and (next_v > turned[-2][0] if way > 0 else next_v < turned[-2][0]):
                starts.append(begin)
                turned_v.append(top_v)
                plays.append(top_plays)
                closing_v = turned[-2][0]
                if end - begin > 1 and (before_v <= closing_v if way > 0 else before_v >= closing_v):
                    begin = end - 1  # passed by the last sample before the turn, as in most sines of constant amplitude
                else:
                    begin += _count_until(volts[begin:end], closing_v, way)
                del turned[-2:]  # the loop is closed and forgotten
                top_v, top_plays = turned[-1]
            starts.append(begin)
            turned_v.append(top_v)
            plays.append(top_plays)
            last_v, begin = next_v, end
        self._turned, self._way, self._last_v = turned, way, last_v
        return starts, turned_v, plays

    def _answer(self, volts: float) -> float:
        """Return `process` of a single voltage."""
        if volts != self._last_v:
            self._branches(np.array([volts]))
        return volts + self._weight * self._plays_at(volts) - self._offset_v

    def _plays_at(self, volts: float) -> float:
        """Return the sum of the plays on the present branch."""
        turned_v, plays = self._turned[-1]
        return plays + self._way * _sum_of_plays(abs(volts - turned_v))


def _sum_of_plays(change_v: float) -> float:
    """Return the sum of the plays' movements since the turn of the voltage, after this change."""
    following = min(round(change_v / (2 * PLAY_SPACING_V)), PLAY_COUNT)
    return following * (change_v - PLAY_SPACING_V * following)


def _turns(volts: Array, before_v: float) -> list[int]:
    """Return the first samples at which the voltage, from `before_v`, moves in the other direction."""
    change = np.diff(volts, prepend=before_v)
    rises = change > 0
    if change.all():
        turns = np.flatnonzero(rises[1:] != rises[:-1]) + 1
    else:
        moves = np.flatnonzero(change)
        turns = moves[1:][np.diff(rises[moves])]
    return [int(turn) for turn in turns.tolist()]


def _count_until(volts: Array, level_v: float, way: float) -> int:
    """Return the number of samples of a monotonic stretch before a level."""
    if way > 0:
        return int(volts.searchsorted(level_v, side="right"))
    return volts.size - int(volts[::-1].searchsorted(level_v, side="left"))
