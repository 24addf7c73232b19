"""Command palette: commands, protocols, runs and settings, searched by text and chosen with Enter."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from PySide6.QtCore import QEvent, QObject, Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QLineEdit, QListWidget, QListWidgetItem, QWidget

from app.gui.widgets import column, configure, make_button, make_label, row, shortcut_label

MAX_SHOWN = 200
ENTRY_ROLE = Qt.ItemDataRole.UserRole


@dataclass(frozen=True, slots=True)
class PaletteEntry:
    """Something that can be chosen."""

    kind: str
    """`command`, `protocol`, `run` or `setting`."""
    text: str
    choose: Callable[[], object]
    hint: str = ""
    """Shortcut, or what distinguishes entries of the same text."""

    def matches(self, words: Sequence[str]) -> bool:
        """Return whether every word occurs in the entry."""
        whole = f"{self.kind} {self.text} {self.hint}".casefold()
        return all(word in whole for word in words)


class CommandPalette(QWidget):
    """Lists what matches the search; up and down select while the keyboard stays in the search."""

    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._entries: tuple[PaletteEntry, ...] = ()
        self.search = configure(
            QLineEdit(),
            "palette.search",
            placeholderText="What to do: words of a command, protocol, run or setting",
            accessibleName="search commands, protocols, runs and settings",
            clearButtonEnabled=True,
        )
        self.list = configure(QListWidget(), "palette.list", accessibleName="found", focusPolicy=Qt.FocusPolicy.NoFocus)
        self.search.textChanged.connect(self._fill_list)
        self.search.returnPressed.connect(self.choose_selected)
        self.search.installEventFilter(self)
        self.list.itemClicked.connect(lambda _: self.choose_selected())
        close = make_button(shortcut_label("Close", "palette"), self.closed.emit, name="palette.close")
        top = row(make_label("Go to", "heading", wrap=False), (self.search, 1), close, spacing=14)
        column(top, (self.list, 1), parent=self, margins=(16, 12, 16, 8), spacing=10)

    def show_entries(self, entries: Sequence[PaletteEntry]) -> None:
        """Show what can be chosen now, and clear the search."""
        self._entries = tuple(entries)
        self.search.clear()
        self._fill_list()
        self.search.setFocus()

    @property
    def shown(self) -> list[PaletteEntry]:
        """The entries that match the search."""
        return [self.list.item(at).data(ENTRY_ROLE) for at in range(self.list.count())]

    def choose_selected(self) -> None:
        """Close the palette and perform the selected entry."""
        item = self.list.currentItem()
        if item is not None:
            self.closed.emit()
            item.data(ENTRY_ROLE).choose()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if watched is self.search and isinstance(event, QKeyEvent) and event.type() == QEvent.Type.KeyPress:
            step = {Qt.Key.Key_Down: 1, Qt.Key.Key_Up: -1, Qt.Key.Key_PageDown: 10, Qt.Key.Key_PageUp: -10}.get(
                Qt.Key(event.key()), 0
            )
            if step:
                self.list.setCurrentRow(min(max(self.list.currentRow() + step, 0), self.list.count() - 1))
                return True
        return super().eventFilter(watched, event)

    def _fill_list(self) -> None:
        words = self.search.text().casefold().split()
        self.list.clear()
        for entry in [entry for entry in self._entries if entry.matches(words)][:MAX_SHOWN]:
            item = QListWidgetItem(f"{entry.text}    {entry.hint}" if entry.hint else entry.text)
            item.setData(ENTRY_ROLE, entry)
            item.setToolTip(entry.kind)
            self.list.addItem(item)
        self.list.setCurrentRow(0)
