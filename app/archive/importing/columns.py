"""Column mapping of imported tables: quantities of each protocol, their names, units and usual ranges.

Ambiguous columns that change a number are not guessed: an `amplitude` may be max - min or half of it, so the user is asked.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from app.archive.importing.table import ImportTable, TableColumn, TableImportError, split_heading
from app.common import UnitError, to_number
from protocols.registry import PROTOCOLS
from protocols.runfile.schema import ENTRY_COLUMN, point_columns

TIME_SERIES = "raw"
"""A time series, reduced here to a point of a sine dwell."""


@dataclass(frozen=True, slots=True)
class ColumnSpec:
    """A quantity that a table may contain.

    Attributes:
        aliases: other names for it, lower case, letters and digits only.
        usual_range: values outside give a warning.
    """

    name: str
    unit: str
    description: str
    aliases: tuple[str, ...] = ()
    usual_range: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class TableKind:
    """Columns of a protocol's table: possible ones, required groups (one of each), and names that are ambiguous."""

    name: str
    protocol: str
    columns: tuple[ColumnSpec, ...]
    required: tuple[tuple[str, ...], ...]
    ambiguous: Mapping[str, tuple[str, ...]]
    measured_columns: tuple[str, ...]
    """What was measured; a column `error` without more words belongs to the first of these that is there."""

    def column(self, name: str) -> ColumnSpec | None:
        """Return the specification of a quantity by name."""
        return next((slot for slot in self.columns if slot.name == name), None)


DISPLACEMENT_RANGE_M = (1e-9, 1e-2)
COLUMN_SPECS: dict[str, tuple[ColumnSpec, ...]] = {
    "sine-dwell": (
        ColumnSpec("frequency", "Hz", "frequency of the drive", ("f", "freq", "frequenz", "fhz", "omega", "angularfrequency"), (1.0, 2000.0)),
        ColumnSpec("peak_to_peak", "m", "max - min of the displacement: the paper's amplitude", ("pp", "p2p", "pkpk", "pktopk", "maxmin", "peaktopeakamplitude", "peakpeak"), DISPLACEMENT_RANGE_M),
        ColumnSpec("fundamental", "m", "peak amplitude of the fundamental", ("peakamplitude", "fundamentalamplitude", "sineamplitude"), DISPLACEMENT_RANGE_M),
        ColumnSpec("receptance", "m/V", "peak amplitude of the fundamental over that of the drive", ("frf", "frequencyresponse", "displacementpervolt"), (1e-10, 1e-2)),
        ColumnSpec("receptance_errors", "m/V", "standard uncertainty of the receptance"),
        ColumnSpec("phase", "rad", "phase of the fundamental against the drive", ("phi", "phaseangle"), (-7.0, 7.0)),
        ColumnSpec("drive_amplitude", "V", "peak amplitude of the drive at the amplifier's input", ("drivepeak",), (0.01, 2.5)),
        ColumnSpec("drive_peak_to_peak", "V", "drive at the amplifier's input, max - min", ("drivepp", "vpp", "drivemaxmin"), (0.02, 5.0)),
        ColumnSpec("elongation", "m", "elongation of the membrane; empty for the free tactor", ("stretch", "membraneelongation"), (0.0, 0.05)),
    ),
    "static-loading": (
        ColumnSpec("load", "N", "force on the centre", ("force", "f", "kraft", "weight"), (1e-3, 20.0)),
        ColumnSpec("mass", "kg", "mass of the weight on the centre", ("m", "weightmass", "load", "weight"), (1e-4, 2.0)),
        ColumnSpec("deflection", "m", "displacement under the load against none", ("displacement", "w", "durchbiegung"), DISPLACEMENT_RANGE_M),
        ColumnSpec("side", "1", "which side was pushed", ("seite",)),
        ColumnSpec("repeat", "1", "which repeat", ("run", "trial", "wiederholung")),
    ),
    "voltage-steps": (
        ColumnSpec("level", "V", "volts at the amplifier's input", ("voltage", "input", "inputvoltage", "v", "u", "spannung"), (0.0, 5.0)),
        ColumnSpec("specimen_voltage", "V", "volts on the specimen, behind the amplifier", ("highvoltage", "hv", "outputvoltage"), (-500.0, 1500.0)),
        ColumnSpec("deflection", "m", "displacement against rest", ("displacement", "w", "durchbiegung"), DISPLACEMENT_RANGE_M),
        ColumnSpec("repeat", "1", "which repeat", ("run", "trial", "wiederholung")),
        ColumnSpec("direction", "1", "levels rising (1) or falling (-1)", ()),
        ColumnSpec("read_time", "s", "how long the level had been held", ("time", "t")),
    ),
    "mass-resonance": (
        ColumnSpec("mass", "kg", "added mass", ("m", "addedmass", "masse"), (1e-5, 0.1)),
        ColumnSpec("frequency", "Hz", "where the response is largest: the paper's resonance", ("f", "fres", "resonancefrequency", "peakfrequency", "freq", "frequenz"), (1.0, 2000.0)),
        ColumnSpec("resonance", "Hz", "undamped natural frequency", ("naturalfrequency", "undampedfrequency", "eigenfrequency"), (1.0, 2000.0)),
    ),
    "membrane-sag": (
        ColumnSpec("sag", "m", "depth of the membrane's centre", ("durchhang", "sagging", "membranesag"), (1e-5, 5e-2)),
        ColumnSpec("repeat", "1", "which repeat; numbered by itself if it is not there", ("run", "trial", "wiederholung")),
    ),
    TIME_SERIES: (
        ColumnSpec("time", "s", "time of the sample", ("t", "zeit")),
        ColumnSpec("drive", "V", "volts at the amplifier's input", ("input", "voltage", "u", "v"), (-0.5, 5.5)),
        ColumnSpec("displacement", "m", "displacement of the centre", ("deflection", "w", "position", "x"), (-1e-2, 1e-2)),
    ),
}  # fmt: skip
INPUT_UNCERTAINTIES: dict[str, dict[str, str]] = {
    "sine-dwell": {"frequency": "Hz", "elongation": "m"},
    "membrane-series": {"frequency": "Hz", "elongation": "m"},
    "static-loading": {"mass": "kg"},
    "voltage-steps": {"level": "V", "specimen_voltage": "V"},
    "mass-resonance": {"mass": "kg"},
}
"""Inputs whose uncertainty a fit takes into account, beside the measured quantities, by protocol and with their units."""
REQUIRED_COLUMNS: dict[str, tuple[tuple[str, ...], ...]] = {
    "sine-dwell": (("frequency",), ("peak_to_peak", "fundamental", "receptance")),
    "static-loading": (("load", "mass"), ("deflection",)),
    "voltage-steps": (("level", "drive", "specimen_voltage"), ("deflection",)),
    "mass-resonance": (("mass",), ("frequency", "resonance")),
    "membrane-sag": (("sag",),),
    TIME_SERIES: (("displacement",), ("time",)),
}
AMBIGUOUS_NAMES: dict[str, dict[str, tuple[str, ...]]] = {
    "sine-dwell": {
        **dict.fromkeys(("amplitude", "displacement", "deflection", "a", "response"), ("peak_to_peak", "fundamental")),
        **dict.fromkeys(("drive", "voltage", "drivevoltage"), ("drive_peak_to_peak", "drive_amplitude")),
    },
}


def table_kinds() -> dict[str, TableKind]:
    """Every kind of table, by name: those of the protocols, and raw time series."""
    made = {
        TIME_SERIES: TableKind(
            TIME_SERIES, "sine-dwell", COLUMN_SPECS[TIME_SERIES], REQUIRED_COLUMNS[TIME_SERIES], {}, ("displacement",)
        )
    }
    for name, protocol in PROTOCOLS.items():
        own = {}
        for column, (unit, words, width) in point_columns(protocol.point_type).items():
            for each in [f"{column}_{i}" for i in range(1, width + 1)] or [column]:
                own[each] = ColumnSpec(each, unit, words)
        for slot in COLUMN_SPECS.get(name, ()):
            known = own.get(slot.name, slot)
            own[slot.name] = ColumnSpec(slot.name, known.unit, slot.description, slot.aliases, slot.usual_range)
        for column, unit in INPUT_UNCERTAINTIES.get(name, {}).items():
            errors = f"{column}_errors"
            own.setdefault(errors, ColumnSpec(errors, unit, f"standard uncertainty of {column.replace('_', ' ')}"))
        own[ENTRY_COLUMN] = ColumnSpec(ENTRY_COLUMN, "1", "entry of the plan")
        needs = REQUIRED_COLUMNS.get(name, tuple((axis,) for axis in protocol.axes))
        made[name] = TableKind(name, name, tuple(own.values()), needs, AMBIGUOUS_NAMES.get(name, {}), needs[-1])
    return made


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
    best = [kind for kind in best if kind.name in COLUMN_SPECS] or best
    if len(best) > 1 and any(kind.name == TIME_SERIES for kind in best) and _is_sampled(table):
        best = [kind for kind in best if kind.name == TIME_SERIES]
    if len(best) == 1:
        return best[0]
    heads = ", ".join(f"'{cells.heading}'" for cells in table.columns)
    if not best:
        forms = "; ".join(
            f"{name}: {' and '.join(' or '.join(g) for g in table_kinds()[name].required)}" for name in COLUMN_SPECS
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


def _is_sampled(table: ImportTable) -> bool:
    """Whether the table has many rows at even steps of time."""
    names = {"time", *next(slot.aliases for slot in COLUMN_SPECS[TIME_SERIES] if slot.name == "time")}
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


def si_factor(table: ImportTable, spec: ColumnSpec, column: TableColumn, units: Mapping[str, str]) -> float:
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


def _find_spec(kind: TableKind, column: TableColumn, named: Iterable[str]) -> ColumnSpec | None:
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
