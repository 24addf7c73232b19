"""Aspects of the protocol `electrical`: loops of charge over voltage, capacitance and loss over frequency, leakage over voltage."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from model import SeriesAxis, quantity_label
from protocols.base import Aspects, Figure, ResultTable, RunFigure

if TYPE_CHECKING:
    from protocols.aspects.run_points import RunPoints

DATA_SHEET = (
    "± total standard uncertainty. Smart Material states about 0.30 nF/cm² for an MFC of type P1 at 1 kHz: 1.2 nF for the 28 x 14 mm "
    "of an M2814-P1. Bending adds to the capacitance below resonance."
)


class ElectricalAspects(Aspects):
    """Electrical figures beside their measurement."""

    def figures(self, points: RunPoints) -> Iterator[Figure]:
        """Yield loops, capacitance and loss over frequency for each drive, and leakage over voltage."""
        yield Figure(lines=points.run.series())
        columns = points.columns
        sines = columns["frequency"] > 0
        x = SeriesAxis("frequency", "Hz", "frequency")
        for name, unit, text, title in (
            ("capacitance", "F", "parallel capacitance", "Capacitance over frequency"),
            ("loss", "1", "loss factor", ""),
        ):
            y = SeriesAxis(name, unit, text)
            yield Figure(
                tuple(
                    points.series(x, y, f"{drive:g} V", sines & (columns["drive"] == drive))
                    for drive in np.unique(columns["drive"][sines]).tolist()
                ),
                title,
            )
        if not sines.all():
            axes = SeriesAxis("voltage", "V", "voltage held"), SeriesAxis("leakage", "A", "leakage current")
            yield Figure((points.series(*axes, "held", ~sines),))

    def result_tables(self, run_name: str, figures: Sequence[RunFigure]) -> Iterator[ResultTable]:
        """Yield the table of the electrical figures."""
        names = ("capacitance", "loss_factor", "energy_per_cycle", "leakage_current", "insulation_resistance")
        rows = tuple((quantity_label(f.name), f) for f in figures if f.name.startswith(names))
        if rows:
            yield ResultTable(f"Electrical figures ({run_name})", ("figure", "value"), rows, DATA_SHEET)


ASPECTS = ElectricalAspects()
