"""Shortcut sheet over the pages: every keyboard shortcut by group, with a search."""

from collections.abc import Mapping

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeySequence
from PySide6.QtWidgets import (
    QFrame,
    QGridLayout,
    QLabel,
    QLineEdit,
    QScrollArea,
    QWidget,
)

from app.gui.widgets.actions import ActionInfo, shortcut_label
from app.gui.widgets.form import set_style_kind
from app.gui.widgets.layouts import STRETCH, column, make_button, make_label, row


class ShortcutSheet(QWidget):
    """Lists the shortcuts by group; filled whenever it is opened."""

    closed = Signal()
    welcome_requested = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._groups: Mapping[str, tuple[ActionInfo, ...]] = {}
        self.rows: list[tuple[str, ActionInfo]] = []
        """The displayed actions with the title of their group."""
        self.search = QLineEdit()
        self.search.setPlaceholderText("Search: what to do, or a key")
        self.search.setAccessibleName("search the keys")
        self.search.setClearButtonEnabled(True)
        self.search.textChanged.connect(self._fill_list)
        self._scroll = QScrollArea()
        self._scroll.setWidgetResizable(True)
        self._scroll.setFrameShape(QFrame.Shape.NoFrame)
        self._scroll.viewport().setAutoFillBackground(False)
        first = make_button("First steps …", self.welcome_requested.emit)
        close = make_button(shortcut_label("Close", "shortcuts"), self.closed.emit)
        top = row(make_label("Keys", "heading", wrap=False), (self.search, 1), first, close, spacing=14)
        column(top, (self._scroll, 1), parent=self, margins=(16, 12, 16, 8), spacing=10)

    def show_shortcuts(self, groups: Mapping[str, tuple[ActionInfo, ...]]) -> None:
        """Show groups of actions and clear the search."""
        self._groups = groups
        self.search.clear()
        self._fill_list()
        self.search.setFocus()

    def _fill_list(self) -> None:
        wanted = self.search.text().lower().split()
        paper = QWidget()
        paper.setAutoFillBackground(False)
        columns = row(parent=paper, margins=(0, 0, 0, 0), spacing=28)
        self.rows = []
        for title, lines in self._groups.items():
            found = [
                line for line in lines if all(w in f"{line.text} {' '.join(line.shortcuts)}".lower() for w in wanted)
            ]
            if found:
                columns.addWidget(_group_frame(title, found), 1, Qt.AlignmentFlag.AlignTop)
                self.rows += [(title, line) for line in found]
        if not self.rows:
            columns.addWidget(QLabel("No key of this page does that."), 1, Qt.AlignmentFlag.AlignTop)
        columns.addStretch(max(2 - columns.count(), 0))  # one group alone is no wider than beside another
        self._scroll.setWidget(paper)  # deletes the one before


def _group_frame(title: str, lines: list[ActionInfo]) -> QFrame:
    frame = QFrame()
    set_style_kind(frame, "panel")
    grid = QGridLayout(frame)
    grid.setContentsMargins(16, 10, 16, 12)
    grid.setHorizontalSpacing(14)
    grid.setVerticalSpacing(6)
    grid.setColumnStretch(0, 2)
    grid.setColumnStretch(1, 3)
    grid.addWidget(make_label(title, "running", wrap=False), 0, 0, 1, 2)
    for at, line in enumerate(lines, 1):
        native = (QKeySequence(key).toString(QKeySequence.SequenceFormat.NativeText) for key in line.shortcuts)
        grid.addLayout(row(*(make_label(key, "key", wrap=False) for key in native), STRETCH, spacing=4), at, 0)
        grid.addWidget(make_label(line.text), at, 1)
    return frame
