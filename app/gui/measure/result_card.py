"""Result card of the last run: verdict, identified quantities, file, and what can be done next."""

from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame

from app.common import OUTCOME_SYMBOLS, format_quantity, outcome_severity
from app.gui.widgets import SELECTABLE, STRETCH, Theme, column, configure, make_button, make_label, row, tooltip
from app.session import WindowState
from protocols.base import RunEnded, RunStatus

MAX_LARGE = 3
"""Quantities in large type; the others follow in small type."""

MAX_REASON_LENGTH = 200


class ResultCard(QFrame):
    """Stays from the end of a run to the start of the next."""

    open_requested = Signal(object)
    explore_requested = Signal(object)
    continue_requested = Signal()
    again_requested = Signal()

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        configure(self, "result", kind="panel")
        self._theme = theme
        self._outcome: RunEnded | None = None
        self.verdict_label = make_label(kind="running", name="result.verdict")
        self.reason_label = make_label(kind="small", name="result.reason", textInteractionFlags=SELECTABLE)
        self.value_labels = [
            (make_label(kind="note", name=f"result.name-{at}"), make_label(kind="value", name=f"result.value-{at}"))
            for at in range(MAX_LARGE)
        ]
        self.more_label = make_label(kind="small", name="result.more", textInteractionFlags=SELECTABLE)
        self.note_label = make_label(
            "± one standard error of this run's noise; calibration and geometry come with identify", "note"
        )
        self.file_label = make_label(kind="small", name="result.file", textInteractionFlags=SELECTABLE)
        self.open_button = make_button(
            "Open",
            lambda: self.open_requested.emit(self._path()),
            "choice",
            "Show the run on the page Runs",
            "result.open",
        )
        self.explore_button = make_button(
            "Explore",
            lambda: self.explore_requested.emit(self._path()),
            "choice",
            "Lay the run over the model on the page Explore",
            "result.explore",
        )
        self.again_button = make_button(
            "Again", self.again_requested.emit, "choice", tooltip("run", "Measure what the form shows"), "result.again"
        )
        self.continue_button = make_button(
            "Continue",
            self.continue_requested.emit,
            "choice",
            "Measure what is missing, into a file beside this one",
            "result.continue",
        )
        self.simulated_label = make_label("SIMULATED", "simulated-mark", wrap=False, name="result.simulated")
        values = (label for pair in self.value_labels for label in pair)
        column(
            row((self.verdict_label, 1), self.simulated_label),
            self.reason_label,
            *values,
            self.more_label,
            self.note_label,
            self.file_label,
            row(self.open_button, self.again_button, self.explore_button, self.continue_button, STRETCH, spacing=6),
            parent=self,
            margins=(10, 8, 10, 8),
            spacing=2,
        )
        self.hide()

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        if self._outcome is not None:
            self._show_verdict(self._outcome)

    def set_state(self, view: WindowState) -> None:
        """Show the outcome of the last run; hidden during a run and before the first."""
        for button in (self.continue_button, self.again_button):
            button.setEnabled(view.can_run)
        if view.outcome is not self._outcome:
            self._outcome = view.outcome
            if view.outcome is not None:
                self._show_outcome(view.outcome, view.points != ())
        self.simulated_label.setVisible(view.simulated)
        self.setVisible(self._outcome is not None and not view.busy)

    def _show_outcome(self, outcome: RunEnded, measured: bool) -> None:
        self._show_verdict(outcome)
        reasons = outcome.verdict.describe(outcome.reason)
        shown = reasons if len(reasons) <= MAX_REASON_LENGTH else f"{reasons[:MAX_REASON_LENGTH].rsplit(' ', 1)[0]} …"
        self.reason_label.setText(f"{shown[:1].upper()}{shown[1:]}")
        self.reason_label.setToolTip(reasons if shown is not reasons else "")
        lines = [(e.name, format_quantity(e.value, e.standard_error, e.unit)) for e in outcome.estimates]
        for at, (name, value) in enumerate(self.value_labels):
            for label, text in zip((name, value), lines[at] if at < len(lines) else ("", ""), strict=True):
                label.setText(text)
                label.setVisible(bool(text))
        self.more_label.setText("\n".join(f"{name}  {value}" for name, value in lines[MAX_LARGE:]))
        self.more_label.setVisible(len(lines) > MAX_LARGE)
        self.note_label.setVisible(bool(lines))
        self.file_label.setText(Path(outcome.path).name)
        self.file_label.setToolTip(outcome.path)
        self.file_label.setVisible(bool(outcome.path))
        for button in (self.open_button, self.explore_button):
            button.setVisible(bool(outcome.path) and measured)
        unfinished = outcome.status in (RunStatus.STOPPED, RunStatus.FAILED)
        self.continue_button.setVisible(bool(outcome.path) and measured and unfinished)

    def _show_verdict(self, outcome: RunEnded) -> None:
        verdict = outcome.verdict.outcome
        self.verdict_label.setText(f"{OUTCOME_SYMBOLS[verdict]} {verdict.upper()}")
        self.verdict_label.setStyleSheet(f"color: {self._theme.severity_color(outcome_severity(verdict))}")

    def _path(self) -> Path:
        return Path("" if self._outcome is None else self._outcome.path)
