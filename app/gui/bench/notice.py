"""A sentence across the window with buttons beside it: a prompt, a question, a failure, the unsafe sentence."""

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QPainter, QPaintEvent, QPalette
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from app.gui.bench.symbols import SYMBOLS
from app.gui.widgets.form import mark


@dataclass(frozen=True, slots=True)
class Choice:
    """A button: its words with the key that presses it, and what then happens."""

    words: str
    do: Callable[[], object]
    kind: str = ""


class Symbol(QWidget):
    """One of the drawn symbols, in the colour of the writing around it."""

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
    """Hidden until there is something to say. `kind` is `prompt`, `unsafe` or `trouble`: the style sheet's word."""

    def __init__(self, choices: tuple[Choice, ...], kind: str, symbol: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.words = QLabel()
        self.detail = QLabel()
        self.detail.setProperty("kind", "detail")
        for label in (self.words, self.detail):
            label.setWordWrap(True)
            label.setTextFormat(Qt.TextFormat.PlainText)
            label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
            label.setContextMenuPolicy(Qt.ContextMenuPolicy.NoContextMenu)
        self.text = text = QVBoxLayout()
        text.setSpacing(4)
        text.addWidget(self.words)
        text.addWidget(self.detail)
        self.symbol = Symbol(self)
        self.symbol.name = symbol
        self.row = layout = QHBoxLayout(self)
        layout.setContentsMargins(16, 10, 12, 10)
        layout.setSpacing(14)
        layout.addWidget(self.symbol)
        layout.addLayout(text, 1)
        self.buttons = [QPushButton(choice.words) for choice in choices]
        for button, choice in zip(self.buttons, choices, strict=True):
            if choice.kind:
                button.setProperty("kind", choice.kind)
            button.clicked.connect(choice.do)
            layout.addWidget(button)
        mark(self, kind)
        self.hide()

    def say(self, words: str, detail: str = "") -> None:
        """Show a sentence and, smaller, what else is known; nothing hides the notice."""
        if (words, detail) != (self.words.text(), self.detail.text()):
            self.words.setText(words)
            self.detail.setText(detail)
        self.detail.setVisible(bool(detail))
        self.setVisible(bool(words))
