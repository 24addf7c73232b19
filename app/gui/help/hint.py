"""Hints during a user's first run."""

from PySide6.QtWidgets import QWidget

from app.gui.widgets import make_button, make_label, row
from app.session import WindowState
from protocols.base import Outcome

WAITING_TEXT = "The bench is connecting; the measurement then starts automatically."
RUNNING_TEXT = (
    "The generator plays one frequency after the other, and each point falls on the model's curve. "
    "Esc stops at any time and brings the bench to rest."
)
FINISHED_TEXT = "Finished, and the bench is at rest. The run is stored: Ctrl+4 lists it, Enter opens it. F5 measures again; F1 lists every key."
ENDED_TEXT = "The run ended: {summary}. F5 measures again; F1 lists every key."


class FirstRunHint(QWidget):
    """Hint for the first run, hidden until `start`."""

    def __init__(self) -> None:
        super().__init__()
        self._run_finished = False
        self.label = make_label(kind="hint", name="hint.text")
        dismiss = make_button("Got it", self.hide, "choice", name="hint.dismiss")
        row((self.label, 1), dismiss, parent=self, margins=(6, 0, 6, 0))
        self.hide()

    def start(self) -> None:
        """Show the hint for the next run."""
        self._run_finished = False
        self.label.setText(WAITING_TEXT)
        self.show()

    def set_state(self, view: WindowState) -> None:
        """Show the text for the present stage of the run."""
        if self.isHidden():
            return
        if view.busy and self._run_finished:  # another run: the lesson is over
            self.hide()
        elif view.busy:
            self.label.setText(RUNNING_TEXT)
        elif (ended := view.outcome) is not None:
            self._run_finished = True
            good = ended.verdict.outcome is Outcome.GOOD
            self.label.setText(FINISHED_TEXT if good else ENDED_TEXT.format(summary=ended.summary))
