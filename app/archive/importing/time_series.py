"""Import of time series: each becomes points of the protocol whose drive it has, such as a sine or one sweep."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from app.archive.importing.columns import ColumnMapping, uneven_steps
from app.archive.importing.import_table import ImportTable
from app.archive.importing.imported_run import ImportedPoints
from app.archive.importing.si_columns import ImportOptions, refuse_cells, table_values
from app.common import NO_PROGRESS, Progress
from model import Array
from protocols import PROTOCOLS, aspects_of
from protocols.base import ImportedSamples, Protocol, RunOfSamples, TableImportError


class _Source(NamedTuple):
    table: ImportTable
    mapping: ColumnMapping
    cautions: tuple[str, ...]


def build_series_runs(
    series: Sequence[tuple[ImportTable, ColumnMapping]],
    options: ImportOptions,
    progress: Progress = NO_PROGRESS,
) -> list[ImportedPoints]:
    """Return the runs that time series become: each series goes to the first protocol that takes it.

    Raises:
        TableImportError: a file is wrong; the message names it, the place and the remedy.
    """
    if options.uncertainties:
        raise TableImportError(
            f"--uncertainty {next(iter(options.uncertainties))}=...: a time series has the uncertainties of its sine fit; leave it "
            "away, and give the sensor's gain by --gain-error"
        )
    parts = progress.split([len(sheet.row_numbers) for sheet, _ in series])
    sources: dict[ImportedSamples, _Source] = {}
    by_protocol: dict[str, list[ImportedSamples]] = {name: [] for name in PROTOCOLS}
    for (sheet, matched), file_progress in zip(series, parts, strict=True):
        each, cautions = _read_series(sheet, matched, options, file_progress)
        sources[each] = _Source(sheet, matched, cautions)
        by_protocol[_protocol_of(each)].append(each)
    return [
        _imported_run(PROTOCOLS[name], run, sources, options)
        for name, taken in by_protocol.items()
        if taken
        for run in aspects_of(name).series_runs(taken)
    ]


def _protocol_of(series: ImportedSamples) -> str:
    """Return the name of the first protocol that takes a time series."""
    faults = []
    for name in PROTOCOLS:
        fault = aspects_of(name).series_fault(series)
        if fault == "":
            return name
        if fault:
            faults.append(fault)
    raise TableImportError(f"{series.place}: {faults[0]}")


def _read_series(
    table: ImportTable, mapping: ColumnMapping, options: ImportOptions, progress: Progress
) -> tuple[ImportedSamples, tuple[str, ...]]:
    values, cautions = table_values(table, mapping, progress)
    for name, cells in mapping.columns.items():
        refuse_cells(table, cells, ~np.isfinite(values[name]), "'{}' is a gap in the series; cut it off there")
    series = ImportedSamples(
        name=table.path.name,
        place=str(table.path),
        time_s=values["time"],
        displacement_m=values["displacement"],
        drive_v=values.get("drive"),
        rate_hz=_sample_rate(table, mapping, values["time"]),
        delay_s=options.delay_s or 0.0,
        settings=options.settings,
        amplifier=options.amplifier.amplifier_map,
        elongation_m=options.elongation_m,
        simulated=options.simulated or "SIMULATED" in table.path.name,
    )
    return series, tuple(cautions)


def _imported_run(
    protocol: type[Protocol], run: RunOfSamples, sources: dict[ImportedSamples, _Source], options: ImportOptions
) -> ImportedPoints:
    tables = [sources[each] for each in run.samples]
    return ImportedPoints(
        protocol,
        run.points,
        tuple(range(len(run.points))),
        run.parameters,
        tables[0].mapping,
        tuple((each.table.path.name, each.table.sha256) for each in tables),
        (
            *(caution for each in tables for caution in each.cautions),
            *run.warnings,
            *(delay_caution(options) if run.has_phases else ()),
        ),
        run.series,
    )


def delay_caution(options: ImportOptions) -> tuple[str, ...]:
    """Return the caution that the sensor's delay is not given, if it is not."""
    if options.delay_s is not None and math.isfinite(options.delay_s):
        return ()
    caution = (
        "the delay of the sensor's output is not given and taken as 0: phases are late by as much as it has, 6 degrees at 160 Hz for "
        "100 us; --sensor-delay '100 us' says it"
    )
    return (caution,)


def _sample_rate(table: ImportTable, mapping: ColumnMapping, time: Array) -> float:
    if time.size < 2:
        raise TableImportError(f"{table.path} holds {time.size} samples; a series is needed")
    steps, cells = np.diff(time), mapping.columns["time"]
    if (back := np.flatnonzero(steps <= 0)).size:
        row = int(back[0]) + 1
        raise TableImportError(
            f"{table.location(row, cells)}: {cells.cells[row]} does not come after {cells.cells[row - 1]}; sort the samples by time"
        )
    if (uneven := uneven_steps(time)).size:
        row = int(uneven[0]) + 1
        raise TableImportError(
            f"{table.location(row, cells)}: {steps[row - 1]:.6g} s after the sample before, {np.median(steps):.6g} s elsewhere; a series must be even: cut it at its gaps, "
            "or write more digits of the time"
        )
    return float((time.size - 1) / (time[-1] - time[0]))
