"""Toast: a short message in the corner of a page, with Undo where an action can be taken back."""

from collections.abc import Callable

from PySide6.QtCore import QEvent, QObject, QPoint, QRect, Qt, QTimer
from PySide6.QtWidgets import QFrame, QWidget

from app.gui.widgets.layouts import configure, make_button, make_label, row

SHOWN_MS = 10_000
MARGIN = 12


class Toast(QFrame):
    """Lies over the lower left corner of a page, so that nothing moves; disappears by itself.

    Args:
        page: the widget in whose corner it is shown.
        undo_text: text of the button that takes the action back, with its shortcut.
    """

    def __init__(self, page: QWidget, undo_text: str = "Undo   (Ctrl+Z)") -> None:
        super().__init__(page)
        self._page = page
        configure(self, "toast", kind="toast")
        self._undo: Callable[[], object] | None = None
        self.label = make_label(name="toast.text")
        self.undo_button = make_button(undo_text, self._on_undo, "choice", name="toast.undo")
        self.undo_button.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # a page's keys go on working
        row((self.label, 1), self.undo_button, parent=self, margins=(14, 8, 10, 8), spacing=12)
        self._timer = QTimer(self, singleShot=True, interval=SHOWN_MS)
        self._timer.timeout.connect(self.hide)
        page.installEventFilter(self)
        self.hide()

    def show_message(self, text: str, undo: Callable[[], object] | None = None) -> None:
        """Show a message; `undo` reverses the change that it reports. An empty text hides the toast."""
        self._undo = undo
        self.label.setText(text)
        self.undo_button.setVisible(undo is not None)
        self.setVisible(bool(text))
        self._place()
        self._timer.start()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize and self.isVisible():
            self._place()
        return super().eventFilter(watched, event)

    def _on_undo(self) -> None:
        self.hide()
        if self._undo is not None:
            self._undo()

    def _place(self) -> None:
        page = _unclipped_rect(self._page)
        width = min(page.width() - 2 * MARGIN, 60 * self.fontMetrics().averageCharWidth() + 140)
        self.setFixedWidth(max(width, 80))
        height = max(self.heightForWidth(width), self.sizeHint().height())
        self.setGeometry(page.left() + MARGIN, page.bottom() - height - MARGIN, width, height)
        self.raise_()


def _unclipped_rect(widget: QWidget) -> QRect:
    """Return the part of a widget that its ancestors show: a page may be scrolled. Its own children do not count as cover."""
    shown, at, parent = widget.rect(), QPoint(0, 0), widget.parentWidget()
    inner = widget
    while parent is not None and not inner.isWindow():
        at += inner.pos()
        shown &= parent.rect().translated(-at)
        inner, parent = parent, parent.parentWidget()
    return shown
