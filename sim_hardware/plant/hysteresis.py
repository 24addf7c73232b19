"""Hysteresis of the specimen's voltage: plays of evenly spaced widths (Prandtl-Ishlinskii), a Rayleigh loop.

Macro fiber composites are described by Preisach's model (Xue et al. 2016, "Hysteresis and the nonlinear equivalent piezoelectric
coefficient of MFCs for actuation") and by plays in parallel, the generalized Maxwell slip model (doi:10.1177/1045389X12460337). With
an even distribution of the widths both are Rayleigh's law: from each turning point on the response is a parabola, and a closed loop
is forgotten.
"""

import numpy as np

from model import Array

PLAY_SPACING_V = 25.0
PLAY_HALF_WIDTHS_V = PLAY_SPACING_V * (np.arange(50) + 0.5)
"""Half the voltage that must be turned back before each play turns."""
PLAY_COUNTS = np.arange(PLAY_HALF_WIDTHS_V.size + 1)


class HysteresisModel:
    """Plays in parallel beside what follows the voltage at once.

    At the start the specimen has been driven over its whole range before, and came to rest from the lower end, as a sine does.

    Args:
        width: of the loop in the middle of the whole stroke, as a share of the stroke.
        low_v, high_v: the whole range of the specimen's voltage.
    """

    def __init__(self, width: float, low_v: float, high_v: float) -> None:
        # from a turning point on a loop is weight * (change of voltage)^2 / (4 * spacing), so its width in the middle is
        # weight * ((high - low) / 2)^2 / (2 * spacing)
        span_v = high_v - low_v
        self._weight = width * span_v * 2 * PLAY_SPACING_V / (span_v / 2) ** 2
        self._plays_v = np.zeros(PLAY_HALF_WIDTHS_V.size)
        self._offset_v = self._last_v = 0.0
        if width:
            self._offset_v = float(self.process(np.array([high_v, low_v, 0.0]))[-1])

    def process(self, volts: Array) -> Array:
        """Return the voltage (n,) to which the specimen answers."""
        if not self._weight:
            return volts
        change = np.diff(volts, prepend=self._last_v)
        moves = np.flatnonzero(change)
        turns = moves[1:][np.diff(np.sign(change[moves])) != 0]
        out = np.empty_like(volts)
        r, begin = PLAY_HALF_WIDTHS_V, 0
        for end in [*turns.tolist(), volts.size]:  # one way only from turn to turn
            last = float(volts[end - 1])
            way = 1.0 if last >= self._last_v else -1.0
            part, plays = way * volts[begin:end], way * self._plays_v
            # each play rests until the voltage has come to it, and then follows: their sum gets steeper at each of these knots
            met = np.sort(plays + r)
            knots = np.append(met, max(met[-1], way * last) + 1.0)
            moved = PLAY_COUNTS * knots
            moved[1:] -= np.cumsum(met)
            out[begin:end] = way * (plays.sum() + np.interp(part, knots, moved))
            self._plays_v = way * np.maximum(plays, way * last - r)
            self._last_v, begin = last, end
        return np.asarray(volts + self._weight * out - self._offset_v)
