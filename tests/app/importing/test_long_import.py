"""Importing long time series: progress, cancellation, speed, and the position of faulty cells."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from app.archive.importing import read_table
from app.common.progress import OperationCancelled, Progress
from tests.helpers.importing import brought, refused


def long_series(path: Path, mark: str = ",", quote: str = "") -> Path:
    """A second of a sine at 20 kHz."""
    t = np.arange(20_000) / 20_000
    rows = np.stack((t, 2.5 + 2.5 * np.sin(2 * np.pi * 150 * t), 480 * np.sin(2 * np.pi * 150 * t - 1.5)), axis=1)
    lines = (mark.join(f"{quote}{value:.6f}{quote}" for value in row) for row in rows)
    path.write_text("\n".join((mark.join(("time [s]", "drive [V]", "displacement [um]")), *lines)))
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


def test_cells_that_are_cut_quickly_are_the_cells_that_are_cut_carefully(tmp_path: Path) -> None:
    quick, careful = (read_table(long_series(tmp_path / f"{i}.csv", ";", quote)) for i, quote in enumerate(("", '"')))
    for one, other in zip(quick.columns, careful.columns, strict=True):
        assert one.cells == other.cells
    cells = quick.columns[1].cells
    assert [quick.parse_number(quick.columns[1], row) for row in (0, 100, 19_999)] == [
        float(cells[i]) for i in (0, 100, 19_999)
    ]


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
