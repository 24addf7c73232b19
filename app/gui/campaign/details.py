"""Beside the list: everything about the chosen item, what can be done with it, and what is known of the specimen."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QScrollArea, QVBoxLayout, QWidget

from app.gui.widgets.actions import name_button
from app.gui.widgets.form import set_style_kind

if TYPE_CHECKING:
    from app.campaign.summary import CampaignEstimates, ItemSummary

BUTTONS = {"run": "Run this", "skip": "Skip", "repeat": "Repeat", "reject": "Reject", "open": "Open"}
"""Text of the button of each action on an item (`campaign.item.…` in the registry of actions)."""


class ItemDetailsPane(QWidget):
    """Shows one item."""

    pressed = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self.heading_label = QLabel()
        set_style_kind(self.heading_label, "running")
        self.buttons = {}
        row = QHBoxLayout()
        row.setSpacing(4)
        for what, text in BUTTONS.items():
            button = QPushButton()
            name_button(button, f"campaign.item.{what}", text)
            button.setProperty("kind", "choice")
            button.clicked.connect(lambda _=False, what=what: self.pressed.emit(what))
            row.addWidget(button)
            self.buttons[what] = button
        row.addStretch()
        self.details_area = QScrollArea()
        self.details_area.setWidgetResizable(True)
        self.details_area.setFrameShape(QFrame.Shape.NoFrame)
        self.details_area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.details_area.viewport().setAutoFillBackground(False)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(10, 4, 0, 0)
        layout.setSpacing(6)
        layout.addWidget(self.heading_label)
        layout.addLayout(row)
        layout.addWidget(self.details_area, 1)
        self._shown_state: object = None

    def show_item(
        self, item: ItemSummary | None, estimates: CampaignEstimates | None, specimen: str, busy: bool
    ) -> None:
        """Show an item, and allow what can be done with it."""
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
        """All that is shown, as text."""
        paper = self.details_area.widget()
        return "\n".join(label.text() for label in paper.findChildren(QLabel)) if paper is not None else ""

    def _show_details(self, item: ItemSummary, estimates: CampaignEstimates | None, specimen: str) -> None:
        from app.campaign.presentation import item_details  # HDF5 comes with it; by now a thread beside has imported it

        paper = QWidget()
        paper.setAutoFillBackground(False)
        column = QVBoxLayout(paper)
        column.setContentsMargins(0, 0, 8, 0)
        column.setSpacing(2)
        for section in item_details(item, estimates, specimen):
            heading = QLabel(section.heading)
            set_style_kind(heading, "caption")
            lines = QLabel("\n".join(section.lines))
            lines.setTextFormat(Qt.TextFormat.PlainText)
            lines.setWordWrap(True)
            lines.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
            column.addWidget(heading)
            column.addWidget(lines)
            column.addSpacing(8)
        column.addStretch()
        self.details_area.setWidget(paper)  # deletes the one before


def _allowed_actions(item: ItemSummary) -> set[str]:
    """What can be done with an item."""
    line = item.state
    allowed = {"skip"} if line.status != "running" else set()
    if line.next_action not in ("", "wait"):
        allowed.add("run")
    if line.run is not None:
        allowed |= {"repeat", "reject", "open"}
    return allowed
