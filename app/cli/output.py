"""One answer of the model, told four ways: a table for a person, JSON for a machine, CSV for a sheet, a picture."""

import argparse
import csv
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import pi
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table as RichTable

from app.common.errors import DONE, UsageError
from model.studies.paper_figures import Figure
from protocols.base.jsonable import plain
from protocols.runfile.schema import is_hdf5

SCALES = {"µm": 1e6, "mm": 1e3, "ms": 1e3, "%": 1e2, "°": 180 / pi, "nm/V": 1e9, "µm/N": 1e6, "g": 1e3, "krad/s": 1e-3}
"""What a number in SI is multiplied by to be read in one of these."""

PICTURES = (".png", ".pdf", ".svg")
"""What a picture's name may end in."""

Value = float | int | str | None


@dataclass(frozen=True, slots=True)
class Column:
    """Values of one name in SI; `shown` is the unit a person reads them in, `head` the words for it.

    What is not `told` is for machines only: JSON and CSV have it.
    """

    name: str
    unit: str
    values: Sequence[Any] | NDArray[Any]
    head: str = ""
    shown: str = ""
    form: str = ".5g"
    meaning: str = ""
    told: bool = True

    def words(self) -> str:
        """The head of the column, its unit below."""
        unit = self.shown or self.unit
        return f"{self.head or self.name}\n" + (f"({unit})" if unit else "")

    def text(self, value: Value) -> str:
        """One value as a person reads it."""
        if value is None:
            return "never"
        if isinstance(value, str):
            return value
        text = format(value * SCALES.get(self.shown, 1), self.form)
        return text if text.strip("-0.") else text.removeprefix("-")


@dataclass(frozen=True, slots=True)
class Table:
    """Columns of one length; `upright` shows its only row as a list."""

    name: str
    title: str
    columns: tuple[Column, ...]
    upright: bool = False
    most: int = 60
    """Rows a person is shown; longer tables are thinned, but for their first `lead` rows."""
    lead: int = 0

    @property
    def rows(self) -> list[tuple[Value, ...]]:
        """Plain values, row by row."""
        return list(zip(*([_plain(v) for v in column.values] for column in self.columns), strict=True))

    def to_csv(self, path: Path) -> None:
        """Row by row, SI, units in the header, every digit."""
        with path.open("w", newline="", encoding="utf-8") as file:
            sheet = csv.writer(file)
            sheet.writerow(f"{c.name} [{c.unit}]" for c in self.columns)
            sheet.writerows(
                ["" if v is None else v if isinstance(v, str) else repr(v) for v in row] for row in self.rows
            )


class Sheet(Protocol):
    """What can be written as CSV."""

    def to_csv(self, path: Path) -> None: ...


@dataclass(frozen=True, slots=True)
class Answer:
    """What a command found. `curve` is what goes into a CSV file, `pictures` the panels of a picture."""

    command: str
    specimen: Mapping[str, float]
    tables: tuple[Table, ...]
    notes: tuple[str, ...] = ()
    curve: Sheet | None = None
    pictures: tuple[Figure, ...] = ()
    log: bool = False
    more: Mapping[str, Any] = field(default_factory=dict)


def deliver(answer: Answer, options: argparse.Namespace) -> int:
    """Write what was asked for and tell the rest.

    Raises:
        UsageError: a file cannot be written.
    """
    if getattr(options, "csv", None):
        with writing(options.csv):
            (answer.curve or answer.tables[0]).to_csv(options.csv)
    if getattr(options, "picture", None):
        from app.plotting.charts import draw

        with writing(options.picture, PICTURES):
            draw(answer.pictures, options.picture, log=answer.log)
    if options.json:
        say(json.dumps(plain(record(answer)), allow_nan=False))
    else:
        for table in answer.tables:
            show(table)
        for note in answer.notes:
            say(note)
    return DONE


def record(answer: Answer) -> dict[str, Any]:
    """The answer as one JSON object, SI: tables by name, each a column by name; units of all columns beside."""
    tables = {}
    for table in answer.tables:
        columns = {c.name: [_plain(v) for v in c.values] for c in table.columns}
        tables[table.name] = {k: v[0] for k, v in columns.items()} if table.upright else columns
    units = {c.name: c.unit for table in answer.tables for c in table.columns}
    return {"command": answer.command, "specimen": dict(answer.specimen), **tables, **answer.more, "units": units}


def check_files(options: argparse.Namespace) -> None:
    """Refuse what `deliver` could not write, before anything is computed."""
    if getattr(options, "csv", None):
        check_file(options.csv)
    if getattr(options, "picture", None):
        check_file(options.picture, PICTURES)


def check_file(path: Path, kinds: Sequence[str] = ()) -> None:
    """Refuse a file in a folder that does not exist, of none of `kinds`, or in the place of measured data."""
    if not path.parent.is_dir():
        raise UsageError(f"{path} cannot be written: there is no folder {path.parent}; create it or choose another")
    if kinds and path.suffix.lower() not in kinds:
        raise UsageError(f"{path} cannot be drawn: a picture ends in {', '.join(kinds)}")
    if is_hdf5(path):
        raise UsageError(f"{path} holds a run or a study and is not overwritten; choose another name")


@contextmanager
def writing(path: Path, kinds: Sequence[str] = ()) -> Iterator[None]:
    """Tells that a file was written, or refuses in a sentence why it cannot be."""
    check_file(path, kinds)
    try:
        yield
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror or error}; choose another file") from error
    sys.stderr.write(f"wrote {path}\n")


def tracked(items: Sequence[Any], words: str) -> Iterator[Any]:
    """The items, with a bar on a terminal."""
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, disable=not console.is_terminal, transient=True) as progress:
        yield from progress.track(items, description=words)


def show(table: Table) -> None:
    """The table for a person, on standard output."""
    rows = table.rows
    if table.upright:
        shown = RichTable(show_header=False, box=None, padding=(0, 2))
        for column, value in zip(table.columns, rows[0], strict=True):
            known = value is not None and not isinstance(value, str)
            shown.add_row(
                column.head or column.name, column.text(value), (column.shown or column.unit) if known else ""
            )
    else:
        shown = RichTable(box=None, padding=(0, 2), header_style="bold")
        told = [column for column in table.columns if column.told]
        for column in told:
            text = any(isinstance(v, str) for v in column.values)
            shown.add_column(column.words(), justify="left" if text else "right", overflow="fold")
        step = max(-(-(len(rows) - table.lead) // table.most), 1)
        for i in (*range(table.lead), *range(table.lead, len(rows), step)):
            shown.add_row(*(column.text(_plain(column.values[i])) for column in told))
        if step > 1:
            shown.caption = f"one row in {step} of {len(rows)}; all of them with --csv or --json"
    out = Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else 120)
    out.print(table.title, style="bold", soft_wrap=True)
    out.print(shown)
    out.print()


def say(text: str) -> None:
    """A line on standard output."""
    sys.stdout.write(text + "\n")


def _plain(value: Any) -> Value:
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, int | np.integer):
        return int(value)
    return float(value) if np.isfinite(value) else None
