"""A line that leads a newcomer through the first run; it goes by itself when that run has been looked at."""

from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QWidget

from app.gui.widgets.form import mark
from app.session.state import View
from protocols.base.events import Status

WAITS = "The bench is connecting; the measurement then begins by itself."
RUNS = (
    "The generator plays one frequency after the other, and each point falls on the model's curve. "
    "Esc stops at any time and brings the bench to rest."
)
DONE = "Finished, and the bench is at rest. The run is kept: Ctrl+4 lists it, Enter opens it. F5 measures again; F1 tells every key."
ENDED = "The run did not come to its end: {reason}. F5 begins again; F1 tells every key."


class Hint(QWidget):
    """Hidden, until `begin`."""

    def __init__(self) -> None:
        super().__init__()
        self._told = False
        self.words = QLabel()
        self.words.setWordWrap(True)
        mark(self.words, "hint")
        close = QPushButton("Got it")
        close.setProperty("kind", "choice")
        close.clicked.connect(self.hide)
        row = QHBoxLayout(self)
        row.setContentsMargins(6, 0, 6, 0)
        row.addWidget(self.words, 1)
        row.addWidget(close)
        self.hide()

    def begin(self) -> None:
        """Lead through the run that comes."""
        self._told = False
        self.words.setText(WAITS)
        self.show()

    def show_view(self, view: View) -> None:
        """Say what is to be seen now."""
        if self.isHidden():
            return
        if view.busy and self._told:  # another run: the lesson is over
            self.hide()
        elif view.busy:
            self.words.setText(RUNS)
        elif (ended := view.outcome) is not None:
            self._told, done = True, ended.status is Status.COMPLETED
            self.words.setText(DONE if done else ENDED.format(reason=ended.reason))
