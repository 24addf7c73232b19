"""Plot tools: zoom that stays while points arrive, read-out, marker, context menu, files."""

from pathlib import Path

import numpy as np
import pytest
from pypdfium2 import PdfDocument
from pyqtgraph import GraphicsView
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QAction, QPixmap, QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from app.gui.widgets.actions import ACTIONS
from tests.helpers.main_window import OpenStage, Stage, find, until
from tests.helpers.session_events import LIVE, OPENED, point


@pytest.fixture
def measured(stage: Stage) -> Stage:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE, point(0, 100.0), point(1, 160.0))
    return stage


def turn_wheel(canvas, box, notches: int) -> None:
    at = canvas.mapFromScene(box.sceneBoundingRect().center())
    event = QWheelEvent(
        QPointF(at), QPointF(canvas.mapToGlobal(at)), QPoint(), QPoint(0, 120 * notches), Qt.MouseButton.NoButton,
        Qt.KeyboardModifier.NoModifier, Qt.ScrollPhase.NoScrollPhase, False,
    )  # fmt: skip
    QApplication.sendEvent(canvas.viewport(), event)


@pytest.mark.deep
def test_a_zoom_stays_while_points_arrive_until_everything_is_shown_again(measured: Stage) -> None:
    plot = measured.window.measure_page.live_pane.plots.chart
    box = plot.panels[0].box
    until(lambda: "curve:" in plot.note_label.text(), "for the curve")
    whole = box.viewRange()
    turn_wheel(plot.canvas, box, 5)
    closer = box.viewRange()
    assert closer[0][1] - closer[0][0] < 0.9 * (whole[0][1] - whole[0][0])
    measured.happen(point(2, 200.0))
    assert box.viewRange() == closer, "the arrival of a point does not take the zoom away"
    plot.canvas.setFocus()
    QTest.keyClick(plot.canvas, Qt.Key.Key_Home)
    assert box.viewRange() == whole
    QTest.keyClick(plot.canvas, Qt.Key.Key_Plus)
    assert box.zoomed
    at = plot.canvas.mapFromScene(box.sceneBoundingRect().center())
    QTest.mouseDClick(plot.canvas.viewport(), Qt.MouseButton.LeftButton, pos=at)
    assert not box.zoomed, "a double click shows everything"


@pytest.mark.deep
def test_the_cursor_goes_to_the_highest_point_and_along_the_curve(measured: Stage) -> None:
    plot = measured.window.measure_page.live_pane.plots.chart
    until(lambda: "curve:" in plot.note_label.text(), "for the curve")
    plot.canvas.setFocus()
    QTest.keyClick(plot.canvas, Qt.Key.Key_P)
    label = find(plot.canvas, "plot.read-out")
    assert label.isVisible()
    assert label.text().startswith("100 Hz\n")
    assert "900.0 ± 2.0 µm" in label.text()
    before = label.text()
    QTest.keyClick(plot.canvas, Qt.Key.Key_Right)
    assert label.text() != before
    QTest.keyClick(plot.canvas, Qt.Key.Key_Home)
    assert not label.isVisible()


@pytest.mark.deep
def test_the_menu_of_a_plot_shows_its_tools_and_leaves_stop_in_reach(measured: Stage) -> None:
    plot = measured.window.measure_page.live_pane.plots.chart
    measured.window.resize(1280, 800)
    menu = plot.tools.make_menu()
    texts = [action.text() for action in menu.actions()]
    assert ACTIONS["plot.peak"].text in texts
    assert "Lower plot: residual of the fit" in texts
    next(action for action in menu.actions() if action.text() == "Lower plot: residual of the fit").trigger()
    assert len(plot.panels) == 2
    measured.window.resize(900, 560)
    until(lambda: len(plot.panels) == 1, "for the plot of a low window, which has no place for both")
    menu.popup(plot.canvas.mapToGlobal(QPoint(40, 40)))
    QTest.keyClick(menu, Qt.Key.Key_F12)
    assert measured.session.stops == 1
    menu = plot.tools.make_menu()
    menu.popup(plot.canvas.mapToGlobal(QPoint(40, 40)))
    QTest.keyClick(menu, Qt.Key.Key_Escape)
    assert measured.session.stops == 2, "Escape stops a run, also where a menu is open"
    menu = plot.tools.make_menu()
    menu.popup(plot.canvas.mapToGlobal(QPoint(40, 40)))
    stop = find(measured.window, "status.stop")
    QTest.mouseClick(menu, Qt.MouseButton.LeftButton, pos=menu.mapFromGlobal(stop.mapToGlobal(stop.rect().center())))
    assert measured.session.stops == 3, "so does a click on STOP"


@pytest.mark.deep
def test_picture_and_data_are_written_to_files(measured: Stage, tmp_path: Path) -> None:
    plot = measured.window.measure_page.live_pane.plots.chart
    tools = plot.tools
    tools.files.write_data(tmp_path / "response")
    assert (tmp_path / "response.tsv").read_text("utf-8").startswith("SIMULATED\nseries\tFrequency, Hz")
    tools.files.write_picture(tmp_path / "response.png")
    picture = QPixmap(str(tmp_path / "response.png"))
    assert picture.size() == plot.canvas.viewport().grab().size()
    tools.files.write_picture(tmp_path / "response.svg")
    drawn = (tmp_path / "response.svg").read_text("utf-8")
    assert drawn.count("<path") + drawn.count("<polyline") > 20, "lines, not pixels"
    for text in ("SIMULATED", "Frequency, Hz"):
        assert f">{text}<" in drawn
    tools.files.write_picture(tmp_path / "response.pdf")
    with PdfDocument(tmp_path / "response.pdf") as document:
        (page,) = document
        width, height = page.get_size()
        assert width / height == pytest.approx(picture.width() / picture.height(), rel=0.01)
        assert page.render(scale=96 / 72).to_pil().getbbox() is not None
        rendered = page.render(scale=96 / 72).to_pil().convert("L")
        assert sum(rendered.histogram()[:128]) > 1000, "ink"
    tools.files.write_data(tmp_path / "no" / "folder.tsv")
    assert str(tmp_path / "no" / "folder.tsv") in find(plot.canvas, "plot.read-out").text()


@pytest.mark.deep
def test_every_plot_has_the_same_tools(open_stage: OpenStage) -> None:
    stage = open_stage(ahead=True)
    until(lambda: len(stage.window.tabs.created_pages) == stage.window.tabs.count(), "for the pages")
    canvases = stage.window.findChildren(GraphicsView)
    assert len(canvases) >= 8
    for canvas in canvases:
        assert canvas.findChild(QAction, "plot.peak") is not None, canvas.accessibleName()
        assert canvas.contextMenuPolicy() is Qt.ContextMenuPolicy.CustomContextMenu


@pytest.mark.deep
def test_logarithmic_axes_show_the_same_values(measured: Stage) -> None:
    plot = measured.window.measure_page.live_pane.plots.chart
    until(lambda: "curve:" in plot.note_label.text(), "for the curve")
    box, name = plot.panels[0].box, "max − min, measured"
    whole, table, (x, y) = box.viewRange(), plot.table(), plot.panels[0].drawn_layer(name).scatter.getData()
    plot.canvas.setFocus()
    for key in (Qt.Key.Key_X, Qt.Key.Key_Y):
        QTest.keyClick(plot.canvas, key, Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier)
    assert plot.log_axes == (True, True)
    np.testing.assert_allclose(plot.panels[0].drawn_layer(name).scatter.getData(), np.log10([x, y]))
    (left, right), (bottom, top) = box.viewRange()
    assert left == pytest.approx(np.log10(5.0)), "the model's curve begins at 5 Hz"
    assert right == pytest.approx(np.log10(whole[0][1]))
    assert bottom < np.log10(y.min()) < top
    assert plot.table() == table, "what is copied does not depend on the axes"
    measured.happen(point(2, 200.0))
    np.testing.assert_allclose(plot.panels[0].drawn_layer(name).scatter.getData()[0], np.log10([100.0, 160.0, 200.0]))
    entries = [action for action in plot.tools.make_menu().actions() if action.text().startswith("Logarithmic")]
    assert [entry.isChecked() for entry in entries] == [True, True]
    for entry in entries:
        entry.trigger()
    assert box.viewRange() == whole
    traces = measured.window.measure_page.live_pane.time_plot
    assert not [a for a in traces.tools.make_menu().actions() if a.text().startswith("Logarithmic") and a.isEnabled()]
