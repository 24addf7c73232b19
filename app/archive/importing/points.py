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

from app.archive.importing.columns import INPUT_UNCERTAINTIES, REQUIRED_COLUMNS, ColumnMapping
from app.archive.importing.table import ImportTable, TableImportError
from app.archive.importing.values import (
    ColumnSource,
    ImportOptions,
    add_stated_uncertainties,
    check_repeats,
    column_sources,
    missing_uncertainty_warning,
    table_values,
)
from app.common import NO_PROGRESS, Progress
from drivers import LaserSensor
from model import GRAVITY, Array
from protocols.base import Protocol, Quality, RunStatus, Series
from protocols.registry import PROTOCOLS
from protocols.runfile.layout import RunMetadata
from protocols.runfile.schema import ENTRY_COLUMN, point_columns
from protocols.runfile.writer import RunFileWriter


@dataclass(frozen=True, slots=True)
class ImportedRun:
    """Points of a protocol from a table, before anything is written."""

    protocol: type[Protocol]
    points: tuple[Any, ...]
    entries: tuple[int, ...]
    parameters: Mapping[str, Any]
    sources: tuple[ColumnSource, ...]
    files: tuple[tuple[str, str], ...]
    """Name and SHA-256 of every file."""
    warnings: tuple[str, ...] = ()
    unused_columns: tuple[str, ...] = ()
    curves: tuple[Series, ...] = ()

    @property
    def simulated(self) -> bool:
        """Whether any point has the flag."""
        return any(Quality(point.quality) & Quality.SIMULATED for point in self.points)


def build_points(
    table: ImportTable, mapping: ColumnMapping, options: ImportOptions, progress: Progress = NO_PROGRESS
) -> ImportedRun:
    """Return the points of a table.

    Raises:
        TableImportError: a cell is wrong; the message names it and the remedy.
    """
    values, cautions = table_values(table, mapping, options, progress)
    rows = len(next(iter(values.values())))
    kind = mapping.kind
    parameters = dict(options.settings)
    protocol = PROTOCOLS[kind.protocol]
    completed = add_stated_uncertainties(kind, values, options.uncertainties, last=False)
    match kind.name:
        case "sine-dwell" | "membrane-series":
            protocol = _complete_dwell(table, values, options, parameters, cautions)
        case "static-loading":
            _complete_loads(values, parameters, cautions)
        case "voltage-steps":
            _complete_steps(table, mapping, values, options, cautions)
        case "membrane-sag":
            values.setdefault("repeat", np.arange(1.0, rows + 1))
            parameters = protocol(**options.settings).model_dump(mode="json")
            cautions.append(
                "the strip's geometry and weight are the protocol's unless changed with --set: see 'parameters'"
            )
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
    return ImportedRun(
        protocol,
        points,
        tuple(int(e) for e in entries),
        parameters,
        tuple(column_sources(mapping, options)),
        ((table.path.name, table.sha256),),
        tuple(cautions),
        tuple(cells.heading for cells in mapping.unused),
    )


def write_imported_run(run: ImportedRun, options: ImportOptions, folder: Path) -> Path:
    """Write the run file and return its path.

    Raises:
        StorageError: it cannot be written.
    """
    names = ", ".join(name for name, _ in run.files)
    nothing = math.nan
    header = RunMetadata(
        protocol=run.protocol.name,
        title=run.protocol.title,
        parameters=dict(run.parameters),
        point_type=type(run.points[0]),
        axes=_plotted_axes(run),
        default_plot=run.protocol.default_plot,
        sensor=LaserSensor(
            options.sensor or "not told (imported)", nothing, nothing, nothing, nothing, nothing, options.gain_error
        ),
        bench={"amplifier": options.amplifier.model_dump(), "identities": {}},
        simulated=run.simulated,
        specimen=options.specimen,
        imported={
            "files": [{"name": name, "sha256": sha256} for name, sha256 in run.files],
            "columns": {s.name: {"column": s.heading, "unit": s.unit} for s in run.sources},
            "left_out": list(run.unused_columns),
            "uncertainty": dict(options.uncertainties),
            "cautions": list(run.warnings),
            "measured": options.measured.isoformat() if options.measured else None,
        },
        started_at=options.measured,
    )
    file = RunFileWriter.new(folder, header)
    for entry, point in zip(run.entries, run.points, strict=True):
        file.append_point(point, entry)
    hashes = ", ".join(f"{name} (SHA-256 {sha256[:16]}...)" for name, sha256 in run.files)
    file.finish(RunStatus.COMPLETED, f"from {hashes if len(run.files) < 4 else names}", series=run.curves)
    return file.path


def _plotted_axes(run: ImportedRun) -> tuple[str, str]:
    """Return the columns of the default plot: the protocol's, or what was measured instead of its second."""
    x, y = run.protocol.axes
    required = REQUIRED_COLUMNS.get("sine-dwell" if y == "peak_to_peak" else run.protocol.name, ((y,),))
    present = (
        name for name in (y, *required[-1]) if any(math.isfinite(getattr(p, name, math.nan)) for p in run.points)
    )
    return x, next(present, y)


def _complete_dwell(
    table: ImportTable,
    values: dict[str, Array],
    options: ImportOptions,
    parameters: dict[str, Any],
    warnings: list[str],
) -> type[Protocol]:
    """Add drive and membrane elongation to the points of a dwell."""
    rows = len(values["frequency"])
    rest_v = options.amplifier.rest_v
    if "drive_peak_to_peak" in values:
        values["drive_amplitude"] = values.pop("drive_peak_to_peak") / 2
    if "drive_amplitude" not in values:
        if "peak_to_peak_v" not in options.settings:
            raise TableImportError(
                f"{table.path}: the amplitude of the drive is not given; give it as max - min at the amplifier's input: "
                '--set "peak_to_peak_v=5 V", or name its column: --column drive_peak_to_peak=NAME'
            )
        values["drive_amplitude"] = np.full(rows, options.settings["peak_to_peak_v"] / 2)
    if "receptance" in values:
        if "fundamental" in values:
            raise TableImportError(
                f"{table.path} has both receptance and fundamental; name the one to leave out with --column"
            )
        values["fundamental"] = values.pop("receptance") * values["drive_amplitude"]
        if "receptance_errors" in values:
            values["fundamental_errors"] = values.pop("receptance_errors") * values["drive_amplitude"]
    if (beyond := np.flatnonzero(values["drive_amplitude"] > 1.05 * (options.amplifier.high_v - rest_v))).size:
        raise TableImportError(
            f"{table.path}, {table.row_locations[beyond[0]]}: a drive of {2 * values['drive_amplitude'][beyond[0]]:.4g} V, max - min, leaves the "
            f"amplifier's range of {options.amplifier.low_v:g} to {options.amplifier.high_v:g} V around {rest_v:g} V; give the volts at its input"
        )
    parameters.setdefault("peak_to_peak_v", 2 * float(np.nanmax(values["drive_amplitude"])))
    if "drive_offset" not in values:
        values["drive_offset"] = np.full(rows, rest_v)
        warnings.append(f"the drive is taken to swing around rest, {rest_v:g} V at the amplifier's input")
    if options.elongation_m is not None:
        if "elongation" in values:
            raise TableImportError(f"{table.path} has a column for the elongation: leave --membrane-elongation away")
        values["elongation"] = np.full(rows, options.elongation_m)
    if "elongation" not in values:
        return PROTOCOLS["sine-dwell"]
    if "part" not in values:
        each = values["elongation"]
        new = np.concatenate(([False], ~((each[1:] == each[:-1]) | (np.isnan(each[1:]) & np.isnan(each[:-1])))))
        values["part"] = np.cumsum(new).astype(float)
    return PROTOCOLS["membrane-series"]


def _complete_loads(values: dict[str, Array], parameters: dict[str, Any], warnings: list[str]) -> None:
    gravity = float(parameters.get("gravity_m_per_s2", GRAVITY))
    if "load" not in values:
        values["load"] = gravity * values["mass"]
    if "mass_errors" in values:
        if "load_errors" in values:
            raise TableImportError("the uncertainty of the weights is given twice, for mass and load; leave one away")
        values["load_errors"] = gravity * values.pop("mass_errors")
    values.setdefault("mass", values["load"] / gravity)
    if "side" not in values:
        side = {"MFC up": 1.0, "aluminium up": -1.0}.get(str(parameters.get("sides", "")), math.nan)
        values["side"] = np.full(len(values["load"]), side)
        if math.isnan(side):
            warnings.append(
                'no column states which side was loaded: taken as the mean of both (otherwise give --set "sides=MFC up")'
            )


def _complete_steps(
    table: ImportTable, mapping: ColumnMapping, values: dict[str, Array], options: ImportOptions, warnings: list[str]
) -> None:
    map_ = options.amplifier.amplifier_map
    if "level" not in values and "drive" in values:
        values["level"] = values["drive"]
    if "level" not in values:
        values["level"] = map_.input_v(values.pop("specimen_voltage"))
        if "specimen_voltage_errors" in values:
            values["level_errors"] = values.pop("specimen_voltage_errors") / map_.slope_at(values["level"])
        warnings.append(
            f"volts on the specimen are turned into volts at the input by {map_.slope_below:g} and {map_.slope_above:g} V/V around {map_.rest_v:g} V"
        )
    level = values["level"]
    if (wrong := np.flatnonzero((level < map_.low_v - 0.05) | (level > map_.high_v + 0.05))).size:
        cells = next(
            mapping.columns[name] for name in ("level", "drive", "specimen_voltage") if name in mapping.columns
        )
        raise TableImportError(
            f"{table.cell_location(int(wrong[0]), cells)}: {level[wrong[0]]:.4g} V leaves the amplifier's input range of {map_.low_v:g} to {map_.high_v:g} V; "
            f'volts on the specimen are named so: --column "specimen_voltage={cells.heading}"'
        )
    warnings.append(f"deflections are taken as against rest, {map_.rest_v:g} V at the amplifier's input")


def _with_input_errors(protocol: type[Protocol], values: Mapping[str, Array]) -> type:
    """Return the protocol's point type, with columns for the uncertainties of inputs that this table states."""
    known = point_columns(protocol.point_type)
    more = [
        (f"{name}_errors", Annotated[float, Unit(unit), f"standard uncertainty of the {name}"])
        for name, unit in INPUT_UNCERTAINTIES.get(protocol.name, {}).items()
        if f"{name}_errors" in values and f"{name}_errors" not in known
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
