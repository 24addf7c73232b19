"""Something that takes its time beside the window: what it is, how far, and a button that ends it."""

import threading

from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import QHBoxLayout, QLabel, QProgressBar, QPushButton, QWidget

from app.gui.widgets.form import mark

PATIENCE_MS = 300
"""What is over sooner is not shown: it would only flash."""

STEPS = 1000


class GoingOn(QWidget):
    """Hidden while nothing goes on. `tell` and `stopped` are for the thread that works."""

    _told = Signal(float)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.words, self.bar, self.stop = QLabel(), QProgressBar(), QPushButton("Stop")
        self.bar.setRange(0, STEPS)
        self.bar.setTextVisible(False)
        self.bar.setFixedHeight(10)
        mark(self.words, "note")
        mark(self.stop, "choice")
        self.stop.setToolTip("End it; what is whole stays, and nothing is left half done")
        self.going = False
        self._stop = threading.Event()
        self._last = 0.0
        self._due = QTimer(self, singleShot=True, interval=PATIENCE_MS)
        self._due.timeout.connect(self.show)
        self._told.connect(lambda share: self.bar.setValue(round(STEPS * share)))
        self.stop.clicked.connect(self.end_it)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(8)
        row.addWidget(self.words)
        row.addWidget(self.bar, 1)
        row.addWidget(self.stop)
        self.hide()

    def begin(self, words: str) -> None:
        """Something begins."""
        self.going, self._last = True, 0.0
        self._stop.clear()
        self.words.setText(words)
        self.bar.setValue(0)
        self.stop.setEnabled(True)
        self._due.start()

    def over(self) -> None:
        """It has ended, or was ended."""
        self.going = False
        self._due.stop()
        self.hide()

    def end_it(self) -> None:
        """Somebody wants no more of it."""
        self._stop.set()
        self.stop.setEnabled(False)

    def tell(self, share: float) -> None:
        """How far it is, 0 to 1; from any thread."""
        if not 0 <= share - self._last < 1 / STEPS:  # more could not be seen
            self._last = share
            self._told.emit(share)

    def stopped(self) -> bool:
        """Whether somebody wants no more of it; from any thread."""
        return self._stop.is_set()
