"""Something that takes its time beside the window: what it is, how far, and a button that ends it."""

import threading

from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import QProgressBar, QWidget

from app.gui.widgets.layouts import make_button, make_label, row

SHOW_DELAY_MS = 300
"""What is over sooner is not shown: it would only flash."""

PROGRESS_STEPS = 1000


class ProgressRow(QWidget):
    """Hidden while nothing goes on. `tell` and `stopped` are for the thread that works."""

    _progress_changed = Signal(float)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.label, self.bar = make_label(kind="note", wrap=False), QProgressBar()
        self.cancel_button = make_button(
            "Stop", self.request_cancel, "choice", "End it; what is whole stays, and nothing is left half done"
        )
        self.bar.setRange(0, PROGRESS_STEPS)
        self.bar.setTextVisible(False)
        self.bar.setFixedHeight(10)
        self.running = False
        self._cancel_event = threading.Event()
        self._last_share = 0.0
        self._show_timer = QTimer(self, singleShot=True, interval=SHOW_DELAY_MS)
        self._show_timer.timeout.connect(self.show)
        self._progress_changed.connect(lambda share: self.bar.setValue(round(PROGRESS_STEPS * share)))
        row(self.label, (self.bar, 1), self.cancel_button, parent=self, margins=(0, 0, 0, 0), spacing=8)
        self.hide()

    def start(self, text: str) -> None:
        """Something begins."""
        self.running, self._last_share = True, 0.0
        self._cancel_event.clear()
        self.label.setText(text)
        self.bar.setValue(0)
        self.cancel_button.setEnabled(True)
        self._show_timer.start()

    def finish(self) -> None:
        """It has ended, or was ended."""
        self.running = False
        self._show_timer.stop()
        self.hide()

    def request_cancel(self) -> None:
        """Somebody wants no more of it."""
        self._cancel_event.set()
        self.cancel_button.setEnabled(False)

    def update_progress(self, share: float) -> None:
        """How far it is, 0 to 1; from any thread."""
        if not 0 <= share - self._last_share < 1 / PROGRESS_STEPS:  # more could not be seen
            self._last_share = share
            self._progress_changed.emit(share)

    def cancelled(self) -> bool:
        """Whether somebody wants no more of it; from any thread."""
        return self._cancel_event.is_set()
