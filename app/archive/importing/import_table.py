"""Table to import: columns with name and unit, and the file location of every cell."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from app.common import truncate_text
from model import Array
from protocols.base import TableImportError

EMPTY_CELLS = frozenset({"", "-", "--", "nan", "na", "n/a", "#n/a", "none", "null"})
"""Cells without a number."""

HEADING_PATTERN = re.compile(
    r"(?P<name>.*?)\s*(?:\[(?P<a>[^\[\]]*)\]|\((?P<b>[^()]*)\)|\s/\s+(?P<e>\S+)|/\s*(?P<c>[^\s/]+)|\sin\s(?P<d>\S+))"
)
UNIT_SUFFIXES = {
    unit.casefold(): unit
    for unit in (
        "Hz",
        "kHz",
        "nm",
        "um",
        "µm",
        "mm",
        "cm",
        "m",
        "V",
        "kV",
        "N",
        "g",
        "kg",
        "s",
        "ms",
        "us",
        "deg",
        "rad",
        "gf",
        "kgf",
        "lb",
        "lbf",
        "oz",
        "mil",
        "inch",
    )
} | {"mv": "mV", "mn": "mN", "mg": "mg", "percent": "%", "lbs": "lb", "mils": "mil", "thou": "mil"}
"""Units that may end a name: `amplitude_um`."""


@dataclass(frozen=True, slots=True, eq=False)
class TableColumn:
    """One column: heading as in the file, name and unit parsed from it, and cells: texts, or numbers, (rows,)."""

    heading: str
    name: str
    unit: str | None
    cells: Sequence[str | float] | Array


@dataclass(frozen=True, slots=True)
class ImportTable:
    """A table with the number of each row in its file, and metadata of the file."""

    path: Path
    columns: tuple[TableColumn, ...]
    row_numbers: Sequence[int]
    row_name: str = "line {}"
    """Name of a row by its number."""
    decimal_comma: bool = False
    metadata: Mapping[str, Any] = field(default_factory=dict)
    sha256: str = ""

    @property
    def headings(self) -> str:
        """The headings of all columns as text."""
        return ", ".join(f"'{column.heading}'" for column in self.columns)

    def parse_number(self, column: TableColumn, row: int) -> float:
        """Return the number in a cell, NaN for a cell marked as missing.

        Raises:
            TableImportError: it is neither.
        """
        cell = column.cells[row]
        if not isinstance(cell, str):
            return float(cell)
        text = cell.strip()
        if text.casefold() in EMPTY_CELLS:
            return float("nan")
        if self.decimal_comma:
            text = text.replace(",", ".")
        try:
            if "_" in text:
                raise ValueError
            return float(text)
        except ValueError:
            hint = "write it without thousands separators" if re.fullmatch(r"[\d.,' ]+", text) else "write a number"
            raise TableImportError(
                f"{self.location(row, column)}: '{truncate_text(cell)}' is not a number; {hint}, or correct the line"
            ) from None

    def row_location(self, row: int) -> str:
        """Return the name of a row in the file."""
        return self.row_name.format(self.row_numbers[row])

    def location(self, row: int | None = None, column: TableColumn | None = None) -> str:
        """Return file, row and column as text."""
        line = "" if row is None else f", {self.row_location(row)}"
        return f"{self.path}{line}" + ("" if column is None else f", column '{column.heading}'")


def split_heading(heading: str) -> tuple[str, str | None]:
    """Parse name and unit of a heading: `frequency [Hz]`, `Load (g)`, `f / Hz`, `amplitude_um`."""
    heading = heading.strip()
    if match := HEADING_PATTERN.fullmatch(heading):
        unit = next(part for part in match.group("a", "b", "c", "d", "e") if part is not None).strip()
        if match["name"].strip() and unit and (match["d"] is None or unit.casefold() in UNIT_SUFFIXES):
            return match["name"].strip(), unit
    name, _, suffix = heading.rpartition("_")
    if name and suffix.casefold() in UNIT_SUFFIXES:
        return name, UNIT_SUFFIXES[suffix.casefold()]
    return heading, None
