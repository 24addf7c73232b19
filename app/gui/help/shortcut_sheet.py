"""Shortcut sheet over the pages: every keyboard shortcut by group, with a search."""

from collections.abc import Mapping

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeySequence
from PySide6.QtWidgets import QFrame, QLabel, QLineEdit, QWidget

from app.gui.widgets import (
    STRETCH,
    ActionInfo,
    column,
    configure,
    grid,
    make_button,
    make_label,
    make_scroll_area,
    row,
    shortcut_label,
)


class ShortcutSheet(QWidget):
    """Lists the shortcuts by group; filled whenever it is opened."""

    closed = Signal()
    welcome_requested = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._groups: Mapping[str, tuple[ActionInfo, ...]] = {}
        self.rows: list[tuple[str, ActionInfo]] = []
        """The displayed actions with the title of their group."""
        self.search = configure(
            QLineEdit(),
            "shortcuts.search",
            placeholderText="Search: what to do, or a key",
            accessibleName="search the keys",
            clearButtonEnabled=True,
        )
        self.search.textChanged.connect(self._fill_list)
        self._scroll = make_scroll_area()
        first = make_button("First steps …", self.welcome_requested.emit, name="shortcuts.first-steps")
        close = make_button(shortcut_label("Close", "shortcuts"), self.closed.emit, name="shortcuts.close")
        top = row(make_label("Keys", "heading", wrap=False), (self.search, 1), first, close, spacing=14)
        column(top, (self._scroll, 1), parent=self, margins=(16, 12, 16, 8), spacing=10)

    def show_shortcuts(self, groups: Mapping[str, tuple[ActionInfo, ...]]) -> None:
        """Show groups of actions and clear the search."""
        self._groups = groups
        self.search.clear()
        self._fill_list()
        self.search.setFocus()

    def _fill_list(self) -> None:
        words = self.search.text().lower().split()
        found = {
            title: [
                info for info in group if all(w in f"{info.text} {' '.join(info.shortcuts)}".lower() for w in words)
            ]
            for title, group in self._groups.items()
        }
        self.rows = [(title, info) for title, group in found.items() for info in group]
        frames = [_group_frame(title, group) for title, group in found.items() if group]
        content = QWidget(autoFillBackground=False)
        columns = row(
            *((frame, 1, Qt.AlignmentFlag.AlignTop) for frame in frames or [QLabel("No key of this page does that.")]),
            parent=content,
            margins=(0, 0, 0, 0),
            spacing=28,
        )
        columns.addStretch(max(2 - columns.count(), 0))  # one group alone is as wide as one of two
        self._scroll.setWidget(content)  # deletes the previous content


def _group_frame(title: str, lines: list[ActionInfo]) -> QFrame:
    frame = configure(QFrame(), kind="panel")
    layout = grid(
        (make_label(title, "running", wrap=False), 0, 0, 1, 2),
        parent=frame,
        margins=(16, 10, 16, 12),
        spacing=(14, 6),
        stretch={0: 2, 1: 3},
    )
    for at, line in enumerate(lines, 1):
        native = (QKeySequence(key).toString(QKeySequence.SequenceFormat.NativeText) for key in line.shortcuts)
        layout.addLayout(row(*(make_label(key, "key", wrap=False) for key in native), STRETCH, spacing=4), at, 0)
        layout.addWidget(make_label(line.text), at, 1)
    return frame
