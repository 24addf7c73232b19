"""Figures of a protocol as data: measured series over one axis, with the curve of the model and reference levels."""

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
        mass_fraction, mass_offset_kg: acting share and offset of the masses in the cylinder.
    """

    specimen: Specimen = field(default_factory=Specimen)
    amplifier: AmplifierMap = field(default_factory=AmplifierMap)
    shape_count: int = 5
    mass_fraction: float = 1.0
    mass_offset_kg: float = 0.0

    def acting_mass(self, mass_kg: Array) -> Array:
        """Return the acting masses at the centre of masses in the cylinder, (N,)."""
        return self.mass_fraction * mass_kg + self.mass_offset_kg

    def crept(self, time_s: float) -> float:
        """Return the creep factor of a deflection at a time after its step."""
        from model.response import REFERENCE_S  # slow to import

        return 1 + self.specimen.creep * float(np.log10(time_s / REFERENCE_S))


ModelFunction = Callable[[ModelState, Array], Array | None]
"""Returns y over x by the model, (N,), SI; None without a model curve."""


class ReferenceSpan(NamedTuple):
    """A reference range of y, SI."""

    low: float
    high: float
    label: str


@dataclass(frozen=True, slots=True)
class Figure:
    """Series of a run over one axis.

    Attributes:
        points: drawn with symbols and error bars; a series without a label is named after its run.
        title: title in the report of a specimen, which joins the figures of one title of all runs; empty: in the run's picture
            only.
        caption: caption in the report.
        model: curve of the model, drawn over `grid`, by default over the range of the points.
        models: curves of the model for the points of a label.
        has_threshold: draw the threshold of perception, in µm over Hz.
        lines: series drawn as lines.
        levels: reference levels of y.
        spans: reference ranges of y.
        from_zero: begin the axis of y at zero.
        log_limits: limits of a logarithmic axis of y.
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
        """Return the abscissae of the model's curve for points at `x`, (N,)."""
        if self.grid is not None:
            return self.grid
        return np.linspace(x.min(), x.max(), 40) if np.ptp(x) else x[:1] * np.array([0.95, 1, 1.05])
