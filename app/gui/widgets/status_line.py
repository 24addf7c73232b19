"""Status line of a page; messages disappear after some seconds, errors stay."""

from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import QLabel, QWidget

from app.gui.widgets.form import set_style_kind
from app.gui.widgets.layouts import configure

DISPLAY_MS = 8000
"""How long a message that is not an error stays visible."""


class StatusLine(QLabel):
    """Hidden while there is no message."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        configure(self, visible=False, wordWrap=True, textFormat=Qt.TextFormat.PlainText)
        self._hide_timer = QTimer(self, singleShot=True, interval=DISPLAY_MS)
        self._hide_timer.timeout.connect(lambda: self.show_message(""))

    def show_message(self, message: str, is_error: bool = False, persistent: bool = False) -> None:
        """Show a message, or hide the line if it is empty. Errors and `persistent` messages stay."""
        if message != self.text():
            self.setText(message)
            set_style_kind(self, "fault" if is_error else "note")
            self.setVisible(bool(message))
        if message and not (is_error or persistent):
            self._hide_timer.start()
        else:
            self._hide_timer.stop()
