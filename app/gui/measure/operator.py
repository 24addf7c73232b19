"""Operator of today on the run panel: read and stored in the background."""

from contextlib import suppress

from PySide6.QtCore import QObject, QTimer

from app.common import UsageError, remember_conditions, remembered_conditions
from app.gui.measure.run_panel import RunPanel
from app.gui.widgets import BackgroundWorker
from protocols.base import RunConditions

POLL_MS = 30_000
"""Interval at which the operator is read again: another program may set it, and it expires at midnight."""


class OperatorOfToday(QObject):
    """Shows the operator of today and stores another one that is typed."""

    def __init__(self, panel: RunPanel, worker: BackgroundWorker, parent: QObject) -> None:
        super().__init__(parent)
        self._panel, self._worker = panel, worker
        panel.operator_named.connect(self._store)
        timer = QTimer(self, interval=POLL_MS)
        timer.timeout.connect(self.read)
        timer.start()

    def read(self) -> None:
        """Show the stored operator; the file is read in the background."""
        self._worker.submit(remembered_conditions, self._show)

    def _show(self, conditions: RunConditions) -> None:
        self._panel.show_operator(conditions.operator)

    def _store(self, name: str) -> None:
        def store() -> None:
            with suppress(UsageError):  # a name that cannot be stored is not; the login is
                remember_conditions(name)

        self._worker.submit(store)
