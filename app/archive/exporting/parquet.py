"""Export as Parquet files, one for each part; units are in the metadata of the columns."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from app.archive.exporting.parts import raw_chunks, raw_columns
from app.common import Progress, Table
from protocols.runfile import Run

COMPRESSION = "zstd"


def write_parquet(run: Run, table: Table | None, path: Path, progress: Progress) -> None:
    """Write a table of a run; without one, the raw samples, which are streamed.

    Raises:
        OperationCancelled: `progress` is cancelled.
    """
    about = _file_metadata(run)
    if table is not None:
        columns = [(c.name, c.unit, pa.array(_plain(c.values))) for c in table.columns]
        schema = pa.schema([_field(name, values.type, unit) for name, unit, values in columns], about)
        with path.open("wb") as file:  # its own opening takes UTF-8 names only
            pq.write_table(pa.table([values for *_, values in columns], schema=schema), file, compression=COMPRESSION)
        return
    schema = pa.schema([_field(name, pa.float64(), unit) for name, unit in raw_columns(run)], about)
    with path.open("wb") as file, pq.ParquetWriter(file, schema, compression=COMPRESSION) as writer:
        for chunk in raw_chunks(run, progress):
            writer.write_table(pa.table([pa.array(column, pa.float64()) for column in chunk], schema=schema))


def _field(name: str, kind: Any, unit: str | None) -> Any:
    return pa.field(name, kind, metadata={"unit": unit} if unit else None)


def _plain(values: Iterable[Any]) -> Any:
    """Return numbers as they are and everything else as text."""
    array = np.asarray(values if isinstance(values, np.ndarray) else list(values))
    return array if array.dtype.kind in "fiub" else [str(value) for value in values]


def _file_metadata(run: Run) -> dict[str, str]:
    return {
        "run": run.path.name,
        "protocol": run.record.protocol,
        "specimen": run.record.specimen,
        "start_time": run.record.start_time,
        "simulated": str(run.record.simulated).lower(),
    }
