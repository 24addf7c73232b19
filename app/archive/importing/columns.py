"""Column mapping of imported tables: quantities of each protocol, their names, units and usual ranges.

Ambiguous columns that change a number are not guessed: an `amplitude` may be max - min or half of it, so the user is asked.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.archive.importing.import_table import ImportTable, TableColumn, split_heading
from app.common import UnitError, to_number
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
    """Whether the protocol describes its columns for import; such a kind is preferred where a table fits several."""

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


def match_columns(table: ImportTable, kind: TableKind, named: Mapping[str, str]) -> ColumnMapping:
    """Return the columns of a table by the quantities of a kind; `columns` of the options name them by heading.

    Raises:
        TableImportError: a quantity is unknown, missing, or there twice; or a name may mean several.
    """
    of: dict[str, TableColumn] = {}
    for name, head in named.items():
        if kind.column(name) is None:
            known = ", ".join(slot.name for slot in kind.columns if not slot.name.endswith("_errors"))
            raise TableImportError(f"--column {name}={head}: {kind.name} has no '{name}'; it has: {known}")
        of[name] = _column_by_heading(table, head, f"--column {name}={head}")
    there = {slot.name for cells in table.columns if (slot := _find_spec(kind, cells, named)) is not None}
    values = (
        *named,
        *(name for name in kind.measured_columns if name in there),
    )  # a column `sigma` belongs to the first
    for cells in table.columns:
        if any(cells is known for known in of.values()):
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
    left = tuple(cells for cells in table.columns if all(cells is not known for known in of.values()))
    _check_required(table, kind, of, left)
    return ColumnMapping(kind, of, left)


def detect_kind(table: ImportTable, named_columns: Mapping[str, str]) -> TableKind:
    """Return the kind that has these columns; some may be given by the user.

    Raises:
        TableImportError: none, or several.
    """
    found: list[tuple[int, TableKind]] = []
    for kind in table_kinds().values():
        named = [_find_spec(kind, cells, {}) for cells in table.columns]
        names = {slot.name for slot in named if slot is not None} | {
            name for name in named_columns if kind.column(name)
        }
        unclear = {name for cells in table.columns for name in kind.ambiguous.get(normalize_name(cells.name), ())}
        if all(names & set(group) or unclear & set(group) for group in kind.required):
            found.append((sum(slot is None for slot in named), kind))
    least = min((missed for missed, _ in found), default=0)
    best = [kind for missed, kind in found if missed == least]
    best = [kind for kind in best if kind.described] or best
    series = [kind for kind in best if kind.name == TIME_SERIES]
    if len(best) > 1 and series and _is_sampled(table, series[0]):
        best = series
    if len(best) == 1:
        return best[0]
    heads = ", ".join(f"'{cells.heading}'" for cells in table.columns)
    if not best:
        forms = "; ".join(
            f"{kind.name}: {' and '.join(' or '.join(g) for g in kind.required)}"
            for kind in table_kinds().values()
            if kind.described
        )
        raise TableImportError(
            f"{table.path} has the columns {heads}, which belong to no known measurement; name the measurement and its columns with --as and --column. Required are, for {forms}"
        )
    names_ = " or ".join(f"--as {kind.name}" for kind in best)
    raise TableImportError(
        f"{table.path} has the columns {heads}, which fit {len(best)} kinds of measurement; choose one: {names_}"
    )


MIN_SERIES_ROWS = 30
"""A table with more rows, at even steps of time, is a time series."""
TIME_STEP_TOLERANCE = 0.02
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
    steps = np.diff(time)
    middle = float(np.median(steps))
    return bool(
        middle > 0 and (np.abs(steps - middle) <= TIME_STEP_TOLERANCE * middle + 2 * np.spacing(abs(time[-1]))).all()
    )


def unit_factor(unit: str, expected: str) -> float:
    """Return the factor from a unit of a table to another unit; a mil is a thousandth of an inch where a length is meant.

    Raises:
        UnitError: the unit is unknown, or of something else.
    """
    length_in_mil = expected == "m" and unit.casefold() in ("mil", "mils")
    return to_number(f"1 {'thou' if length_in_mil else unit}", expected)


def si_factor(table: ImportTable, spec: ImportColumn, column: TableColumn, units: Mapping[str, str]) -> float:
    """Return the factor that converts a column to SI; `units` given by the user, by heading, name or quantity.

    Raises:
        TableImportError: no unit, an unknown one, or one of something else.
    """
    unit = next((units[key] for key in (column.heading, column.name, spec.name) if key in units), column.unit)
    where = f"{table.path}, column '{column.heading}'"
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
    if normalize_name(column.name) in kind.ambiguous:
        return None
    name = normalize_name(column.name)
    fitting = [slot for slot in kind.columns if name == normalize_name(slot.name)]
    fitting += [slot for slot in kind.columns if name in slot.aliases]
    if len(fitting) > 1 and column.unit is not None:  # a load in grams is a mass
        fitting = [slot for slot in fitting if _has_dimension(column.unit, slot.unit)] or fitting
    if fitting:
        return fitting[0]
    if found := UNCERTAINTY_PATTERN.fullmatch(column.name.casefold().replace(" ", "_").replace("±", "error_")):
        of, _ = split_heading(found[1] or found[2] or "")
        if not normalize_name(of):
            value = next(
                (v for v in (*named, *kind.measured_columns) if v in kind.measured_columns), kind.measured_columns[0]
            )
            return kind.column(f"{value}_errors")
        base = _find_spec(kind, TableColumn(of, of, column.unit, ()), named)
        return kind.column(f"{base.name}_errors") if base is not None else None
    return None


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
        found = [cells for cells in table.columns if same(cells)]
        if len(found) == 1:
            return found[0]
    have = ", ".join(f"'{cells.heading}'" for cells in table.columns)
    raise TableImportError(f"{option}: {table.path} has no such column; it has: {have}")


def _check_required(
    table: ImportTable, kind: TableKind, columns: Mapping[str, TableColumn], unused: Sequence[TableColumn]
) -> None:
    """Reject a table with missing or ambiguous columns."""
    for cells in unused:
        meant = kind.ambiguous.get(normalize_name(cells.name), ())
        if meant and not any(name in columns for name in meant):
            which = " or ".join(
                f'--column "{name}={cells.heading}" ({kind.column(name).description})'  # type: ignore[union-attr]
                for name in meant
            )
            raise TableImportError(
                f"{table.path}, column '{cells.heading}': its quantity does not follow from its name; give it: {which}"
            )
    for group in kind.required:
        if not any(name in columns for name in group):
            have = ", ".join(f"'{cells.heading}'" for cells in table.columns)
            wanted = " or ".join(group)
            raise TableImportError(
                f"{table.path} has no column {wanted}, which {kind.name} needs; it has: {have}. Name it: --column {group[0]}=NAME"
            )
