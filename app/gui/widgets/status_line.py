"""A line for what a page has to say; what is no fault goes by itself."""

from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import QLabel, QWidget

from app.gui.widgets.form import mark

STAYS_MS = 8000
"""How long a remark stays."""


class Remark(QLabel):
    """Hidden while there is nothing to say."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.hide()
        self.setWordWrap(True)
        self.setTextFormat(Qt.TextFormat.PlainText)
        self._silence = QTimer(self, singleShot=True, interval=STAYS_MS)
        self._silence.timeout.connect(lambda: self.say(""))

    def say(self, words: str, fault: bool = False, stays: bool = False) -> None:
        """Show a sentence in place of the last one; nothing where it is empty. A fault stays, and what `stays`."""
        if words != self.text():
            self.setText(words)
            mark(self, "fault" if fault else "note")
            self.setVisible(bool(words))
        if words and not fault:
            self._silence.start()
        if stays:
            self._silence.stop()
