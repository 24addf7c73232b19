"""Figures of a protocol as data: measured series over one axis, with the curve of the model and what to compare with."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from model import AmplifierMap, Array, Series, Specimen


@dataclass(frozen=True, slots=True)
class ModelState:
    """A specimen and the other inputs of a model curve.

    Attributes:
        shape_count: number of shape functions.
        mass_fraction, mass_offset_kg: share and offset of the masses put in the cylinder that act at the centre.
    """

    specimen: Specimen = field(default_factory=Specimen)
    amplifier: AmplifierMap = field(default_factory=AmplifierMap)
    shape_count: int = 5
    mass_fraction: float = 1.0
    mass_offset_kg: float = 0.0

    def acting_mass(self, mass_kg: Array) -> Array:
        """Return the masses that act at the centre, of those put in the cylinder, (N,)."""
        return self.mass_fraction * mass_kg + self.mass_offset_kg

    def crept(self, time_s: float) -> float:
        """Return the factor of a deflection that creeps for so long after its step."""
        from model.response import REFERENCE_S  # slow to import

        return 1 + self.specimen.creep * float(np.log10(time_s / REFERENCE_S))


ModelFunction = Callable[[ModelState, Array], Array | None]
"""Returns y over x by the model, (N,), SI; None where there is none."""


class ReferenceSpan(NamedTuple):
    """A range of y to compare with, SI."""

    low: float
    high: float
    label: str


@dataclass(frozen=True, slots=True)
class Figure:
    """Series of a run over one axis.

    Attributes:
        points: drawn with symbols and error bars; a series without a label is named after its run.
        title: in the report of a specimen, where the figures of one title of all runs are one; empty: in the run's picture only.
        caption: for the report.
        model: curve of the model, drawn over `grid`, by default over the range of the points.
        models: curves of the model for the points of a label.
        has_threshold: the threshold of perception, in µm over Hz, is drawn.
        lines: drawn as lines.
        levels: of y to compare with.
        spans: ranges of y to compare with.
        from_zero: the axis of y begins at zero.
        log_limits: of a logarithmic axis of y.
        markers: symbols by label; others in turn.
    """

    points: tuple[Series, ...] = ()
    title: str = ""
    caption: str = ""
    model: ModelFunction | None = None
    grid: Array | None = None
    models: Mapping[str, ModelFunction] = field(default_factory=dict)
    has_threshold: bool = False
    lines: tuple[Series, ...] = ()
    levels: tuple[float, ...] = ()
    spans: tuple[ReferenceSpan, ...] = ()
    from_zero: bool = False
    log_limits: tuple[float, float] | None = None
    markers: Mapping[str, str] = field(default_factory=dict)

    @property
    def has_usable_points(self) -> bool:
        """Whether fits may use any of its points."""
        return any(series.usable is None or series.usable.any() for series in self.points)

    def model_grid(self, x: Array) -> Array:
        """Return where the model's curve is drawn for points at `x`, (N,)."""
        if self.grid is not None:
            return self.grid
        return np.linspace(x.min(), x.max(), 40) if np.ptp(x) else x[:1] * np.array([0.95, 1, 1.05])
