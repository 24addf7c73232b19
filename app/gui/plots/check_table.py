"""Table of the checks of a verdict: pass or fail, figure, limits and remedy."""

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QResizeEvent
from PySide6.QtWidgets import QTableWidgetItem, QWidget

from app.common import OUTCOME_SYMBOLS, check_row, outcome_severity
from app.gui.widgets import WindowTheme, column, make_label, make_read_only_table
from protocols.base import Outcome, Verdict

COLUMNS = ("", "what", "figure", "limits", "unit", "what to do")
RIGHT_ALIGNED = ("figure", "limits")


class CheckTable(QWidget):
    """The checks of a run with the remedies of those that did not pass."""

    def __init__(self, theme: WindowTheme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme, self._verdict = theme, Verdict()
        self.caption = make_label(kind="caption", name="checks.caption")
        self.table = make_read_only_table(COLUMNS, "checks.table", "checks")
        column(self.caption, (self.table, 1), parent=self, margins=(4, 2, 4, 0), spacing=4)
        theme.changed.connect(self._show_checks)

    def show_verdict(self, verdict: Verdict) -> None:
        """Show the checks of a verdict."""
        if verdict != self._verdict:
            self._verdict = verdict
            self._show_checks()

    def _show_checks(self) -> None:
        verdict = self._verdict
        outcome, failed = verdict.outcome, len(verdict.failed_checks)
        count = f"{failed} of {len(verdict.checks)} checks did not pass" if failed else "all checks passed"
        head = "" if outcome is Outcome.DID_NOT_PASS else f"{outcome}: "
        text = f"{head}{count}"
        color = self._theme.colors.severity_color(outcome_severity(outcome))
        self.caption.setText(f"{OUTCOME_SYMBOLS[outcome]} {text[:1].upper()}{text[1:]}")
        self.caption.setStyleSheet(f"color: {color}")
        self.table.setRowCount(len(verdict.checks))
        rows = sorted(map(check_row, verdict.checks), key=lambda row: row.passed)  # what to remedy comes first
        for at, row in enumerate(rows):
            mark = "✓ pass" if row.passed else "✕ FAIL"
            for place, text in enumerate((mark, *row[1:])):
                item = QTableWidgetItem(str(text))
                if COLUMNS[place] in RIGHT_ALIGNED:
                    item.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
                if place == 0 or not row.passed:
                    item.setForeground(QColor(self._theme.colors.success if row.passed else self._theme.colors.error))
                self.table.setItem(at, place, item)
        self.table.resizeRowsToContents()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.table.resizeRowsToContents()
