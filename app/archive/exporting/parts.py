"""Parts of an exported run: metadata, points, series, estimates, events and raw samples, in SI units."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Protocol, get_args
from unicodedata import normalize

import numpy as np

from app.common import Column, Progress, Table
from model import Array
from protocols.base import Quality, Series, SeriesAxis, SpecimenMounted, usable_mask
from protocols.runfile import RESPONSE_COLUMNS, LoggedEvent, RunRecord, RunTrace

Part = Literal["about", "points", "series", "estimates", "events", "raw"]
PARTS: tuple[Part, ...] = get_args(Part)

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

MAX_SHEET_NAME = 31
"""Characters of the name of a worksheet."""
MAX_IDENTIFIER = 63
"""Characters of an identifier of MATLAB."""
MATLAB_KEYWORDS = frozenset(
    [
        "break",
        "case",
        "catch",
        "classdef",
        "continue",
        "else",
        "elseif",
        "end",
        "for",
        "function",
        "global",
        "if",
        "otherwise",
        "parfor",
        "persistent",
        "return",
        "spmd",
        "switch",
        "try",
        "while",
    ]
)

POINTS = "points"
"""Name of the series of the points."""

TIME_AND_DRIVE = (("time", "s"), ("drive", "V"))
"""First raw columns; the sensor's quantity and further channels follow."""


class ExportedRun(Protocol):
    """What the exporters take of a run; a comparison of runs is exported in the same way."""

    @property
    def path(self) -> Path: ...
    @property
    def record(self) -> RunRecord: ...
    @property
    def trace(self) -> RunTrace: ...
    @property
    def mountings(self) -> tuple[SpecimenMounted, ...]: ...
    def points(self) -> dict[str, Array]: ...
    def units(self) -> dict[str, str]: ...
    def series(self) -> tuple[Series, ...]: ...
    def events(self, *kinds: str) -> Iterator[LoggedEvent]: ...
    def earlier_runs(self) -> list[Path]: ...


class ExportError(Exception):
    """A run cannot be exported; the message gives reason and remedy."""


def raw_columns(run: ExportedRun) -> tuple[tuple[str, str], ...]:
    """Return names and units of the raw columns."""
    sensor = run.record.sensor
    return (*TIME_AND_DRIVE, (sensor.quantity, sensor.unit), *run.trace.further_channels.items())


def raw_chunks(run: ExportedRun, progress: Progress) -> Iterator[tuple[Array, ...]]:
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


def part_tables(run: ExportedRun, part: Part) -> Iterator[Table]:
    """Yield a part other than the raw data as a table; the series are a table for each kind of them."""
    match part:
        case "points":
            yield Table(part, part, tuple(_point_columns(run)))
        case "series":
            yield from _series_tables(run.series())
        case "estimates":
            names = ("name", "value", "standard error", "unit", "source")
            estimates = [(e.name, e.value, e.standard_error, e.unit, str(e.source)) for e in run.record.estimates]
            yield Table.of_rows(part, names, estimates)
        case "events":
            events = [
                (e.time_s, e.row, e.kind, json.dumps(e.fields, default=str, ensure_ascii=False)) for e in run.events()
            ]
            yield Table.of_rows(part, ("time [s]", "row", "kind", "fields"), events)
        case _:
            yield Table.of_rows(part, ("name", "value"), [(name, str(value)) for name, value in about_rows(run)])


def _series_tables(series: Sequence[Series]) -> Iterator[Table]:
    """Yield a table for each kind of series: entry and label of each row, then the columns; a missing one is NaN."""
    kinds: dict[tuple[str, SeriesAxis, SeriesAxis], list[Series]] = {}
    for one in series:
        kinds.setdefault((one.name, one.x_axis, one.y_axis), []).append(one)
    titles = [name for name, *_ in kinds]
    names = distinct(
        (f"series-{re.sub(r'[^a-z0-9]+', '-', title.lower()).strip('-')}" for title in titles), MAX_SHEET_NAME
    )
    for name, title, alike in zip(names, titles, kinds.values(), strict=True):
        columns = [dict(one.columns()) for one in alike]
        entries = np.repeat([one.entry for one in alike], [one.x.size for one in alike])
        labels = [one.label for one in alike for _ in one.x]
        axes = (
            Column(
                axis.name,
                axis.unit,
                np.concatenate(
                    [own.get(axis, np.full(one.x.size, np.nan)) for one, own in zip(alike, columns, strict=True)]
                ),
                description=axis.description,
            )
            for axis in dict.fromkeys(axis for own in columns for axis in own)
        )
        yield Table(name, title, (Column("entry", None, entries), Column("label", None, labels), *axes))


def points_series(run: ExportedRun) -> Series:
    """Return the usable points over the axes of their protocol; sines with a phase as displacement over drive."""
    points, units = run.points(), run.units()
    x, y = run.record.axes
    usable = usable_mask(points["quality"])
    if points.keys() >= RESPONSE_COLUMNS and np.isfinite(points["fundamental"] * points["phase"]).any():
        x, drive = "frequency", points["drive_amplitude"]
        values: Any = points["fundamental"] / drive * np.exp(1j * points["phase"])
        errors: Array | None
        errors, axis = points["fundamental_errors"] / drive, SeriesAxis("response", "m/V", "displacement of the centre")
    else:
        values, errors, axis = points[y], points.get(f"{y}_errors"), SeriesAxis(y, units[y], y.replace("_", " "))
    whole = Series(
        points[x], values, errors, x_axis=SeriesAxis(x, units[x], x.replace("_", " ")), y_axis=axis, name=POINTS
    )
    rows = np.flatnonzero(usable & np.isfinite(whole.x) & np.isfinite(whole.y))
    return whole.at(rows[np.argsort(whole.x[rows], kind="stable")] if whole.is_complex else rows)


def series_record(series: Series) -> dict[str, Any]:
    """Return a series as plain values: identity, names of the drawn columns, columns and their units by name."""
    return {
        "name": series.name,
        "label": series.label,
        "entry": series.entry,
        "role": str(series.role),
        "x": series.x_axis.name,
        "y": series.y_axis.name,
        "columns": {axis.name: values for axis, values in series.columns()},
        "units": {axis.name: axis.unit for axis, _ in series.columns()},
    }


def identifiers(names: Iterable[str]) -> list[str]:
    """Return names as identifiers of MATLAB, each once: letters, digits and underscores, first a letter, at most 63."""
    plain = (normalize("NFKD", name.replace("µ", "u")).encode("ascii", "ignore").decode() for name in names)
    legal = (re.sub(r"\W+", "_", name).strip("_") for name in plain)
    return distinct(
        (name if name[:1].isalpha() and name not in MATLAB_KEYWORDS else f"x_{name}" for name in legal), MAX_IDENTIFIER
    )


def distinct(names: Iterable[str], longest: int) -> list[str]:
    """Return names of at most `longest` characters; a repeated one gets a number."""
    taken: dict[str, None] = {}
    for name in names:
        one, number = name[:longest], 1
        while one in taken:
            number += 1
            one = f"{name[: longest - len(str(number)) - 1]}_{number}"
        taken[one] = None
    return list(taken)


def _point_columns(run: ExportedRun) -> Iterator[Column]:
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


def about_rows(run: ExportedRun) -> Iterator[tuple[str, Any]]:
    """Yield names and values of the run's metadata, parameters one by one."""
    yield "file", run.path.name
    for name in ("protocol", "specimen", "state", "reason", "start_time"):
        yield name, str(getattr(run.record, name))
    yield "simulated", int(run.record.simulated)
    yield "sample_rate_hz", run.trace.rate_hz
    yield "samples", run.trace.sample_count
    yield "sensor_gain_relative_uncertainty", run.record.sensor.gain_relative_uncertainty
    for name, value in run.record.parameters.items():
        yield f"parameter_{name}", value if isinstance(value, int | float | str) else json.dumps(value)
    for name, value in run.record.software.items():
        yield f"software_{name}".replace("-", "_"), value


def event_records(run: ExportedRun) -> Iterator[Mapping[str, Any]]:
    """Yield time, row, kind and fields of each event."""
    for event in run.events():
        yield {"time": event.time_s, "row": event.row, "kind": event.kind, "fields": event.fields}
