"""Tables in text, CSV of any country: which marks part the cells, where the header ends, whether commas are decimal."""

import csv
import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from app.archive.importing.table import Cells, Sheet, SheetError, is_unit, split_head
from app.common.inputs import shortened
from app.common.progress import Tell, counted, part, untold

COMMENTS = ("#", "%", "//")
"""What a line of remarks begins with."""
MARKS = "\t;|,"
"""What may stand between two cells, the surest first; else blanks."""
COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
LOOKED, CUT = 0.4, 0.9
"""How far reading is when the lines are found, and when they are cells."""
POINT = re.compile(r"[-+]?\d*\.\d+([eE][-+]?\d+)?")


def read_text(path: Path, sha256: str, data: bytes, tell: Tell = untold) -> Sheet:
    """The table in a file's bytes.

    Raises:
        SheetError: it is no text, or holds no table.
    """
    try:
        return _table(path, sha256, _decoded(path, data), tell)
    except csv.Error as error:
        raise SheetError(f"{path} is no table of cells ({error}); save it anew as CSV") from None


def _decoded(path: Path, data: bytes) -> str:
    for mark, encoding in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if data.startswith(mark):
            return data.decode(encoding, errors="replace")
    if b"\0" in data:
        raise SheetError(f"{path} is no text and no MAT file; save the table as CSV")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:  # what a spreadsheet on Windows writes
        return data.decode("cp1252", errors="replace")


def _table(path: Path, sha256: str, text: str, tell: Tell) -> Sheet:
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    lines = [
        (at, line)
        for at, line in enumerate(counted(text.split("\n"), part(tell, 0.0, LOOKED)), 1)
        if (bare := line.lstrip(' "')) and not bare.isspace() and not bare.startswith(COMMENTS)
    ]
    mark: str | None = None
    if lines and (told := re.fullmatch(r"sep=(.)", lines[0][1].strip())):
        mark, lines = told[1], lines[1:]
    if not lines:
        raise SheetError(f"{path} holds remarks only; give a header line and values below it")
    mark = mark or _mark(path, lines)
    # Without a quotation mark a line is parted where the mark stands: five times faster, and the same cells.
    cut = partial(_split, mark=mark) if len(mark) > 1 or '"' in text else partial(str.split, sep=mark)
    rows = [(at, tuple(map(str.strip, cut(line)))) for at, line in counted(lines, part(tell, LOOKED, CUT))]
    (first, heads), body = rows[0], rows[1:]
    if all(_is_number(cell) for cell in heads if cell):
        raise SheetError(
            f"{path}, line {first}: '{shortened(lines[0][1])}' are numbers where the names of the columns should stand; "
            "put a line above it, for example 'frequency [Hz],peak_to_peak [um]'"
        )
    for at, cells in body:
        if len(cells) != len(heads):
            raise SheetError(_uneven(path, at, cells, first, heads, mark))
    split = [split_head(head) for head in heads]
    if body and _are_units(body[0][1]):
        units = [cell.strip("[]() ") or None for cell in body[0][1]]
        split = [(name, unit or below) for (name, unit), below in zip(split, units, strict=True)]
        body = body[1:]
    if not body:
        raise SheetError(f"{path} has a header (line {first}) and no values below it")
    columns = []
    for i, (head, (name, unit)) in enumerate(zip(heads, split, strict=True)):
        below = [row[i] for _, row in body]
        if head or any(below):  # a mark at the end of every line makes an empty column
            columns.append(Cells(head, name, unit, below))
    return Sheet(path, sha256, tuple(columns), [f"line {at}" for at, _ in body], _decimal_comma(path, body))


def _mark(path: Path, lines: Sequence[tuple[int, str]]) -> str:
    """What stands between the cells: what the header has, else what lies between two words of it."""
    (at, head), body = lines[0], lines[1:]
    for mark in MARKS:
        if len(_split(head, mark)) > 1:
            return mark
    if not body:
        return ","
    last = body[-1][1]  # what a value looks like, even below a title that somebody forgot to mark
    blanks = [mark for mark in (r"\s{2,}", r"\s+") if len(_split(head, mark)) == len(_split(last, r"\s+")) > 1]
    if blanks:
        return blanks[0]
    if any(mark in last for mark in "\t;|") or len(_split(last, r"\s+")) > 1:
        raise SheetError(
            f"{path}, line {at}: '{shortened(head)}' does not name the columns below it; begin remarks with #, "
            "and give one line with a name for each column"
        )
    return ","


def _split(line: str, mark: str) -> list[str]:
    if len(mark) > 1:
        return re.split(mark if line.strip()[:1].isalpha() else r"\s+", line.strip())
    return next(csv.reader([line], delimiter=mark, skipinitialspace=True))


def _uneven(path: Path, at: int, cells: Sequence[str], first: int, heads: Sequence[str], mark: str) -> str:
    said = f"{path}, line {at}: {len(cells)} cells where the header (line {first}) names {len(heads)} columns: '{shortened(mark.join(cells))}'"
    if mark == "," and len(cells) == 2 * len(heads):
        return f"{said}; decimal commas between commas cannot be told apart: save it with ; between the cells"
    return f"{said}; give every column a cell, an empty one where there is no value"


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _are_units(cells: Sequence[str]) -> bool:
    """Whether a line holds units and nothing else."""
    told = [cell.strip("[]() ") for cell in cells if cell.strip("[]() ")]
    return bool(told) and all(is_unit(cell) or cell in ("°", "%", "1") for cell in told)


def _decimal_comma(path: Path, body: Sequence[tuple[int, Sequence[str]]]) -> bool:
    comma = _first(body, ",", COMMA)
    if comma is None:
        return False
    if (point := _first(body, ".", POINT)) is not None:
        (a, one), (b, other) = comma, point
        raise SheetError(
            f"{path} has a decimal comma in line {a} ('{one}') and a decimal point in line {b} ('{other}'); use one of them"
        )
    return True


def _first(body: Sequence[tuple[int, Sequence[str]]], mark: str, form: re.Pattern[str]) -> tuple[int, str] | None:
    """Line and text of the first number with this mark."""
    return next(((at, cell) for at, cells in body for cell in cells if mark in cell and form.fullmatch(cell)), None)
