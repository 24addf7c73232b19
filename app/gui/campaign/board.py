"""A campaign that is open: what comes next above, the list on the left, and beside it the chosen item or the live plots.

The next step of a campaign, large, with why it is next, what it will take, and one key for each answer.

The top of an open campaign: whose it is, how far it is, and the way to another one.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QFrame,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QSplitter,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from app.gui.campaign.details import CampaignSide
from app.gui.campaign.item_list import CampaignList
from app.gui.plots.live_pane import LivePane
from app.gui.widgets.form import mark
from app.gui.widgets.shortcuts import HERE, bind
from app.gui.widgets.theme import Theme
from app.session.state import View
from protocols.measurements.sine_dwell import SineDwell
from protocols.registry import PROTOCOLS

if TYPE_CHECKING:
    from PySide6.QtGui import QShortcut

    from app.campaign.presentation import Step
    from app.campaign.summary import Known, Row, Sheet


WORDS = {
    "accept": "Accept   (Enter)",
    "reject": "Reject   (X)",
    "run": "Run   (F5)",
    "run without hands": "Run what needs no hands   (Ctrl+F5)",
    "halt the queue": "Only this one   (Ctrl+F5)",
}
"""Of the buttons, by what they do (`app.campaign.presentation.Do`)."""


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
        from app.campaign.presentation import progress_words  # HDF5 comes with it; a thread beside has imported it

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


class CampaignBoard(QWidget):
    """Shows; what a person wants is told as signals."""

    wanted = Signal(str, str)
    """What shall be done (a word of `campaign_side.BUTTONS` or `campaign_step.Do`), and with which item ("": none)."""
    moved = Signal(str, str)

    def __init__(self, live: LivePane, theme: Theme) -> None:
        super().__init__()
        self.sheet: Sheet | None = None
        self.step: Step | None = None
        self._known: Known | None = None
        self._busy = False
        self.head, self.pane = CampaignHead(), StepPane()
        self.list, self.side, self.live = CampaignList(theme), CampaignSide(), live
        self.beside = QStackedWidget()
        self.beside.addWidget(self.side)
        self.beside.addWidget(self.live)
        columns = QSplitter()
        columns.addWidget(self.list)
        columns.addWidget(self.beside)
        columns.setSizes([520, 700])
        columns.setObjectName("campaign/columns")
        self.live.setObjectName("campaign/rows")
        columns.setChildrenCollapsible(False)
        self.list.setMinimumWidth(330)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 4, 0, 0)
        layout.setSpacing(8)
        layout.addWidget(self.head)
        layout.addWidget(self.pane)
        layout.addWidget(columns, 1)
        self.list.moved.connect(self.moved)
        self.list.chosen_changed.connect(self._show_side)
        self.list.entered_key.connect(lambda: self._want("accept"))
        self.side.pressed.connect(self._want)
        self.pane.pressed.connect(self._answer)
        self.keys = self._bind()

    def show_sheet(self, sheet: Sheet, known: Known | None, view: View, running: str, queue: bool) -> None:
        """Show how everything stands."""
        from app.campaign.presentation import step_of  # HDF5 comes with it; by now a thread beside has imported it

        about = self.step.about if self.step is not None else ""
        self.sheet, self._known, self._busy = sheet, known, view.busy
        self.step = step_of(sheet, running, view.busy, queue)
        self.pane.show_step(self.step, "" if view.busy else view.why_not)
        self.list.show_sheet(sheet, running)
        if self.step.about and self.step.about != about:
            self.list.choose(self.step.about)
        row = sheet.row(running)
        self.live.show_view(view, PROTOCOLS.get(row.line.item.protocol, SineDwell) if row is not None else SineDwell)
        self.beside.setCurrentWidget(self.live if view.busy else self.side)
        for key in self.keys:
            key.setEnabled(not view.busy)  # an answer to a prompt may have the same letter
        self._show_side()

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self.list.set_theme(theme)
        self.live.set_theme(theme)

    @property
    def chosen(self) -> Row | None:
        return self.sheet.row(self.list.chosen) if self.sheet is not None else None

    def _show_side(self) -> None:
        if self.sheet is not None:
            self.side.show_row(self.chosen, self._known, self.sheet.specimen, self._busy)

    def _want(self, what: str) -> None:
        self.wanted.emit(what, self.list.chosen)

    def _answer(self, what: str) -> None:
        """A button of the step: what is accepted or rejected is what it asks about, and what runs is what comes next."""
        about = self.step.about if self.step is not None and what in ("accept", "reject") else ""
        self.wanted.emit(what, about)

    def _bind(self) -> list[QShortcut]:
        return [
            key
            for words, what, name in (
                ("Run the chosen measurement", "run", "Shift+F5"),
                ("Leave the chosen measurement out, or take it in again", "skip", "S"),
                ("Measure the chosen one again", "repeat", "M"),
                ("Accept what the chosen one found (also Enter)", "accept", "A"),
                ("Reject what the chosen one found", "reject", "X"),
                ("Open the run of the chosen one", "open", "O"),
            )
            for key in bind(self, words, partial(self._want, what), name, context=HERE)
        ] + [
            key
            for words, by, name in (
                ("Move the chosen one up", -1, "Alt+Up"),
                ("Move the chosen one down", 1, "Alt+Down"),
            )
            for key in bind(self, words, partial(self.list.step, by), name, context=HERE, repeats=True)
        ]
