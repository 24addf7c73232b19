"""Values of an imported table in SI, with checks for invalid, duplicate and implausible cells."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from app.archive.importing.columns import ColumnMapping, TableKind, si_factor
from app.archive.importing.import_table import ImportTable, TableColumn
from app.common import ITEMS_PER_UPDATE, NO_PROGRESS, Progress, UnitError, to_number
from app.config import AmplifierTable
from model import Array, Mask
from protocols import PROTOCOLS
from protocols.base import UNNAMED, ImportColumn, TableImportError
from protocols.runfile import ENTRY_COLUMN


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """Options of an import; each may be left to the files.

    Attributes:
        kind: name of the kind of measurement, None to recognise each table by its columns.
        specimen: `unnamed` to take the name from an exported file.
        columns: quantity -> head of its column.
        units: quantity, name or head of a column -> its unit.
        uncertainties: quantity -> `2 um` or `1 %`, standard, for every value.
        settings: parameter of the protocol -> its value; as text, with or without a unit, until it is checked.
        elongation_m: elongation of the membrane; None if the tactor is free, or the table states it.
        sensor: name and serial number of the displacement sensor.
        gain_error: relative standard uncertainty of the sensor's gain, common to all values; 0 if unknown.
        delay_error_s: standard uncertainty of the sensor's delay, common to all phases; 0 if unknown.
        delay_s: delay of the sensor's output, removed from phases of a time series; None if not given.
        amplifier: the amplifier that drove the specimen.
        simulated: whether the values come from a simulation.
        measured: time of the measurement, None if unknown.
        dry_run: read the files and write nothing.
    """

    files: tuple[Path, ...]
    folder: Path
    kind: str | None = None
    specimen: str = UNNAMED
    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    uncertainties: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    elongation_m: float | None = None
    sensor: str = ""
    gain_error: float = 0.0
    delay_error_s: float = 0.0
    delay_s: float | None = None
    amplifier: AmplifierTable = field(default_factory=AmplifierTable)
    simulated: bool = False
    measured: datetime | None = None
    dry_run: bool = False


def table_values(
    table: ImportTable, mapping: ColumnMapping, progress: Progress = NO_PROGRESS
) -> tuple[dict[str, Array], list[str]]:
    """Every quantity in SI, and warnings."""
    lengths = {cells.heading: len(cells.cells) for cells in mapping.columns.values()}
    if len(set(lengths.values())) > 1:
        each = ", ".join(f"'{head}' {length}" for head, length in lengths.items())
        raise TableImportError(
            f"{table.path}: the columns differ in length: {each}; save them of one length, a row a measurement"
        )
    values: dict[str, Array] = {}
    cautions: list[str] = []
    needed = {name for group in mapping.kind.required for name in group}
    whole = "quality" in mapping.columns  # an export of this program: its flags mark missing values
    shares = progress.split([1.0] * len(mapping.columns))
    for (slot, cells), column_progress in zip(mapping.read(), shares, strict=True):
        name = slot.name
        if slot.codes:
            values[name] = np.array([_parse_code(table, slot, cells, row, whole) for row in range(len(cells.cells))])
            continue
        column = si_factor(table, slot, cells) * _parse_numbers(table, cells, column_progress)
        wrong = ~np.isfinite(column) if name in needed and not whole else np.isinf(column)
        refuse_cells(table, cells, wrong, "'{}' is not a number; give the number, or delete the line")
        if name.endswith("_errors"):
            refuse_cells(table, cells, column < 0, "{} is not an uncertainty: it must not be negative")
        if slot.usual_range is not None and column.size:
            cautions += _plausibility_warnings(table, cells, slot, column, slot.usual_range)
        if slot.lowest > -math.inf:
            wrong = column <= slot.lowest if slot.lowest_excluded else column < slot.lowest
            fault = (
                f"{{}} is not a {name}: it must be {'above' if slot.lowest_excluded else 'at least'} {slot.lowest:g}"
            )
            refuse_cells(table, cells, wrong, f"{fault}. Delete the line, or correct it")
        values[name] = column
    return values, cautions


def refuse_cells(table: ImportTable, column: TableColumn, wrong: Mask, fault: str) -> None:
    """Raise TableImportError for the first wrong cell; `{}` in `fault` is its content."""
    for row in np.flatnonzero(wrong)[:1].tolist():
        raise TableImportError(f"{table.location(row, column)}: {fault.format(column.cells[row])}")


def _parse_numbers(table: ImportTable, column: TableColumn, progress: Progress) -> Array:
    """Return the numbers of a column, NaN for missing values; plain numbers are converted in bulk."""
    if isinstance(column.cells, np.ndarray):
        progress.update(1.0)
        return column.cells.astype(float)
    numbers = np.empty(len(column.cells))
    for start in range(0, numbers.size, ITEMS_PER_UPDATE):
        progress.update(start / numbers.size)
        progress.raise_if_cancelled()
        some = column.cells[start : start + ITEMS_PER_UPDATE]
        try:
            numbers[start : start + len(some)] = _parse_plain_numbers(some, table.decimal_comma)
        except ValueError:
            numbers[start : start + len(some)] = [table.parse_number(column, start + i) for i in range(len(some))]
    progress.update(1.0)
    return numbers


def _parse_plain_numbers(cells: Sequence[str | float], decimal_comma: bool) -> Array:
    """The numbers of cells that are nothing else. Raises ValueError where one is something else."""
    if any(isinstance(cell, float) for cell in cells[:1]):  # of a MAT file
        return np.array([float(cell) for cell in cells])
    texts = "\n".join(map(str, cells))
    if "_" in texts:  # Python would take it for a mark of thousands
        raise ValueError("not plain")
    numbers = (texts.replace(",", ".") if decimal_comma else texts).split("\n")
    if len(numbers) != len(cells):
        raise ValueError("not plain")
    return np.fromiter(map(float, numbers), float, len(cells))


def _plausibility_warnings(
    table: ImportTable, cells: TableColumn, slot: ImportColumn, column: Array, usual_range: tuple[float, float]
) -> Iterator[str]:
    """Return a warning if the values of a column are implausible: most likely its unit is wrong."""
    low, high = usual_range
    size = np.abs(column) if low > 0 else column
    at = np.flatnonzero(np.isfinite(size) & ((size > high) | ((size < low) & (size != 0))))
    if at.size:
        row, name, unit = int(at[0]), slot.name, slot.unit
        yield (
            f"{table.location(row, cells)}: {cells.cells[row]} is {column[row]:.4g} {unit}, and {name.replace('_', ' ')} is usually "
            f"{low:g} to {high:g} {unit} ({at.size} of {column.size} values are not): is the unit right? Give another with --unit {name}=UNIT"
        )


def _parse_code(table: ImportTable, slot: ImportColumn, cells: TableColumn, row: int, exported: bool) -> float:
    """Return the number that a text stands for, or the number itself if it is one of those."""
    cell = cells.cells[row]
    text = str(cell).casefold().replace(" ", "")
    if text in slot.codes:
        return slot.codes[text]
    try:
        number = float(text or "nan")
    except ValueError:
        number = 0.0
    if number in slot.codes.values() or (exported and math.isnan(number)):
        return number
    raise TableImportError(f"{table.location(row, cells)}: '{cell}' is not a {slot.name}; {slot.code_hint}")


def check_repeats(table: ImportTable, mapping: ColumnMapping, values: dict[str, Array], rows: int) -> list[str]:
    """Reject duplicate lines; warn of repeated or unsorted values."""
    names = [name for name in values if not name.endswith("_errors") and values[name].ndim == 1]
    if same := _equal_rows([values[name] for name in names], rows):
        first, row = min(same, key=lambda group: group[1])[:2]
        raise TableImportError(
            f"{table.location(row)} is the same as {table.row_location(first)}; take one out, or number them in a column 'repeat' or 'entry'"
        )
    if ENTRY_COLUMN in values:
        return []
    x = next(name for name in mapping.kind.required[0] if name in values)
    conditions = (x, "elongation", "side", "repeat", "drive_amplitude")
    if twice := _equal_rows([values[name] for name in conditions if name in values], rows):
        where = ", ".join(map(table.row_location, twice[0][:5]))
        return [f"{x} {values[x][twice[0][0]]:g} occurs {len(twice[0])} times ({where}): all are kept, as repeats"]
    back = np.flatnonzero(np.diff(values[x]) < 0)
    if back.size and PROTOCOLS[mapping.kind.name].aspects.import_form.rising and "elongation" not in values:
        return [f"{x} does not rise ({table.row_location(int(back[0]) + 1)}): kept in the order of the file"]
    return []


def _equal_rows(columns: Iterable[Array], rows: int) -> list[list[int]]:
    """Return the rows with equal values, in groups of two or more; missing values are equal."""
    plain = [np.nan_to_num(column, nan=-1e300).tolist() for column in columns]
    groups: dict[tuple[float, ...], list[int]] = {}
    for row, key in zip(range(rows), zip(*plain, strict=True), strict=True):
        groups.setdefault(key, []).append(row)
    return [group for group in groups.values() if len(group) > 1]


def add_stated_uncertainties(
    kind: TableKind, values: dict[str, Array], stated: Mapping[str, str], last: bool = True
) -> dict[str, str]:
    """Add the stated standard errors, and return the errors of quantities that are not among the values.

    Args:
        kind: of the table.
        values: by quantity; errors are added as `QUANTITY_errors`.
        stated: quantity -> `2 um` or `1 %`.
        last: refuse errors of quantities that are not among the values.

    Raises:
        TableImportError: names the uncertainty that no fit can use, that is there twice, or that is no number.
    """
    left: dict[str, str] = {}
    for name, text in stated.items():
        option = f"--uncertainty {name}={text}"
        if kind.column(name) is not None and kind.column(f"{name}_errors") is None:
            usable = ", ".join(
                each.name.removesuffix("_errors") for each in kind.columns if each.name.endswith("_errors")
            )
            raise TableImportError(
                f"{option}: no fit takes the uncertainty of {name.replace('_', ' ')} into account; leave it out, or add it to the "
                f"uncertainty of the measured values. It can be given for: {usable}"
            )
        slot = kind.column(name)
        if slot is None or name not in values:
            if last:
                have = ", ".join(n for n in values if kind.column(f"{n}_errors") is not None)
                raise TableImportError(f"{option}: {name} is not one of the values; there are: {have}")
            left[name] = text
            continue
        if f"{name}_errors" in values:
            raise TableImportError(f"{option}: the table has a column for it; omit one of them")
        try:
            relative = text.strip().endswith("%")
            size = to_number(text.strip().removesuffix("%"), "1") / 100 if relative else to_number(text, slot.unit)
        except UnitError as error:
            raise TableImportError(f"{option}: {error}; or a share of the value: '1 %'") from None
        if not (math.isfinite(size) and size > 0):
            raise TableImportError(f"{option}: it must be positive")
        errors = size * np.abs(values[name]) if relative else np.full(len(values[name]), size)
        values[f"{name}_errors"] = np.where(np.isfinite(values[name]), errors, np.nan)
    return left


def missing_uncertainty_warning(kind: TableKind, values: Mapping[str, Array]) -> list[str]:
    """Return a warning if no measured quantity has an uncertainty."""
    measured = [name for name in kind.measured_columns if name in values]
    if measured and not any(np.any(values.get(f"{name}_errors", np.zeros(1)) > 0) for name in measured):
        message = (
            "the uncertainty of the values is not given: the run can be looked at and compared, but not identified; "
            f"give it with --uncertainty {measured[0]}='1 %', or a column '{measured[0]}_errors'"
        )
        return [message]
    return []
