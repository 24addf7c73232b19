"""Export as MAT files, with identifiers of MATLAB as names of all fields."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from app.archive.exporting.parts import (
    ExportedRun,
    Part,
    about_rows,
    event_records,
    identifiers,
    raw_chunks,
    raw_columns,
    series_record,
)
from app.common import Progress
from protocols.base import Series

MAX_COMPRESSED_SCANS = 1_000_000
"""Most raw scans that are compressed in version 5: the library holds them in memory for that, twice."""


def mat_writer(run: ExportedRun, parts: Sequence[Part]) -> Callable[[Path, Progress], None]:
    """Return the function that writes a MAT file of version 5, which every version of MATLAB and Octave reads."""
    return partial(_write_mat, run, _record(run, parts), "raw" in parts)


def mat73_writer(run: ExportedRun, parts: Sequence[Part]) -> Callable[[Path, Progress], None]:
    """Return the function that writes a MAT file of version 7.3, which has no limit of 2 GB for a variable."""
    return partial(_write_mat73, run, _record(run, parts), "raw" in parts)


def _write_mat(run: ExportedRun, record: dict[str, Any], with_raw: bool, path: Path, progress: Progress) -> None:
    from scipy.io import savemat

    with _with_raw(run, record, with_raw, progress) as whole:
        savemat(
            str(path),
            whole,
            appendmat=False,
            long_field_names=True,
            oned_as="column",
            do_compression=not with_raw or run.trace.sample_count <= MAX_COMPRESSED_SCANS,
        )


def _write_mat73(run: ExportedRun, record: dict[str, Any], with_raw: bool, path: Path, progress: Progress) -> None:
    import hdf5storage

    with _with_raw(run, record, with_raw, progress) as whole:
        # Texts of this library are vectors, too: only with "row" are they MATLAB's character arrays.
        hdf5storage.savemat(
            str(path),
            _upright(whole),
            appendmat=False,
            format="7.3",
            oned_as="row",
            store_python_metadata=False,
        )


def _upright(value: Any) -> Any:
    """Return a structure whose vectors of numbers are columns, (N, 1): plain arrays, the library knows no other kind."""
    if isinstance(value, Mapping):
        return {name: _upright(each) for name, each in value.items()}
    if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype != object:
        return np.asarray(value).reshape(-1, 1)
    return value


def _record(run: ExportedRun, parts: Sequence[Part]) -> dict[str, Any]:
    """Return structures `about`, `points`, `series`, `estimates`, `events`, each of columns with a `units` of its fields."""
    record: dict[str, Any] = {}
    if "about" in parts:
        record["about"] = _legal(dict(about_rows(run)))
    if "points" in parts:
        record["points"] = _legal({name: np.asarray(column) for name, column in run.points().items()})
        record["points"]["units"] = _legal(run.units())
    if "series" in parts and (series := run.series()):
        names = identifiers(f"{one.name} {number}" for number, one in enumerate(series, 1))
        record["series"] = dict(zip(names, map(_series_structure, series), strict=True))
    if "estimates" in parts:
        record["estimates"] = _legal(
            {
                e.name: {"name": e.name, "value": e.value, "standard_error": e.standard_error, "unit": e.unit}
                for e in run.record.estimates
            }
        )
    if "events" in parts:
        events = list(event_records(run))
        record["events"] = {
            "time": np.array([e["time"] for e in events]),
            "kind": np.array([e["kind"] for e in events], object),
            "fields": np.array([json.dumps(e["fields"], default=str) for e in events], object),
            "units": {"time": "s"},
        }
    return record


def _series_structure(series: Series) -> dict[str, Any]:
    """Return identity, columns and units of a series; `x` and `y` are the names of the fields with the drawn columns."""
    record = series_record(series)
    columns, units = _legal(record.pop("columns")), _legal(record.pop("units"))
    record["x"], record["y"], *_ = columns
    return record | {"units": units} | columns


def _legal(fields: Mapping[str, Any]) -> dict[str, Any]:
    return dict(zip(identifiers(fields), fields.values(), strict=True))


@contextmanager
def _with_raw(run: ExportedRun, record: dict[str, Any], with_raw: bool, progress: Progress) -> Iterator[dict[str, Any]]:
    """Yield the record with a structure `raw`.

    The raw samples are in a temporary file, which is mapped into memory: both libraries copy one column at a time.
    """
    if not with_raw:
        yield record
        return
    columns, samples = dict(raw_columns(run)), run.trace.sample_count
    with TemporaryFile() as file:
        shape = (len(columns), samples)
        mapped = np.memmap(file, float, "w+", shape=shape) if samples else np.empty(shape)
        start = 0
        for chunk in raw_chunks(run, progress):
            mapped[:, start : start + chunk[0].size] = chunk
            start += chunk[0].size
        raw = _legal(dict(zip(columns, mapped, strict=True)))
        yield record | {"raw": raw | {"units": _legal(columns)}}
