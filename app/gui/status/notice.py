"""Notice across the window: a message with buttons."""

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QPainter, QPaintEvent, QPalette
from PySide6.QtWidgets import QFrame, QLabel, QPushButton, QWidget

from app.gui.status.symbols import SYMBOLS
from app.gui.widgets import SELECTABLE, column, configure, make_label, row, set_style_kind


class SymbolIcon(QWidget):
    """One of the drawn symbols, in the text colour of a label."""

    def __init__(self, symbol: str, label: QLabel) -> None:
        super().__init__()
        self._symbol, self._label = symbol, label
        self.setFixedSize(QSize(40, 40))

    def set_symbol(self, symbol: str) -> None:
        """Show another symbol."""
        self._symbol = symbol
        self.update()

    def paintEvent(self, _event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(self._label.palette().color(QPalette.ColorRole.WindowText))
        SYMBOLS[self._symbol](painter, self.rect().toRectF().adjusted(2, 2, -2, -2))
        painter.end()


class Notice(QFrame):
    """A message with buttons, hidden while it is empty. `kind` is one of the style sheet."""

    def __init__(self, name: str, kind: str, symbol: str, *buttons: QPushButton) -> None:
        super().__init__()
        self.message_label, self.detail_label = (
            make_label(
                kind=label_kind,
                name=f"{name}.{label_kind or 'message'}",
                textInteractionFlags=SELECTABLE,
                contextMenuPolicy=Qt.ContextMenuPolicy.NoContextMenu,
            )
            for label_kind in ("", "detail")
        )
        self.text_layout = column(self.message_label, self.detail_label, spacing=4)
        self.symbol, self.buttons = SymbolIcon(symbol, self.message_label), list(buttons)
        top = Qt.AlignmentFlag.AlignTop  # in a window so small that the notice scrolls, they are seen first
        placed = ((button, 0, top) for button in buttons)
        self.row = row(
            (self.symbol, 0, top), (self.text_layout, 1), *placed, parent=self, margins=(16, 10, 12, 10), spacing=14
        )
        configure(self, name, kind=kind).hide()

    def set_style(self, kind: str, symbol: str) -> None:
        """Change the style of the frame and its texts, and the symbol."""
        if self.property("kind") == kind:
            return
        set_style_kind(self, kind)
        for label in (self.message_label, self.detail_label):  # their colour follows from the frame's kind
            label.style().unpolish(label)
            label.style().polish(label)
        self.symbol.set_symbol(symbol)

    def show_message(self, text: str, detail: str = "") -> None:
        """Show a message and, smaller, its details; an empty message hides the notice."""
        if (text, detail) != (self.message_label.text(), self.detail_label.text()):
            self.message_label.setText(text)
            self.detail_label.setText(detail)
        self.detail_label.setVisible(bool(detail))
        self.setVisible(bool(text))
