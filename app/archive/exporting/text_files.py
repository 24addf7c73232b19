"""Export as CSV and JSON, written in chunks."""

import json
from collections.abc import Callable, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO

from app.archive.description import run_record
from app.archive.exporting.parts import Part, event_records, raw_chunks, raw_columns, series_record
from app.common import Progress, Table
from model import Array
from protocols.base import to_jsonable
from protocols.runfile import Run


def write_csv(run: Run, table: Table | None, path: Path, progress: Progress) -> None:
    """Write a table of a run; without one, the raw samples.

    Raises:
        OperationCancelled: `progress` is cancelled.
    """
    if table is not None:
        table.to_csv(path)
        return
    with path.open("wb") as file:
        file.write((",".join(f"{name} [{unit}]" for name, unit in raw_columns(run)) + "\n").encode())
        write_rows = _arrow_rows if find_spec("pyarrow") is not None else _plain_rows
        for columns in raw_chunks(run, progress):
            write_rows(file, columns)


def _arrow_rows(file: BinaryIO, columns: Sequence[Array]) -> None:
    """Write rows of numbers, each in the fewest digits that give its value back, by PyArrow: seven times as fast as without it."""
    import pyarrow as pa
    from pyarrow import csv

    names = [str(at) for at in range(len(columns))]
    csv.write_csv(pa.table(list(columns), names=names), file, csv.WriteOptions(include_header=False))


def _plain_rows(file: BinaryIO, columns: Sequence[Array]) -> None:
    rows = zip(*(column.tolist() for column in columns), strict=True)
    file.write("".join(",".join(map(repr, scan)) + "\n" for scan in rows).encode())


def json_writer(run: Run, parts: Sequence[Part]) -> Callable[[Path, Progress], None]:
    """Return the function that writes the parts of a run as one object; it raises OperationCancelled."""
    whole = run_record(run)
    about = {k: v for k, v in whole.items() if k not in ("points", "units", "estimates")}
    record: dict[str, Any] = about | {"configuration": run.record.configuration} if "about" in parts else {}
    if "points" in parts:
        record |= {"points": whole["points"], "units": whole["units"]}
    if "estimates" in parts:
        record["estimates"] = whole["estimates"]
    if "series" in parts:
        record["series"] = [series_record(one) for one in run.series()]
    if "events" in parts:
        record["events"] = list(event_records(run))
    return partial(_write_json, run, to_jsonable(record), "raw" in parts)


def _write_json(run: Run, record: Any, with_raw: bool, path: Path, progress: Progress) -> None:
    with path.open("w", encoding="utf-8", errors="backslashreplace") as file:
        text = json.dumps(record, ensure_ascii=False, allow_nan=False)
        file.write(text.removesuffix("}"))
        if with_raw:
            columns_of_raw = raw_columns(run)
            file.write((", " if record else "") + '"raw": {"units": ' + json.dumps(dict(columns_of_raw)))
            shares = progress.split([1] * len(columns_of_raw))
            for at, ((name, _), column_progress) in enumerate(zip(columns_of_raw, shares, strict=True)):
                file.write(f', "{name}": [')
                for number, columns in enumerate(raw_chunks(run, column_progress)):
                    values = (f"{v:.9g}" if v == v else "null" for v in columns[at].tolist())
                    file.write(("," if number else "") + ",".join(values))
                file.write("]")
            file.write("}")
        file.write("}\n")
