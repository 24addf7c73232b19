"""Comparison workspace on page Runs: opened by keys, layers, cursors, relations, waterfall, saved views."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QModelIndex, QPoint, Qt
from PySide6.QtTest import QTest

from app.archive import RunSummary
from app.comparison import read_view
from app.config.bench_file import BenchConfig
from app.gui.runs.compare import ComparisonWorkspace
from app.gui.runs.page import RunsPage
from app.gui.runs.run_table import RunTableModel
from app.live.model_overlay import Overlay
from model import Relation
from tests.helpers.main_window import OpenPage, find, until
from tests.helpers.messages import assert_names
from tests.helpers.run_files import finished_run

FREQUENCIES = (100.0, 160.0, 250.0)
ALT = Qt.KeyboardModifier.AltModifier


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path / "cache")


@pytest.fixture(scope="module")
def five_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("five")
    for at in range(5):
        finished_run(folder, f"T{at}", FREQUENCIES, size_m=(at + 1) * 1e-4)
    return folder


@pytest.fixture
def page(open_page: OpenPage, config: BenchConfig, five_runs: Path, tmp_path: Path) -> RunsPage:
    folder = shutil.copytree(five_runs, tmp_path / "runs")
    overlay = Overlay(amplifier=config.amplifier.amplifier_map)
    page = open_page(lambda: RunsPage(lambda: folder, lambda: "T0", config.amplifier, overlay))
    until(lambda: page.list.folder_model.is_idle and page.list.model.rowCount() == 5, "for the list")
    page.list.table.sortByColumn(1, Qt.SortOrder.AscendingOrder)
    return page


@pytest.fixture
def workspace(page: RunsPage) -> ComparisonWorkspace:
    page.list.table.setFocus()
    page.list.table.selectAll()
    QTest.keyClick(page.list.table, Qt.Key.Key_Return)
    until(lambda: page.currentWidget() is page.workspace, "for the comparison")
    return page.workspace


def drawn(workspace: ComparisonWorkspace) -> dict[str, float]:
    """Height of each drawn layer at 160 Hz by its letter."""
    return {each.label[0]: float(each.y[1]) for each in workspace.plot.picture.layers}


def column(workspace: ComparisonWorkspace, at: int) -> list[str]:
    items = (workspace.layers.item(row, at) for row in range(workspace.layers.rowCount()))
    return [item.text() for item in items if item is not None]


def choose(workspace: ComparisonWorkspace, relation: Relation) -> None:
    find(workspace, f"compare.relation.{relation}").click()


@pytest.mark.deep
def test_layers_are_hidden_moved_and_related_by_keys(page: RunsPage, workspace: ComparisonWorkspace) -> None:
    assert drawn(workspace) == pytest.approx(dict(zip("ABCDE", (100.0, 200.0, 300.0, 400.0, 500.0), strict=True)))
    assert all(each.label_at is not None for each in workspace.plot.picture.layers), "letters stand on the curves"
    layers = workspace.layers
    assert layers.hasFocus()
    QTest.keyClick(layers, Qt.Key.Key_Space)
    assert list(drawn(workspace)) == list("BCDE")
    QTest.keyClick(layers, Qt.Key.Key_Space)
    QTest.keyClick(layers, Qt.Key.Key_Down, ALT)
    assert drawn(workspace)["B"] == pytest.approx(100.0), "the first run has become the second"
    choose(workspace, Relation.RATIO)
    QTest.keyClick(layers, Qt.Key.Key_R)
    assert drawn(workspace) == pytest.approx(dict(zip("ABCDE", (2.0, 1.0, 3.0, 4.0, 5.0), strict=True)))
    assert "reference" in column(workspace, 2)[1]
    choose(workspace, Relation.DIFFERENCE)
    assert drawn(workspace)["E"] == pytest.approx(400.0)
    assert page.go_back()
    assert page.currentWidget() is page.list


def test_the_table_follows_the_pointer_and_two_cursors_have_a_difference(workspace: ComparisonWorkspace) -> None:
    canvas, box = workspace.plot.canvas, workspace.plot.panels[0]

    def shows_values_at_160() -> bool:
        # The layout of a new page may still move the plot: the place is computed for each attempt, a pixel beside the last one.
        scene = box.box.mapToScene(*box.to_pixels(160.0, 50.0)[0])
        QTest.mouseMove(canvas.viewport(), QPoint(int(scene.x()) - 1, int(scene.y())))
        QTest.mouseMove(canvas.viewport(), QPoint(int(scene.x()), int(scene.y())))
        text = column(workspace, 3)[1].split(" ")[0]
        return text not in ("", "–") and float(text) == pytest.approx(200.0, rel=0.02)

    until(shows_values_at_160, "for the values under the pointer")
    workspace.plot.set_cursors([160.0, 130.0])
    assert column(workspace, 3) == ["100", "200", "300", "400", "500"]
    assert column(workspace, 5) == ["0"] * 5
    assert column(workspace, 6) == ["1"] * 5


@pytest.mark.deep
def test_a_waterfall_lifts_curves_and_the_values_stay(workspace: ComparisonWorkspace) -> None:
    workspace.over.setCurrentIndex(workspace.over.findData("time"))
    heights = [float(np.nanmax(each.y)) for each in workspace.plot.picture.layers]
    assert np.diff(heights).min() > 100.0, "each a step above the one before"
    workspace.plot.set_cursors([160.0])
    assert [float(text.split(" ")[0]) for text in column(workspace, 3)] == pytest.approx([100, 200, 300, 400, 500])


@pytest.mark.deep
def test_a_view_is_saved_and_opened_as_it_was(page: RunsPage, workspace: ComparisonWorkspace, tmp_path: Path) -> None:
    choose(workspace, Relation.NORMALISED)
    workspace.plot.set_cursors([120.0, 200.0])
    QTest.keyClick(workspace.layers, Qt.Key.Key_Space)
    workspace.save(tmp_path / "runs" / "all five")
    saved = tmp_path / "runs" / "all five.compare.json"
    assert read_view(saved).cursors == (120.0, 200.0)
    page.go_back()
    choose(workspace, Relation.VALUES)
    page.workspace.open_view(saved)
    until(lambda: page.currentWidget() is workspace, "for the view")
    assert list(drawn(workspace)) == list("BCDE")
    assert workspace.relation.selected is Relation.NORMALISED
    assert workspace.plot.tools.cursors == [120.0, 200.0]
    page.workspace.open_view(tmp_path / "none.compare.json")
    until(workspace.note_label.isVisible, "for the message")
    assert_names(workspace.note_label.text(), "none.compare.json")


@pytest.mark.deep
def test_the_models_curve_is_laid_over_the_runs(page: RunsPage, workspace: ComparisonWorkspace) -> None:
    def drawn_model() -> bool:
        page.tick()
        return any(each.label == "Model" for each in workspace.plot.picture.layers)

    workspace.model.click()
    until(drawn_model, "for the model's curve")
    workspace.model.click()
    assert len(workspace.plot.picture.layers) == 5


def test_peaks_and_differences_are_in_tables(workspace: ComparisonWorkspace) -> None:
    cells = [[workspace.peaks.item(row, at).text() for at in range(workspace.peaks.columnCount())] for row in range(5)]  # type: ignore[union-attr]
    assert [row[0] for row in cells] == list("ABCDE")
    assert {row[2] for row in cells} == {"158.350"}
    find(workspace, "compare.tables.1").click()
    assert workspace.differences.table.columnCount() == 6


def test_the_search_shows_what_is_wrong_and_orders_by_specimen_and_tags(page: RunsPage, tmp_path: Path) -> None:
    bar, model = page.list.filter_bar, page.list.model
    path = page.list.path_of(page.list.folder_model.summaries[0])
    page.list.folder_model.annotate([(path, "", "")], "", "beside T1")
    until(lambda: any(e.note for e in page.list.folder_model.summaries), "for the note")
    page.list.table.sortByColumn(0, Qt.SortOrder.DescendingOrder)
    until(lambda: page.list.folder_model.is_idle, "for the list with the note")
    bar.search_edit.setText("t1")
    assert [e.specimen for e in model.summaries] == ["T1", "T4"]
    assert "notes" in model.days[1]
    bar.search_edit.setText("colour:red")
    assert_names(bar.count_label.text(), "colour")
    assert [e.specimen for e in model.summaries] == ["T1", "T4"], "the list stays"
    bar.search_edit.setText("specimen:T2 verdict:not")
    assert [e.specimen for e in model.summaries] == ["T2"]


def test_no_column_of_the_list_is_cut(page: RunsPage) -> None:
    table = page.list.table
    titles = [table.model().headerData(at, Qt.Orientation.Horizontal) for at in range(table.model().columnCount())]
    table.sortByColumn(0, Qt.SortOrder.DescendingOrder)
    page.window().resize(1280, 800)

    def hidden() -> set[str]:
        return {title.casefold() for at, title in enumerate(titles) if table.isColumnHidden(at)}

    def is_whole() -> bool:
        return table.horizontalScrollBar().maximum() == 0 and "found" in hidden()

    until(lambda: page.window().width() == 1280 and is_whole(), "for the columns")
    assert hidden() <= {"points", "found"}


def test_a_selection_of_all_runs_asks_for_no_cell_of_them(page: RunsPage, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    flags = RunTableModel.flags

    def count(model: RunTableModel, index: QModelIndex) -> Qt.ItemFlag:
        asked.append(index.row())
        return flags(model, index)

    monkeypatch.setattr(RunTableModel, "flags", count)
    runs = [RunSummary(f"{at}.h5", "completed", specimen=f"T{at}") for at in range(2000)]
    page.list.model.set_summaries(page.list.model.folder, runs)
    page.list.table.selectAll()
    until(lambda: len(page.list.selected) == len(runs), "for the selection")
    page.list.table.viewport().repaint()
    page.list.table.horizontalHeader().viewport().repaint()
    assert max(asked, default=0) < 200, "only what is drawn"
    assert {run.path for run in page.list.selected} == {run.path for run in runs}
    page.list.select_paths(["7.h5", "9.h5", "8.h5", "20.h5", "gone.h5"])
    assert {run.path for run in page.list.selected} == {"7.h5", "8.h5", "9.h5", "20.h5"}
