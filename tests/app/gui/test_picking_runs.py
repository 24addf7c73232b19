"""Runs are chosen from the list of the page Runs; keys that start nothing are answered; menus and messages of the page Runs."""

from pathlib import Path

import pytest
from PySide6.QtCore import Qt

from app.gui.runs.transfers import folder_link
from app.gui.shell.page_host import EXPLORE, RUNS
from tests.helpers.main_window import Stage
from tests.helpers.messages import assert_names
from tests.helpers.session_events import LIVE, OPENED, STOPPED


@pytest.mark.deep
def test_runs_for_the_explore_page_are_chosen_from_the_list(stage: Stage) -> None:
    tabs = stage.window.tabs
    stage.happen(OPENED)
    tabs.select_page(EXPLORE)
    tabs.explore.toolbar.overlay_button.click()
    assert tabs.currentIndex() == RUNS
    assert "press Explore (E)" in tabs.runs.details.message_label.text()
    overlaid: list[list[Path]] = []
    tabs.explore.overlaid.add = overlaid.append  # type: ignore[assignment, method-assign]
    tabs.runs.explore_requested.emit([Path("one.h5")])
    assert tabs.currentIndex() == EXPLORE
    assert overlaid == [[Path("one.h5")]]


@pytest.mark.deep
def test_a_key_that_starts_no_run_is_answered(stage: Stage) -> None:
    stage.press(Qt.Key.Key_F5)
    assert "begins when the bench is connected" in stage.window.status_line.label.text()
    assert stage.session.runs == []
    stage.press(Qt.Key.Key_4, Qt.KeyboardModifier.ControlModifier)
    assert stage.window.tabs.currentIndex() == RUNS, "pages are changed while the bench connects"
    stage.press(Qt.Key.Key_1, Qt.KeyboardModifier.ControlModifier)
    stage.happen(OPENED)
    assert len(stage.session.runs) == 1
    stage.happen(*LIVE)
    stage.press(Qt.Key.Key_F5)
    assert_names(stage.window.status_line.label.text(), "run", "progress")
    stage.happen(*STOPPED)
    assert len(stage.session.runs) == 1


def test_a_message_about_files_opens_their_folder(tmp_path: Path) -> None:
    assert folder_link(tmp_path).startswith('<a href="file:///')
    assert str(tmp_path) in folder_link(tmp_path)
