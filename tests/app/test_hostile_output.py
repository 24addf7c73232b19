"""Text of files from elsewhere on a terminal and in sheets: no control characters, no formulas."""

import csv
import json
from pathlib import Path
from typing import Any

import h5py
import pytest

from app.cli.main import main
from app.common import Column, ExitCode, Table
from tests.helpers.run_files import finished_run

ORDER = "T\x1b]0;owned\x07\x9b2J\u202e"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run whose texts give orders to a terminal, and whose specimen is a formula."""
    path = finished_run(tmp_path)
    with h5py.File(path, "r+") as file:
        for name in ("title", "reason", "start_time", "specimen"):
            del file[f"entry/{name}"]
            file[f"entry/{name}"] = ORDER
        for name in ("peak_to_peak", "frequency"):
            file[f"entry/points/{name}"].attrs["units"] = ORDER
    path.with_suffix(".notes.json").write_text(json.dumps({"tags": [ORDER], "note": ORDER}))
    return path


@pytest.mark.parametrize(
    "command",
    ["show {run}", "show --json {run}", "runs {folder}", "compare {run} {run}", "identify {run}", "export {run}"],
)
def test_no_text_of_a_run_gives_orders_to_the_terminal(
    command: str, run: Path, capfd: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.archive.catalogue.index_path", lambda folder: folder / "index.sqlite")
    main(command.format(run=run, folder=run.parent).split())
    said = "".join(capfd.readouterr())
    assert len(said) > 20
    assert all(c.isprintable() or c == "\n" for c in said), said


def test_no_cell_of_a_table_gives_orders_to_the_terminal(tmp_path: Path, capfd: Any) -> None:
    table = tmp_path / "a.csv"
    table.write_text(f"frequency [Hz],peak_to_peak [um],{ORDER}\n100,{ORDER},1\n")
    assert main(["import", str(table), "--out", str(tmp_path)]) == ExitCode.USAGE
    said = "".join(capfd.readouterr())
    assert all(c.isprintable() or c == "\n" for c in said), said


@pytest.mark.parametrize("text", ["=cmd|'/C calc'!A0", "+1+1", "-2-3", "@SUM(A1)", "\t=1", "\r=1", "\n=1"])
def test_a_sheet_holds_no_formula(text: str, tmp_path: Path) -> None:
    table = Table(
        "t", "t", (Column(text, text, [text]), Column("number", "V", [-1.5]), Column("as text", None, ["-1e3"]))
    )
    table.to_csv(tmp_path / "t.csv")
    with (tmp_path / "t.csv").open(newline="", encoding="utf-8") as file:
        (head, *_), (cell, number, number_text) = csv.reader(file)
    assert head.startswith(f"'{text}")
    assert cell == f"'{text}"
    assert (number, number_text) == ("-1.5", "-1e3")


def test_an_export_holds_no_formula(tmp_path: Path) -> None:
    path = finished_run(tmp_path, "=cmd|'/C calc'!A0")
    assert main(["export", str(path), "--part", "about"]) == 0
    assert "\nspecimen,'=cmd|" in next(tmp_path.glob("*about.csv")).read_text("utf-8").replace("\r", "")


@pytest.mark.deep
def test_what_identifies_nothing_is_not_accepted(tmp_path: Path, capsys: Any) -> None:
    path = finished_run(tmp_path, "T7", (100.0,))
    assert main(["identify", str(path), "--accept"]) == ExitCode.USAGE
    assert "nothing is accepted: these runs identify no parameter of T7" in capsys.readouterr().err
    assert not list(tmp_path.glob("*.calibrations.json"))
