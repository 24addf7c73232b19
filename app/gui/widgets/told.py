"""Message to the window: what a widget tells the user in the status line, with Undo where it can be taken back."""

from collections.abc import Callable

from PySide6.QtCore import QCoreApplication, QEvent
from PySide6.QtWidgets import QWidget

from app.common import Severity

TOLD = QEvent.Type(QEvent.registerEventType())


class Told(QEvent):
    """A message that a window shows in its status line; an empty text takes the last one away."""

    def __init__(self, text: str, severity: Severity, undo: Callable[[], object] | None) -> None:
        super().__init__(TOLD)
        self.text, self.severity, self.undo = text, severity, undo


def tell(
    widget: QWidget, text: str, undo: Callable[[], object] | None = None, severity: Severity = Severity.INFO
) -> None:
    """Tell the user something in the status line of a widget's window.

    Args:
        widget: in the window.
        text: what has happened.
        undo: reverses it.
        severity: an error stays until something else has happened.
    """
    QCoreApplication.sendEvent(widget.window(), Told(text, severity, undo))
