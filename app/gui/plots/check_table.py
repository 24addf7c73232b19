"""Table of the checks of a verdict: pass or fail, figure, limits and remedy."""

from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QWidget

from app.common import OUTCOME_SYMBOLS, check_row, outcome_severity, sentence_case
from app.gui.face import follow_tokens, tokens
from app.gui.widgets import column, fill_table, make_label, make_read_only_table, set_tone
from protocols.base import Outcome, Verdict

COLUMNS = ("", "check", "figure", "limits", "unit", "remedy")
RIGHT_ALIGNED = ("figure", "limits")


class CheckTable(QWidget):
    """The checks of a run with the remedies of failed ones."""

    def __init__(self) -> None:
        super().__init__()
        self._verdict = Verdict()
        self.caption = make_label(kind="caption", name="checks.caption")
        self.table = make_read_only_table(COLUMNS, "checks.table", "checks")
        column(self.caption, (self.table, 1), parent=self, margins=(4, 2, 4, 0), spacing=4)
        follow_tokens(self, lambda _: self._show_checks())

    def show_verdict(self, verdict: Verdict) -> None:
        if verdict != self._verdict:
            self._verdict = verdict
            self._show_checks()

    def _show_checks(self) -> None:
        verdict = self._verdict
        outcome, failed = verdict.outcome, len(verdict.failed_checks)
        count = f"{failed} of {len(verdict.checks)} checks did not pass" if failed else "all checks passed"
        text = count if outcome is Outcome.DID_NOT_PASS else f"{outcome}: {count}"
        self.caption.setText(f"{OUTCOME_SYMBOLS[outcome]} {sentence_case(text)}")
        set_tone(self.caption, outcome_severity(outcome))
        rows = sorted(map(check_row, verdict.checks), key=lambda row: row.passed)  # failed checks come first
        fill_table(
            self.table,
            [("✓ pass" if row.passed else "✕ FAIL", sentence_case(row.name), *map(str, row[2:])) for row in rows],
            lambda at, place: tokens().passed_color(rows[at].passed) if place == 0 or not rows[at].passed else "",
            [COLUMNS.index(name) for name in RIGHT_ALIGNED],
        )
        self.table.resizeRowsToContents()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.table.resizeRowsToContents()
