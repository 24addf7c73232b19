"""Details of the selected campaign item, its actions, and the specimen's estimates."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QLabel, QPushButton, QScrollArea, QWidget

from app.gui.widgets.actions import name_button
from app.gui.widgets.layouts import STRETCH, Item, column, make_button, make_label, row

if TYPE_CHECKING:
    from app.campaign import CampaignEstimates, ItemSummary

BUTTONS = {"run": "Run this", "skip": "Skip", "repeat": "Repeat", "reject": "Reject", "open": "Open"}
"""Text of the button of each action on an item (`campaign.item.…` in the registry of actions)."""


class ItemDetailsPane(QWidget):
    """Shows one item."""

    pressed = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self.heading_label = make_label(kind="running", wrap=False)
        self.buttons: dict[str, QPushButton] = {}
        for what, text in BUTTONS.items():
            self.buttons[what] = button = make_button(text, partial(self.pressed.emit, what), "choice")
            name_button(button, f"campaign.item.{what}", text)
        self.details_area = QScrollArea()
        self.details_area.setWidgetResizable(True)
        self.details_area.setFrameShape(QFrame.Shape.NoFrame)
        self.details_area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.details_area.viewport().setAutoFillBackground(False)
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
        for what, button in self.buttons.items():
            button.setEnabled(what in allowed and (not busy or what == "open"))
        if item is not None:
            skipped = item.state.status == "skipped"
            name_button(self.buttons["skip"], "campaign.item.skip", "Take in" if skipped else BUTTONS["skip"])
            self._show_details(item, estimates, specimen)

    @property
    def plain_text(self) -> str:
        """The displayed details as text."""
        paper = self.details_area.widget()
        return "\n".join(label.text() for label in paper.findChildren(QLabel)) if paper is not None else ""

    def _show_details(self, item: ItemSummary, estimates: CampaignEstimates | None, specimen: str) -> None:
        from app.campaign import item_details  # imports HDF5, which a background thread has loaded by now

        paper = QWidget()
        paper.setAutoFillBackground(False)
        sections: list[Item] = []
        for section in item_details(item, estimates, specimen):
            lines = make_label("\n".join(section.lines))
            lines.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
            sections += [make_label(section.heading, "caption", wrap=False), lines, 8]
        column(*sections, STRETCH, parent=paper, margins=(0, 0, 8, 0), spacing=2)
        self.details_area.setWidget(paper)  # deletes the one before


def _allowed_actions(item: ItemSummary) -> set[str]:
    """Return the actions that an item allows."""
    line = item.state
    allowed = {"skip"} if line.status != "running" else set()
    if line.next_action not in ("", "wait"):
        allowed.add("run")
    if line.run is not None:
        allowed |= {"repeat", "reject", "open"}
    return allowed
