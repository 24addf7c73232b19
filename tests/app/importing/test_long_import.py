"""Importing long time series: progress, cancellation, speed, and the position of faulty cells."""

import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from app.archive.importing import csv_table, plain_numbers, read_table
from app.common.progress import OperationCancelled, Progress
from protocols.base import TableImportError
from tests.helpers.importing import brought, refused


def long_series(path: Path, mark: str = ",", comma: bool = False) -> Path:
    """A second of a sine at 20 kHz."""
    t = np.arange(20_000) / 20_000
    rows = np.stack((t, 2.5 + 2.5 * np.sin(2 * np.pi * 150 * t), 480 * np.sin(2 * np.pi * 150 * t - 1.5)), axis=1)
    lines = (mark.join(f"{value:.6f}" for value in row) for row in rows)
    text = "\n".join((mark.join(("time [s]", "drive [V]", "displacement [um]")), *lines))
    path.write_text(text.replace(".", ",") if comma else text)
    return path


@pytest.mark.deep
def test_a_long_series_tells_how_far_it_is_and_can_be_stopped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    reported: list[float] = []

    class Listener(Progress):
        def update(self, fraction: float, text: str = "") -> None:
            reported.append(fraction)

    class Stopping(Progress):
        """Cancelled from a fraction on."""

        def __init__(self, end: float) -> None:
            self.end, self.fraction = end, 0.0

        @property
        def cancelled(self) -> bool:
            return self.fraction >= self.end

        def update(self, fraction: float, text: str = "") -> None:
            self.fraction = fraction

    @contextmanager
    def listening(words: str, quiet: bool) -> Iterator[Progress]:
        assert (words, quiet) == ("long.csv", False)
        yield Listener()

    monkeypatch.setattr(plain_numbers, "BYTES_PER_CHUNK", 50_000)
    path = long_series(tmp_path / "long.csv")
    with monkeypatch.context() as patched:
        patched.setattr("app.cli.import_.terminal_progress", listening)
        brought(path, "--as", "raw")
    assert reported == sorted(reported)
    assert len(reported) > 10
    assert (reported[0], reported[-1]) == (0.0, pytest.approx(1.0, abs=0.2))
    for ends in (0.0, 0.3, 0.5):
        with pytest.raises(OperationCancelled):
            read_table(path, Stopping(ends))
    assert capsys.readouterr().err == ""
    monkeypatch.setenv("FORCE_COLOR", "1")
    brought(path, "--as", "raw", "--json")
    assert capsys.readouterr().err == "", "a machine listens"
    brought(path, "--as", "raw")
    assert "long.csv" in capsys.readouterr().err


@pytest.mark.parametrize("reader", ["PyArrow", "NumPy"])
@pytest.mark.parametrize(("mark", "comma"), [(";", False), (";", True), ("\t", False), ("  ", False)])
def test_numbers_read_in_bulk_are_those_read_cell_by_cell(
    mark: str, comma: bool, reader: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if reader == "NumPy":
        monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setattr(plain_numbers, "BYTES_PER_CHUNK", 50_000)
    path = long_series(tmp_path / "long.csv", mark, comma)
    bulk = read_table(path)
    monkeypatch.setattr(csv_table, "LONG_TABLE_CHARACTERS", math.inf)
    cell_by_cell = read_table(path)
    for one, other in zip(bulk.columns, cell_by_cell.columns, strict=True):
        assert isinstance(one.cells, np.ndarray)
        assert (one.name, one.unit) == (other.name, other.unit)
        assert np.array_equal(one.cells, [cell_by_cell.parse_number(other, row) for row in range(20_000)])
    assert list(bulk.row_numbers) == cell_by_cell.row_numbers


@pytest.mark.parametrize("odd", ["", "1;2", "1;2;3;4", "# remark", "1;2;"])
def test_a_long_table_with_an_odd_line_is_read_cell_by_cell(odd: str, tmp_path: Path) -> None:
    path = long_series(tmp_path / "long.csv", ";")
    lines = path.read_text().split("\n")
    lines.insert(15_000, odd)
    path.write_text("\n".join(lines))
    if odd in ("", "# remark"):
        assert read_table(path).row_location(14_999) == "line 15002"
    elif odd == "1;2;":  # an empty cell: where the value is needed, it is refused by its line
        table = read_table(path)
        assert table.columns[2].cells[14_999] == ""
        assert table.row_location(14_999) == "line 15001"
    else:
        with pytest.raises(TableImportError, match="line 15001"):
            read_table(path)


@pytest.mark.parametrize(("cell", "says"), [("1_000", "not a number"), ("", "is not a number"), ("2,5", "decimal")])
def test_one_odd_cell_in_a_long_series_is_found_where_it_stands(
    cell: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = long_series(tmp_path / "long.csv", ";")
    lines = path.read_text().split("\n")
    lines[15_000] = f"{lines[15_000].rpartition(';')[0]};{cell}"
    path.write_text("\n".join(lines))
    told = refused(path, capsys, "--as", "raw")
    assert says in told
    assert "line 15001" in told
