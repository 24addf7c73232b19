"""Aspects of the protocol `free-decay`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from model import identification
from protocols.base import Aspects

if TYPE_CHECKING:
    from model.identification import Observation
    from protocols.aspects.run_points import RunPoints


class FreeDecayAspects(Aspects):
    """Free decay beside its measurement."""

    def observations(self, points: RunPoints) -> Iterator[Observation]:
        names = ("natural_frequency", "natural_frequency_errors", "damping", "damping_errors")
        values = tuple(points.columns[name] for name in names)
        frequency, errors, damping, damping_errors = values
        good = points.good & np.isfinite(frequency) & np.isfinite(damping)
        good &= (errors > 0) & (damping_errors > 0) & (damping < 1)
        if good.any():
            filled = (np.where(good, column, 0.5) for column in values)
            yield identification.DecayPoleObservation(points.label, *filled, good=good, **points.common_arguments())


ASPECTS = FreeDecayAspects()
