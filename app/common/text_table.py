"""Table of results: columns with name, unit and formatter, for terminal, CSV file and report."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from model import SCALES
from protocols.base import visible_text

CellValue = float | int | str | None


@dataclass(frozen=True, slots=True)
class Column:
    """A column of values in SI; `display_unit` is the unit in which tables show them, `heading` their name there.

    The unit is None where a header names none, as for text. A column that is not `displayed` is in JSON and CSV only.
    """

    name: str
    unit: str | None
    values: Sequence[Any] | NDArray[Any]
    heading: str = ""
    display_unit: str = ""
    format_spec: str = ".5g"
    description: str = ""
    displayed: bool = True
    missing: str = "never"
    """Text of a value that does not exist: most columns with such values are times."""

    @property
    def cells(self) -> list[CellValue]:
        """Return plain values: numbers and texts, None for values that are not finite."""
        return [_cell_value(value) for value in self.values]

    @property
    def displayed_name(self) -> str:
        """Return the name that tables show."""
        return self.heading or self.name

    @property
    def displayed_unit(self) -> str:
        """Return the unit that tables show; empty for none."""
        return self.display_unit or self.unit or ""

    def format_value(self, value: CellValue) -> str:
        """Return a value as text in the display unit."""
        if value is None:
            return self.missing
        if isinstance(value, str):
            return visible_text(value, multiline=True)
        text = format(value * SCALES.get(self.display_unit, 1), self.format_spec)
        return text if text.strip("-0.") else text.removeprefix("-")


@dataclass(frozen=True, slots=True)
class Table:
    """A table of columns of equal length; `vertical` shows its only row as a list."""

    name: str
    title: str
    columns: tuple[Column, ...]
    vertical: bool = False
    max_rows: int = 60
    """Rows that a terminal displays; longer tables are thinned, except for their first `leading_rows` rows."""
    leading_rows: int = 0
    note: str = ""
    highlighted_rows: frozenset[int] = frozenset()
    """Rows that a reader must not miss."""
    monospace: bool = False
    """Fixed-width font, for hashes."""

    @classmethod
    def of_rows(
        cls,
        title: str,
        headings: Sequence[str],
        rows: Sequence[Sequence[CellValue]],
        note: str = "",
        highlighted_rows: frozenset[int] = frozenset(),
        monospace: bool = False,
    ) -> Self:
        """Return a table of columns without units, row by row."""
        columns = tuple(Column(heading, None, [row[i] for row in rows]) for i, heading in enumerate(headings))
        return cls(title, title, columns, note=note, highlighted_rows=highlighted_rows, monospace=monospace)

    @property
    def headings(self) -> tuple[str, ...]:
        """Return the displayed names of the columns."""
        return tuple(column.displayed_name for column in self.columns)

    @property
    def rows(self) -> list[tuple[CellValue, ...]]:
        """Return plain values, row by row."""
        return list(zip(*(column.cells for column in self.columns), strict=True))

    @property
    def text_rows(self) -> list[tuple[str, ...]]:
        """Return formatted values, row by row."""
        return [tuple(map(Column.format_value, self.columns, row)) for row in self.rows]

    def to_csv(self, path: Path) -> None:
        """Write the rows in SI with units in the header and every digit."""
        with path.open("w", newline="", encoding="utf-8", errors="backslashreplace") as file:
            sheet = csv.writer(file)
            sheet.writerow(sheet_text(c.name if c.unit is None else f"{c.name} [{c.unit}]") for c in self.columns)
            sheet.writerows(map(sheet_text, row) for row in self.rows)


FORMULA_STARTS = tuple("=+-@\t\r\n\uff1d\uff0b\uff0d\uff20")
"""First characters of cells that a spreadsheet interprets as a formula, or drops before it does."""


def sheet_text(value: CellValue) -> CellValue:
    """Return a cell that no spreadsheet runs as a formula: a text that begins like one gets an apostrophe before it."""
    if not isinstance(value, str) or not value.startswith(FORMULA_STARTS):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value if value == value.strip() else f"'{value}"


def _cell_value(value: Any) -> CellValue:
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, int | np.integer):
        return int(value)
    return float(value) if np.isfinite(value) else None
