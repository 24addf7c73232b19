"""Help: words and how-tos under F1, tutorials that tick their steps, and a name for every widget that takes input."""

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QComboBox,
    QHeaderView,
    QLineEdit,
    QPlainTextEdit,
    QScrollBar,
    QWidget,
)

from app.gui.help.shortcut_sheet import CONCEPTS
from app.gui.help.tutorial import TUTORIALS
from app.gui.shell.page_host import CAMPAIGN
from tests.helpers.main_window import OpenStage, Stage, find, until
from tests.helpers.session_events import LIVE, LOST, OPENED

pytestmark = pytest.mark.deep


@pytest.mark.parametrize(
    ("search", "found"),
    [("membrane sag", "Membrane sag"), ("armed", "Armed"), ("stopped run", ""), ("wiring", "Check the wiring")],
)
def test_f1_explains_words_and_answers_how_to(stage: Stage, search: str, found: str) -> None:
    stage.press(Qt.Key.Key_F1)
    sheet = stage.window.central.shortcut_sheet
    assert next(iter(sheet.concepts)) == "Safety"
    QTest.keyClicks(sheet.search, search)
    names = [name for group in sheet.concepts.values() for name in group]
    assert (found or "Continue a stopped run") in names
    assert len(names) < sum(map(len, CONCEPTS.values()))


def test_the_tour_ticks_what_the_window_shows_to_be_done_and_is_resumed(stage: Stage) -> None:
    window, band = stage.window, stage.window.central.tutorial
    window.central.show_welcome()
    find(window, "welcome.tutorial.tour").click()
    assert band.isVisible()
    assert not window.central.is_covered
    for event, at in ((None, 0), (LIVE, 1)):
        if event is not None:
            stage.happen(OPENED, *event)
        assert "✓ done" in band.title_label.text(), f"step {at + 1}"
        band.next_button.click()
    assert "✓" not in band.title_label.text()
    assert band.position == "tour:2"
    band.resume("tour:4")
    stage.happen(*LOST)
    assert "✓ done" in band.title_label.text()
    band.resume("own-bench:99")
    assert band.position == "tour:4", "there is no such step"
    for _ in range(len(TUTORIALS["tour"].steps)):
        band.next_button.click()
    assert not band.isVisible()


def test_the_key_of_a_page_shows_it_whatever_lies_over_the_pages(stage: Stage) -> None:
    stage.window.central.show_welcome()
    stage.press(Qt.Key.Key_2, Qt.KeyboardModifier.ControlModifier)
    assert not stage.window.central.is_covered
    assert stage.window.tabs.currentIndex() == CAMPAIGN
    assert stage.window.tabs.campaign.start_pane.specimen_edit.hasFocus()


def test_the_palette_and_the_menu_have_the_tutorials(stage: Stage) -> None:
    texts = [entry.text for entry in stage.window.menus.palette_entries()]
    for tutorial in TUTORIALS.values():
        assert f"Tutorial: {tutorial.title}" in texts


def test_every_widget_that_takes_input_has_a_name_for_screen_readers(open_stage: OpenStage) -> None:
    window = open_stage().window
    for index in range(window.tabs.count()):
        window.tabs.page(index)
    window.central.show_settings()
    window.central.show_palette()
    window.central.show_shortcuts()
    window.central.show_welcome()
    bench = window.tabs.bench
    until(lambda: bench.draft is not None, "for the bench")
    bench.editor.further.open_button.click()
    bench.editor.simulation.open_button.click()
    find(bench, "bench.channels.add").click()
    find(bench, "bench.meters.add").click()
    nameless = []
    for widget in window.findChildren(QWidget):
        takes_keys = bool(widget.focusPolicy() & Qt.FocusPolicy.TabFocus)
        if not takes_keys and not isinstance(widget, QAbstractButton | QLineEdit | QComboBox | QPlainTextEdit):
            continue
        parts = [widget, widget.parentWidget(), getattr(widget.parentWidget(), "parentWidget", lambda: None)()]
        of_qt = isinstance(widget, QScrollBar | QHeaderView) or widget.objectName().startswith("qt_")
        of_qt = of_qt or any(isinstance(part, QComboBox | QLineEdit | QAbstractItemView) for part in parts[1:])
        of_qt = of_qt or (type(widget) is QWidget and bool(parts[1].accessibleName()))  # viewport of a named plot
        text = "" if isinstance(widget, QLineEdit | QComboBox | QPlainTextEdit) else widget.property("text")
        hidden_without_text = isinstance(widget, QAbstractButton) and widget.isHidden()
        if not (of_qt or hidden_without_text or widget.accessibleName() or text):
            nameless.append(" < ".join(f"{type(part).__name__} {part.objectName()}" for part in parts if part))
    assert not nameless
