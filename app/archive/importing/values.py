"""The values of an imported table in SI, each looked at: what is no number, no measured value, twice, or of an odd size."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.archive.importing.columns import ImportingError, Kind, Matched, factor
from app.archive.importing.table import Cells, Sheet
from app.common.progress import STEP, Tell, parts, untold
from app.common.units import UnitError, to_number
from app.config.tables import AmplifierTable
from protocols.runfile.schema import ENTRY

Array = NDArray[np.float64]
SIDES = {"mfc": 1.0, "mfcup": 1.0, "mfcside": 1.0, "+1": 1.0, "aluminium": -1.0, "aluminum": -1.0, "al": -1.0}
SIDES |= {"aluminiumup": -1.0, "aluminumup": -1.0, "aluminiumside": -1.0}
"""What a cell of the column `side` may say beside 1 and -1."""


@dataclass(frozen=True, slots=True)
class Asked:
    """What a person said beside the tables.

    Attributes:
        unit: quantity, name or head of a column -> its unit.
        uncertainty: quantity -> `2 um` or `1 %`, standard, for every value.
        settings: parameters of the protocol that are known.
        elongation_m: of the membrane, None where it is free or the table says it.
        gain_error: relative standard uncertainty of the displacement sensor's gain, common to all values; 0: not told.
        delay_s: how late the sensor's output follows, taken out of phases of a time series.
        begun: when it was measured.
    """

    specimen: str = "unnamed"
    unit: Mapping[str, str] = field(default_factory=dict)
    uncertainty: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    elongation_m: float | None = None
    sensor: str = ""
    gain_error: float = 0.0
    delay_s: float = 0.0
    amplifier: AmplifierTable = field(default_factory=AmplifierTable)
    simulated: bool = False
    begun: datetime | None = None


@dataclass(frozen=True, slots=True)
class Source:
    """One column of the table as it was read."""

    name: str
    head: str
    unit: str
    meaning: str


def values_of(sheet: Sheet, matched: Matched, asked: Asked, tell: Tell = untold) -> tuple[dict[str, Array], list[str]]:
    """Every quantity in SI, and what looks odd."""
    lengths = {cells.head: len(cells.cells) for cells in matched.of.values()}
    if len(set(lengths.values())) > 1:
        each = ", ".join(f"'{head}' {length}" for head, length in lengths.items())
        raise ImportingError(
            f"{sheet.path}: the columns differ in length: {each}; save them of one length, a row a measurement"
        )
    values: dict[str, Array] = {}
    cautions: list[str] = []
    needed = {name for group in matched.kind.needs for name in group}
    whole = "quality" in matched.of  # our own export: its flags say what is missing
    for (name, cells), tell_column in zip(matched.of.items(), parts(tell, [1.0] * len(matched.of)), strict=True):
        slot = matched.kind.slot(name)
        assert slot is not None
        if name == "side":
            values[name] = np.array([_side(sheet, cells, row, whole) for row in range(len(cells.cells))])
            continue
        column = factor(sheet, slot, cells, asked.unit) * _numbers(sheet, cells, tell_column)
        for row in np.flatnonzero(~np.isfinite(column)).tolist():
            if np.isinf(column[row]) or (name in needed and not whole):
                raise ImportingError(
                    f"{sheet.at(row, cells)}: '{cells.cells[row]}' is no measured value; give the number, or take the line out"
                )
        if name.endswith("_errors"):
            for row in np.flatnonzero(column < 0).tolist():
                told = f"{cells.cells[row]} is no uncertainty; it must not be negative"
                raise ImportingError(f"{sheet.at(row, cells)}: {told}")
        if slot.usual is not None and column.size:
            cautions += _odd(sheet, cells, name, slot.unit, column, slot.usual)
        values[name] = column
    for name in ("frequency", "resonance", "mass"):
        column = values.get(name, np.ones(1))
        for row in np.flatnonzero(column < 0 if name == "mass" else column <= 0).tolist():
            cells = matched.of[name]
            told = f"{cells.cells[row]} is no {name}; it must be positive. Take the line out, or mend it"
            raise ImportingError(f"{sheet.at(row, cells)}: {told}")
    return values, cautions


def _numbers(sheet: Sheet, column: Cells, tell: Tell) -> Array:
    """The numbers of a column, NaN where a cell says that there is none; many cells at once where all are plain numbers."""
    numbers = np.empty(len(column.cells))
    for start in range(0, numbers.size, STEP):
        tell(start / numbers.size)
        some = column.cells[start : start + STEP]
        try:
            numbers[start : start + len(some)] = _plain(some, sheet.decimal_comma)
        except ValueError:
            numbers[start : start + len(some)] = [sheet.number(column, start + i) for i in range(len(some))]
    tell(1.0)
    return numbers


def _plain(cells: Sequence[str | float], decimal_comma: bool) -> Array:
    """The numbers of cells that are nothing else. Raises ValueError where one is something else."""
    if any(isinstance(cell, float) for cell in cells[:1]):  # of a MAT file
        return np.array([float(cell) for cell in cells])
    texts = "\n".join(map(str, cells))
    if "_" in texts:  # Python would take it for a mark of thousands
        raise ValueError("not plain")
    told = (texts.replace(",", ".") if decimal_comma else texts).split("\n")
    if len(told) != len(cells):
        raise ValueError("not plain")
    return np.fromiter(map(float, told), float, len(cells))


def _odd(sheet: Sheet, cells: Cells, name: str, unit: str, column: Array, usual: tuple[float, float]) -> Iterator[str]:
    """A sentence where a column is of a size that nobody measures here: most likely its unit is wrong."""
    low, high = usual
    size = np.abs(column) if low > 0 else column
    at = np.flatnonzero(np.isfinite(size) & ((size > high) | ((size < low) & (size != 0))))
    if at.size:
        row = int(at[0])
        yield (
            f"{sheet.at(row, cells)}: {cells.cells[row]} is {column[row]:.4g} {unit}, and {name.replace('_', ' ')} is usually "
            f"{low:g} to {high:g} {unit} ({at.size} of {column.size} values are not): is the unit right? --unit {name}=UNIT says another"
        )


def _side(sheet: Sheet, cells: Cells, row: int, whole: bool) -> float:
    cell = cells.cells[row]
    text = str(cell).casefold().replace(" ", "")
    if text in SIDES:
        return SIDES[text]
    try:
        number = float(text or "nan")
    except ValueError:
        number = 0.0
    if number in (1.0, -1.0) or (whole and math.isnan(number)):
        return number
    raise ImportingError(
        f"{sheet.at(row, cells)}: '{cell}' is no side; write 'MFC' or 1 where the MFC is up, 'aluminium' or -1 else"
    )


def repeated(sheet: Sheet, matched: Matched, values: dict[str, Array], rows: int) -> list[str]:
    """Refuse a line that stands there twice; tell of values that were measured more than once, or out of order."""
    names = [name for name in values if not name.endswith("_errors") and values[name].ndim == 1]
    seen: dict[tuple[float, ...], int] = {}
    for row in range(rows):
        key = tuple(float(np.nan_to_num(values[name][row], nan=-1e300)) for name in names)
        if (first := seen.setdefault(key, row)) != row:
            raise ImportingError(
                f"{sheet.path}, {sheet.places[row]} is the same as {sheet.places[first]}; take one out, or number them in a column 'repeat' or 'entry'"
            )
    if ENTRY in values:
        return []
    x = next(name for name in matched.kind.needs[0] if name in values)
    places: dict[tuple[float, ...], list[int]] = {}
    for row in range(rows):
        key = tuple(
            float(np.nan_to_num(values[name][row], nan=-1e300))
            for name in (x, "elongation", "side", "repeat", "drive_amplitude")
            if name in values
        )
        places.setdefault(key, []).append(row)
    twice = [group for group in places.values() if len(group) > 1]
    said = []
    if twice:
        where = ", ".join(sheet.places[row] for row in twice[0][:5])
        said.append(f"{x} {values[x][twice[0][0]]:g} stands {len(twice[0])} times ({where}): all are kept, as repeats")
    elif (
        matched.kind.name in ("sine-dwell", "mass-resonance")
        and "elongation" not in values
        and (np.diff(values[x]) < 0).any()
    ):
        row = int(np.flatnonzero(np.diff(values[x]) < 0)[0]) + 1
        said.append(f"{x} does not rise ({sheet.places[row]}): kept in the order of the file")
    return said


def add_errors(kind: Kind, values: dict[str, Array], asked: Asked, cautions: list[str]) -> None:
    """Errors as a person gave them, for values that have none of their own."""
    for name, text in asked.uncertainty.items():
        slot = kind.slot(name)
        if slot is None or name not in values:
            have = ", ".join(n for n in values if kind.slot(f"{n}_errors") is not None)
            raise ImportingError(f"--uncertainty {name}={text}: there is no {name} among the values; there are: {have}")
        if f"{name}_errors" in values:
            raise ImportingError(f"--uncertainty {name}={text}: the table has a column for it; leave one of them away")
        try:
            relative = text.strip().endswith("%")
            size = to_number(text.strip().removesuffix("%"), "1") / 100 if relative else to_number(text, slot.unit)
        except UnitError as error:
            raise ImportingError(f"--uncertainty {name}={text}: {error}; or a share of the value: '1 %'") from None
        if not (math.isfinite(size) and size > 0):
            raise ImportingError(f"--uncertainty {name}={text}: it must be positive")
        values[f"{name}_errors"] = size * np.abs(values[name]) if relative else np.full(len(values[name]), size)
    measured = [name for name in kind.value if name in values]
    if measured and not any(np.any(values.get(f"{name}_errors", np.zeros(1)) > 0) for name in measured):
        cautions.append(
            f"nothing tells how certain the values are: the run can be looked at and compared, but not identified; "
            f"say it with --uncertainty {measured[0]}='1 %', or a column '{measured[0]}_errors'"
        )


def sources(matched: Matched, asked: Asked) -> Iterator[Source]:
    """Which column each quantity was read from, and in which unit."""
    for name, cells in matched.of.items():
        slot = matched.kind.slot(name)
        assert slot is not None
        unit = next((asked.unit[key] for key in (cells.head, cells.name, name) if key in asked.unit), cells.unit)
        yield Source(name, cells.head, unit or slot.unit, slot.meaning)
