"""Aspects of the protocol `square-dwell`."""

from collections.abc import Iterator

from protocols.aspects.run_points import RunPoints
from protocols.aspects.sine_dwell import amplitude_figure
from protocols.base import Aspects, Figure


class SquareDwellAspects(Aspects):
    """Square dwell beside its measurement."""

    def figures(self, points: RunPoints) -> Iterator[Figure]:
        """Yield both amplitudes, beside the model's amplitudes under a sine of the same volts."""
        yield amplitude_figure(points)


ASPECTS = SquareDwellAspects()
