"""CSV reader: detects delimiter, header rows and decimal comma."""

import csv
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from app.archive.importing.import_table import UNIT_SUFFIXES, ImportTable, TableColumn, split_heading
from app.archive.importing.plain_numbers import numeric_columns
from app.common import NO_PROGRESS, Progress, truncate_text
from protocols.base import TableImportError

COMMENT_MARKS = ("#", "%", "//")
"""Starts of comment lines."""
DELIMITERS = "\t;|,"
"""Delimiters, the most reliable first; otherwise blanks."""
FIRST_NUMBER = re.compile(r"^[ \t]*[-+.]?\d", re.MULTILINE)
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
LONG_TABLE_CHARACTERS = 100_000
"""Length from which plain numbers are read in bulk."""
SCAN_SHARE, SPLIT_SHARE = 0.4, 0.9
"""Progress when lines are split, and when cells are."""
DECIMAL_POINT = re.compile(r"[-+]?\d*\.\d+([eE][-+]?\d+)?")


def read_text_table(path: Path, data: bytes, progress: Progress = NO_PROGRESS) -> ImportTable:
    """Read the table in a file's bytes.

    Raises:
        TableImportError: the file is not text, or has no table.
    """
    try:
        return _parse_table(path, _decode(path, data), progress, data)
    except csv.Error as error:
        raise TableImportError(f"{path} is not a table of cells ({error}); save it again as CSV") from None


def _decode(path: Path, data: bytes) -> str:
    for mark, encoding in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if data.startswith(mark):
            return data.decode(encoding, errors="replace")
    if b"\0" in data:
        raise TableImportError(f"{path} is neither text nor a MAT file; save the table as CSV")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:  # written by spreadsheets on Windows
        return data.decode("cp1252", errors="replace")


def _parse_table(path: Path, text: str, progress: Progress, data: bytes = b"") -> ImportTable:
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if len(text) >= LONG_TABLE_CHARACTERS and (table := _read_plain_numbers(path, data, text, progress)) is not None:
        return table
    mark, lines = _delimited_lines(path, text, progress.part(0.0, SCAN_SHARE))
    # Without quotation marks a plain split gives the same cells five times faster.
    cut = partial(_split_line, delimiter=mark) if len(mark) > 1 or '"' in text else partial(str.split, sep=mark)
    rows = [
        (at, tuple(map(str.strip, cut(line)))) for at, line in progress.part(SCAN_SHARE, SPLIT_SHARE).iterate(lines)
    ]
    (first, heads), body = rows[0], rows[1:]
    if all(_is_number(cell) for cell in heads if cell):
        raise TableImportError(
            f"{path}, line {first}: '{truncate_text(lines[0][1])}' are numbers where the names of the columns are expected; "
            "put a line above it, for example 'frequency [Hz],peak_to_peak [um]'"
        )
    _check_widths(path, rows, mark)
    split = [split_heading(head) for head in heads]
    if units := _units(body[0][1]) if body else []:
        split = [(name, unit or below) for (name, unit), below in zip(split, units, strict=True)]
        body = body[1:]
    if not body:
        raise TableImportError(f"{path} has a header (line {first}) and no values below it")
    columns = tuple(
        TableColumn(head, name, unit, below)
        for head, (name, unit), below in zip(heads, split, zip(*(cells for _, cells in body), strict=True), strict=True)
        if head or any(below)  # a mark at the end of every line makes an empty column
    )
    return ImportTable(path, columns, [at for at, _ in body], decimal_comma=_uses_decimal_comma(path, body))


def _delimited_lines(path: Path, text: str, progress: Progress) -> tuple[str, list[tuple[int, str]]]:
    """Return the delimiter, and the lines with their numbers, without empty ones and remarks."""
    lines = [
        (at, line)
        for at, line in enumerate(progress.iterate(text.split("\n")), 1)
        if (bare := line.lstrip(' "')) and not bare.isspace() and not bare.startswith(COMMENT_MARKS)
    ]
    declared = re.fullmatch(r"sep=(.)", lines[0][1].strip()) if lines else None
    if not (lines := lines[1:] if declared else lines):
        raise TableImportError(f"{path} holds remarks only; give a header line and values below it")
    return declared[1] if declared else _find_delimiter(path, lines), lines


def _read_plain_numbers(path: Path, data: bytes, text: str, progress: Progress) -> ImportTable | None:
    """Read a table of plain numbers in consecutive lines below its header; None for any other content.

    Reading a table cell by cell finds its faults and their places.
    """
    match, end = FIRST_NUMBER.search(text), len(text)
    begin = match.start() if match else -1
    while end > 0 and text[end - 1].isspace():
        end -= 1
    first_end, last = text.find("\n", begin), text.rfind("\n", 0, end) + 1
    if '"' in text or not 0 <= begin < first_end < last:
        return None
    header, first, final = text[:begin], text[begin:first_end], text[last:end]
    try:
        sample = _parse_table(path, f"{header}{first}\n{final}", NO_PROGRESS)
    except TableImportError:
        return None
    width = len(sample.columns)
    delimiter = next((mark for mark in DELIMITERS if len(final.split(mark)) == width), None)
    values = numeric_columns(path, data, text, (begin, end), delimiter, progress)
    if values is None or len(values) != width:
        return None
    columns = tuple(replace(column, cells=cells) for column, cells in zip(sample.columns, values, strict=True))
    first_line = header.count("\n") + 1
    return replace(sample, columns=columns, row_numbers=range(first_line, first_line + len(values[0])))


def _find_delimiter(path: Path, lines: Sequence[tuple[int, str]]) -> str:
    """Return the delimiter."""
    (at, head), body = lines[0], lines[1:]
    for mark in DELIMITERS:
        if len(_split_line(head, mark)) > 1:
            return mark
    if not body:
        return ","
    last = body[-1][1]  # typical values, even below a title line that is not marked as a comment
    blanks = [
        mark for mark in (r"\s{2,}", r"\s+") if len(_split_line(head, mark)) == len(_split_line(last, r"\s+")) > 1
    ]
    if blanks:
        return blanks[0]
    if any(mark in last for mark in "\t;|") or len(_split_line(last, r"\s+")) > 1:
        raise TableImportError(
            f"{path}, line {at}: '{truncate_text(head)}' does not name the columns below it; begin remarks with #, "
            "and give one line with a name for each column"
        )
    return ","


def _split_line(line: str, delimiter: str) -> list[str]:
    if len(delimiter) > 1:
        return re.split(delimiter if line.strip()[:1].isalpha() else r"\s+", line.strip())
    return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))


def _check_widths(path: Path, rows: Sequence[tuple[int, Sequence[str]]], delimiter: str) -> None:
    """Refuse the first row with more or fewer cells than the header."""
    (first, heads), *body = rows
    for at, cells in body:
        if len(cells) != len(heads):
            remedy = "give every column a cell, an empty one where there is no value"
            if delimiter == "," and len(cells) == 2 * len(heads):
                remedy = (
                    "decimal commas cannot be distinguished from delimiting commas: save it with ; between the cells"
                )
            raise TableImportError(
                f"{path}, line {at}: {len(cells)} cells where the header (line {first}) names {len(heads)} columns: '{truncate_text(delimiter.join(cells))}'; {remedy}"
            )


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _units(cells: Sequence[str]) -> list[str | None]:
    """Return the units in a line, None for an empty cell; nothing for a line that holds anything else."""
    texts = [cell.strip("[]() ") or None for cell in cells]
    is_unit = (text.casefold() in UNIT_SUFFIXES or text in ("°", "%", "1") for text in texts if text)
    return texts if any(texts) and all(is_unit) else []


def _uses_decimal_comma(path: Path, body: Sequence[tuple[int, Sequence[str]]]) -> bool:
    comma = _first_number(body, ",", DECIMAL_COMMA)
    if comma is None:
        return False
    if (point := _first_number(body, ".", DECIMAL_POINT)) is not None:
        (a, one), (b, other) = comma, point
        raise TableImportError(
            f"{path} has a decimal comma in line {a} ('{one}') and a decimal point in line {b} ('{other}'); use one of them"
        )
    return True


def _first_number(
    body: Sequence[tuple[int, Sequence[str]]], delimiter: str, form: re.Pattern[str]
) -> tuple[int, str] | None:
    """Return line and text of the first number with this mark."""
    return next(
        ((at, cell) for at, cells in body for cell in cells if delimiter in cell and form.fullmatch(cell)), None
    )
