"""Command palette, menu bar and settings page."""

from pathlib import Path

import pytest
from PySide6.QtCore import QSettings, Qt
from PySide6.QtTest import QTest

from app.gui.face import DARK, LIGHT, tokens
from app.gui.help.palette import ENTRY_ROLE, PaletteEntry
from app.gui.shell.page_host import MEASURE, RUNS
from app.gui.widgets.actions import ACTIONS
from tests.helpers.main_window import OpenStage, Stage, find, until
from tests.helpers.run_files import finished_run
from tests.helpers.session_events import LIVE, OPENED, STOPPED, point

CTRL = Qt.KeyboardModifier.ControlModifier


@pytest.mark.deep
def test_the_palette_finds_commands_protocols_settings_and_runs(open_stage: OpenStage, tmp_path: Path) -> None:
    finished_run(tmp_path, "T9", size_m=8e-4)
    stage = open_stage()
    stage.happen(OPENED)
    stage.press(Qt.Key.Key_4, CTRL)
    until(lambda: stage.window.tabs.runs.list.folder_model.summaries, "for the runs")
    stage.press(Qt.Key.Key_K, CTRL)
    palette = stage.window.central.command_palette
    assert palette.isVisible()

    def shown() -> list[PaletteEntry]:
        return [palette.list.item(at).data(ENTRY_ROLE) for at in range(palette.list.count())]

    assert {entry.kind for entry in shown()} == {"command", "protocol", "setting", "run"}
    of_plots = {info.text for name, info in ACTIONS.items() if name.startswith("plot.")}
    assert not of_plots & {entry.text for entry in shown()}
    QTest.keyClicks(palette.search, "t9")
    assert [entry.kind for entry in shown()] == ["run"]
    QTest.keyClick(palette.search, Qt.Key.Key_Return)
    until(lambda: stage.window.tabs.runs.viewer.run is not None, "for the run")

    stage.press(Qt.Key.Key_K, CTRL)
    palette.search.setText("hysteresis")
    QTest.keyClick(palette.search, Qt.Key.Key_Return)
    assert stage.window.tabs.currentIndex() == MEASURE
    assert stage.window.measure_page.run_panel.kind.name == "hysteresis"
    assert not stage.window.central.is_covered

    stage.press(Qt.Key.Key_K, CTRL)
    palette.search.setText("page runs")
    QTest.keyClick(palette.search, Qt.Key.Key_Return)
    assert stage.window.tabs.currentIndex() == RUNS


def test_a_protocol_of_the_palette_shows_its_set_up_over_a_result(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE, point(0, 100.0), *STOPPED)
    panel = stage.window.measure_page.run_panel
    panel.show_side("result")
    assert not panel.form.isVisible()
    for name in ("hysteresis", "sine dwell"):
        stage.press(Qt.Key.Key_K, CTRL)
        palette = stage.window.central.command_palette
        palette.search.setText(f"measure: {name}")
        QTest.keyClick(palette.search, Qt.Key.Key_Return)
        assert panel.form.isVisible()
        assert not panel.result_pane.isVisible()
        assert panel.kind.title.casefold().startswith(name)
        panel.show_side("result")


@pytest.mark.deep
def test_stop_works_while_the_palette_or_a_menu_of_the_bar_is_open(stage: Stage) -> None:
    stage.happen(OPENED)
    stage.window.start_run()
    stage.happen(*LIVE)
    stage.press(Qt.Key.Key_K, CTRL)
    stage.press(Qt.Key.Key_F12)
    assert stage.session.stops == 1
    menu = find(stage.window, "menu.run")
    menu.popup(stage.window.mapToGlobal(stage.window.rect().center()))
    assert ACTIONS["stop"].text in [action.text() for action in menu.actions()]
    QTest.keyClick(menu, Qt.Key.Key_Escape)
    assert stage.session.stops == 2
    assert not menu.isVisible()


@pytest.mark.deep
def test_the_appearance_is_chosen_and_kept(open_stage: OpenStage, settings: QSettings) -> None:
    stage = open_stage()
    stage.press(Qt.Key.Key_Comma, CTRL)
    box = find(stage.window, "settings.appearance")
    box.setCurrentIndex(box.findData("dark"))
    assert tokens() == DARK
    page = stage.window.central.settings_page
    page.search.setText("appearance")
    assert box.isVisible()
    assert not find(stage.window, "settings.specimen").isVisible()
    edit = find(stage.window, "settings.specimen")
    edit.setText("T12")
    edit.editingFinished.emit()
    assert stage.window.tabs.specimen == "T12"
    stage.press(Qt.Key.Key_Escape)
    assert not stage.window.central.is_covered
    stage.window.close_session(force=True)
    until(lambda: not stage.window.isVisible(), "for the window to close")
    assert settings.value("window/appearance") == "dark"
    again = open_stage()
    assert tokens() == DARK
    again.window.look.set_appearance("light")
    assert tokens() == LIGHT


@pytest.mark.deep
def test_the_menu_of_the_page_has_its_actions(stage: Stage) -> None:
    stage.press(Qt.Key.Key_3, CTRL)
    menu = find(stage.window, "menu.page")
    menu.aboutToShow.emit()
    assert "Save as a study" in [action.text() for action in menu.actions()]
    stage.press(Qt.Key.Key_1, CTRL)
    menu.aboutToShow.emit()
    assert [action.text() for action in menu.actions()] == ["Undo in the form", "Redo in the form"]
