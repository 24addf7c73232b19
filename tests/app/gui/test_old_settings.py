"""Qt settings of an earlier version are read by this version (tests/data/format-2/README.md)."""

import shutil
from pathlib import Path

import pytest
from PySide6.QtCore import QSettings

from tests.helpers.main_window import OpenStage, until

DATA = Path(__file__).parents[2] / "data" / "format-2"


@pytest.fixture
def old(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the folder as that version left it, with its settings."""
    copy = tmp_path / "old"
    shutil.copytree(DATA, copy)
    monkeypatch.chdir(copy)
    kept = copy / "settings.ini"
    kept.write_text(kept.read_text("utf-8").replace("@FOLDER@", copy.as_posix()), encoding="utf-8")
    return copy


@pytest.mark.deep
def test_the_window_is_as_the_earlier_version_left_it(open_stage: OpenStage, old: Path) -> None:
    kept = QSettings(str(old / "settings.ini"), QSettings.Format.IniFormat)
    pages = open_stage(settings=kept, folder=None, specimen=None).window.tabs
    assert pages.currentIndex() == 3
    assert (str(pages.folder), pages.specimen) == ("runs", "T1")
    form = pages.measure.run_panel.protocol
    assert form is not None
    assert (form.name, form.model_dump()["frequencies_hz"], form.model_dump()["peak_to_peak_v"]) == (
        "sine-dwell",
        (100.0, 165.0),
        4.0,
    )
    assert pages.measure.live_pane.time_plot.selected_span == 2
    explored = pages.explore.model.setting
    assert (dict(explored.values), explored.on_skin) == ({"k2": 0.0075, "delta": 0.01}, True)
    campaign = pages.campaign
    until(lambda: campaign.controller.summary is not None, "for the campaign")
    assert campaign.controller.recent == [old / "runs" / "T1.campaign.json"]


@pytest.mark.deep
def test_the_window_keeps_the_names_of_its_settings(open_stage: OpenStage, old: Path) -> None:
    """What this version writes, the earlier one can read."""
    names = set(QSettings(str(old / "settings.ini"), QSettings.Format.IniFormat).allKeys())
    kept = QSettings(str(old / "new.ini"), QSettings.Format.IniFormat)
    stage = open_stage(settings=kept, folder=old / "runs")
    for page in range(4):
        stage.window.tabs.setCurrentIndex(page)
        until(lambda page=page: page in stage.window.tabs.created_pages, "for the page")
    stage.window.close_session(force=True)
    until(lambda: not stage.window.isVisible(), "for the window to close")
    # The columns of Measure, Explore and Campaign have fixed widths.
    assert names - {"window/seen", "measure/columns", "explore/columns", "campaign/columns"} <= set(kept.allKeys())
