"""Aspects of the protocol `membrane-series`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from model import SeriesAxis
from protocols.aspects.sine_dwell import (
    INPUT_UNCERTAINTIES,
    MEASURED_COLUMNS,
    amplitude_model,
    complete_dwell,
    dwell_observation,
)
from protocols.base import Aspects, Figure, ImportedTable, ImportForm

if TYPE_CHECKING:
    from model.identification import Observation
    from protocols.aspects.run_points import RunPoints


class MembraneSeriesAspects(Aspects):
    """Membrane series beside its measurement."""

    import_form = ImportForm(required=(("frequency",), MEASURED_COLUMNS), input_uncertainties=INPUT_UNCERTAINTIES)

    short_name = "membrane"

    def figures(self, points: RunPoints) -> Iterator[Figure]:
        """Yield max - min over frequency at each elongation, with the curve of the model."""
        series, models = [], {}
        x, y = SeriesAxis("frequency", "Hz"), SeriesAxis("peak_to_peak", "m", "peak-to-peak displacement of the centre")
        for part in np.unique(points.columns["part"]):
            at = points.columns["part"] == part
            elongation = float(points.columns["elongation"][at][0])
            free = np.isnan(elongation)
            label = "free" if free else f"{1e3 * elongation:.2f} mm"
            series.append(points.series(x, y, label, at))
            models[label] = amplitude_model(points, None if free else elongation)
        grid = np.linspace(5.0, 1.05 * max(float(points.columns["frequency"].max(initial=0.0)), 100.0), 300)
        yield Figure(tuple(series), models=models, grid=grid, from_zero=True, has_threshold=True)

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
