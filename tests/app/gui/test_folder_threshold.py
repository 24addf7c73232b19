"""Perception threshold of the laboratory file in every plot of the window, and the shade of uncomfortable frequencies."""

from pathlib import Path

import numpy as np
import pytest

from app.config import LABORATORY_FILE_NAME
from app.gui.explore.page import ExplorePage
from app.gui.laboratory.page import SPECIMENS
from app.gui.plots.threshold_items import ABDOMEN_LABEL
from app.gui.shell.page_host import EXPLORE, LABORATORY, RUNS
from tests.helpers.fleet_runs import write_run
from tests.helpers.main_window import Stage, find, until
from tests.helpers.session_events import OPENED


def test_the_file_of_the_folder_is_drawn_on_every_page_and_the_abdomen_without_it(stage: Stage, tmp_path: Path) -> None:
    stage.happen(OPENED)
    tabs = stage.window.tabs
    felt = stage.window.measure_page.live_pane.plots.response.threshold
    assert felt is not None
    assert felt.line.isVisible()
    assert felt.line.value() == pytest.approx(50)
    assert felt.line.label.format == ABDOMEN_LABEL
    folder = tmp_path / "lab"
    folder.mkdir()
    write_run(folder, "T1", 0.0, 1e-3, 150.0, 1)
    (folder / "own.csv").write_text("50,20\n200,5\n")
    (folder / LABORATORY_FILE_NAME).write_text('threshold = "own.csv"\n')
    find(stage.window, "measure.folder").setText(str(folder))
    until(felt.curve.isVisible, "for the file")
    f, um = felt.curve.getData()
    assert np.interp(100.0, f, um) == pytest.approx(10, rel=0.01)
    assert felt.curve_label.toPlainText() == "felt: own"
    assert not felt.line.isVisible()
    tabs.select_page(RUNS)
    shown = tabs.runs.details.plot.threshold
    assert shown is not None
    assert np.interp(100.0, *shown.curve.getData()) == pytest.approx(10, rel=0.01)
    tabs.select_page(EXPLORE)
    page = tabs.explore
    assert isinstance(page, ExplorePage)
    assert page.toolbar.site_box.currentText() == "laboratory"
    until(lambda: page.result is not None and page.result.threshold_label == "felt: own", "for the curve")
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
    until(felt.line.isVisible, "for the abdomen's line")
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
    felt = stage.window.measure_page.live_pane.plots.response.threshold
    assert felt is not None
    assert felt.line.isVisible()


def test_frequencies_that_are_uncomfortable_are_shaded_on_both_kinds_of_axis(stage: Stage) -> None:
    plot = stage.window.measure_page.live_pane.plots.response
    assert plot.threshold is not None
    begins = [shade.getRegion()[0] for shade in plot.threshold.shades]
    assert begins == pytest.approx([200, 250])
    plot.set_log_axes(True, True)
    assert [shade.getRegion()[0] for shade in plot.threshold.shades] == pytest.approx(np.log10([200, 250]))
    assert plot.threshold.line.value() == pytest.approx(np.log10(50))
