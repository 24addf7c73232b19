"""Perception threshold of the laboratory file in every plot of the window, and the shade of uncomfortable frequencies."""

from pathlib import Path

import numpy as np
import pytest

from app.config import LABORATORY_FILE_NAME
from app.gui.explore.page import ExplorePage
from app.gui.face import tokens
from app.gui.laboratory.page import SPECIMENS
from app.gui.plots import Chart
from app.gui.shell.page_host import EXPLORE, LABORATORY, RUNS
from model.response import ABDOMEN_THRESHOLD
from tests.helpers.fleet_runs import write_run
from tests.helpers.main_window import Stage, find, until
from tests.helpers.session_events import OPENED


def levels(chart: Chart) -> dict[str, float]:
    """The level lines of a plot by their labels."""
    return {rule.label: rule.at for rule in chart.picture.rules if rule.along_y}


def felt_at(chart: Chart, hz: float) -> float:
    layer = chart.layer("Felt: own")
    assert layer is not None
    return float(np.interp(hz, layer.x, layer.y))


@pytest.mark.deep
def test_the_file_of_the_folder_is_drawn_on_every_page_and_the_abdomen_without_it(stage: Stage, tmp_path: Path) -> None:
    stage.happen(OPENED)
    tabs = stage.window.tabs
    chart = stage.window.measure_page.live_pane.plots.chart
    assert levels(chart) == {ABDOMEN_THRESHOLD.line_label: pytest.approx(50)}
    folder = tmp_path / "lab"
    folder.mkdir()
    write_run(folder, "T1", 0.0, 1e-3, 150.0, 1)
    (folder / "own.csv").write_text("50,20\n200,5\n")
    (folder / LABORATORY_FILE_NAME).write_text('threshold = "own.csv"\n')
    find(stage.window, "measure.folder").setText(str(folder))
    until(lambda: chart.layer("Felt: own") is not None, "for the file")
    assert felt_at(chart, 100.0) == pytest.approx(10, rel=0.01)
    assert not levels(chart)
    tabs.select_page(RUNS)
    assert tabs.runs.details.plot._threshold.label == "Felt: own"  # drawn with the runs that are selected
    tabs.select_page(EXPLORE)
    page = tabs.explore
    assert isinstance(page, ExplorePage)
    assert page.toolbar.site_box.currentText() == "laboratory"
    until(lambda: page.result is not None and page.result.threshold_label == "Felt: own", "for the curve")
    tabs.select_page(LABORATORY)
    laboratory = tabs.laboratory
    laboratory.show_view(SPECIMENS)
    until(lambda: laboratory.fleet.view is not None, "for the specimens")
    assert laboratory.fleet.view is not None
    values = laboratory.fleet._fleet
    assert values is not None
    margin = values.of("margin_at_resonance")
    assert margin.condition.endswith("over own")
    assert margin.values[0].value == pytest.approx(1e-3 / (20e-6 * 50 / 150), rel=0.01)
    (folder / LABORATORY_FILE_NAME).unlink()
    tabs.select_page(0)
    until(lambda: bool(levels(chart)), "for the abdomen's line")
    assert page.toolbar.site_box.findText("laboratory") < 0


def test_a_faulty_file_is_a_message_and_the_abdomen_s_line_stays(stage: Stage, tmp_path: Path) -> None:
    stage.happen(OPENED)
    said: list[str] = []
    stage.window.tabs._threshold._show_message = said.append
    folder = tmp_path / "lab"
    folder.mkdir()
    (folder / LABORATORY_FILE_NAME).write_text('threshold = "elbow"\n')
    find(stage.window, "measure.folder").setText(str(folder))
    until(lambda: said, "for the message")
    assert "threshold 'elbow': neither a site" in said[0]
    assert ABDOMEN_THRESHOLD.line_label in levels(stage.window.measure_page.live_pane.plots.chart)


def test_frequencies_that_are_uncomfortable_are_shaded_on_both_kinds_of_axis(stage: Stage) -> None:
    chart = stage.window.measure_page.live_pane.plots.chart
    assert [region.low for region in chart.picture.regions] == [200, 250]
    for log in (False, True):
        chart.set_log_axes(log, log)
        panel = chart.panels[0]
        (inside, _), (edge, _) = panel.to_pixels(220.0, 1.0)[0], panel.to_pixels(200.0, 1.0)[0]
        picture = chart.canvas.viewport().grab().toImage()
        row = (chart.canvas.mapFromScene(panel.box.mapToScene(across, 4.5)) for across in (inside, edge - 4))
        assert [picture.pixelColor(place).name() for place in row] == [tokens().sand, tokens().surface]
