"""Column mapping of imported tables: quantities of each protocol, their names, units and usual ranges.

Ambiguous columns that change a number are not guessed: an `amplitude` may be max - min or half of it, so the user must choose.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.archive.importing.import_table import ImportTable, TableColumn, split_heading
from app.common import UnitError, to_number
from model import Array
from protocols import PROTOCOLS
from protocols.base import ImportColumn, TableImportError
from protocols.runfile import ENTRY_COLUMN, point_columns

TIME_SERIES = "raw"
"""A time series, which becomes points of the protocol whose drive it has."""


@dataclass(frozen=True, slots=True)
class TableKind:
    """Columns of a protocol's table: possible ones, required groups (one of each), and names that are ambiguous."""

    name: str
    protocol: str
    columns: tuple[ImportColumn, ...]
    required: tuple[tuple[str, ...], ...]
    ambiguous: Mapping[str, tuple[str, ...]]
    measured_columns: tuple[str, ...]
    """Measured quantities; a column named only `error` belongs to the first one in the table."""
    described: bool
    """Whether the protocol describes its columns for import; such a kind is preferred for a table that fits several."""

    def column(self, name: str) -> ImportColumn | None:
        """Return the specification of a quantity by name."""
        return next((slot for slot in self.columns if slot.name == name), None)


def table_kinds() -> dict[str, TableKind]:
    """Every kind of table, by name: tables of the protocols, and raw time series."""
    PROTOCOLS.load_others()
    made, series = {}, {}
    for name, protocol in PROTOCOLS.items():
        form = protocol.aspects.import_form
        if form.series:
            drawn = ("displacement",)
            series[TIME_SERIES] = TableKind(
                TIME_SERIES, name, form.series, (drawn, ("time",)), {}, drawn, described=True
            )
        own = {}
        for column, (unit, description, width) in point_columns(protocol.point_type).items():
            for each in [f"{column}_{i}" for i in range(1, width + 1)] or [column]:
                own[each] = ImportColumn(each, unit, description)
        for spec in form.columns:
            own[spec.name] = replace(spec, unit=own[spec.name].unit) if spec.name in own else spec
        for column, unit in form.input_uncertainties.items():
            errors = f"{column}_errors"
            own.setdefault(errors, ImportColumn(errors, unit, f"standard uncertainty of {column.replace('_', ' ')}"))
        own[ENTRY_COLUMN] = ImportColumn(ENTRY_COLUMN, "1", "entry of the plan")
        required = form.required or tuple((axis,) for axis in protocol.axes)
        described = bool(form.columns)
        made[name] = TableKind(name, name, tuple(own.values()), required, form.ambiguous, required[-1], described)
    return made | series


def normalize_name(text: str) -> str:
    """Normalize a name for comparison: lower case, letters and digits."""
    return re.sub(r"[^a-z0-9]", "", text.casefold())


UNCERTAINTY_PATTERN = re.compile(
    r"^(?:u|std|sd|sigma|error|err|uncertainty|delta)(?:of)?_(.*)$|^(.*?)_?(?:errors?|err|uncertainty|sigma|std|sd|unsicherheit)$"
)


@dataclass(frozen=True, slots=True)
class ColumnMapping:
    """Columns of a table by quantity, and the columns without one."""

    kind: TableKind
    columns: Mapping[str, TableColumn]
    unused: tuple[TableColumn, ...]

    def read(self) -> Iterator[tuple[ImportColumn, TableColumn]]:
        """Yield each quantity with its column."""
        specs = {spec.name: spec for spec in self.kind.columns}
        return ((specs[name], column) for name, column in self.columns.items())


def match_columns(
    table: ImportTable, kind: TableKind, named: Mapping[str, str], units: Mapping[str, str]
) -> ColumnMapping:
    """Return the columns of a table by the quantities of a kind.

    Args:
        table: as it was read.
        kind: of the table.
        named: headings of columns by quantity, as the user gives them.
        units: by heading, name or quantity of a column, as the user gives them.

    Raises:
        TableImportError: a quantity is unknown, missing, or there twice; or a name may mean several.
    """
    of: dict[str, TableColumn] = {}
    for name, head in named.items():
        if kind.column(name) is None:
            names = ", ".join(slot.name for slot in kind.columns if not slot.name.endswith("_errors"))
            raise TableImportError(f"--column {name}={head}: {kind.name} has no '{name}'; it has: {names}")
        of[name] = _column_by_heading(table, head, f"--column {name}={head}")
    there = {slot.name for cells in table.columns if (slot := _find_spec(kind, cells, named)) is not None}
    values = (
        *named,
        *(name for name in kind.measured_columns if name in there),
    )  # a column `sigma` belongs to the first
    for cells in table.columns:
        if cells in of.values():
            continue
        slot = _find_spec(kind, cells, values)
        if slot is None:
            continue
        if slot.name in of:
            if slot.name in named:
                continue
            raise TableImportError(
                f"{table.path}: '{of[slot.name].heading}' and '{cells.heading}' may both be the {slot.name.replace('_', ' ')}; "
                f'choose one: --column "{slot.name}={cells.heading}"'
            )
        of[slot.name] = cells
    left = tuple(cells for cells in table.columns if cells not in of.values())
    _check_required(table, kind, of, left)
    for name, cells in of.items():
        stated = next((units[key] for key in (cells.heading, cells.name, name) if key in units), cells.unit)
        of[name] = replace(cells, unit=stated)
    return ColumnMapping(kind, of, left)


def detect_kind(table: ImportTable, named_columns: Mapping[str, str]) -> TableKind:
    """Return the kind that has these columns; some may be given by the user.

    Raises:
        TableImportError: none, or several.
    """
    missed = {name: _unknown_columns(table, kind, named_columns) for name, kind in table_kinds().items()}
    least = min((count for count in missed.values() if count is not None), default=0)
    best = [kind for name, kind in table_kinds().items() if missed[name] == least]
    best = [kind for kind in best if kind.described] or best
    series = [kind for kind in best if kind.name == TIME_SERIES]
    if len(best) > 1 and series and _is_sampled(table, series[0]):
        best = series
    if len(best) == 1:
        return best[0]
    if best:
        choices = " or ".join(f"--as {kind.name}" for kind in best)
        raise TableImportError(
            f"{table.path} has the columns {table.headings}, which fit {len(best)} kinds of measurement; choose one: {choices}"
        )
    required = {kind.name: map(" or ".join, kind.required) for kind in table_kinds().values() if kind.described}
    forms = "; ".join(f"{name}: {' and '.join(groups)}" for name, groups in required.items())
    raise TableImportError(
        f"{table.path} has the columns {table.headings}, which belong to no known measurement; name the measurement and its columns with --as and --column. Required are, for {forms}"
    )


def _unknown_columns(table: ImportTable, kind: TableKind, named_columns: Iterable[str]) -> int | None:
    """Return how many columns are no quantity of a kind; None if the table lacks a required one."""
    specs = [_find_spec(kind, cells, {}) for cells in table.columns]
    names = {slot.name for slot in specs if slot is not None} | {name for name in named_columns if kind.column(name)}
    names.update(*(kind.ambiguous.get(normalize_name(cells.name), ()) for cells in table.columns))
    return specs.count(None) if all(names.intersection(group) for group in kind.required) else None


MIN_SERIES_ROWS = 30
"""A table with more rows, at even steps of time, is a time series."""
TIME_STEP_TOLERANCE = 0.02
"""Tolerated unevenness of the steps of time, relative to the median step."""
MAX_ROWS_LOOKED_AT = 1000


def _is_sampled(table: ImportTable, series: TableKind) -> bool:
    """Whether the table has many rows at even steps of time."""
    spec = series.column("time")
    assert spec is not None
    names = {spec.name, *spec.aliases}
    column = next((cells for cells in table.columns if normalize_name(cells.name) in names), None)
    if column is None or len(column.cells) < MIN_SERIES_ROWS:
        return False
    count = min(len(column.cells), MAX_ROWS_LOOKED_AT)
    try:
        time = np.array([table.parse_number(column, row) for row in range(count)])
    except TableImportError:
        return False
    return bool(np.median(np.diff(time)) > 0) and not uneven_steps(time).size


def uneven_steps(time: Array) -> NDArray[np.intp]:
    """Return the rows at the begin of a step of time that differs from the median."""
    steps = np.diff(time)
    middle = np.median(steps)
    return np.flatnonzero(~(np.abs(steps - middle) <= TIME_STEP_TOLERANCE * middle + 2 * np.spacing(abs(time[-1]))))


def unit_factor(unit: str, expected: str) -> float:
    """Return the factor from a unit of a table to another unit; a mil is a thousandth of an inch where a length is meant.

    Raises:
        UnitError: the unit is unknown, or of something else.
    """
    length_in_mil = expected == "m" and unit.casefold() in ("mil", "mils")
    return to_number(f"1 {'thou' if length_in_mil else unit}", expected)


def si_factor(table: ImportTable, spec: ImportColumn, column: TableColumn) -> float:
    """Return the factor that converts a column to SI.

    Raises:
        TableImportError: no unit, an unknown one, or one of something else.
    """
    unit, where = column.unit, table.location(column=column)
    if unit == spec.unit or (spec.unit == "1" and unit is None):
        return 1.0
    if unit is None:
        raise TableImportError(
            f"{where}: no unit; write it in the header, '{column.name} [{spec.unit}]', or give it with --unit {spec.name}={spec.unit}"
        )
    try:
        return unit_factor(unit, spec.unit)
    except UnitError:
        raise TableImportError(
            f"{where}: '{unit}' is not a unit of {spec.name.replace('_', ' ')}; {spec.unit} or a multiple of it is needed: --unit {spec.name}={spec.unit}"
        ) from None


def _find_spec(kind: TableKind, column: TableColumn, named: Iterable[str]) -> ImportColumn | None:
    """Return the quantity of a heading; an error column belongs to its quantity, or to the only value."""
    name = normalize_name(column.name)
    if meant := _meanings(kind, column):
        return meant[0] if len(meant) == 1 else None
    fitting = [slot for slot in kind.columns if name == normalize_name(slot.name)]
    fitting += [slot for slot in kind.columns if name in slot.aliases]
    if fitting:
        return _of_dimension(fitting, column)[0]  # a load in grams is a mass
    if match := UNCERTAINTY_PATTERN.fullmatch(column.name.casefold().replace(" ", "_").replace("±", "error_")):
        of, _ = split_heading(match[1] or match[2] or "")
        if not normalize_name(of):
            value = next(
                (v for v in (*named, *kind.measured_columns) if v in kind.measured_columns), kind.measured_columns[0]
            )
            return kind.column(f"{value}_errors")
        base = _find_spec(kind, TableColumn(of, of, column.unit, ()), named)
        return kind.column(f"{base.name}_errors") if base is not None else None
    return None


def _meanings(kind: TableKind, column: TableColumn) -> list[ImportColumn]:
    """Return the quantities that an ambiguous name may mean; only quantities in the column's unit if there are any."""
    meant = kind.ambiguous.get(normalize_name(column.name), ())
    return _of_dimension([slot for slot in kind.columns if slot.name in meant], column)


def _of_dimension(slots: list[ImportColumn], column: TableColumn) -> list[ImportColumn]:
    """Return the quantities that a column's unit is one of; all of them if it has none, or fits none."""
    return [slot for slot in slots if column.unit is not None and _has_dimension(column.unit, slot.unit)] or slots


def _has_dimension(unit: str, expected: str) -> bool:
    try:
        unit_factor(unit, expected)
    except UnitError:
        return False
    return True


def _column_by_heading(table: ImportTable, heading: str, option: str) -> TableColumn:
    for same in (
        lambda c: c.heading == heading,
        lambda c: c.name == heading,
        lambda c: normalize_name(c.name) == normalize_name(heading),
    ):
        columns = [cells for cells in table.columns if same(cells)]
        if len(columns) == 1:
            return columns[0]
    raise TableImportError(f"{option}: {table.path} has no such column; it has: {table.headings}")


def _check_required(
    table: ImportTable, kind: TableKind, columns: Mapping[str, TableColumn], unused: Iterable[TableColumn]
) -> None:
    """Reject a table with missing or ambiguous columns."""
    for cells in unused:
        meant = _meanings(kind, cells)
        if meant and not any(slot.name in columns for slot in meant):
            which = " or ".join(f'--column "{slot.name}={cells.heading}" ({slot.description})' for slot in meant)
            raise TableImportError(
                f"{table.location(column=cells)}: its quantity does not follow from its name; give it: {which}"
            )
    for group in kind.required:
        if not any(name in columns for name in group):
            names = " or ".join(group)
            raise TableImportError(
                f"{table.path} has no column {names}, which {kind.name} needs; it has: {table.headings}. Name it: --column {group[0]}=NAME"
            )
