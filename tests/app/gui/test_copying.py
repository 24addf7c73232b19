"""Copying plots: a picture, and a table whose numbers are those of the points."""

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QGuiApplication
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QFileDialog

from app.gui.face import tokens
from tests.helpers.main_window import OpenStage, Stage, find, until
from tests.helpers.session_events import LIVE, OPENED, point

CONTROL = Qt.KeyboardModifier.ControlModifier


def pasted() -> str:
    return QGuiApplication.clipboard().text()


@pytest.mark.deep
def test_every_canvas_of_the_window_can_be_copied(open_stage: OpenStage) -> None:
    stage = open_stage(ahead=True)
    until(lambda: len(stage.window.tabs.created_pages) == stage.window.tabs.count(), "for the pages")
    canvases = stage.window.findChildren(pg.GraphicsView)
    assert len(canvases) >= 8
    assert [c for c in canvases if c.findChild(QAction, "plot.copy-data") is None] == []


def test_the_points_of_a_run_as_a_table(stage: Stage) -> None:
    columns = ["series", "Frequency, Hz", "Peak-to-peak displacement, µm", "standard error"]
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE, point(0, 100.0), point(1, 160.0))
    chart = stage.window.measure_page.live_pane.plots.chart
    until(lambda: "curve:" in chart.note_label.text(), "for the curve")
    canvas = chart.canvas
    canvas.setFocus()
    QTest.keyClick(canvas, Qt.Key.Key_D, CONTROL)
    first, head, *rows = pasted().splitlines()
    assert first == "SIMULATED"
    assert head.split("\t") == columns
    table = [row.split("\t") for row in rows]
    assert [row[1:] for row in table if row[0] == "max − min, measured"] == [["100", "900", "2"], ["160", "840", "2"]]
    curve = [(float(x), float(y)) for name, x, y, _ in table if name == "max − min, curve: the paper's values"]
    x, y = np.array(curve).T
    assert 145 < x[y.argmax()] < 157


def test_the_keys_of_a_plot_act_on_the_largest_one_where_none_has_the_focus(stage: Stage) -> None:
    plots = stage.window.measure_page.live_pane.plots
    find(stage.window, "measure.specimen").setFocus()
    QGuiApplication.clipboard().clear()
    QTest.keyClick(find(stage.window, "measure.specimen"), Qt.Key.Key_P, CONTROL)
    assert QGuiApplication.clipboard().image() == plots.chart.tools.files.picture().toImage()
    QTest.keyClick(find(stage.window, "measure.specimen"), Qt.Key.Key_P, CONTROL | Qt.KeyboardModifier.ShiftModifier)
    (dialog,) = stage.window.findChildren(QFileDialog)
    assert dialog.acceptMode() is QFileDialog.AcceptMode.AcceptSave
    assert dialog.nameFilters() == ["Pictures (*.png *.svg *.pdf)"]
    dialog.reject()


@pytest.mark.deep
def test_a_picture_of_the_plot_without_the_read_out(stage: Stage) -> None:
    chart = stage.window.measure_page.live_pane.plots.chart
    before = chart.tools.files.picture().toImage()
    chart.tools.show_text("a text over the plot")
    assert chart.tools.files.picture().toImage() == before
    chart.tools.buttons[2].click()
    assert QGuiApplication.clipboard().image().size() == before.size()


@pytest.mark.deep
def test_a_plot_that_has_the_keyboard_shows_it(stage: Stage) -> None:
    window, canvas = stage.window, stage.window.measure_page.live_pane.plots.chart.canvas
    find(window, "measure.specimen").setFocus()
    before = canvas.grab().toImage()
    canvas.setFocus()
    edge = canvas.grab().toImage().pixelColor(0, canvas.height() // 2).name()
    assert edge == tokens().accent_text
    assert before.pixelColor(0, canvas.height() // 2).name() == tokens().surface
    find(window, "measure.specimen").setFocus()


@pytest.mark.deep
def test_what_explore_copies_is_amplitude_also_where_the_axis_is_logarithmic(stage: Stage) -> None:
    stage.press(Qt.Key.Key_3, CONTROL)
    page = stage.window.tabs.explore
    until(lambda: page.result is not None and page.result.motion is not None, "for the curve")
    QGuiApplication.clipboard().setText(page.plot.table())
    linear = pasted()
    page.toolbar.series[3].click()
    QGuiApplication.clipboard().setText(page.plot.table())
    assert pasted() == linear
    top = max(float(row.split("\t")[2]) for row in linear.splitlines() if row.startswith("Model: max"))
    assert abs(top - 1155) < 2
