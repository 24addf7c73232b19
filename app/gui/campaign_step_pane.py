"""The next step of a campaign, large, with why it is next, what it will take, and one key for each answer."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QVBoxLayout

from app.gui.form import mark

if TYPE_CHECKING:
    from app.campaign_step import Step

WORDS = {
    "accept": "Accept   (Enter)",
    "reject": "Reject   (X)",
    "run": "Run   (F5)",
    "run without hands": "Run what needs no hands   (Ctrl+F5)",
    "halt the queue": "Only this one   (Ctrl+F5)",
}
"""Of the buttons, by what they do (`app.campaign_step.Do`)."""


class StepPane(QFrame):
    """Shows one step."""

    pressed = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        mark(self, "panel")
        self.heading, self.why, self.detail = QLabel(), QLabel(), QLabel()
        mark(self.heading, "step")
        mark(self.why, "step-why")
        mark(self.detail, "step-detail")
        text = QVBoxLayout()
        text.setSpacing(4)
        for label in (self.heading, self.why, self.detail):
            label.setTextFormat(Qt.TextFormat.PlainText)
            label.setWordWrap(True)
            text.addWidget(label)
        text.addStretch()
        self.buttons = {what: QPushButton(words) for what, words in WORDS.items()}
        column = QVBoxLayout()
        column.setSpacing(6)
        for what, button in self.buttons.items():
            button.clicked.connect(lambda _=False, what=what: self.pressed.emit(what))
            button.hide()
            column.addWidget(button)
        column.addStretch()
        layout = QHBoxLayout(self)
        layout.setContentsMargins(16, 10, 12, 10)
        layout.setSpacing(20)
        layout.addLayout(text, 1)
        layout.addLayout(column)

    def show_step(self, step: Step, why_not: str) -> None:
        """Show a step; `why_not` tells why no run may begin now, and is empty where one may."""
        self.heading.setText(step.heading)
        self.why.setText(step.why)
        self.detail.setText(step.detail)
        for label in (self.why, self.detail):
            label.setVisible(bool(label.text()))
        for what, button in self.buttons.items():
            button.setVisible(what in step.does)
            first = bool(step.does) and what == step.does[0]
            mark(button, "go" if first else "")
            runs = what.startswith("run")
            if what == "run":
                button.setText(WORDS[what] if first else "Run the next   (F5)")
            button.setEnabled(not (runs and why_not))
            button.setToolTip(f"Cannot run: {why_not}" if runs and why_not else "")
