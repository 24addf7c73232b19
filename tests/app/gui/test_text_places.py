"""Cut and overlapping texts: the detector finds planted ones in plots and among widgets, and none in the window at any size or scale."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtCore import QCoreApplication, QSize
from PySide6.QtWidgets import QApplication, QLabel, QWidget

from app.gui.plots import Chart, Panel, Picture, layer
from tests.helpers.main_window import Stage
from tests.helpers.session_events import OPENED
from tests.helpers.size_matrix import SCALES
from tests.helpers.text_places import faults_of_plot, faults_of_window


def shown_plot() -> pg.PlotWidget:
    plot = pg.PlotWidget()
    plot.resize(400, 300)
    plot.setXRange(0, 10)
    plot.setYRange(0, 10)
    plot.show()
    QCoreApplication.processEvents()
    return plot


def test_a_sound_plot_has_no_fault(qt: QApplication) -> None:
    plot = shown_plot()
    assert list(faults_of_plot(plot)) == []
    plot.deleteLater()


@pytest.mark.parametrize(
    ("places", "fault"),
    [(((5.0, 5.0), (5.1, 5.05)), "overlaps"), (((9.9, 5.0),), "is cut"), (((-1.2, 5.0),), "overlaps")],
    ids=["two labels", "at the edge", "over the ticks"],
)
def test_planted_faults_of_a_plot_are_found(
    qt: QApplication, places: tuple[tuple[float, float], ...], fault: str
) -> None:
    plot = shown_plot()
    for at in places:
        item = pg.TextItem("a direct label")
        plot.addItem(item, ignoreBounds=True)
        item.setPos(*at)
    QCoreApplication.processEvents()
    assert any(fault in each for each in faults_of_plot(plot))
    plot.deleteLater()


def test_overlapping_labels_are_found(qt: QApplication) -> None:
    window = QWidget()
    for text, x in (("one text", 0), ("another text", 20)):
        QLabel(text, window).move(x, 0)
    window.show()
    QCoreApplication.processEvents()
    assert any("overlaps" in each for each in faults_of_window(window))
    window.deleteLater()


def test_the_shell_has_no_fault_at_any_size(stage: Stage) -> None:
    stage.happen(OPENED)
    for size in (QSize(900, 560), QSize(1093, 614), QSize(1366, 768), QSize(1920, 1080)):
        stage.window.resize(size)
        QCoreApplication.processEvents()
        assert list(faults_of_window(stage.window)) == [], size


@pytest.mark.deep
def test_dates_of_an_axis_never_overlap(qt: QApplication) -> None:
    chart, labels = Chart("dates"), set[str]()
    chart.show()
    for at, days in enumerate(np.geomspace(1, 300_000, 20)):
        times = 1_700_000_000 + 2_100_000 * at + np.array([0, 86400 * days])
        chart.show_picture(
            Picture(dates=True, log=(False, False), layers=(layer(name="a", x=times, y=np.arange(2.0)),))
        )
        for width in range(230, 600, 53):
            chart.resize(width, 250)
            QCoreApplication.processEvents()
            assert list(faults_of_plot(chart.canvas)) == [], f"{width} {days}"
            labels |= {text for _, text in chart.panels[0].axes["bottom"].places()}
    assert len(labels) > 25
    chart.deleteLater()


def test_the_screen_shows_the_labels_of_another_range(qt: QApplication) -> None:
    """A grab repaints the whole plot; the screen shows only what was repainted."""
    chart = Chart("another range")
    curve = layer(name="a", x=np.arange(3.0), y=np.array([0.0, 2.0, 1.0]))
    chart.show_picture(Picture(x_title="x", panels=(Panel(title="y"),), log=(False, False), layers=(curve,)))
    chart.show()
    QCoreApplication.processEvents()
    for limits in ((-300.0, 500.0), (-2.0, 3.0), (-1.0, 4.0)):
        chart.panels[0].box.set_whole((0.0, 2.0), limits)
        QCoreApplication.processEvents()
        shown = chart.screen().grabWindow(chart.winId()).toImage()
        assert shown == chart.grab().toImage().convertToFormat(shown.format()), limits
    chart.deleteLater()


def test_an_axis_that_grew_shows_nothing_of_its_earlier_size(qt: QApplication) -> None:
    """Its picture is kept by Qt; painted without that, it is the same."""
    chart = Chart("grown")
    chart.show()
    for size, high in (
        (QSize(400, 150), 700.0),
        (QSize(900, 500), 1300.0),
        (QSize(500, 200), 90.0),
        (QSize(1200, 700), 90.0),
    ):
        chart.resize(size)
        curve = layer(name="a", x=np.arange(3.0) * high, y=np.array([0.0, high, 1.0]))
        chart.show_picture(Picture(x_title="x", panels=(Panel(title="y"),), log=(False, False), layers=(curve,)))
        QCoreApplication.processEvents()
        kept = chart.grab().toImage()
        for axis in chart.panels[0].axes.values():
            axis.setCacheMode(axis.CacheMode.NoCache)
        assert chart.grab().toImage() == kept, size
        for axis in chart.panels[0].axes.values():
            axis.setCacheMode(axis.CacheMode.DeviceCoordinateCache)
        chart.grab()
    chart.deleteLater()


@pytest.mark.deep
@pytest.mark.parametrize("scale", SCALES)
def test_nothing_is_cut_and_stop_pause_and_state_are_whole(scale: float, tmp_path: Path) -> None:
    environment = {key: value for key, value in os.environ.items() if not key.startswith("QT_")}
    done = subprocess.run(
        [sys.executable, "-m", "tests.helpers.size_matrix", "--scale", f"{scale:g}"],
        env={**environment, "PYTHONPATH": str(Path(__file__).parents[3])},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr[-2000:]}"
