"""Wiring check in the Bench page: starts it and shows its table of pass or fail with remedies."""

from collections.abc import Callable

from PySide6.QtWidgets import QWidget

from app.gui.plots import CheckTable
from app.gui.widgets import column, make_button, make_label, make_panel, row
from app.session import WindowState
from protocols import WIRING_CHECK

ABOUT_TEXT = (
    "Rest, a tenth of a volt to either side and a small sine, with the prompts for high voltage: polarity, gain, latency, noise and the "
    "drive read back. Disconnect the specimen for the first time."
)


class WiringPanel(QWidget):
    """Starts the wiring check and shows its last verdict."""

    def __init__(self, start: Callable[[], object]) -> None:
        super().__init__()
        self.start_button = make_button("Check wiring", start, "go", name="bench.check")
        self.status_label = make_label(kind="large", name="bench.check.status")
        self.table = CheckTable()
        self.table.setMinimumHeight(330)
        self.table.setObjectName("bench.check.table")
        self.table.hide()
        panel = make_panel(
            make_label("Check the wiring", "heading", wrap=False),
            make_label(ABOUT_TEXT),
            row(self.start_button, (self.status_label, 1)),
            self.table,
        )
        column(panel, parent=self)

    def set_state(self, view: WindowState, enabled: bool) -> None:
        """Show the state of the check, if it is or was the last run."""
        self.start_button.setEnabled(enabled)
        if view.protocol != WIRING_CHECK:
            return
        if view.busy:
            self.status_label.setText("running; the prompts and Stop are above")
        elif view.outcome is not None:
            verdict = view.outcome.verdict
            self.status_label.setText("" if verdict.checks else f"There is no table: {view.outcome.reason}")
            self.table.setVisible(bool(verdict.checks))
            if verdict.checks:
                self.table.show_verdict(verdict)
