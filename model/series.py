"""Series: values of one quantity over another with units, errors and mask, from measurement to file, fit, plot and export."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from model.arrays import Array, Mask
from model.quantities import ERRORS, FIT, LENGTH_UNITS, TOTAL_ERRORS

PHASE, COHERENCE, USABLE = "phase", "coherence", "usable"


class Role(StrEnum):
    """Origin of a series, which decides how it is drawn."""

    MEASURED = "measured"
    FIT = "fit"
    MODEL = "model"
    REFERENCE = "reference"


@dataclass(frozen=True, slots=True)
class SeriesAxis:
    """Name, unit and description of the values of an axis or column; the name is one of a run file."""

    name: str
    unit: str = "1"
    description: str = ""

    @property
    def long_name(self) -> str:
        """Description and unit, as in a NeXus file."""
        return f"{self.description} ({self.unit})"


class Band(NamedTuple):
    """Lower and upper end of an interval about each value, (N,), such as the 95 % band of a model curve."""

    lower: Array
    upper: Array


X_AXIS, Y_AXIS = SeriesAxis("x"), SeriesAxis("y")


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """Values of one quantity over another.

    Attributes:
        x: (N,), in the unit of `x_axis`; a loop goes back along it.
        y: (N,), in the unit of `y_axis`; real or complex.
        errors: (N,), statistical standard error of y, or of its real and of its imaginary part; None if unknown.
        total_errors: (N,), total standard uncertainty of y.
        usable: (N,), whether fits may use each value; None: all values.
        fit: (N,), a line fitted to y, or to its modulus; NaN outside the fit.
        fit_description: description of the fit.
        band: interval about y, or about its modulus.
        coherence: (N,), share of the power of y that follows x, 0..1.
        name: kind of series, such as `frequency response`; `label` distinguishes series of one kind.
        entry: its entry in the run's plan.
        fitted_rows: indices of the fitted points, for a fitted line.

    Raises:
        ValueError: the arrays differ in length.
    """

    x: Array
    y: NDArray[Any]
    errors: Array | None = None
    total_errors: Array | None = None
    usable: Mask | None = None
    fit: Array | None = None
    coherence: Array | None = None
    band: Band | None = None
    x_axis: SeriesAxis = X_AXIS
    y_axis: SeriesAxis = Y_AXIS
    fit_description: str = "fit"
    name: str = ""
    label: str = ""
    role: Role = Role.MEASURED
    entry: int = 0
    fitted_rows: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        arrays = (self.x, self.y, self.errors, self.total_errors, self.usable, self.fit, self.coherence)
        if {array.shape for array in arrays if array is not None} != {(self.x.size,)}:
            raise ValueError(f"the columns of {self.title or 'a series'} differ in length")

    @property
    def title(self) -> str:
        """Name and label."""
        return f"{self.name} {self.label}".strip()

    @property
    def fit_rows(self) -> Mask:
        """(N,), whether fits may use each value."""
        return np.ones(self.x.size, bool) if self.usable is None else self.usable

    @property
    def is_complex(self) -> bool:
        """Whether y has a phase."""
        return bool(np.iscomplexobj(self.y))

    @property
    def plotted(self) -> Array:
        """(N,), real values for a plot: |y| of a complex series, y of a real one."""
        return np.abs(self.y) if self.is_complex else np.asarray(self.y, float)

    @property
    def phase(self) -> Array | None:
        """(N,), radians, -pi..pi; None for real values."""
        return np.angle(self.y) if self.is_complex else None

    @property
    def is_loop(self) -> bool:
        """Whether x decreases anywhere."""
        return bool((np.diff(self.x) < 0).any())

    def scaled(self, x_factor: float, y_factor: float) -> Self:
        """Return the series in other units, such as display units; the axes keep their names and SI units."""
        arrays = ("y", "errors", "total_errors", "fit")
        scaled = {name: y_factor * array for name in arrays if (array := getattr(self, name)) is not None}
        band = None if self.band is None else Band(*(y_factor * end for end in self.band))
        return replace(self, x=x_factor * self.x, band=band, **scaled)

    def with_gain(self, relative_uncertainty: float) -> Self:
        """Return a measured displacement with total errors that include the relative standard uncertainty of the sensor's gain."""
        if self.errors is None or self.total_errors is not None or self.y_axis.unit not in LENGTH_UNITS:
            return self
        return replace(self, total_errors=np.hypot(self.errors, relative_uncertainty * self.plotted))

    def within(self, low: float, high: float) -> Self:
        """Return the values of a range of x."""
        return self.at((self.x >= low) & (self.x <= high))

    def at(self, rows: Mask | slice | NDArray[np.intp]) -> Self:
        """Return the values of a mask, slice or index of rows."""
        arrays = ("x", "y", "errors", "total_errors", "usable", "fit", "coherence")
        kept = {name: array[rows] for name in arrays if (array := getattr(self, name)) is not None}
        band = None if self.band is None else Band(*(end[rows] for end in self.band))
        return replace(self, band=band, **kept)

    def columns(self) -> Iterator[tuple[SeriesAxis, Array]]:
        """Yield name, unit and description of each column with its values as real numbers; x and y come first."""
        axis = self.y_axis
        yield self.x_axis, self.x
        yield axis, self.plotted
        for ending, values, description in (
            (ERRORS, self.errors, "statistical standard error"),
            (TOTAL_ERRORS, self.total_errors, "total standard uncertainty"),
            (FIT, self.fit, self.fit_description),
        ):
            if values is not None:
                yield SeriesAxis(axis.name + ending, axis.unit, description), values
        if (phase := self.phase) is not None:
            yield SeriesAxis(PHASE, "rad", f"phase of the {axis.name}, delay removed"), phase
        if self.coherence is not None:
            yield SeriesAxis(COHERENCE, "1", "share of the power that follows the drive"), self.coherence
        if self.usable is not None:
            yield SeriesAxis(USABLE, "1", "1 where fits may use the value"), self.usable.astype(float)
