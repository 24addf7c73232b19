"""Wiring check in the Bench page: starts it and shows its table of pass or fail with remedies."""

from collections.abc import Callable

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame

from app.gui.plots import CheckTable
from app.gui.widgets import make_button, make_label, make_panel, row
from app.session import WindowState
from protocols import WIRING_CHECK
from protocols.base import RunEnded

ABOUT_TEXT = (
    "Rest, a tenth of a volt to either side and a small sine, with the prompts for high voltage: polarity, gain, latency, noise and the "
    "drive read back. Disconnect the specimen for the first time."
)


class WiringPanel(QFrame):
    """Starts the wiring check and shows its last verdict."""

    ended = Signal()
    """A check has ended, and its outcome is shown."""

    def __init__(self, start: Callable[[], object]) -> None:
        super().__init__()
        self._outcome: RunEnded | None = None
        """End of the last wiring check; None before the first one and during one."""
        self.start_button = make_button("Check the wiring", start, "go", name="bench.check")
        self.status_label = make_label(kind="large", name="bench.check.status")
        self.table = CheckTable()
        self.table.setMinimumHeight(330)
        self.table.setObjectName("bench.check.table")
        self.table.hide()
        make_panel(
            row(make_label("Wiring check", "heading", wrap=False), (self.status_label, 1), self.start_button),
            make_label(ABOUT_TEXT),
            self.table,
            frame=self,
        )

    def set_state(self, view: WindowState, is_open: bool, enabled: bool) -> None:
        """Show the state of the check; its last outcome belongs to the open bench, and is hidden while another one is shown."""
        if not enabled and self.start_button.hasFocus():
            self.setFocus()  # the next control would take the keyboard, and the page scroll to it
        self.start_button.setEnabled(enabled)
        before = self._outcome
        if view.protocol == WIRING_CHECK and (view.busy or view.outcome is not None):
            self._outcome = None if view.busy else view.outcome
        runs, last = view.busy and view.protocol == WIRING_CHECK, self._outcome
        text = "running; the prompts and Stop are above" if runs else ""
        if last is not None and not last.verdict.checks:
            text = f"There is no table: {last.reason}"
        self.status_label.setText(text if is_open else "")
        self.table.setVisible(is_open and last is not None and bool(last.verdict.checks))
        if last is not None and last.verdict.checks:
            self.table.show_verdict(last.verdict)
        if is_open and last is not None and last is not before:
            self.ended.emit()
