"""Beside the list: the points of what is chosen, what was found, tags and a note, and what can be done with it."""

from collections.abc import Sequence

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtGui import QFocusEvent
from PySide6.QtWidgets import (
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPlainTextEdit,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from app.archive.export import FORMATS
from app.archive.replay import Measured
from app.archive.run_summary import Entry
from app.gui.runs.compare_plot import ComparePlot
from app.gui.widgets.form import mark
from app.gui.widgets.progress_row import GoingOn
from app.gui.widgets.theme import Theme

NOTHING = "No run is listed.\n\nRun files and tables can be dropped here; the folder is the one of the Measure page."
LONGEST = 280
"""Characters of a reason that are shown beside the list."""


class _Note(QPlainTextEdit):
    """Is kept when it is left."""

    left = Signal()

    def focusOutEvent(self, event: QFocusEvent) -> None:
        super().focusOutEvent(event)
        self.left.emit()


class RunSide(QWidget):
    """Tells of the chosen runs; what is typed is kept when the field is left."""

    noted = Signal(str, str)
    open_pressed = Signal()
    explore_pressed = Signal()
    export_pressed = Signal(str)

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._before, self._of = ("", ""), ""
        self.heading, self.facts, self.said = QLabel(), QLabel(), QLabel()
        self.heading.setProperty("kind", "caption")
        for label in (self.heading, self.facts, self.said):
            label.setWordWrap(True)
            label.setTextFormat(Qt.TextFormat.PlainText)
        self.facts.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.going = GoingOn()
        self.plot = ComparePlot(theme)
        self.plot.setMinimumHeight(160)
        self.none = QLabel()
        self.none.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.none.setWordWrap(True)
        mark(self.none, "note-size")
        self.tags, self.note = QLineEdit(), _Note()
        self.tags.setPlaceholderText("good, second try   (F2)")
        self.tags.setAccessibleName("tags")
        self.note.setAccessibleName("note")
        self.note.setTabChangesFocus(True)
        self.note.setMaximumHeight(3 * self.note.fontMetrics().lineSpacing() + 14)
        self.tags.editingFinished.connect(self._keep)
        self.note.left.connect(self._keep)
        self.open, self.explore = _button("Open", "Enter"), _button("Explore", "Lay over the model's curve: E")
        self.open.clicked.connect(self.open_pressed)
        self.explore.clicked.connect(self.explore_pressed)
        row = QHBoxLayout()
        row.setSpacing(6)
        row.addWidget(self.open)
        row.addWidget(self.explore)
        row.addStretch()
        row.addWidget(QLabel("Export"))
        self.exports = []
        for kind in FORMATS:
            button = _button(kind.upper(), f"Points, estimates, events and raw samples as {kind.upper()} files")
            button.clicked.connect(lambda _=False, kind=kind: self.export_pressed.emit(kind))
            row.addWidget(button)
            self.exports.append(button)
        fields = QGridLayout()
        fields.addWidget(QLabel("tags"), 0, 0)
        fields.addWidget(self.tags, 0, 1)
        fields.addWidget(QLabel("note"), 1, 0, Qt.AlignmentFlag.AlignTop)
        fields.addWidget(self.note, 1, 1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(8, 0, 0, 0)
        layout.setSpacing(6)
        for widget in (self.heading, self.plot, self.none, self.facts):
            layout.addWidget(widget, 1 if widget in (self.plot, self.none) else 0)
        layout.addLayout(fields)
        layout.addWidget(self.said)
        layout.addWidget(self.going)
        layout.addLayout(row)
        self.said.hide()
        self.plot.hide()  # until something is chosen

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self.plot.set_theme(theme)

    def say(self, words: str, fault: bool = False) -> None:
        """A remark, or what went wrong."""
        self.said.setText(words)
        mark(self.said, "fault" if fault else "note")
        self.said.setVisible(bool(words))

    def show_entries(self, chosen: Sequence[Entry]) -> None:
        """Tell of these; the plot follows when the files are read."""
        one = chosen[0] if len(chosen) == 1 else None
        readable = any(e.readable for e in chosen)
        for widget in (self.open, self.explore, *self.exports):
            widget.setEnabled(readable)
        self.tags.setEnabled(bool(chosen))
        self.note.setEnabled(one is not None)
        if one is not None:
            self.heading.setText(f"{one.specimen or one.name}   {one.protocol}   {one.state}")
            lines = [_short(one.reason), *one.found.split("; "), one.path]
            self.facts.setText("\n".join(line for line in lines if line))
        else:
            self.heading.setText(f"{len(chosen)} runs chosen" if chosen else "Nothing is chosen")
            found = [f"{e.specimen}: {e.found}" for e in chosen if e.found]
            more = f"\n… and {len(found) - 6} more" if len(found) > 6 else ""
            self.facts.setText("\n".join(found[:6]) + more)
        texts, of = ((one.tags, one.note), one.path) if one is not None else (("", ""), "")
        # A list that was read before the last words were kept, or before those that are being typed, takes none away.
        if of != self._of or not (self.tags.hasFocus() or self.note.hasFocus()):
            self._before, self._of = texts, of
            with QSignalBlocker(self.tags):
                self.tags.setText(texts[0])
            self.note.setPlainText(texts[1])
        if not chosen:
            self.show_runs((), 0)

    def show_runs(self, runs: Sequence[Measured], of: int) -> None:
        """The points of what is chosen."""
        self.plot.show_runs(runs, f"{len(runs)} of {of} are shown" if 0 < len(runs) < of else "")
        self.plot.setVisible(bool(runs))
        self.none.setVisible(not runs)
        self.none.setText("No response over frequency.\nEnter opens what was measured." if of else NOTHING)

    def _keep(self) -> None:
        texts = (self.tags.text().strip(), self.note.toPlainText().strip())
        if texts != self._before:
            self._before = texts
            self.noted.emit(*texts)


def _short(reason: str) -> str:
    """As much of why a run ended as there is room for; it says all of it when it is opened."""
    return reason if len(reason) <= LONGEST else f"{reason[:LONGEST].rsplit(' ', 1)[0]} … (Enter opens all of it)"


def _button(text: str, tip: str) -> QPushButton:
    button = QPushButton(text)
    button.setToolTip(tip)
    button.setProperty("kind", "choice")
    return button
