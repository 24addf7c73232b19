"""Aspects of the protocol `mass-resonance`."""

from collections.abc import Iterator

import numpy as np

from model.identification import MassResonanceObservation, Observation
from protocols.aspects.run_points import RunPoints
from protocols.aspects.running_sweep import RunningSweepAspects
from protocols.base import ImportColumn, ImportForm


class MassResonanceAspects(RunningSweepAspects):
    """Mass resonance beside its measurement."""

    import_form = ImportForm(
        columns=(
            ImportColumn("mass", "kg", "added mass", ("m", "addedmass", "masse"), (1e-5, 0.1), 0.0),
            ImportColumn("frequency", "Hz", "where the response is largest: the paper's resonance", ("f", "fres", "resonancefrequency", "peakfrequency", "freq", "frequenz"), (1.0, 2000.0), 0.0, True),
            ImportColumn("resonance", "Hz", "undamped natural frequency", ("naturalfrequency", "undampedfrequency", "eigenfrequency"), (1.0, 2000.0), 0.0, True),
        ),
        required=(("mass",), ("frequency", "resonance")),
        input_uncertainties={"mass": "kg"},
        rising=True,
    )  # fmt: skip

    short_name = "resonance"

    def observations(self, points: RunPoints) -> Iterator[Observation]:
        columns = points.columns
        peak = (
            "frequency" if np.isfinite(columns["frequency"]).any() else "resonance"
        )  # a table may have the latter only
        frequency, errors = columns[peak], columns[f"{peak}_errors"]
        good = points.good & (errors > 0) & np.isfinite(frequency)
        yield MassResonanceObservation(
            points.label,
            columns["mass"],
            frequency,
            errors,
            meaning="peak" if peak == "frequency" else "undamped",
            good=good,
            shared_errors=points.input_errors("mass", "mass", good, f"{points.label}, mass of {{}} kg"),
            simulated=points.run.simulated,
        )


ASPECTS = MassResonanceAspects()
