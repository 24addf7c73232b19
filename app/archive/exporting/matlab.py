"""Export as MAT files."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from app.archive.exporting.parts import Part, about_rows, event_records, raw_chunks, raw_columns
from app.common import Progress
from protocols.runfile.reader import Run

MAX_COMPRESSED_SCANS = 1_000_000
"""Most raw scans that are compressed in version 5: the library holds them in memory for that, twice."""


def write_mat(run: Run, parts: Sequence[Part], path: Path, progress: Progress) -> None:
    """Write a MAT file of version 5, which every version of MATLAB and Octave reads."""
    from scipy.io import savemat

    with _record(run, parts, progress) as record:
        savemat(
            str(path),
            record,
            appendmat=False,
            long_field_names=True,
            oned_as="column",
            do_compression="raw" not in parts or run.trace.sample_count <= MAX_COMPRESSED_SCANS,
        )


def write_mat73(run: Run, parts: Sequence[Part], path: Path, progress: Progress) -> None:
    """Write a MAT file of version 7.3, which has no limit of 2 GB for a variable."""
    import hdf5storage

    with _record(run, parts, progress) as whole:
        record = {name: _columns_upright(part) for name, part in whole.items()}
        # Texts of this library are vectors, too: only with "row" are they those of MATLAB.
        hdf5storage.savemat(
            str(path), record, appendmat=False, format="7.3", oned_as="row", store_python_metadata=False
        )


def _columns_upright(part: Mapping[str, Any]) -> dict[str, Any]:
    """Return a structure whose vectors of numbers are columns, (N, 1): plain arrays, the library knows no other kind."""
    return {
        name: np.asarray(value).reshape(-1, 1)
        if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype != object
        else value
        for name, value in part.items()
    }


@contextmanager
def _record(run: Run, parts: Sequence[Part], progress: Progress) -> Iterator[dict[str, Any]]:
    """Yield structures `about`, `points`, `estimates`, `events`, `raw`, each with a `units` of its fields.

    The raw samples are in a temporary file, which is mapped into memory: both libraries copy one column at a time.
    """
    record: dict[str, Any] = {}
    if "about" in parts:
        record["about"] = dict(about_rows(run))
    if "points" in parts:
        record["points"] = {name: np.asarray(column) for name, column in run.points().items()}
        record["points"]["units"] = run.units()
    if "estimates" in parts:
        record["estimates"] = {
            e.name.replace(" ", "_"): {"value": e.value, "standard_error": e.standard_error, "unit": e.unit}
            for e in run.estimates()
        }
    if "events" in parts:
        events = list(event_records(run))
        record["events"] = {
            "time": np.array([e["time"] for e in events]),
            "kind": np.array([e["kind"] for e in events], object),
            "fields": np.array([json.dumps(e["fields"], default=str) for e in events], object),
            "units": {"time": "s"},
        }
    if "raw" in parts:
        columns = raw_columns(run)
        with TemporaryFile() as file:
            samples = run.trace.sample_count
            mapped = (
                np.memmap(file, float, "w+", shape=(len(columns), samples)) if samples else np.empty((len(columns), 0))
            )
            start = 0
            for chunk in raw_chunks(run, progress):
                mapped[:, start : start + chunk[0].size] = chunk
                start += chunk[0].size
            names = (name for name, _ in columns)
            record["raw"] = {**dict(zip(names, mapped, strict=True)), "units": dict(columns)}
            yield record
    else:
        yield record
