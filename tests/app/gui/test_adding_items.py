"""A series over a parameter, added to a campaign in the window: keys, volts on the simulated bench, a curve on the screen."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import QSettings, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from app.campaign.campaign import Campaign
from app.campaign.plan import CampaignItem, campaign_path
from app.config.bench_file import BenchConfig
from app.gui.shell.main_window import MainWindow
from protocols.measurements.sine_dwell import SineDwell
from protocols.runfile.reader import Run
from tests.helpers.main_window import Bench, find, press, until, until_read, whole_window

pytestmark = pytest.mark.deep

CTRL_SHIFT = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier
DWELL = CampaignItem("dwell", "sine-dwell", {"frequencies_hz": (120, 150), "record_s": 0.2})


@pytest.fixture
def window(
    qt: QApplication, config: BenchConfig, settings: QSettings, tmp_path: Path, no_widget_left_behind: None
) -> Iterator[MainWindow]:
    Campaign.create(tmp_path, "T7", True, (DWELL,))
    settings.setValue("campaign/open", str(campaign_path(tmp_path, "T7")))
    with whole_window(Bench(config), config, SineDwell(), tmp_path, settings) as window:
        press(window, Qt.Key.Key_2, Qt.KeyboardModifier.ControlModifier)
        page = window.tabs.campaign
        until_read(page.controller)
        press(window, Qt.Key.Key_N, CTRL_SHIFT)
        assert page.add_pane is not None
        yield window


def choose(window: MainWindow, box: str, text: str) -> None:
    widget = find(window, box)
    widget.setCurrentIndex(widget.findText(text))
    assert widget.currentText() == text


def test_a_series_is_added_measured_and_drawn(window: MainWindow, tmp_path: Path) -> None:
    page = window.tabs.campaign
    choose(window, "add.varied", "peak to peak")
    assert not page.add_pane.form.rows["peak_to_peak_v"].editor.isEnabled()
    page.add_pane.form.rows["frequencies_hz"].editor.setPlainText("140, 160")
    page.add_pane.form.rows["record_s"].editor.setText("0.2 s")
    values = find(window, "add.values")
    values.setFocus()
    QTest.keyClicks(values, "1...3 step 1")
    assert find(window, "add.values-read").text() == "3 runs: 1, 2, 3 V"
    QTest.keyClick(values, Qt.Key.Key_Return)
    until(lambda: page.board.item_list.selected_item == "sine-dwell-series", "for the new item")
    added = json.loads(campaign_path(tmp_path, "T7").read_text("utf-8"))["items"][1]
    assert (added["varied"], added["values"]) == ("peak_to_peak_v", [1.0, 2.0, 3.0])
    assert added["settings"] == {"frequencies_hz": [140.0, 160.0], "record_s": 0.2}

    press(window, Qt.Key.Key_F5, Qt.KeyboardModifier.ShiftModifier)  # one key measures all values
    until(lambda: len(list(tmp_path.glob("*.h5"))) == 3 and not window.state.busy, "for the runs")
    pane = page.board.details
    until(
        lambda: bool(drawn := pane.plots.chart.picture.layers) and any(each.x.size == 3 for each in drawn),
        "for the curve",
    )
    largest = {}  # runs of one second are numbered in their names, which are not in order then
    for path in tmp_path.glob("*.h5"):
        with Run(path) as run:
            largest[run.record.parameters["peak_to_peak_v"]] = 1e6 * run.points()["peak_to_peak"].max()
    line = next(each for each in pane.plots.chart.picture.layers if each.x.size == 3)
    assert line.x.tolist() == [1.0, 2.0, 3.0]
    assert line.y.tolist() == pytest.approx([largest[volts] for volts in (1.0, 2.0, 3.0)])
    assert pane.plots.chart.picture.x_title == "Peak to peak, V"


def test_what_is_wrong_is_shown_and_not_added(window: MainWindow, tmp_path: Path) -> None:
    add, values = find(window, "add.add"), find(window, "add.values")
    choose(window, "add.varied", "peak to peak")
    for text, problem in (
        ("3", "at least two values"),
        ("1, 1", "at least two values"),
        ("1...9 step 4", "9 V is outside the range"),
        ("1 kg, 2 kg", "kg"),
    ):
        values.setText(text)
        assert problem in find(window, "add.values-read").text()
        assert not add.isEnabled()
    values.setText("1, 2")
    assert add.isEnabled()
    name = find(window, "add.name")
    name.selectAll()
    QTest.keyClicks(name, "dwell")
    assert "already" in find(window, "add.message").text()
    assert not add.isEnabled()
    press(window, Qt.Key.Key_Escape)
    assert window.tabs.campaign.currentWidget() is window.tabs.campaign.board
    assert len(json.loads(campaign_path(tmp_path, "T7").read_text("utf-8"))["items"]) == 1
