"""Progress bar of a background operation with a Stop button."""

from collections.abc import Callable

from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import QWidget

from app.common import Progress
from app.gui.widgets.layouts import make_button, make_label, make_progress_bar, row

SHOW_DELAY_MS = 300
"""An operation that ends sooner is not shown: it would only flash."""

PROGRESS_STEPS = 1000


class RowProgress(Progress):
    """Progress of the operation that a row shows; updates too small to be seen are dropped."""

    cancelled = False

    def __init__(self, show_fraction: Callable[[float], object]) -> None:
        self._show_fraction = show_fraction
        self._last = 0.0

    def restart(self) -> None:
        self.cancelled, self._last = False, 0.0

    def cancel(self) -> None:
        """Request that the operation ends."""
        self.cancelled = True

    def update(self, fraction: float, text: str = "") -> None:  # noqa: ARG002 - the row shows its own text
        if not 0 <= fraction - self._last < 1 / PROGRESS_STEPS:
            self._last = fraction
            self._show_fraction(fraction)


class ProgressRow(QWidget):
    """Shows the progress of one operation with a Stop button; hidden while none is running."""

    _fraction_changed = Signal(float)

    def __init__(self) -> None:
        super().__init__()
        self.label = make_label(kind="note", wrap=False, name="progress.label")
        self.bar = make_progress_bar(PROGRESS_STEPS, 10, "progress.bar")
        self.cancel_button = make_button(
            "Stop",
            self.request_cancel,
            "choice",
            "Cancel it; completed files stay, and none is left incomplete",
            "progress.cancel",
        )
        self.running = False
        self.progress = RowProgress(self._fraction_changed.emit)
        self._show_timer = QTimer(self, singleShot=True, interval=SHOW_DELAY_MS)
        self._show_timer.timeout.connect(self.show)
        self._fraction_changed.connect(self._show_fraction)
        row(self.label, (self.bar, 1), self.cancel_button, parent=self, spacing=8)
        self.hide()

    def start(self, text: str) -> None:
        """Show that an operation begins."""
        self.running = True
        self.progress.restart()
        self.label.setText(text)
        self.bar.setValue(0)
        self.cancel_button.setEnabled(True)
        self._show_timer.start()

    def finish(self) -> None:
        """Hide the row after the operation has ended or was cancelled."""
        self.running = False
        self._show_timer.stop()
        self.hide()

    def request_cancel(self) -> None:
        self.progress.cancel()
        self.cancel_button.setEnabled(False)

    def _show_fraction(self, fraction: float) -> None:
        self.bar.setValue(round(PROGRESS_STEPS * fraction))
