"""Interface of a protocol for the import of tables and time series: columns, values to complete, and points of a time series."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from model import AmplifierMap, Array
from protocols.base.records import Series, SeriesAxis

DISPLACEMENT_RANGE_M = (1e-9, 1e-2)
"""Usual range of a tactor's displacement."""

REPEAT_ALIASES = ("run", "trial", "wiederholung")


class TableImportError(Exception):
    """A table or time series cannot be imported; the message gives file, place, fault and remedy."""


@dataclass(frozen=True, slots=True)
class ImportColumn:
    """A quantity that an imported table may contain.

    Attributes:
        aliases: other names for it, lower case, letters and digits only.
        usual_range: values outside give a warning.
        lowest: lower bound of all values; a value below it is refused.
        lowest_excluded: whether the bound itself is refused.
        codes: numbers by text of a cell, lower case without blanks; no other numbers are valid then.
        code_hint: remedy for an invalid text.
    """

    name: str
    unit: str
    description: str
    aliases: tuple[str, ...] = ()
    usual_range: tuple[float, float] | None = None
    lowest: float = -math.inf
    lowest_excluded: bool = False
    codes: Mapping[str, float] = field(default_factory=dict)
    code_hint: str = ""


@dataclass(frozen=True)
class ImportedTable:
    """Values of an imported table in SI, which a protocol's aspects complete to its points; `values` and others are changed.

    Attributes:
        values: by column, (F,) each.
        parameters: given parameters of the protocol.
        amplifier: map of the amplifier that drove the specimen.
        elongation_m: elongation of the membrane for all rows; None if not given.
        headings: headings of the table's columns, by quantity.
        place: function that returns file, row and column as text; without a row, the file.
        warnings: for the user.
    """

    values: dict[str, Array]
    parameters: dict[str, Any]
    amplifier: AmplifierMap
    elongation_m: float | None
    headings: Mapping[str, str]
    place: Callable[[int | None, str | None], str]
    warnings: list[str] = field(default_factory=list)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self.values.values())))

    def refusal(self, message: str, row: int | None = None, quantity: str | None = None) -> TableImportError:
        """Return the error for a fault at a row, in the column of a quantity."""
        return TableImportError(f"{self.place(row, quantity)}{message}")


@dataclass(frozen=True, eq=False)
class ImportedSamples:
    """An evenly sampled time series of a file, in SI, (samples,) each.

    Attributes:
        name: name of the file.
        place: place of the file, for messages.
        drive_v: volts at the amplifier's input; None if not recorded.
        delay_s: delay of the sensor's output, which is removed from phases.
        settings: parameters given by the user.
        amplifier: map of the amplifier that drove the specimen.
        elongation_m: elongation of the membrane; None if not given.
    """

    name: str
    place: str
    time_s: Array
    displacement_m: Array
    drive_v: Array | None
    rate_hz: float
    delay_s: float
    settings: Mapping[str, Any]
    amplifier: AmplifierMap
    elongation_m: float | None
    simulated: bool

    def refusal(self, message: str) -> TableImportError:
        """Return the error for a fault of the file."""
        return TableImportError(f"{self.place}{message}")

    def as_series(self, label: str) -> tuple[Series, ...]:
        """Return the drive, if recorded, and the displacement over time."""
        axis, since = SeriesAxis("time", "s", "time"), self.time_s - self.time_s[0]
        moved = SeriesAxis("displacement", "m", "displacement of the centre")
        shown = Series(since, self.displacement_m, x_axis=axis, y_axis=moved, name="time series", label=label)
        if self.drive_v is None:
            return (shown,)
        driven, name = SeriesAxis("drive", "V", "volts at the amplifier's input"), "time series of the drive"
        return Series(since, self.drive_v, x_axis=axis, y_axis=driven, name=name, label=label), shown


@dataclass(frozen=True, slots=True)
class RunOfSamples:
    """Points of one run from time series, with the series to store."""

    samples: Sequence[ImportedSamples]
    points: tuple[Any, ...]
    series: tuple[Series, ...]
    parameters: Mapping[str, Any]
    warnings: tuple[str, ...]
    has_phases: bool
    """Whether phases depend on the delay of the sensor."""


@dataclass(frozen=True, slots=True)
class ImportForm:
    """Columns of a protocol's tables.

    Attributes:
        columns: quantities that a table may contain beside the columns of the protocol's points, or that replace their
            descriptions.
        required: groups of columns, one of each is needed; empty: the protocol's axes. The last group has the measured quantity.
        ambiguous: names of several possible quantities, which the user must choose from.
        input_uncertainties: inputs, with their units, whose uncertainty the fit takes into account beside the measured quantities.
        rising: whether rows usually rise with the first required column.
        series: columns of a time series that becomes points of this protocol or of another.
    """

    columns: tuple[ImportColumn, ...] = ()
    required: tuple[tuple[str, ...], ...] = ()
    ambiguous: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    input_uncertainties: Mapping[str, str] = field(default_factory=dict)
    rising: bool = False
    series: tuple[ImportColumn, ...] = ()
