"""Bulk reader of text that holds nothing but numbers, by NumPy, or by PyArrow where it is installed."""

import io
from collections.abc import Iterator

import numpy as np

from app.common import Progress
from model import Array

CHARACTERS_PER_CHUNK = 8_000_000
"""Text read between two looks at the progress, at most about 0.2 s."""


def numeric_columns(text: str, span: tuple[int, int], delimiter: str | None, progress: Progress) -> Array | None:
    """Return the numbers in the lines of a part of a text, (rows, columns); None if it holds anything else.

    Args:
        text: lines end with a line feed.
        span: first character of the first line, and the end of the last one.
        delimiter: one character; None for blanks.
        progress: updated after each chunk.

    Raises:
        OperationCancelled: `progress` is cancelled.
    """
    begin, end = span
    decimal_comma = delimiter != "," and text.find(",", begin, end) >= 0
    if decimal_comma and text.find(".", begin, end) >= 0:
        return None
    parts = []
    for start, stop in _chunks(text, begin, end):
        progress.update((start - begin) / (end - begin))
        progress.raise_if_cancelled()
        lines = text[start:stop].replace(",", ".") if decimal_comma else text[start:stop]
        try:
            part = _read_chunk(lines, delimiter)
        except ValueError:
            return None
        if len(part) != text.count("\n", start, stop - 1) + 1:  # empty lines: the numbers of lines would be wrong
            return None
        parts.append(part)
    progress.update(1.0)
    widths = {part.shape[1] for part in parts}
    return np.concatenate(parts) if len(widths) == 1 else None


def _chunks(text: str, begin: int, end: int) -> Iterator[tuple[int, int]]:
    while begin < end:
        line_end = text.find("\n", min(begin + CHARACTERS_PER_CHUNK, end), end)
        stop = end if line_end < 0 else line_end + 1
        yield begin, stop
        begin = stop


def _read_chunk(lines: str, delimiter: str | None) -> Array:
    """Read lines of numbers, (rows, columns).

    Raises:
        ValueError: a cell is not a number, or a line has fewer or more cells.
    """
    if delimiter is not None and (fast := _read_by_arrow(lines, delimiter)) is not None:
        return fast
    # NumPy reads a list of lines faster than a stream in memory.
    return np.loadtxt(lines.split("\n"), delimiter=delimiter, comments=None, ndmin=2)


def _read_by_arrow(lines: str, delimiter: str) -> Array | None:
    """Read lines of numbers with PyArrow, several times faster than NumPy; None if it is not installed."""
    try:
        import pyarrow as pa
        from pyarrow import csv
    except ImportError:
        return None
    width = lines.partition("\n")[0].count(delimiter) + 1
    types = dict.fromkeys((f"f{i}" for i in range(width)), pa.float64())
    table = csv.read_csv(  # pyarrow.lib.ArrowInvalid is a ValueError
        io.BytesIO(lines.encode()),
        read_options=csv.ReadOptions(autogenerate_column_names=True),
        parse_options=csv.ParseOptions(delimiter=delimiter, quote_char=False),
        convert_options=csv.ConvertOptions(column_types=types, null_values=[]),
    )
    return np.column_stack([column.to_numpy() for column in table.columns])
