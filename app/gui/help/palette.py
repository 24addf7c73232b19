"""Command palette: commands, protocols, runs and settings, searched by text and chosen with Enter."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QListWidget, QListWidgetItem

from app.gui.face import set_length
from app.gui.help.cover import SearchOverlay
from app.gui.widgets import Place, configure

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
    """Shortcut, or distinction of entries with equal text."""


class CommandPalette(SearchOverlay):
    """Lists the matches of the search; up and down select while the search keeps the keyboard focus."""

    def __init__(self) -> None:
        super().__init__(
            "palette",
            "Go to",
            "Words of a command, protocol, run or setting",
            "search commands, protocols, runs and settings",
            Place.TOP,
        )
        self._entries: tuple[PaletteEntry, ...] = ()
        self.list = configure(QListWidget(), "palette.list", accessibleName="found", focusPolicy=Qt.FocusPolicy.NoFocus)
        set_length(self.list, height=360)
        self.search.returnPressed.connect(self.choose_selected)
        self.search.installEventFilter(self)
        self.list.itemClicked.connect(lambda _: self.choose_selected())
        self._lay_out(self.list)

    def show_entries(self, entries: Sequence[PaletteEntry]) -> None:
        """Show the present choices, and clear the search."""
        self._entries = tuple(entries)
        self.search_for()

    def choose_selected(self) -> None:
        """Close the palette and perform the selected entry."""
        item = self.list.currentItem()
        if item is not None:
            self.leave()
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

    def _fill(self) -> None:
        self.list.clear()
        entries = (entry for entry in self._entries if self._matches(f"{entry.kind} {entry.text} {entry.hint}"))
        for entry in islice(entries, MAX_SHOWN):
            item = QListWidgetItem(f"{entry.text}    {entry.hint}" if entry.hint else entry.text)
            item.setData(ENTRY_ROLE, entry)
            item.setToolTip(entry.kind)
            self.list.addItem(item)
        self.list.setCurrentRow(0)
