"""Settings page: the settings of the window with a search."""

from collections.abc import Sequence
from dataclasses import dataclass

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QLineEdit, QWidget

from app.gui.widgets import (
    STRETCH,
    column,
    configure,
    make_button,
    make_label,
    make_panel,
    make_scroll_area,
    row,
    shortcut_label,
)

EDITOR_WIDTH = 320


@dataclass(frozen=True, slots=True)
class Setting:
    """One setting: name, editor, and description."""

    name: str
    editor: QWidget
    description: str


class SettingsPage(QWidget):
    """Settings apply immediately; the search hides those that do not match."""

    closed = Signal()

    def __init__(self, settings: Sequence[Setting]) -> None:
        super().__init__()
        self.search = configure(
            QLineEdit(),
            "settings.search",
            placeholderText="Search",
            accessibleName="search the settings",
            clearButtonEnabled=True,
        )
        self.search.textChanged.connect(self._filter)
        close = make_button(shortcut_label("Close", "settings"), self.closed.emit, name="settings.close")
        self._frames = []
        for setting in settings:
            setting.editor.setAccessibleName(setting.name)
            setting.editor.setFixedWidth(EDITOR_WIDTH)
            name, about = make_label(setting.name, "caption"), make_label(setting.description, "note-size")
            frame = make_panel(
                row((column(STRETCH, name, about, STRETCH, spacing=2), 1), setting.editor),
                margins=(14, 10, 14, 10),
                spacing=4,
            )
            self._frames.append((f"{setting.name} {setting.description}".casefold(), frame))
        frames = (frame for _, frame in self._frames)
        area = make_scroll_area(*frames, STRETCH, margins=(0, 0, 8, 0), spacing=8, accessibleName="settings")
        top = row(make_label("Settings", "heading", wrap=False), (self.search, 1), close, spacing=14)
        column(top, (area, 1), parent=self, margins=(16, 12, 16, 8), spacing=10)

    def show_settings(self, search: str = "") -> None:
        """Show the settings that match a search."""
        self.search.setText(search)
        self._filter()
        self.search.setFocus()

    def _filter(self) -> None:
        words = self.search.text().casefold().split()
        for text, frame in self._frames:
            frame.setVisible(all(word in text for word in words))
