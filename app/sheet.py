"""A table in somebody's file, as any program writes it: CSV of any country, or MATLAB's vectors. Every cell knows its place."""

import csv
import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from app.arguments import shortened
from protocols.layout import SIGNATURE

COMMENTS = ("#", "%", "//")
"""What a line of remarks begins with."""
MARKS = "\t;|,"
"""What may stand between two cells, the surest first; else blanks."""
LARGEST_BYTES = 400_000_000

NOTHING = frozenset({"", "-", "--", "nan", "na", "n/a", "#n/a", "none", "null"})
"""Cells in which there is no number."""

COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
POINT = re.compile(r"[-+]?\d*\.\d+([eE][-+]?\d+)?")
HEAD = re.compile(r"(?P<name>.*?)\s*(?:\[(?P<a>[^\[\]]*)\]|\((?P<b>[^()]*)\)|/\s*(?P<c>[^\s/]+)|\sin\s(?P<d>\S+))")
SUFFIXES = {
    unit.casefold(): unit
    for unit in (
        "Hz",
        "kHz",
        "nm",
        "um",
        "µm",
        "mm",
        "cm",
        "m",
        "V",
        "kV",
        "N",
        "g",
        "kg",
        "s",
        "ms",
        "us",
        "deg",
        "rad",
    )
} | {"mv": "mV", "mn": "mN", "mg": "mg", "percent": "%"}
"""Units that may end a name: `amplitude_um`."""


class SheetError(Exception):
    """A file gives no table. The sentence says which file, where, what stands there, and what would do."""


@dataclass(frozen=True, slots=True)
class Cells:
    """One column: its head as it stands in the file, the name and unit in it, and what stands below."""

    head: str
    name: str
    unit: str | None
    cells: Sequence[str | float]


@dataclass(frozen=True, slots=True)
class Sheet:
    """A table. `places` tell where each row stands; `about` what else the file says of itself."""

    path: Path
    sha256: str
    columns: tuple[Cells, ...]
    places: Sequence[str]
    decimal_comma: bool = False
    about: Mapping[str, Any] = field(default_factory=dict)

    def number(self, column: Cells, row: int) -> float:
        """The number in a cell, NaN where it says that there is none.

        Raises:
            SheetError: it is neither.
        """
        cell = column.cells[row]
        if not isinstance(cell, str):
            return float(cell)
        text = cell.strip()
        if text.casefold() in NOTHING:
            return float("nan")
        if self.decimal_comma:
            text = text.replace(",", ".")
        try:
            if "_" in text:
                raise ValueError
            return float(text)
        except ValueError:
            hint = "write it without thousands separators" if re.fullmatch(r"[\d.,' ]+", text) else "write a number"
            raise SheetError(
                f"{self.at(row, column)}: '{shortened(cell)}' is no number; {hint}, or mend the line"
            ) from None

    def at(self, row: int, column: Cells) -> str:
        """File, line and column in words."""
        return f"{self.path}, {self.places[row]}, column '{column.head}'"


def read_sheet(path: Path) -> Sheet:
    """The table of a file.

    Raises:
        SheetError: there is no file, or no table in it.
    """
    try:
        if path.is_file() and path.stat().st_size > LARGEST_BYTES:
            raise SheetError(f"{path} has more than {LARGEST_BYTES / 1e6:.0f} MB; cut it into smaller files")
        data = path.read_bytes()
    except FileNotFoundError:
        raise SheetError(f"there is no file {path}") from None
    except OSError as error:
        raise SheetError(f"{path} cannot be read: {error.strerror or error}") from None
    sha256 = hashlib.sha256(data).hexdigest()
    if not data.strip():
        raise SheetError(
            f"{path} is empty; give a table with a header line, for example 'frequency [Hz],peak_to_peak [um]'"
        )
    if data.startswith(b"MATLAB 7.3 MAT-file"):
        raise SheetError(
            f"{path} is a MATLAB file of version 7.3, which is HDF5; save it anew: save('file.mat', '-v7')"
        )
    if data.startswith(SIGNATURE):
        raise SheetError(
            f"{path} is an HDF5 file: a run is used as it is; of anything else save the table as CSV or MAT"
        )
    if data.startswith(b"PK\x03\x04"):
        raise SheetError(f"{path} is a workbook or an archive; save its sheet as CSV")
    if data.startswith(b"MATLAB 5.0 MAT-file") or path.suffix.lower() == ".mat":
        from app.sheet_mat import read_mat  # scipy.io takes a while, and CSV needs none of it

        return read_mat(path, sha256)
    try:
        return _csv(path, sha256, _decoded(path, data))
    except csv.Error as error:
        raise SheetError(f"{path} is no table of cells ({error}); save it anew as CSV") from None


def split_head(head: str) -> tuple[str, str | None]:
    """Name and unit of a head: `frequency [Hz]`, `Load (g)`, `f / Hz`, `amplitude_um`."""
    head = head.strip()
    if found := HEAD.fullmatch(head):
        unit = next(part for part in found.group("a", "b", "c", "d") if part is not None).strip()
        if found["name"].strip() and unit and (found["d"] is None or unit.casefold() in SUFFIXES):
            return found["name"].strip(), unit
    name, _, suffix = head.rpartition("_")
    if name and suffix.casefold() in SUFFIXES:
        return name, SUFFIXES[suffix.casefold()]
    return head, None


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


def _csv(path: Path, sha256: str, text: str) -> Sheet:
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    lines = [(at, line) for at, line in enumerate(text.split("\n"), 1) if line.strip()]
    lines = [(at, line) for at, line in lines if not line.lstrip(' "').startswith(COMMENTS)]
    mark: str | None = None
    if lines and (told := re.fullmatch(r"sep=(.)", lines[0][1].strip())):
        mark, lines = told[1], lines[1:]
    if not lines:
        raise SheetError(f"{path} holds remarks only; give a header line and values below it")
    mark = mark or _mark(path, lines)
    rows = [(at, [cell.strip() for cell in _split(line, mark)]) for at, line in lines]
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
        cells = [row[i] for _, row in body]
        if head or any(cells):  # a mark at the end of every line makes an empty column
            columns.append(Cells(head, name, unit, cells))
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
    return bool(told) and all(cell.casefold() in SUFFIXES or cell in ("°", "%", "1") for cell in told)


def _decimal_comma(path: Path, body: Sequence[tuple[int, Sequence[str]]]) -> bool:
    seen: dict[bool, tuple[int, str]] = {}
    for at, cells in body:
        for cell in cells:
            for comma, form in ((True, COMMA), (False, POINT)):
                if form.fullmatch(cell):
                    seen.setdefault(comma, (at, cell))
    if len(seen) == 2:
        (a, one), (b, other) = seen[True], seen[False]
        raise SheetError(
            f"{path} has a decimal comma in line {a} ('{one}') and a decimal point in line {b} ('{other}'); use one of them"
        )
    return True in seen
