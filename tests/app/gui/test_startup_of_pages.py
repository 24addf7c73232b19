"""Hidden pages are created after the first paint, and none of their widgets becomes a window."""

import pytest
from PySide6.QtCore import QEvent, QObject, QSettings, Qt
from PySide6.QtWidgets import QApplication, QLabel, QSplitter, QWidget

from app.gui.plots import Chart
from app.gui.shell.page_host import EXPLORE, MEASURE, RUNS
from protocols.measurements.free_decay import FreeDecay
from protocols.measurements.sine_dwell import SineDwell
from tests.helpers.main_window import OpenStage, until


class Windows(QObject):
    """Remembers what was shown as a window."""

    def __init__(self) -> None:
        super().__init__()
        self.shown: list[str] = []

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Show and isinstance(watched, QWidget) and watched.isWindow():
            self.shown.append(type(watched).__name__)
        return False


def left_on(open_stage: OpenStage, at: int) -> None:
    """A window that was closed while this page was seen."""
    window = open_stage().window
    window.tabs.setCurrentIndex(at)
    for splitter in window.tabs.current_page.findChildren(QSplitter):
        if splitter.isVisible():
            splitter.setSizes([520, 520])
    window.close()
    until(lambda: not window.isVisible(), "for the window to close")


@pytest.mark.deep
def test_last_page_is_restored_after_first_paint_with_keyboard_focus(open_stage: OpenStage) -> None:
    left_on(open_stage, RUNS)
    stage = open_stage(ahead=True)
    pages = stage.window.tabs
    assert pages.currentIndex() == RUNS
    assert list(pages.created_pages) == [MEASURE], "nobody waits for it"
    assert not pages.measure.findChildren(Chart), "the page that is not shown has no plots yet"
    (comes,) = (label for label in pages.currentWidget().findChildren(QLabel))
    assert comes.text() == "Runs …"
    until(lambda: RUNS in pages.created_pages, "for the page")
    assert list(pages.created_pages)[1] == RUNS, "it is made before the others"
    until(stage.window.tabs.runs.list.table.hasFocus, "for the keyboard")
    until(lambda: not pages.currentWidget().findChildren(QLabel, "", Qt.FindChildOption.FindDirectChildrenOnly))
    columns = stage.window.tabs.runs.findChild(QSplitter, "runs/columns")
    assert abs(columns.sizes()[0] - columns.sizes()[1]) < 20, "divided as it was left"
    until(lambda: len(pages.created_pages) == pages.count(), "for the other pages")
    until(lambda: bool(pages.measure.findChildren(Chart)), "for the plots, before the page is turned to")
    assert pages.currentIndex() == RUNS


@pytest.mark.deep
def test_who_starts_a_run_or_asks_for_a_protocol_sees_it(open_stage: OpenStage) -> None:
    left_on(open_stage, EXPLORE)
    assert open_stage(autostart=True).window.tabs.currentIndex() == MEASURE
    assert open_stage(protocol=SineDwell(peak_to_peak_v=4.0)).window.tabs.currentIndex() == MEASURE
    assert open_stage(protocol=FreeDecay()).window.tabs.currentIndex() == MEASURE
    stage = open_stage()
    assert stage.window.tabs.currentIndex() == EXPLORE
    stage.window.start_demo()
    assert stage.window.tabs.currentIndex() == MEASURE


@pytest.mark.deep
def test_settings_that_make_no_sense_open_the_first_page(open_stage: OpenStage, settings: QSettings) -> None:
    for nonsense in ("17", "-1", "runs", ""):
        settings.setValue("window/page", nonsense)
        assert open_stage().window.tabs.currentIndex() == MEASURE


@pytest.mark.deep
def test_the_other_pages_are_made_behind_the_first_one(open_stage: OpenStage, qt: QApplication) -> None:
    windows = Windows()
    qt.installEventFilter(windows)
    try:
        pages = open_stage(ahead=True).window.tabs
        assert list(pages.created_pages) == [0]
        until(lambda: len(pages.created_pages) == pages.count(), "for the other pages")
    finally:
        qt.removeEventFilter(windows)
    assert windows.shown == ["MainWindow"]
    assert pages.currentIndex() == 0


@pytest.mark.deep
def test_a_page_that_is_made_below_the_welcome_page_leaves_it_the_keyboard(open_stage: OpenStage) -> None:
    window = open_stage(ahead=True).window
    window.tabs.show_page_later(RUNS)
    window.central.show_welcome()
    before = window.focusWidget()
    until(lambda: len(window.tabs.created_pages) == window.tabs.count(), "for the pages")
    assert window.focusWidget() is before
    window.central.show_pages()
    assert window.tabs.currentIndex() == RUNS
