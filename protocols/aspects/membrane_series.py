"""Aspects of the protocol `membrane-series`."""

from collections.abc import Iterator

import numpy as np

from model.identification import Observation
from protocols.aspects.run_points import RunPoints
from protocols.aspects.sine_dwell import SineDwellAspects, dwell_observation
from protocols.base import Aspects


class MembraneSeriesAspects(SineDwellAspects):
    """Membrane series beside its measurement."""

    short_name = "membrane"
    run_figures = Aspects.run_figures

    def observations(self, points: RunPoints) -> Iterator[Observation]:
        """Yield one response for each elongation and each free reference."""
        for part in dict.fromkeys(points.columns["part"].tolist()):
            mine = points.take(points.columns["part"] == part)
            elongation = float(mine.columns["elongation"][0])
            free = np.isnan(elongation)
            name = f"{part:.0f} free" if free else f"{part:.0f} at {1e3 * elongation:g} mm"
            if mine.good.any():
                yield dwell_observation(mine, f"{points.label} {name}", None if free else elongation)


ASPECTS = MembraneSeriesAspects()
