"""The window's pages behind tabs; a single page needs none."""

from collections.abc import Sequence
from typing import Protocol

from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QTabWidget, QWidget

from app.gui.theme import Theme
from app.view import View


class Page(Protocol):
    """What the window does with a page: a widget that shows views."""

    title: str

    def show_view(self, view: View) -> None: ...

    def set_theme(self, theme: Theme) -> None: ...

    def refresh(self) -> None: ...


class Pages(QTabWidget):
    """Shows one page at a time and passes on what all of them must hear."""

    def __init__(self, pages: Sequence[Page], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setDocumentMode(True)
        self.setTabBarAutoHide(True)
        self._pages = tuple(pages)
        for page in self._pages:
            assert isinstance(page, QWidget)
            at = self.addTab(page, page.title)
            self.setTabToolTip(at, f"Ctrl+{at + 1}")
            shortcut = QShortcut(QKeySequence(f"Ctrl+{at + 1}"), self)
            shortcut.activated.connect(lambda at=at: self.setCurrentIndex(at))

    def show_view(self, view: View) -> None:
        for page in self._pages:
            page.show_view(view)

    def set_theme(self, theme: Theme) -> None:
        for page in self._pages:
            page.set_theme(theme)

    def refresh(self) -> None:
        """Let what can be seen move."""
        self._pages[self.currentIndex()].refresh()
