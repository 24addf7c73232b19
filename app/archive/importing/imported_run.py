"""Points of an imported table: values in SI with standard errors, stored as a run file with their source.

An imported run has no raw samples, instruments or events; values that the table lacks are NaN.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, make_dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from annotated_types import Unit

from app.archive.importing.columns import ColumnMapping
from app.archive.importing.import_table import ImportTable
from app.archive.importing.si_columns import (
    ImportOptions,
    add_stated_uncertainties,
    check_repeats,
    missing_uncertainty_warning,
    table_values,
)
from app.common import NO_PROGRESS, Progress
from drivers import LaserSensor
from model import Array
from protocols import PROTOCOLS, aspects_of
from protocols.base import ImportedTable, Protocol, Quality, RunStatus, Series
from protocols.runfile import ENTRY_COLUMN, RunFileWriter, RunRecord, point_columns


@dataclass(frozen=True, slots=True)
class ImportedPoints:
    """Points of a protocol from a table, before anything is written."""

    protocol: type[Protocol]
    points: tuple[Any, ...]
    entries: tuple[int, ...]
    parameters: Mapping[str, Any]
    mapping: ColumnMapping
    """Columns of the table; of several time series, of the first."""
    files: tuple[tuple[str, str], ...]
    """Name and SHA-256 of every file."""
    warnings: tuple[str, ...] = ()
    series: tuple[Series, ...] = ()

    @property
    def simulated(self) -> bool:
        """Whether any point has the flag."""
        return any(Quality(point.quality) & Quality.SIMULATED for point in self.points)


def build_points(
    table: ImportTable, mapping: ColumnMapping, options: ImportOptions, progress: Progress = NO_PROGRESS
) -> ImportedPoints:
    """Return the points of a table.

    Raises:
        TableImportError: a cell is wrong; the message names it and the remedy.
    """
    values, cautions = table_values(table, mapping, progress)
    kind = mapping.kind
    protocol = PROTOCOLS[kind.protocol]
    completed = add_stated_uncertainties(kind, values, options.uncertainties, last=False)

    def place(row: int | None, quantity: str | None) -> str:
        return table.location(row, None if row is None or quantity is None else mapping.columns[quantity])

    headings = {name: cells.heading for name, cells in mapping.columns.items()}
    amplifier = options.amplifier.amplifier_map
    whole = ImportedTable(values, dict(options.settings), amplifier, options.elongation_m, headings, place, cautions)
    protocol = aspects_of(protocol.name).complete_table(whole) or protocol
    rows = whole.rows
    cautions += check_repeats(table, mapping, values, rows)
    add_stated_uncertainties(kind, values, completed)
    cautions += missing_uncertainty_warning(kind, values)
    flags = Quality.IMPORTED | (
        Quality.SIMULATED if options.simulated or "SIMULATED" in table.path.name else Quality.GOOD
    )
    quality = values.pop("quality", np.zeros(rows))
    entries = values.pop(ENTRY_COLUMN, np.arange(rows, dtype=float))
    point_type = _with_input_errors(protocol, values)
    points = tuple(_make_points(point_type, values, [int(q) | int(flags) for q in quality]))
    return ImportedPoints(
        protocol,
        points,
        tuple(int(e) for e in entries),
        whole.parameters,
        mapping,
        ((table.path.name, table.sha256),),
        tuple(cautions),
    )


def write_imported_run(run: ImportedPoints, options: ImportOptions, folder: Path) -> Path:
    """Write the run file and return its path.

    Raises:
        StorageError: it cannot be written.
    """
    names = ", ".join(name for name, _ in run.files)
    nothing = math.nan
    record = RunRecord(
        protocol=run.protocol.name,
        title=f"{run.protocol.title} of {options.specimen}",
        parameters=dict(run.parameters),
        axes=_plotted_axes(run),
        default_plot=run.protocol.default_plot,
        sensor=LaserSensor(
            options.sensor or "not told (imported)",
            *(nothing,) * 5,
            options.gain_error,
            delay_uncertainty_s=options.delay_error_s,
        ),
        configuration={"amplifier": options.amplifier.model_dump(), "identities": {}},
        simulated=run.simulated,
        specimen=options.specimen,
        imported={
            "files": [{"name": name, "sha256": sha256} for name, sha256 in run.files],
            "columns": {
                spec.name: {"column": cells.heading, "unit": cells.unit or spec.unit}
                for spec, cells in run.mapping.read()
            },
            "left_out": [cells.heading for cells in run.mapping.unused],
            "uncertainty": dict(options.uncertainties),
            "cautions": list(run.warnings),
            "measured": options.measured.isoformat() if options.measured else None,
        },
        start_time=options.measured.isoformat(timespec="milliseconds") if options.measured else "",
    )
    file = RunFileWriter.new(folder, record, type(run.points[0]))
    for entry, point in zip(run.entries, run.points, strict=True):
        file.append_point(point, entry)
    hashes = ", ".join(f"{name} (SHA-256 {sha256[:16]}...)" for name, sha256 in run.files)
    file.finish(RunStatus.COMPLETED, f"from {hashes if len(run.files) < 4 else names}", series=run.series)
    return file.path


def _plotted_axes(run: ImportedPoints) -> tuple[str, str]:
    """Return the columns of the default plot: the protocol's, or a measured column in place of a missing second one."""
    x, y = run.protocol.axes
    measured = (y, *(run.protocol.aspects.import_form.required or ((y,),))[-1])
    present = (name for name in measured if any(math.isfinite(getattr(p, name, math.nan)) for p in run.points))
    return x, next(present, y)


def _with_input_errors(protocol: type[Protocol], values: Mapping[str, Array]) -> type:
    """Return the protocol's point type, with columns for the uncertainties of inputs that this table states."""
    columns = point_columns(protocol.point_type)
    more = [
        (f"{name}_errors", Annotated[float, Unit(unit), f"standard uncertainty of the {name}"])
        for name, unit in protocol.aspects.import_form.input_uncertainties.items()
        if f"{name}_errors" in values and f"{name}_errors" not in columns
    ]
    base = protocol.point_type
    return make_dataclass(base.__name__, more, bases=(base,), frozen=True, slots=True) if more else base


def _make_points(point_type: type, values: Mapping[str, Array], flags: Sequence[int]) -> Iterator[Any]:
    """Yield the points; quantities without values are NaN."""
    widths = {name: width for name, (_, _, width) in point_columns(point_type).items()}
    missing = np.full(len(flags), math.nan)
    columns: dict[str, Sequence[Any]] = {}
    for name in (each.name for each in fields(point_type)):
        if width := widths.get(name):
            parts = [values.get(f"{name}_{i}", missing).tolist() for i in range(1, width + 1)]
            columns[name] = list(zip(*parts, strict=True))
        else:
            columns[name] = values.get(name, missing).tolist()
    columns["quality"] = flags
    for row in zip(*columns.values(), strict=True):
        yield point_type(**dict(zip(columns, row, strict=True)))
