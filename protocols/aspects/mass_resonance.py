"""Aspects of the protocol `mass-resonance`."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from model import Array, SeriesAxis, identification
from protocols.aspects.running_sweep import RunningSweepAspects
from protocols.base import Figure, ImportColumn, ImportForm, ModelState

if TYPE_CHECKING:
    from model.identification import Observation
    from protocols.aspects.run_points import RunPoints


class MassResonanceAspects(RunningSweepAspects):
    """Mass resonance beside its measurement."""

    import_form = ImportForm(
        columns=(
            ImportColumn("mass", "kg", "added mass", ("m", "addedmass", "masse"), (1e-5, 0.1), 0.0),
            ImportColumn("frequency", "Hz", "frequency of the largest response: the paper's resonance", ("f", "fres", "resonancefrequency", "peakfrequency", "freq", "frequenz"), (1.0, 2000.0), 0.0, True),
            ImportColumn("natural_frequency", "Hz", "undamped natural frequency", ("undampedfrequency", "eigenfrequency"), (1.0, 2000.0), 0.0, True),
        ),
        required=(("mass",), ("frequency", "natural_frequency")),
        ambiguous={"resonance": ("frequency", "natural_frequency")},
        input_uncertainties={"mass": "kg"},
        rising=True,
    )  # fmt: skip

    short_name = "resonance"

    def model_curve(self, state: ModelState, x: Array) -> Array:
        """Return the frequency of the largest response to a sine for each added mass."""
        return _resonance(state, x, peak=True)

    def figures(self, points: RunPoints) -> Iterator[Figure]:
        """Yield the resonance frequency against the added mass, with the peak of the model's response."""
        name = _frequency_column(points)
        x, y = SeriesAxis("mass", "kg", "added mass"), SeriesAxis(name, "Hz", "resonance")
        meaning = "peak of the displacement's spectrum" if name == "frequency" else "natural frequency"
        model = partial(_resonance, peak=name == "frequency")
        title = "Fig. 5: resonance against added mass"
        yield Figure((points.series(x, y),), title, f"Frequency of the {meaning}.", model)

    def observations(self, points: RunPoints) -> Iterator[Observation]:
        columns, peak = points.columns, _frequency_column(points)
        frequency, errors = columns[peak], columns[f"{peak}_errors"]
        good = points.good & (errors > 0) & np.isfinite(frequency)
        masses = points.input_errors("mass", "mass", good, f"{points.label}, mass of {{}} kg")
        yield identification.MassResonanceObservation(
            points.label,
            columns["mass"],
            frequency,
            errors,
            meaning="peak" if peak == "frequency" else "undamped",
            good=good,
            **points.common_arguments() | {"shared_errors": masses},
        )


def _frequency_column(points: RunPoints) -> str:
    """Return the column of the largest response; of the fitted mode if a table has no other."""
    return "frequency" if np.isfinite(points.columns["frequency"]).any() else "natural_frequency"


def _resonance(state: ModelState, mass_kg: Array, peak: bool) -> Array:
    acting, damped = state.acting_mass(mass_kg), np.full(mass_kg.size, peak)
    return identification.resonance_frequencies(state.specimen.acting_tactor, acting, damped, state.shape_count)[0]


ASPECTS = MassResonanceAspects()
