"""Pages that nobody sees yet are made after the first paint, and no part of them is ever a window of its own."""

from PySide6.QtCore import QEvent, QObject
from PySide6.QtWidgets import QApplication, QWidget

from tests.app.gui.stage import OpenStage, until


class Windows(QObject):
    """Remembers what was shown as a window."""

    def __init__(self) -> None:
        super().__init__()
        self.shown: list[str] = []

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Show and isinstance(watched, QWidget) and watched.isWindow():
            self.shown.append(type(watched).__name__)
        return False


def test_the_other_pages_are_made_behind_the_first_one(open_stage: OpenStage, qt: QApplication) -> None:
    windows = Windows()
    qt.installEventFilter(windows)
    try:
        pages = open_stage(ahead=True).window.pages
        assert list(pages.made) == [0]
        until(lambda: len(pages.made) == pages.count(), "for the other pages")
    finally:
        qt.removeEventFilter(windows)
    assert windows.shown == ["MainWindow"]
    assert pages.currentIndex() == 0
