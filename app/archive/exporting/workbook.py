"""Export as an Excel workbook with a sheet for each part."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import xlsxwriter

from app.archive.exporting.parts import Part, part_tables, raw_chunks, raw_columns
from app.common import Column, Progress, Table
from protocols.runfile import Run

MAX_WIDTH = 60
"""Of a column, in characters."""

# A text that begins like a formula or an address stays a text.
OPTIONS = {
    "strings_to_formulas": False,
    "strings_to_urls": False,
    "strings_to_numbers": False,
    "nan_inf_to_errors": False,
}


def xlsx_writer(run: Run, parts: Sequence[Part]) -> Callable[[Path, Progress], None]:
    """Return the function that writes the parts of a run as sheets, with names and units in a first row that stays in view.

    It raises OperationCancelled.
    """
    tables = [table for part in parts for table in ((None,) if part == "raw" else part_tables(run, part))]
    return partial(_write_xlsx, run, tables)


def _write_xlsx(run: Run, tables: Sequence[Table | None], path: Path, progress: Progress) -> None:
    with xlsxwriter.Workbook(str(path), {**OPTIONS, "constant_memory": True}) as book:
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
    return min(max(len(_heading(column)), max(texts, default=0), 10) + 1, MAX_WIDTH)
