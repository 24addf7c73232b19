"""Progress bar of a background operation with a Stop button."""

from collections.abc import Callable
from functools import partial
from typing import Any

from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import QWidget

from app.common import Progress
from app.gui.widgets.background import BackgroundWorker
from app.gui.widgets.layouts import make_button, make_label, make_progress_bar, row

SHOW_DELAY_MS = 300
"""An operation that ends sooner is not shown: it would only flash."""

PROGRESS_STEPS = 1000


class JobProgress(Progress):
    """Progress of a job of a widget: reports to a function, in the thread of the job; updates smaller than `least` are dropped."""

    cancelled = False

    def __init__(self, report: Callable[[float, str], object], least: float = 0.0) -> None:
        self._report, self._least, self._last = report, least, 0.0

    def restart(self) -> None:
        self.cancelled, self._last = False, 0.0

    def update(self, fraction: float, text: str = "") -> None:
        if not 0 <= fraction - self._last < self._least:
            self._last = fraction
            self._report(fraction, text)


class ProgressRow(QWidget):
    """Runs one job at a time in its own thread and shows its progress with a Stop button; hidden while none is running."""

    started = Signal(bool)
    """A job has begun (True) or ended."""
    _progressed = Signal(float, str)

    def __init__(self, name: str) -> None:
        super().__init__()
        self._worker = BackgroundWorker(name, self, self.request_cancel)
        self.label = make_label(kind="note", wrap=False, name="progress.label")
        self.bar = make_progress_bar(PROGRESS_STEPS, 10, "progress.bar")
        tip = "Cancel it; completed files stay, and none is left incomplete"
        self.cancel_button = make_button("Stop", self.request_cancel, "choice", tip, "progress.cancel")
        self.running = False
        self.progress = JobProgress(self._progressed.emit, 1 / PROGRESS_STEPS)
        self._show_timer = QTimer(self, singleShot=True, interval=SHOW_DELAY_MS)
        self._show_timer.timeout.connect(self.show)
        self._progressed.connect(lambda fraction, _: self.bar.setValue(round(PROGRESS_STEPS * fraction)))
        row(self.label, (self.bar, 1), self.cancel_button, parent=self, spacing=8)
        self.hide()

    def run(
        self,
        text: str,
        work: Callable[[Progress], Any],
        on_result: Callable[[Any], object],
        on_error: Callable[[Exception], object],
    ) -> None:
        """Run a job in the background under a text, and give it its progress."""
        self.progress.restart()
        self.label.setText(text)
        self.bar.setValue(0)
        self.cancel_button.setEnabled(True)
        self._show_timer.start()
        self._set_running(True)

        def ended(follow: Callable[[Any], object], outcome: Any) -> None:
            self._show_timer.stop()
            self.hide()
            self._set_running(False)
            follow(outcome)

        self._worker.submit(lambda: work(self.progress), partial(ended, on_result), partial(ended, on_error))

    def request_cancel(self) -> None:
        self.progress.cancelled = True
        self.cancel_button.setEnabled(False)

    def _set_running(self, running: bool) -> None:
        self.running = running
        self.started.emit(running)
