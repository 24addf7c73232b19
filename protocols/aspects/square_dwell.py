"""Aspects of the protocol `square-dwell`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from protocols.aspects.sine_dwell import amplitude_figure
from protocols.base import Aspects, Figure

if TYPE_CHECKING:
    from protocols.aspects.run_points import RunPoints


class SquareDwellAspects(Aspects):
    """Square dwell beside its measurement."""

    def figures(self, points: RunPoints) -> Iterator[Figure]:
        """Yield both amplitudes, beside the model's amplitudes under a sine of the same volts."""
        yield amplitude_figure(points)


ASPECTS = SquareDwellAspects()
