"""Settings page: the settings of the window with a search."""

from collections.abc import Sequence
from dataclasses import dataclass

from PySide6.QtWidgets import QWidget

from app.gui.help.cover import SearchCover
from app.gui.widgets import STRETCH, column, make_label, make_panel, make_scroll_area, row

EDITOR_WIDTH = 320


@dataclass(frozen=True, slots=True)
class Setting:
    """One setting: name, editor, and description."""

    name: str
    editor: QWidget
    description: str


class SettingsPage(SearchCover):
    """Settings that apply immediately; the search hides settings without a match."""

    def __init__(self, settings: Sequence[Setting]) -> None:
        super().__init__("settings", "Settings", "Search", "search the settings")
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
            self._frames.append((f"{setting.name} {setting.description}", frame))
        frames = (frame for _, frame in self._frames)
        area = make_scroll_area(*frames, STRETCH, margins=(0, 0, 8, 0), spacing=8, accessibleName="settings")
        self._lay_out(area)

    def _fill(self) -> None:
        for text, frame in self._frames:
            frame.setVisible(self._matches(text))
