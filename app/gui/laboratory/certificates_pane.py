"""Pane of calibration certificates: instruments by due date; certificates that expired or expire soon are marked."""

from collections.abc import Sequence
from datetime import date

from PySide6.QtWidgets import QWidget

from app.common import Severity, Table, pluralize
from app.config import WARNING_DAYS, Certificate
from app.gui.laboratory.value_table import ValueTable
from app.gui.widgets import column, make_label, set_style_kind

SEVERITIES = {"expired": Severity.ERROR, "due soon": Severity.WARNING}
SYMBOLS = {"expired": "✕ ", "due soon": "! ", "valid": "✓ "}
COLUMNS = ("due", "state", "days left", "instrument", "certificate", "calibrated", "laboratory")
NOTE = (
    f"Every run warns from {WARNING_DAYS} days before the due date of an instrument that it uses, and flags every point after it. "
    "Add certificates with: tactor-bench certificate add"
)


class CertificatesPane(QWidget):
    """The certificates beside the runs, by due date."""

    def __init__(self) -> None:
        super().__init__()
        self.state_label = make_label(kind="caption", name="laboratory.certificates.state")
        self.table = ValueTable("laboratory.certificates", "calibration certificates")
        column(self.state_label, (self.table, 1), make_label(NOTE, "note"), parent=self, spacing=4)

    def show_certificates(self, certificates: Sequence[Certificate], problems: Sequence[str], today: date) -> None:
        """Show certificates, and the numbers of expired and soon due ones."""
        states = [each.state(today) for each in certificates]
        self.state_label.setText("\n".join((_summary(states), *problems)))
        kind = "danger" if "expired" in states or problems else "caution" if "due soon" in states else "caption"
        set_style_kind(self.state_label, kind)
        rows = [
            (
                each.due or "not stated",
                f"{SYMBOLS.get(state, '')}{state}",
                "" if (left := each.days_left(today)) is None else str(left),
                each.name,
                each.number,
                each.date,
                each.laboratory,
            )
            for each, state in zip(certificates, states, strict=True)
        ]
        table = Table.of_rows("Calibration certificates", COLUMNS, rows)
        self.table.set_table(table, [SEVERITIES.get(state, Severity.INFO) for state in states])


def _summary(states: Sequence[str]) -> str:
    """Return the numbers of certificates that are expired or due soon as text."""
    if not states:
        return "There are no certificates beside the runs."
    texts = [f"{states.count(state)} {state}" for state in SEVERITIES if state in states]
    return ", ".join(texts) or f"{pluralize(len(states), 'certificate')}: none is due within {WARNING_DAYS} days."
