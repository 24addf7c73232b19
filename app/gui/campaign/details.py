"""Beside the list: everything about the chosen item, what can be done with it, and what is known of the specimen."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QScrollArea, QVBoxLayout, QWidget

from app.gui.widgets.form import mark

if TYPE_CHECKING:
    from app.campaign.summary import Known, Row

BUTTONS = {
    "run": ("Run this   (Shift+F5)", "Measure this item now"),
    "skip": ("Skip   (S)", "Leave it out, or take it in again"),
    "repeat": ("Repeat   (M)", "Measure it again: its runs until now do not count"),
    "reject": ("Reject   (X)", "The run that counts now shall not count"),
    "open": ("Open   (O)", "The run on the Runs page, as it was"),
}
"""What can be done with an item: words with the key, and what it means."""


class CampaignSide(QWidget):
    """Shows one item."""

    pressed = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self.heading = QLabel()
        mark(self.heading, "running")
        self.buttons = {}
        row = QHBoxLayout()
        row.setSpacing(4)
        for what, (words, tip) in BUTTONS.items():
            button = QPushButton(words)
            button.setToolTip(tip)
            button.setProperty("kind", "choice")
            button.clicked.connect(lambda _=False, what=what: self.pressed.emit(what))
            row.addWidget(button)
            self.buttons[what] = button
        row.addStretch()
        self.text = QScrollArea()
        self.text.setWidgetResizable(True)
        self.text.setFrameShape(QFrame.Shape.NoFrame)
        self.text.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.text.viewport().setAutoFillBackground(False)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(10, 4, 0, 0)
        layout.setSpacing(6)
        layout.addWidget(self.heading)
        layout.addLayout(row)
        layout.addWidget(self.text, 1)
        self._shown: object = None

    def show_row(self, row: Row | None, known: Known | None, specimen: str, busy: bool) -> None:
        """Show an item, and allow what can be done with it."""
        if (row, known, specimen, busy) == self._shown:
            return
        self._shown = (row, known, specimen, busy)
        self.heading.setText(f"{row.name}: {row.line.title}" if row is not None else "")
        allowed = _allowed(row) if row is not None else set()
        for what, button in self.buttons.items():
            button.setEnabled(what in allowed and (not busy or what == "open"))
        if row is not None:
            skipped = row.line.standing == "skipped"
            self.buttons["skip"].setText("Take in   (S)" if skipped else BUTTONS["skip"][0])
            self._tell(row, known, specimen)

    @property
    def words(self) -> str:
        """All that is shown, as text."""
        paper = self.text.widget()
        return "\n".join(label.text() for label in paper.findChildren(QLabel)) if paper is not None else ""

    def _tell(self, row: Row, known: Known | None, specimen: str) -> None:
        from app.campaign.presentation import details_of  # HDF5 comes with it; by now a thread beside has imported it

        paper = QWidget()
        paper.setAutoFillBackground(False)
        column = QVBoxLayout(paper)
        column.setContentsMargins(0, 0, 8, 0)
        column.setSpacing(2)
        for section in details_of(row, known, specimen):
            heading = QLabel(section.heading)
            mark(heading, "caption")
            lines = QLabel("\n".join(section.lines))
            lines.setTextFormat(Qt.TextFormat.PlainText)
            lines.setWordWrap(True)
            lines.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
            column.addWidget(heading)
            column.addWidget(lines)
            column.addSpacing(8)
        column.addStretch()
        self.text.setWidget(paper)  # deletes the one before


def _allowed(row: Row) -> set[str]:
    """What can be done with an item."""
    line = row.line
    allowed = {"skip"} if line.standing != "running" else set()
    if line.next not in ("", "wait"):
        allowed.add("run")
    if line.run is not None:
        allowed |= {"repeat", "reject", "open"}
    return allowed
