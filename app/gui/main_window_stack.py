"""What is below bench bar and notices: the pages, and what may cover them: the sheet of keys, and the newcomer's page."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QApplication, QSizePolicy, QStackedWidget, QVBoxLayout, QWidget
from shiboken6 import isValid

from app.gui.help.hint import Hint
from app.gui.help.shortcut_sheet import KeySheet
from app.gui.help.welcome import FirstPage
from app.gui.tabs import Book
from app.gui.widgets.file_dialog import ask_for_files
from app.gui.widgets.shortcuts import bind, lines_of


class Room(QWidget):
    """Shows the pages, or one of the covers; whatever covers them goes away with Escape."""

    try_pressed = Signal()
    bench_chosen = Signal(str)
    """Path of a bench file."""

    def __init__(self, pages: Book) -> None:
        super().__init__()
        self.pages, self.keys, self.first, self.hint = pages, KeySheet(), FirstPage(), Hint()
        self.stack = QStackedWidget()
        for widget in (pages, self.keys, self.first):
            self.stack.addWidget(widget)
        for cover in (self.keys, self.first):  # what covers the pages makes no window larger
            cover.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(10, 0, 10, 8)
        layout.setSpacing(6)
        layout.addWidget(self.hint)
        layout.addWidget(self.stack, 1)
        self._before: QWidget | None = None
        self.keys.closed.connect(self.uncover)
        self.keys.first_page_asked.connect(self.show_first)
        self.first.closed.connect(self.uncover)
        self.first.try_pressed.connect(self.try_pressed)
        self.first.browse_pressed.connect(self._browse)
        bind(self, "Show these keys, or close them", self.toggle_keys, Qt.Key.Key_F1, "?")

    @property
    def covered(self) -> bool:
        """Whether the pages cannot be seen."""
        return self.stack.currentWidget() is not self.pages

    def toggle_keys(self) -> None:
        """Show what every key does, or the pages again."""
        if self.stack.currentWidget() is self.keys:
            self.uncover()
            return
        present = self.pages.present
        self._cover(self.keys)
        self.keys.open(lines_of(self.window(), [present]))

    def show_first(self) -> None:
        """Show the newcomer's page."""
        self._cover(self.first)
        self.first.open(str(self.pages.folder))

    def uncover(self) -> bool:
        """Show the pages; whether something covered them."""
        if not self.covered:
            return False
        self.stack.setCurrentWidget(self.pages)
        if self._before is not None and isValid(self._before):
            self._before.setFocus()
        else:
            self.pages.present.enter()
        self._before = None
        return True

    def back(self) -> None:
        """One step back."""
        if not self.uncover():
            self.pages.back()

    def _cover(self, widget: QWidget) -> None:
        if not self.covered:
            self._before = QApplication.focusWidget()
        self.stack.setCurrentWidget(widget)

    def _browse(self) -> None:
        ask_for_files(
            self, "Open a bench file", lambda paths: self.bench_chosen.emit(str(paths[0])), "Bench files (*.toml)"
        )
