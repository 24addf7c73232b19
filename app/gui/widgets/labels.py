"""Labels: elided to their width, and the status line of a page."""

from PySide6.QtCore import QSize, Qt, QTimer
from PySide6.QtGui import QPaintEvent
from PySide6.QtWidgets import QLabel

from app.gui.face import painting
from app.gui.widgets.layouts import configure, set_style_kind

MIN_CHARACTERS = 6
"""Characters that are always visible."""

DISPLAY_MS = 8000
"""How long a message that is not an error stays visible."""


class ElidedLabel(QLabel):
    """Label for one line of plain text that is elided to its width; a `hint` is shown whole or in its tool tip alone."""

    hint = False

    def minimumSizeHint(self) -> QSize:
        whole = super().minimumSizeHint()
        least = 0 if self.hint else MIN_CHARACTERS * self.fontMetrics().averageCharWidth()
        return QSize(min(whole.width(), least), whole.height())

    def paintEvent(self, _event: QPaintEvent) -> None:
        text = self.fontMetrics().elidedText(self.text(), Qt.TextElideMode.ElideRight, self.width())
        if self.hint and text != self.text():
            return
        with painting(self) as painter:
            painter.setPen(self.palette().color(self.foregroundRole()))
            painter.drawText(self.rect(), self.alignment(), text)


class StatusLine(QLabel):
    """Line for one message, hidden without one; a message disappears after some seconds, an error stays."""

    def __init__(self) -> None:
        super().__init__()
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
