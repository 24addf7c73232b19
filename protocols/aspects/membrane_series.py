"""Aspects of the protocol `membrane-series`."""

from collections.abc import Iterator

import numpy as np

from model.identification import Observation
from protocols.aspects.run_points import RunPoints
from protocols.aspects.sine_dwell import (
    INPUT_UNCERTAINTIES,
    MEASURED_COLUMNS,
    complete_dwell,
    dwell_observation,
)
from protocols.base import Aspects, ImportedTable, ImportForm


class MembraneSeriesAspects(Aspects):
    """Membrane series beside its measurement."""

    import_form = ImportForm(required=(("frequency",), MEASURED_COLUMNS), input_uncertainties=INPUT_UNCERTAINTIES)

    short_name = "membrane"

    def observations(self, points: RunPoints) -> Iterator[Observation]:
        """Yield one response for each elongation and each free reference."""
        for part in dict.fromkeys(points.columns["part"].tolist()):
            mine = points.take(points.columns["part"] == part)
            elongation = float(mine.columns["elongation"][0])
            free = np.isnan(elongation)
            name = f"{part:.0f} free" if free else f"{part:.0f} at {1e3 * elongation:g} mm"
            if mine.good.any():
                yield dwell_observation(mine, f"{points.label} {name}", None if free else elongation)

    def complete_table(self, table: ImportedTable) -> None:
        complete_dwell(table)


ASPECTS = MembraneSeriesAspects()
