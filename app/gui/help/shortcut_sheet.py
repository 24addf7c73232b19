"""The sheet of keys over the pages: what every key does, in groups, with a search."""

from collections.abc import Mapping

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeySequence
from PySide6.QtWidgets import (
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QScrollArea,
    QVBoxLayout,
    QWidget,
)

from app.gui.widgets.actions import ActionInfo, shortcut_label
from app.gui.widgets.form import set_style_kind


class ShortcutSheet(QWidget):
    """Filled each time it is opened."""

    closed = Signal()
    welcome_requested = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._groups: Mapping[str, tuple[ActionInfo, ...]] = {}
        self.rows: list[tuple[str, ActionInfo]] = []
        """What is shown, with the title of its group."""
        self.search = QLineEdit()
        self.search.setPlaceholderText("Search: what to do, or a key")
        self.search.setAccessibleName("search the keys")
        self.search.setClearButtonEnabled(True)
        self.search.textChanged.connect(self._fill_list)
        self._scroll = QScrollArea()
        self._scroll.setWidgetResizable(True)
        self._scroll.setFrameShape(QFrame.Shape.NoFrame)
        self._scroll.viewport().setAutoFillBackground(False)
        heading = QLabel("Keys")
        set_style_kind(heading, "heading")
        first, close = QPushButton("First steps …"), QPushButton(shortcut_label("Close", "shortcuts"))
        first.clicked.connect(self.welcome_requested)
        close.clicked.connect(self.closed)
        top = QHBoxLayout()
        top.addWidget(heading)
        top.addWidget(self.search, 1)
        top.addWidget(first)
        top.addWidget(close)
        top.setSpacing(14)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(16, 12, 16, 8)
        layout.setSpacing(10)
        layout.addLayout(top)
        layout.addWidget(self._scroll, 1)

    def show_shortcuts(self, groups: Mapping[str, tuple[ActionInfo, ...]]) -> None:
        """Show these groups."""
        self._groups = groups
        self.search.clear()
        self._fill_list()
        self.search.setFocus()

    def _fill_list(self) -> None:
        wanted = self.search.text().lower().split()
        paper = QWidget()
        paper.setAutoFillBackground(False)
        columns = QHBoxLayout(paper)
        columns.setContentsMargins(0, 0, 0, 0)
        columns.setSpacing(28)
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
    heading = QLabel(title)
    set_style_kind(heading, "running")
    grid.addWidget(heading, 0, 0, 1, 2)
    for at, line in enumerate(lines, 1):
        keys = QHBoxLayout()
        keys.setSpacing(4)
        for key in line.shortcuts:
            cap = QLabel(QKeySequence(key).toString(QKeySequence.SequenceFormat.NativeText))
            set_style_kind(cap, "key")
            keys.addWidget(cap)
        keys.addStretch()
        grid.addLayout(keys, at, 0)
        words = QLabel(line.text)
        words.setWordWrap(True)
        grid.addWidget(words, at, 1)
    return frame
