"""Notice across the window: a message with buttons."""

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QPainter, QPaintEvent, QPalette
from PySide6.QtWidgets import QFrame, QLabel, QWidget

from app.gui.bench.symbols import SYMBOLS
from app.gui.widgets.form import set_style_kind
from app.gui.widgets.layouts import column, make_button, make_label, row


@dataclass(frozen=True, slots=True)
class NoticeButton:
    """A button of a notice: text with its shortcut, and callback."""

    label: str
    callback: Callable[[], object]
    kind: str = ""


class SymbolIcon(QWidget):
    """One of the drawn symbols, in the text colour of its parent."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.name = "danger"
        self.setFixedSize(QSize(40, 40))

    def paintEvent(self, _event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        parent = self.parentWidget()
        label = parent.findChild(QLabel) if parent is not None else None
        palette = label.palette() if isinstance(label, QLabel) else self.palette()
        painter.setPen(palette.color(QPalette.ColorRole.WindowText))
        SYMBOLS[self.name](painter, self.rect().toRectF().adjusted(2, 2, -2, -2))
        painter.end()


class Notice(QFrame):
    """A message with buttons, hidden while it is empty. `kind` is one of the style sheet."""

    def __init__(
        self, choices: tuple[NoticeButton, ...], kind: str, symbol: str, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self.message_label, self.detail_label = make_label(), make_label(kind="detail")
        for label in (self.message_label, self.detail_label):
            label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
            label.setContextMenuPolicy(Qt.ContextMenuPolicy.NoContextMenu)
        self.text_layout = column(self.message_label, self.detail_label, spacing=4)
        self.symbol = SymbolIcon(self)
        self.symbol.name = symbol
        self.buttons = [make_button(choice.label, choice.callback, choice.kind) for choice in choices]
        self.row = row(
            self.symbol, (self.text_layout, 1), *self.buttons, parent=self, margins=(16, 10, 12, 10), spacing=14
        )
        set_style_kind(self, kind)
        self.hide()

    def show_message(self, text: str, detail: str = "") -> None:
        """Show a message and, smaller, its details; an empty message hides the notice."""
        if (text, detail) != (self.message_label.text(), self.detail_label.text()):
            self.message_label.setText(text)
            self.detail_label.setText(detail)
        self.detail_label.setVisible(bool(detail))
        self.setVisible(bool(text))
