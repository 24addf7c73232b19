"""Parts of an exported run: metadata, points, estimates, events and raw samples, in SI units."""

import json
from collections.abc import Iterator, Mapping
from typing import Any, Literal

from app.common import Column, Progress, Table
from model import Array
from protocols.base import Quality
from protocols.runfile.reader import Run

Part = Literal["about", "points", "estimates", "events", "raw"]
PARTS: tuple[Part, ...] = ("about", "points", "estimates", "events", "raw")

ROWS_PER_CHUNK = 20_000
"""Rows converted at once; other threads run between two chunks."""
LEADING_COLUMNS = (
    "frequency",
    "peak_to_peak",
    "peak_to_peak_errors",
    "fundamental",
    "fundamental_errors",
    "phase",
    "phase_errors",
)
"""Columns of points that come first in a table; the run file has no column order."""

RAW_COLUMNS = (("time", "s"), ("drive", "V"), ("displacement", "m"))
"""Raw columns that every run has; further channels follow."""


class ExportError(Exception):
    """A run cannot be exported; the message gives reason and remedy."""


def raw_columns(run: Run) -> tuple[tuple[str, str], ...]:
    """Return names and units of the raw columns."""
    return (*RAW_COLUMNS, *run.trace.further_channels.items())


def raw_chunks(run: Run, progress: Progress) -> Iterator[tuple[Array, ...]]:
    """Yield time, drive, displacement and further channels of each chunk of scans.

    Raises:
        OperationCancelled: `progress` is cancelled.
    """
    trace, samples = run.trace, run.trace.sample_count
    for start in range(0, samples, ROWS_PER_CHUNK):
        progress.raise_if_cancelled()
        stop = min(start + ROWS_PER_CHUNK, samples)
        further = (trace.channel_values(name, start, stop) for name in trace.further_channels)
        yield trace.time_s(start, stop), trace.drive_v(start, stop), trace.displacement_m(start, stop), *further
        progress.update(stop / samples)


def part_table(run: Run, part: Part) -> Table:
    """Return a part other than the raw data as a table."""
    match part:
        case "points":
            return Table(part, part, tuple(_point_columns(run)))
        case "estimates":
            names = ("name", "value", "standard error", "unit", "source")
            estimates = [(e.name, e.value, e.standard_error, e.unit, str(e.source)) for e in run.estimates()]
            return Table.of_rows(part, names, estimates)
        case "events":
            events = [
                (e.time_s, e.row, e.kind, json.dumps(e.fields, default=str, ensure_ascii=False)) for e in run.events()
            ]
            return Table.of_rows(part, ("time [s]", "row", "kind", "fields"), events)
        case _:
            return Table.of_rows(part, ("name", "value"), [(name, str(value)) for name, value in about_rows(run)])


def _point_columns(run: Run) -> Iterator[Column]:
    """Yield the columns of the points; one of several orders is several columns."""
    points, units = run.points(), run.units()
    leading = {name: at for at, name in enumerate(LEADING_COLUMNS)}
    for name in sorted(points, key=lambda name: leading.get(name, len(leading))):
        column = points[name].astype(float)
        if column.ndim == 1:
            yield Column(name, units[name], column)
        else:
            yield from (Column(f"{name}_{i}", units[name], order) for i, order in enumerate(column.T, 1))
    if descriptions := [Quality(int(flags)).description for flags in points.get("quality", ())]:
        yield Column("quality in words", None, descriptions)


def about_rows(run: Run) -> Iterator[tuple[str, Any]]:
    """Yield names and values of the run's metadata, parameters one by one."""
    yield "file", run.path.name
    for name in ("protocol", "specimen", "state", "reason", "start_time"):
        yield name, str(getattr(run, name))
    yield "simulated", int(run.simulated)
    yield "sample_rate_hz", run.trace.rate_hz
    yield "samples", run.trace.sample_count
    for name, value in run.parameters.items():
        yield f"parameter_{name}", value if isinstance(value, int | float | str) else json.dumps(value)
    for name, value in run.software.items():
        yield f"software_{name}".replace("-", "_"), value


def event_records(run: Run) -> Iterator[Mapping[str, Any]]:
    """Yield time, row, kind and fields of each event."""
    for event in run.events():
        yield {"time": event.time_s, "row": event.row, "kind": event.kind, "fields": event.fields}
