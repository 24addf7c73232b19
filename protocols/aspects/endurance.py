"""Aspects of the protocol `endurance`: changes of the figures over the cycles, and the range of the displacement of each block."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from model import SeriesAxis, quantity_label
from protocols.base import Aspects, Figure, ResultTable, RunFigure

if TYPE_CHECKING:
    from protocols.aspects.run_points import RunPoints


class EnduranceAspects(Aspects):
    """Drift over cycles."""

    def figures(self, points: RunPoints) -> Iterator[Figure]:
        """Yield the changes, each figure of the snapshots, and the range of the displacement, over the cycles."""
        if series := points.run.series():
            yield Figure(series, "Change over cycles")
        x = SeriesAxis("cycles", "1", "cycles")
        snapshots = np.isnan(points.columns["rms"])
        for name, unit, text in (
            ("natural_frequency", "Hz", "natural frequency"),
            ("damping", "1", "damping ratio"),
            ("gain", "m/V", "gain"),
            ("capacitance", "F", "capacitance"),
        ):
            if np.isfinite(points.columns[name]).any():
                yield Figure((points.series(x, SeriesAxis(name, unit, text), "snapshots", snapshots),))
        if not snapshots.all():
            rms = SeriesAxis("rms", "m", "root mean square of the displacement")
            yield Figure((points.series(x, rms, "blocks", ~snapshots),))

    def result_tables(self, run_name: str, figures: Sequence[RunFigure]) -> Iterator[ResultTable]:
        """Yield the table of the cycles and of the first and the last snapshot."""
        rows = tuple(
            (quantity_label(f.name), f) for f in figures if f.name.startswith("cycles") or "snapshot" in f.name
        )
        if rows:
            yield ResultTable(
                f"Endurance ({run_name})", ("figure", "value"), rows, "± standard uncertainty, statistical."
            )


ASPECTS = EnduranceAspects()
