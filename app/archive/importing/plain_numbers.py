"""Bulk reader of text that holds nothing but numbers, by NumPy, or by PyArrow where it is installed."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from app.common import Progress
from model import Array

BYTES_PER_CHUNK = 8_000_000
"""Text read between two looks at the progress, at most about 0.2 s."""
WHOLE_BYTES = 64_000_000
"""A file of so many bytes is read by NumPy at once, in half a second: from a file it reads twice as fast as from lines in memory."""


def numeric_columns(
    path: Path, data: bytes, text: str, span: tuple[int, int], delimiter: str | None, progress: Progress
) -> Sequence[Array] | None:
    """Return the columns of numbers in the lines of a part of a text, (rows,) each; None for any other content.

    Args:
        path: the file.
        data: its bytes.
        text: their text; lines end with a line feed.
        span: first character of the first line, and the end of the last one.
        delimiter: one character; None for blanks.
        progress: updated after each chunk.

    Raises:
        OperationCancelled: `progress` is cancelled.
    """
    (begin, end), header = span, text[: span[0]].encode()
    source: Path | None = None
    if len(data) == len(header) + len(text) - begin:  # from there on ASCII, with the same line ends
        body, first, last, source = data, len(header), len(header) + end - begin, path
    else:
        body = text[begin:end].encode()
        first, last = 0, len(body)
    if delimiter != "," and body.find(b",", first, last) >= 0:
        if body.find(b".", first, last) >= 0:
            return None
        body, first, last, source = body[first:last].replace(b",", b"."), 0, last - first, None
    by_arrow = delimiter is not None and _has_arrow()
    if by_arrow or last - first > WHOLE_BYTES:
        source = None
    parts = []
    for start, stop in [(first, last)] if source is not None else _chunks(body, first, last):
        progress.update((start - first) / (last - first))
        progress.raise_if_cancelled()
        try:
            if delimiter is not None and by_arrow:
                part = _read_by_arrow(body, start, stop, delimiter)
            else:
                part = _read_by_numpy(source or body[start:stop], delimiter, header.count(b"\n"))
        except ValueError:
            return None
        if len(part[0]) != body.count(b"\n", start, stop - 1) + 1:  # empty lines: the numbers of lines would be wrong
            return None
        parts.append(part)
    progress.update(1.0)
    if len({len(part) for part in parts}) != 1:
        return None
    return parts[0] if len(parts) == 1 else [np.concatenate(columns) for columns in zip(*parts, strict=True)]


def _chunks(body: bytes, begin: int, end: int) -> Iterator[tuple[int, int]]:
    while begin < end:
        line_end = body.find(b"\n", min(begin + BYTES_PER_CHUNK, end), end)
        stop = end if line_end < 0 else line_end + 1
        yield begin, stop
        begin = stop


def _has_arrow() -> bool:
    try:
        import pyarrow.csv  # noqa: F401
    except ImportError:
        return False
    return True


def _read_by_numpy(source: Path | bytes, delimiter: str | None, header_lines: int) -> Sequence[Array]:
    """Read lines of numbers, of a file those below its header.

    Raises:
        ValueError: a cell is not a number, or a line has fewer or more cells.
    """
    if isinstance(source, bytes):
        return list(np.loadtxt(source.decode().split("\n"), delimiter=delimiter, comments=None, ndmin=2).T)
    columns = np.loadtxt(source, delimiter=delimiter, comments=None, ndmin=2, skiprows=header_lines, encoding="latin1")
    return list(columns.T)


def _read_by_arrow(body: bytes, start: int, stop: int, delimiter: str) -> Sequence[Array]:
    """Read lines of numbers with PyArrow, several times faster than NumPy.

    Raises:
        ValueError: as `_read_by_numpy`.
    """
    import pyarrow as pa
    from pyarrow import csv

    line_end = body.find(b"\n", start, stop)
    width = body.count(delimiter.encode(), start, line_end if line_end >= 0 else stop) + 1
    types = dict.fromkeys((f"f{i}" for i in range(width)), pa.float64())
    table = csv.read_csv(  # pyarrow.lib.ArrowInvalid is a ValueError
        pa.BufferReader(pa.py_buffer(memoryview(body)[start:stop])),
        read_options=csv.ReadOptions(autogenerate_column_names=True, use_threads=False),
        parse_options=csv.ParseOptions(delimiter=delimiter, quote_char=False),
        convert_options=csv.ConvertOptions(column_types=types, null_values=[]),
    )
    return [column.to_numpy() for column in table.columns]
