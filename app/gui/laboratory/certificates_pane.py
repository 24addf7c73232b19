"""Pane of calibration certificates: instruments by due date; certificates that expired or expire soon are marked."""

from collections.abc import Sequence
from datetime import date

from PySide6.QtWidgets import QWidget

from app.common import Column, Severity, Table, pluralize
from app.config import WARNING_DAYS, Certificate
from app.gui.laboratory.value_table import ValueTable
from app.gui.widgets import WindowTheme, column, make_label, set_style_kind

SEVERITIES = {"expired": Severity.ERROR, "due soon": Severity.WARNING}
SYMBOLS = {"expired": "✕ ", "due soon": "! ", "valid": "✓ "}
NOTE = (
    f"Every run warns from {WARNING_DAYS} days before the due date of an instrument that it uses, and flags every point after it. "
    "Add certificates with: tactor-bench certificate add"
)


class CertificatesPane(QWidget):
    """The certificates beside the runs, by due date."""

    def __init__(self, theme: WindowTheme) -> None:
        super().__init__()
        self.state_label = make_label(kind="caption", name="laboratory.certificates.state")
        self.table = ValueTable(theme, "laboratory.certificates", "calibration certificates")
        column(
            self.state_label,
            (self.table, 1),
            make_label(NOTE, "note"),
            parent=self,
            spacing=4,
        )

    def show_certificates(self, found: Sequence[Certificate], problems: Sequence[str], today: date) -> str:
        """Show certificates; return the numbers of expired and soon due ones as text, empty for none."""
        states = [each.state(today) for each in found]
        words = [f"{states.count(state)} {state}" for state in ("expired", "due soon") if state in states]
        text = ", ".join(words) if words else ("" if found else "There are no certificates beside the runs.")
        if found and not words:
            text = f"{pluralize(len(found), 'certificate')}: none is due within {WARNING_DAYS} days."
        self.state_label.setText("\n".join([text, *problems]) if problems else text)
        kind = "danger" if "expired" in states or problems else "caution" if "due soon" in states else "caption"
        set_style_kind(self.state_label, kind)
        self.table.set_table(
            Table(
                "certificates",
                "Calibration certificates",
                (
                    Column("due", None, [each.due or "not stated" for each in found]),
                    Column("state", None, [f"{SYMBOLS.get(s, '')}{s}" for s in states]),
                    Column("days left", None, [_days_left(each, today) for each in found]),
                    Column("instrument", None, [each.name for each in found]),
                    Column("certificate", None, [each.number for each in found]),
                    Column("calibrated", None, [each.date for each in found]),
                    Column("laboratory", None, [each.laboratory for each in found]),
                ),
            ),
            [SEVERITIES.get(state, Severity.INFO) for state in states],
        )
        return ", ".join(words)


def _days_left(certificate: Certificate, today: date) -> str:
    left = certificate.days_left(today)
    return "" if left is None else str(left)
