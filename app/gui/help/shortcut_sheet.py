"""Help over the pages (F1): safety first, concepts and how-tos, and every keyboard shortcut by group, with a search."""

import tomllib
from collections.abc import Mapping
from importlib.resources import files

from PySide6.QtCore import Signal
from PySide6.QtGui import QKeySequence
from PySide6.QtWidgets import QFrame, QLabel, QWidget

from app.gui.help.cover import SearchOverlay
from app.gui.widgets import (
    ActionInfo,
    column,
    configure,
    grid,
    make_button,
    make_label,
    make_panel,
    make_scroll_area,
    row,
)

CONCEPTS: dict[str, dict[str, str]] = tomllib.loads(files("app.gui.help").joinpath("concepts.toml").read_text("utf-8"))
"""Explanation of each word or question, by group in the order of the help: safety first, words of the window, how-tos."""


class ShortcutSheet(SearchOverlay):
    """Lists the shortcuts by group; filled whenever it is opened."""

    welcome_requested = Signal()

    def __init__(self) -> None:
        super().__init__("shortcuts", "Help", "Search: a word, what to do, or a key", "search the help")
        self._groups: Mapping[str, tuple[ActionInfo, ...]] = {}
        self.rows: list[tuple[str, ActionInfo]] = []
        """The displayed actions with the title of their group."""
        self.concepts: Mapping[str, Mapping[str, str]] = {}
        """The displayed explanations by group and name."""
        self._scroll = make_scroll_area(accessibleName="keys by group")
        self._lay_out(
            self._scroll, make_button("First steps …", self.welcome_requested.emit, name="shortcuts.first-steps")
        )

    def show_shortcuts(self, groups: Mapping[str, tuple[ActionInfo, ...]]) -> None:
        """Show groups of actions and clear the search."""
        self._groups = groups
        self.search_for()

    def _fill(self) -> None:
        sections = {
            title: [info for info in group if self._matches(f"{info.text} {' '.join(info.shortcuts)}")]
            for title, group in self._groups.items()
        }
        self.rows = [(title, info) for title, group in sections.items() for info in group]
        frames = [_group_frame(title, group) for title, group in sections.items() if group]
        self.concepts = {
            title: {name: text for name, text in group.items() if self._matches(f"{title} {name} {text}")}
            for title, group in CONCEPTS.items()
        }
        explained = [_concept_frame(title, group) for title, group in self.concepts.items() if group]
        if not frames and not explained:
            frames = [QLabel("Neither a key nor a word of the help.")]
        content = QWidget(autoFillBackground=False)
        column(*explained, *frames, None, parent=content, margins=(0, 0, 8, 0), spacing=12)
        self._scroll.setWidget(content)  # deletes the previous content


def _concept_frame(title: str, concepts: Mapping[str, str]) -> QFrame:
    lines = (
        label
        for name, text in concepts.items()
        for label in (make_label(name, "caption"), make_label(text, "note-size"))
    )
    return make_panel(make_label(title, "running", wrap=False), *lines, margins=(16, 10, 16, 12), spacing=4)


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
        layout.addLayout(row(*(make_label(key, "key", wrap=False) for key in native), None, spacing=4), at, 0)
        layout.addWidget(make_label(line.text), at, 1)
    return frame
