"""Copying plots: a picture, and a table whose numbers are those of the points."""

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtTest import QTest

from app.gui.face import tokens
from app.gui.plots.copy import PlotCopyButtons
from tests.helpers.main_window import OpenStage, Stage, find, until
from tests.helpers.session_events import LIVE, OPENED, point

CONTROL = Qt.KeyboardModifier.ControlModifier


def pasted() -> str:
    return QGuiApplication.clipboard().text()


@pytest.mark.deep
def test_every_canvas_of_the_window_can_be_copied(open_stage: OpenStage) -> None:
    stage = open_stage(ahead=True)
    until(lambda: len(stage.window.tabs.created_pages) == stage.window.tabs.count(), "for the pages")
    stage.window.measure_page.live_pane.plots.response.strip_box.setCurrentIndex(1)
    _ = stage.window.measure_page.live_pane.plots.curves  # these are made when they are needed
    canvases = stage.window.findChildren(pg.GraphicsView)
    assert len(canvases) >= 9
    assert [c for c in canvases if c.findChild(PlotCopyButtons) is None] == []


def test_the_points_of_a_run_as_a_table(stage: Stage) -> None:
    columns = ["series", "frequency (Hz)", "peak-to-peak displacement (µm)", "standard error"]
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE, point(0, 100.0), point(1, 160.0))
    until(stage.window.measure_page.live_pane.plots.response.model_curves.source_label.text, "for the curve")
    canvas = stage.window.measure_page.live_pane.plots.response.canvas
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


@pytest.mark.deep
def test_a_picture_of_the_plot_without_the_buttons(stage: Stage) -> None:
    canvas = stage.window.measure_page.live_pane.plots.response.canvas
    copying = stage.window.measure_page.live_pane.plots.response.copy_buttons[0]
    copying.show_buttons()
    with_buttons = canvas.grab().toImage()
    copying.copy_picture()
    image = QGuiApplication.clipboard().image()
    assert image.size() == with_buttons.size()
    assert image != with_buttons
    assert copying.isVisible()


@pytest.mark.deep
def test_a_plot_that_has_the_keyboard_shows_it_and_what_can_be_done(stage: Stage) -> None:
    window, plot = stage.window, stage.window.measure_page.live_pane.plots.response
    find(window, "measure.specimen").setFocus()
    before = plot.canvas.grab().toImage()
    plot.canvas.setFocus()
    assert plot.copy_buttons[0].isVisible()
    edge = plot.canvas.grab().toImage().pixelColor(0, plot.canvas.height() // 2).name()
    assert edge == tokens().accent
    assert before.pixelColor(0, plot.canvas.height() // 2).name() == tokens().surface
    plot.canvas.setAttribute(Qt.WidgetAttribute.WA_UnderMouse, False)  # the pointer may rest on it since another test
    find(window, "measure.specimen").setFocus()
    assert not plot.copy_buttons[0].isVisible()


@pytest.mark.deep
def test_what_explore_copies_is_amplitude_also_where_the_axis_is_logarithmic(stage: Stage) -> None:
    stage.press(Qt.Key.Key_3, CONTROL)
    page = stage.window.tabs.explore
    until(lambda: page.result is not None and page.result.motion is not None, "for the curve")
    page.plot.copy_buttons[0].copy_data()
    linear = pasted()
    page.toolbar.series[3].click()
    page.plot.copy_buttons[0].copy_data()
    assert pasted() == linear
    top = max(float(row.split("\t")[2]) for row in linear.splitlines() if row.startswith("model: max"))
    assert abs(top - 1155) < 2
