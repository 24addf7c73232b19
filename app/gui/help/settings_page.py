"""Settings page: the settings of the window with a search."""

from collections.abc import Sequence
from dataclasses import dataclass

from PySide6.QtWidgets import QWidget

from app.gui.help.cover import SearchOverlay
from app.gui.widgets import make_label, make_panel, make_scroll_area


@dataclass(frozen=True, slots=True)
class Setting:
    """One setting: name, editor, and description."""

    name: str
    editor: QWidget
    description: str


class SettingsPage(SearchOverlay):
    """Settings that apply immediately; the search hides settings without a match."""

    def __init__(self, settings: Sequence[Setting]) -> None:
        super().__init__("settings", "Settings", "Search", "search the settings")
        self._frames = []
        for setting in settings:
            setting.editor.setAccessibleName(setting.name)
            name, about = make_label(setting.name, "caption"), make_label(setting.description, "note-size")
            frame = make_panel(name, setting.editor, about, margins=(12, 8, 12, 8), spacing=4)
            self._frames.append((f"{setting.name} {setting.description}", frame))
        frames = (frame for _, frame in self._frames)
        area = make_scroll_area(*frames, None, margins=(0, 0, 8, 0), spacing=8, accessibleName="settings")
        self._lay_out(area)

    def _fill(self) -> None:
        for text, frame in self._frames:
            frame.setVisible(self._matches(text))
