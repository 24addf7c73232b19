"""Export as tables: CSV and JSON, written in chunks, Parquet, and Excel workbooks.

Units are in the headings, in Parquet in the metadata of the columns. The library of a format is imported when it is used.
"""

import json
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from app.archive.description import run_record
from app.archive.exporting.parts import (
    ExportedRun,
    Part,
    event_records,
    part_tables,
    raw_chunks,
    raw_columns,
    series_record,
)
from app.common import Column, Progress, Table
from model import Array
from protocols.base import to_jsonable


def write_csv(run: ExportedRun, table: Table | None, path: Path, progress: Progress) -> None:
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


def json_writer(run: ExportedRun, parts: Sequence[Part]) -> Callable[[Path, Progress], None]:
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


def _write_json(run: ExportedRun, record: Any, with_raw: bool, path: Path, progress: Progress) -> None:
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


COMPRESSION = "zstd"


def write_parquet(run: ExportedRun, table: Table | None, path: Path, progress: Progress) -> None:
    """Write a table of a run; without one, the raw samples, which are streamed.

    Raises:
        OperationCancelled: `progress` is cancelled.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    def field(name: str, kind: Any, unit: str | None) -> Any:
        return pa.field(name, kind, metadata={"unit": unit} if unit else None)

    about = _file_metadata(run)
    if table is not None:
        columns = [(c.name, c.unit, pa.array(_plain(c.values))) for c in table.columns]
        schema = pa.schema([field(name, values.type, unit) for name, unit, values in columns], about)
        with path.open("wb") as file:  # its own opening takes UTF-8 names only
            pq.write_table(pa.table([values for *_, values in columns], schema=schema), file, compression=COMPRESSION)
        return
    schema = pa.schema([field(name, pa.float64(), unit) for name, unit in raw_columns(run)], about)
    with path.open("wb") as file, pq.ParquetWriter(file, schema, compression=COMPRESSION) as writer:
        for chunk in raw_chunks(run, progress):
            writer.write_table(pa.table([pa.array(column, pa.float64()) for column in chunk], schema=schema))


def _plain(values: Iterable[Any]) -> Any:
    """Return numbers as they are and everything else as text."""
    array = np.asarray(values if isinstance(values, np.ndarray) else list(values))
    return array if array.dtype.kind in "fiub" else [str(value) for value in values]


def _file_metadata(run: ExportedRun) -> dict[str, str]:
    return {
        "run": run.path.name,
        "protocol": run.record.protocol,
        "specimen": run.record.specimen,
        "start_time": run.record.start_time,
        "simulated": str(run.record.simulated).lower(),
    }


MAX_SHEET_COLUMN_WIDTH = 60
"""Of a column, in characters."""

# A text that begins like a formula or an address stays a text.
WORKBOOK_OPTIONS = {
    "strings_to_formulas": False,
    "strings_to_urls": False,
    "strings_to_numbers": False,
    "nan_inf_to_errors": False,
}


def xlsx_writer(run: ExportedRun, parts: Sequence[Part]) -> Callable[[Path, Progress], None]:
    """Return the function that writes the parts of a run as sheets, with names and units in a first row that stays in view.

    It raises OperationCancelled.
    """
    tables = [table for part in parts for table in ((None,) if part == "raw" else part_tables(run, part))]
    return partial(_write_xlsx, run, tables)


def _write_xlsx(run: ExportedRun, tables: Sequence[Table | None], path: Path, progress: Progress) -> None:
    import xlsxwriter

    with xlsxwriter.Workbook(str(path), {**WORKBOOK_OPTIONS, "constant_memory": True}) as book:
        heading = book.add_format({"bold": True})
        title = f"{run.record.specimen} {run.record.protocol}{' SIMULATED' if run.record.simulated else ''}"
        book.set_properties({"title": title, "comments": run.path.name})
        for table in tables:
            sheet = book.add_worksheet("raw" if table is None else table.name)
            sheet.freeze_panes(1, 0)
            if table is None:
                sheet.write_row(0, 0, [f"{name} [{unit}]" for name, unit in raw_columns(run)], heading)
                row = 1
                for chunk in raw_chunks(run, progress):
                    for scan in zip(*(column.tolist() for column in chunk), strict=True):
                        sheet.write_row(row, 0, scan)
                        row += 1
                continue
            columns = table.columns
            for at, column in enumerate(columns):
                sheet.set_column(at, at, _width(column))
            sheet.write_row(0, 0, [_heading(column) for column in columns], heading)
            for row, cells in enumerate(zip(*(column.cells for column in columns), strict=True), 1):
                for at, cell in enumerate(cells):
                    if cell is not None:  # an empty cell: Excel has no NaN
                        sheet.write(row, at, cell)


def _heading(column: Column) -> str:
    return column.name if column.unit is None else f"{column.name} [{column.unit}]"


def _width(column: Column) -> int:
    texts = (len(cell) for cell in column.cells if isinstance(cell, str))
    return min(max(len(_heading(column)), max(texts, default=0), 10) + 1, MAX_SHEET_COLUMN_WIDTH)
