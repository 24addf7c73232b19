"""A command's result, rendered as tables, JSON, CSV or a picture."""

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.cli.options import FileOptions
from app.common import Column, ExitCode, Table, UsageError, print_line, print_message
from protocols.base import to_jsonable, visible_text

if TYPE_CHECKING:
    from model.studies import PaperFigure  # loads scipy

PICTURE_SUFFIXES = (".png", ".pdf", ".svg")
"""Suffixes of picture files."""

NO_FILES = FileOptions()


@dataclass(frozen=True, slots=True)
class CommandResult:
    """The result of a command. `write_csv` writes a CSV file (default: the first table), `figures` are the panels of a picture."""

    command: str
    specimen: Mapping[str, float]
    tables: tuple[Table, ...]
    notes: tuple[str, ...] = ()
    write_csv: Callable[[Path], None] | None = None
    figures: "tuple[PaperFigure, ...]" = ()
    log_scale: bool = False
    extra: Mapping[str, Any] = field(default_factory=dict)
    heading: tuple[str, ...] = ()
    """Lines before the tables."""


def render(result: CommandResult, as_json: bool, files: FileOptions = NO_FILES) -> int:
    """Write the requested files and print the result as tables or as JSON.

    Raises:
        UsageError: a file cannot be written.
    """
    if files.csv:
        with writing_output(files.csv):
            (result.write_csv or result.tables[0].to_csv)(files.csv)
    if files.picture:
        from app.plotting import draw_figure

        with writing_output(files.picture, PICTURE_SUFFIXES):
            draw_figure(result.figures, files.picture, log=result.log_scale)
    if as_json:
        print_json(result_record(result))
        return ExitCode.DONE
    for line in (*result.heading, *([""] if result.heading else [])):
        print_line(line)
    for table in result.tables:
        print_table(table)
    for note in result.notes:
        print_line(note)
    return ExitCode.DONE


def result_record(result: CommandResult) -> dict[str, Any]:
    """Return the result as one JSON object in SI: tables by name, their columns by name, and the units of all columns."""
    tables = {}
    for table in result.tables:
        columns = {c.name: c.cells for c in table.columns}
        tables[table.name] = {k: v[0] for k, v in columns.items()} if table.vertical else columns
    units = {c.name: c.unit for table in result.tables for c in table.columns}
    return {"command": result.command, "specimen": dict(result.specimen), **tables, **result.extra, "units": units}


def check_output_files(files: FileOptions) -> None:
    """Raise UsageError for files that `render` could not write, before anything is computed."""
    if files.csv:
        check_output_file(files.csv)
    if files.picture:
        check_output_file(files.picture, PICTURE_SUFFIXES)


def check_output_file(path: Path, suffixes: Sequence[str] = ()) -> None:
    """Raise UsageError for a file in a missing folder, with none of the `suffixes`, or in place of measured data."""
    if not path.parent.is_dir():
        raise UsageError(f"{path} cannot be written: there is no folder {path.parent}; create it or choose another")
    if suffixes and path.suffix.lower() not in suffixes:
        raise UsageError(f"{path} cannot be drawn: a picture ends in {', '.join(suffixes)}")
    from protocols.runfile import is_hdf5  # slow to load, and most commands write no file

    if is_hdf5(path):
        raise UsageError(f"{path} holds a run or a study and is not overwritten; choose another name")


@contextmanager
def writing_output(path: Path, suffixes: Sequence[str] = ()) -> Iterator[None]:
    """Report that a file was written, or raise UsageError with the reason why it cannot be."""
    check_output_file(path, suffixes)
    try:
        yield
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror or error}; choose another file") from error
    print_message(f"wrote {path}")


FILE_WIDTH, TEXT_WIDTH = 120, 12
"""Characters of a line into a file or pipe, and the least of a column of texts in it."""


def print_table(table: Table) -> None:
    """Print a table on standard output."""
    from rich.console import Console  # answers of lines and JSON need it not
    from rich.table import Table as RichTable

    if table.vertical:
        shown = RichTable(show_header=False, box=None, padding=(0, 2))
        for column, value in zip(table.columns, table.rows[0], strict=True):
            unit = "" if value is None or isinstance(value, str) else column.displayed_unit
            shown.add_row(visible_text(column.displayed_name), column.format_value(value), unit)
    else:
        shown = RichTable(box=None, padding=(0, 2), header_style="bold")
        displayed = [column for column in table.columns if column.displayed]
        for column in displayed:
            text = any(isinstance(v, str) for v in column.values)
            longest = 0 if text else max((len(column.format_value(value)) for value in column.cells), default=0)
            unit = f"({column.displayed_unit})" if column.displayed_unit else ""
            shown.add_column(
                f"{visible_text(column.displayed_name)}\n{visible_text(unit)}",
                justify="left" if text else "right",
                overflow="fold",
                min_width=longest or None,
            )
        rows = [*zip(*(column.cells for column in displayed), strict=True)]
        step = max(-(-(len(rows) - table.leading_rows) // table.max_rows), 1)
        for row in (*rows[: table.leading_rows], *rows[table.leading_rows :: step]):
            shown.add_row(*map(Column.format_value, displayed, row))
        if step > 1:
            shown.caption = f"one row in {step} of {len(rows)}; all of them with --csv or --json"
    # Into a file or pipe a line is as long as its numbers need: a wrapped number is unreadable for people and programs.
    width = (
        None
        if sys.stdout.isatty()
        else max(FILE_WIDTH, sum(each.min_width or TEXT_WIDTH for each in shown.columns) + 4 * len(shown.columns))
    )
    out = Console(highlight=False, markup=False, width=width)
    out.print(visible_text(table.title, multiline=True), style="bold", soft_wrap=True)
    out.print(shown)
    out.print()


def print_answer(record: Any, lines: Iterable[str], as_json: bool) -> int:
    """Print a record as JSON, or as lines of text; return the exit code 0."""
    if as_json:
        print_json(record)
    else:
        for line in lines:
            print_line(line)
    return ExitCode.DONE


def print_json(record: Any) -> None:
    """Print a record as one line of JSON."""
    print_line(json.dumps(to_jsonable(record), allow_nan=False))
