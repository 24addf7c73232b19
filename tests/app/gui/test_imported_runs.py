"""Imported runs in the real window: labelled in the list, opened, overlaid."""

from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt

from app.archive.replay import read_measured_response
from app.cli.main import main
from app.explore.fit import fit_runs
from app.explore.state import ExploreSetting
from app.gui.plots import SERIES
from tests.helpers.main_window import OpenStage, grab, until
from tests.helpers.run_files import finished_run

POINTS = {"T6": [2, 2], "T7": [5, 0], "T8": [0, 0], "T9": [0, 5]}
"""Points drawn of max - min and of the fundamental."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path / "cache")
    out = tmp_path / "runs"
    f = (50, 100, 150, 175, 225)
    for name, head, values in (
        ("dwell", "frequency [Hz];pp [um]", (537.4, 760.1, 1154.2, 923.5, 403.3)),
        ("sine", "frequency [Hz];fundamental [um]", (261.4, 362.0, 577.0, 461.1, 201.45)),
        ("load", "load [g];deflection [um]", (27, 67.6, 135.2, 270.5, 676.2)),
    ):
        rows = "\n".join(
            f"{x};{y}" for x, y in zip((20, 50, 100, 200, 500) if name == "load" else f, values, strict=True)
        )
        (tmp_path / f"{name}.csv").write_text(f"{head}\n{rows}\n")
    drive = ["--set", "peak_to_peak_v=5"]
    for name, specimen, more in (
        ("dwell", "T7", [*drive, "--uncertainty", "peak_to_peak=1 %"]),
        ("sine", "T9", [*drive, "--uncertainty", "fundamental=1 %"]),
        ("load", "T8", []),
    ):
        assert main(["import", str(tmp_path / f"{name}.csv"), "--specimen", specimen, "--out", str(out), *more]) == 0
    return out


@pytest.mark.deep
def test_an_imported_run_is_listed_opened_and_laid_over(open_stage: OpenStage, folder: Path, tmp_path: Path) -> None:
    """Max - min alone, a fundamental alone, weights; each after the other in one window, and over the curve."""
    finished_run(folder, "T6")
    stage = open_stage(folder=folder)
    stage.press(Qt.Key.Key_4, Qt.KeyboardModifier.ControlModifier)
    page = stage.window.tabs.runs
    until(lambda: page.list.folder_model.is_idle and page.list.model.rowCount() == 4, "for the list")
    assert {e.specimen: e.state for e in page.list.folder_model.summaries}["T7"] == "imported"
    for specimen, words in (("T6", "all points measured"), ("T7", "dwell.csv"), ("T9", "sine.csv"), ("T8", "load.csv")):
        page.list.select_paths([e.path for e in page.list.folder_model.summaries if e.specimen == specimen])
        until(lambda: not page._worker.pending, "for the points")
        grab(stage.window, tmp_path / f"{specimen}_list.png")
        page.open_selected()
        until(lambda: page.currentWidget() is page.viewer and page.list.folder_model.is_idle, "for the run")
        view = page.viewer
        assert words in view.card.reason_label.text() + view.facts_label.text()
        stage.window.tick()
        grab(stage.window, tmp_path / f"{specimen}.png")
        assert (not view.trace_plot.picture.layers) == (specimen != "T6")  # nothing of the run before
        measured = (view.plots.chart.layer(f"{each.label}, measured") for each in SERIES)
        shown = [0 if each is None else int(np.isfinite(each.y).sum()) for each in measured]
        assert shown == (POINTS[specimen] if specimen != "T8" else [0, 0])
        page.go_back()
    page.list.select_paths([e.path for e in page.list.folder_model.summaries if e.specimen in ("T7", "T9")])
    until(lambda: not page._worker.pending, "for the points")
    grab(stage.window, tmp_path / "both.png")
    page.explore_selected()
    until(lambda: stage.window.tabs.explore.overlaid.runs, "for the points")
    grab(stage.window, tmp_path / "explore.png")


def test_explore_fits_what_a_table_tells(folder: Path) -> None:
    for specimen in ("T7", "T9"):  # max - min alone, a fundamental alone
        run = read_measured_response(next(folder.glob(f"*_{specimen}_*.h5")))
        found = fit_runs([run], ExploreSetting())
        assert found.setting.value("c0") == pytest.approx(159, rel=0.05), specimen
