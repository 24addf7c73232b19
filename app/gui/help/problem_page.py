"""Problem report page (Ctrl+F1): lists the contents of a report, and saves it as one file."""

from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QPlainTextEdit, QWidget

from app.archive import CONTENTS, NOT_IN, ProblemFacts, write_problem_report
from app.common import RecentErrors
from app.gui.widgets import (
    ACTIONS,
    BackgroundWorker,
    Mode,
    StatusLine,
    choose_file,
    column,
    configure,
    make_button,
    make_label,
    make_panel,
    row,
)


class ProblemPage(QWidget):
    """Saves a problem report.

    Args:
        facts: function that returns the facts of the window, and the recent errors.
    """

    title = "Problem report"
    closed = Signal()

    def __init__(self, facts: Callable[[], tuple[ProblemFacts, RecentErrors]]) -> None:
        super().__init__()
        self._facts = facts
        self._worker = BackgroundWorker("problem report", self)
        self.comment_edit = configure(
            QPlainTextEdit(),
            "problem.comment",
            placeholderText="What did you do, what happened, and what did you expect?",
            accessibleName="description of the problem",
            tabChangesFocus=True,
        )
        self.comment_edit.setFixedHeight(5 * self.fontMetrics().lineSpacing())
        self.message_label = configure(StatusLine(), "problem.message")
        self.save_button = make_button("Save …", self._choose_file, "go", name="problem.save")
        close = make_button("Close", self.closed.emit, name="problem.close", key=ACTIONS["problem"].shortcut)
        text = "\n".join(f"•  {part}" for part in CONTENTS)
        panel = make_panel(
            make_label(
                "The report is one zip file of texts, which you can read before you give it to anybody. It has:"
            ),
            make_label(text, name="problem.contents"),
            make_label(NOT_IN, name="problem.left-out"),
            margins=(14, 10, 14, 10),
        )
        column(
            row((make_label("Problem report", "heading", wrap=False), 1), close, spacing=14),
            panel,
            self.comment_edit,
            row(self.save_button, (self.message_label, 1), spacing=12),
            None,
            parent=self,
            margins=(16, 12, 16, 8),
            spacing=10,
        )

    def activate(self) -> None:
        self.comment_edit.setFocus()

    def save(self, path: Path) -> None:
        """Write the report in the background."""
        facts, recent = self._facts()
        facts = replace(facts, comment=self.comment_edit.toPlainText())
        self._worker.submit(
            lambda: write_problem_report(path, facts, recent),
            lambda _: self.message_label.show_message(f"Saved: {path}", persistent=True),
            lambda error: self.message_label.show_message(f"{path} cannot be written: {error}", is_error=True),
        )

    def _choose_file(self) -> None:
        name = f"problem_report_{datetime.now().astimezone():%Y%m%dT%H%M%S}.zip"
        choose_file(
            self, "Save the problem report", self.save, "Zip files (*.zip)", str(Path.home() / name), Mode.AnyFile
        )
