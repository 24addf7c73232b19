"""Export of a run as CSV, JSON or MAT files, in SI units with units in every header.

File names of simulated runs contain SIMULATED.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from app.archive.description import run_record
from app.common import NO_PROGRESS, Column, OperationCancelled, Progress, Table, replacing
from model import Array
from protocols.base import Quality, to_jsonable
from protocols.runfile.reader import Run

Format = Literal["csv", "json", "mat"]
FORMATS: tuple[Format, ...] = ("csv", "json", "mat")
Part = Literal["about", "points", "estimates", "events", "raw"]
PARTS: tuple[Part, ...] = ("about", "points", "estimates", "events", "raw")

ROWS_PER_CHUNK = 20_000
"""Rows converted at once; other threads run between two chunks."""
MAX_SCANS_IN_ONE_FILE = 20_000_000
"""Limit of raw scans in JSON and MAT files, which are held in memory whole."""

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


def export_run(
    run: Run,
    folder: Path,
    kind: Format = "csv",
    parts: Sequence[Part] = PARTS,
    progress: Progress = NO_PROGRESS,
) -> list[Path]:
    """Write `parts` of a run into `folder` and return the files written. Files of the same names are replaced.

    CSV makes one file for each part, JSON and MAT one file. `progress` receives the completed share, 0 to 1. If it is
    cancelled, the unfinished file is removed.

    Raises:
        ExportError: a file cannot be written, or the run is too long for the format.
    """
    if kind != "csv" and "raw" in parts and run.trace.sample_count > MAX_SCANS_IN_ONE_FILE:
        raise ExportError(
            f"{run.path.name} has {run.trace.sample_count} scans, and {kind} holds at most {MAX_SCANS_IN_ONE_FILE}: "
            "take csv, or leave the raw data out"
        )
    stem = run.path.stem + ("_SIMULATED" if run.simulated else "")
    writers: dict[str, Callable[[Path, Progress], None]] = {}
    if kind == "csv":
        writers = {f"{stem}_{part}.csv": partial(_write_csv, run, part) for part in parts}
    else:
        writers[f"{stem}.{kind}"] = partial(_write_json if kind == "json" else _write_mat, run, parts)
    written: list[Path] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, write in writers.items():
            with replacing(folder / name) as working:
                write(working, progress)
            written.append(folder / name)
    except OperationCancelled:
        pass
    except OSError as error:
        raise ExportError(f"{folder} cannot be written to: {error.strerror or error}; choose another folder") from None
    return written


def _write_csv(run: Run, part: Part, path: Path, progress: Progress) -> None:
    if part != "raw":
        _part_table(run, part).to_csv(path)
        return
    with path.open("w", newline="", encoding="utf-8") as file:
        file.write(",".join(f"{name} [{unit}]" for name, unit in _raw_columns(run)) + "\r\n")
        for columns in _raw_chunks(run, progress):
            file.writelines(",".join(f"{v:.9g}" for v in scan) + "\r\n" for scan in zip(*columns, strict=True))


def _write_json(run: Run, parts: Sequence[Part], path: Path, progress: Progress) -> None:
    whole = run_record(run)
    about = {k: v for k, v in whole.items() if k not in ("points", "units", "estimates")}
    record: dict[str, Any] = about | {"configuration": run.configuration} if "about" in parts else {}
    if "points" in parts:
        record |= {"points": whole["points"], "units": whole["units"]}
    if "estimates" in parts:
        record["estimates"] = whole["estimates"]
    if "events" in parts:
        record["events"] = list(_event_records(run))
    with path.open("w", encoding="utf-8") as file:
        text = json.dumps(to_jsonable(record), ensure_ascii=False, allow_nan=False)
        file.write(text.removesuffix("}"))
        if "raw" in parts:
            raw_columns = _raw_columns(run)
            file.write((", " if record else "") + '"raw": {"units": ' + json.dumps(dict(raw_columns)))
            shares = progress.split([1] * len(raw_columns))
            for at, ((name, _), column_progress) in enumerate(zip(raw_columns, shares, strict=True)):
                file.write(f', "{name}": [')
                for number, columns in enumerate(_raw_chunks(run, column_progress)):
                    values = (f"{v:.9g}" if v == v else "null" for v in columns[at].tolist())
                    file.write(("," if number else "") + ",".join(values))
                file.write("]")
            file.write("}")
        file.write("}\n")


def _write_mat(run: Run, parts: Sequence[Part], path: Path, progress: Progress) -> None:
    """Structures `about`, `points`, `estimates`, `events`, `raw`, each with a `units` of its fields."""
    from scipy.io import savemat

    record: dict[str, Any] = {}
    if "about" in parts:
        record["about"] = dict(_about_rows(run))
    if "points" in parts:
        record["points"] = {name: np.asarray(column) for name, column in run.points().items()}
        record["points"]["units"] = run.units()
    if "estimates" in parts:
        record["estimates"] = {
            e.name.replace(" ", "_"): {"value": e.value, "standard_error": e.standard_error, "unit": e.unit}
            for e in run.estimates()
        }
    if "events" in parts:
        events = list(_event_records(run))
        record["events"] = {
            "time": np.array([e["time"] for e in events]),
            "kind": np.array([e["kind"] for e in events], object),
            "fields": np.array([json.dumps(e["fields"], default=str) for e in events], object),
            "units": {"time": "s"},
        }
    if "raw" in parts:
        chunks = list(_raw_chunks(run, progress))
        record["raw"] = {
            name: np.concatenate([chunk[at] for chunk in chunks] or [np.empty(0)])
            for at, (name, _) in enumerate(_raw_columns(run))
        }
        record["raw"]["units"] = dict(_raw_columns(run))
    savemat(str(path), record, appendmat=False, long_field_names=True, oned_as="column", do_compression=True)


def _raw_columns(run: Run) -> tuple[tuple[str, str], ...]:
    """Return names and units of the raw columns."""
    return (*RAW_COLUMNS, *run.trace.further_channels.items())


def _raw_chunks(run: Run, progress: Progress) -> Iterator[tuple[Array, ...]]:
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


def _part_table(run: Run, part: Part) -> Table:
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
            return Table.of_rows(part, ("name", "value"), [(name, str(value)) for name, value in _about_rows(run)])


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


def _about_rows(run: Run) -> Iterator[tuple[str, Any]]:
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


def _event_records(run: Run) -> Iterator[Mapping[str, Any]]:
    for event in run.events():
        yield {"time": event.time_s, "row": event.row, "kind": event.kind, "fields": event.fields}
