"""Details of the selected campaign item, its actions, and the specimen's estimates."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QLabel, QWidget

from app.gui.widgets import (
    SELECTABLE,
    STRETCH,
    Item,
    column,
    make_button,
    make_label,
    make_scroll_area,
    name_button,
    row,
)

if TYPE_CHECKING:
    from app.campaign import CampaignEstimates, ItemSummary

BUTTONS = {"run": "Run this", "skip": "Skip", "repeat": "Repeat", "reject": "Reject", "open": "Open"}
"""Text of the button of each action on an item (`campaign.item.…` in the registry of actions)."""


class ItemDetailsPane(QWidget):
    """Shows one item."""

    pressed = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self.heading_label = make_label(kind="running", wrap=False, name="campaign.item")
        self.buttons = {
            action: make_button(text, partial(self.pressed.emit, action), "choice", name=f"campaign.item.{action}")
            for action, text in BUTTONS.items()
        }
        for action, button in self.buttons.items():
            name_button(button, f"campaign.item.{action}", BUTTONS[action])
        self.details_area = make_scroll_area(horizontalScrollBarPolicy=Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        buttons = row(*self.buttons.values(), STRETCH, spacing=4)
        column(self.heading_label, buttons, (self.details_area, 1), parent=self, margins=(10, 4, 0, 0), spacing=6)
        self._shown_state: object = None

    def show_item(
        self, item: ItemSummary | None, estimates: CampaignEstimates | None, specimen: str, busy: bool
    ) -> None:
        """Show an item and enable its actions."""
        if (item, estimates, specimen, busy) == self._shown_state:
            return
        self._shown_state = (item, estimates, specimen, busy)
        self.heading_label.setText(f"{item.name}: {item.state.title}" if item is not None else "")
        allowed = _allowed_actions(item) if item is not None else set()
        for action, button in self.buttons.items():
            button.setEnabled(action in allowed and (not busy or action == "open"))
        if item is not None:
            skipped = item.state.status == "skipped"
            name_button(self.buttons["skip"], "campaign.item.skip", "Take in" if skipped else BUTTONS["skip"])
            self._show_details(item, estimates, specimen)

    @property
    def plain_text(self) -> str:
        """The displayed details as text."""
        return "\n".join(label.text() for label in self.details_area.viewport().findChildren(QLabel))

    def _show_details(self, item: ItemSummary, estimates: CampaignEstimates | None, specimen: str) -> None:
        from app.campaign import item_details  # imports HDF5, which a background thread has loaded by now

        content, sections = QWidget(autoFillBackground=False), list[Item]()
        for section in item_details(item, estimates, specimen):
            lines = make_label("\n".join(section.lines), textInteractionFlags=SELECTABLE)
            sections += [make_label(section.heading, "caption", wrap=False), lines, 8]
        column(*sections, STRETCH, parent=content, margins=(0, 0, 8, 0), spacing=2)
        self.details_area.setWidget(content)  # deletes the previous content


def _allowed_actions(item: ItemSummary) -> set[str]:
    """Return the actions that an item allows."""
    state = item.state
    allowed = {"skip"} if state.status != "running" else set()
    if state.next_action not in ("", "wait"):
        allowed.add("run")
    return allowed | {"repeat", "reject", "open"} if state.run is not None else allowed
