"""The top of an open campaign: whose it is, how far it is, and the way to another one."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QHBoxLayout, QLabel, QProgressBar, QPushButton, QVBoxLayout, QWidget

from app.gui.form import mark

if TYPE_CHECKING:
    from app.campaign_sheet import Sheet
    from app.view import View


class CampaignHead(QWidget):
    """A line of words, a bar, and below it what could not be done."""

    another_pressed = Signal()
    open_pressed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.name, self.progress, self.said = QLabel(), QLabel(), QLabel()
        mark(self.name, "heading")
        mark(self.said, "fault")
        self.said.setWordWrap(True)
        self.said.hide()
        self.bar = QProgressBar()
        self.bar.setRange(0, 1000)
        self.bar.setTextVisible(False)
        self.bar.setFixedHeight(10)
        another, other = QPushButton("New …   (Ctrl+N)"), QPushButton("Open …   (Ctrl+O)")
        row = QHBoxLayout()
        row.setSpacing(12)
        row.addWidget(self.name)
        row.addWidget(self.progress)
        row.addWidget(self.bar, 1)
        for button, signal in ((another, self.another_pressed), (other, self.open_pressed)):
            button.setProperty("kind", "choice")
            button.clicked.connect(signal)
            row.addWidget(button)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(4)
        layout.addLayout(row)
        layout.addWidget(self.said)

    def show_progress(self, sheet: Sheet, running: str, view: View, streamed_s: float) -> None:
        """How far campaign and present run are."""
        from app.campaign_step import progress_words  # HDF5 comes with it; a thread beside has imported it

        self.name.setText(f"Campaign of {sheet.specimen}")
        self.name.setToolTip(str(sheet.path))
        progress = view.progress if running and view.busy else None
        left_s = progress.left_at(streamed_s) if progress is not None else 0.0
        self.progress.setText(progress_words(sheet, running, left_s))
        share = progress.fraction_at(streamed_s) if progress is not None else 0.0
        self.bar.setValue(round(1000 * (sheet.done + share) / max(sheet.wanted, 1)))

    def say(self, words: str) -> None:
        """Why something was not done."""
        self.said.setText(words)
        self.said.setVisible(bool(words))
