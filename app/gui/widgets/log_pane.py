"""What happened, line by line, with the time: newest at the bottom, kept in sight unless somebody reads further up."""

from html import escape

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QPlainTextEdit, QWidget

from app.gui.widgets.theme import Theme
from app.session.messages import Level, Message
from app.session.state import View

SIGN = {Level.PLAIN: " ", Level.GOOD: "✓", Level.ATTENTION: "!", Level.BAD: "✕"}


class LogPane(QPlainTextEdit):
    """Shows the messages of a view."""

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme, self._told = theme, 0
        self._messages: tuple[Message, ...] = ()
        self.setReadOnly(True)
        self.setContextMenuPolicy(Qt.ContextMenuPolicy.NoContextMenu)  # an open menu would keep the Stop key to itself
        self.setMaximumBlockCount(1000)
        self.setAccessibleName("log")
        self.setPlaceholderText("What happens is written here.")

    def set_theme(self, theme: Theme) -> None:
        """Take other colours, also for what is already written."""
        self._theme = theme
        self.clear()
        for message in self._messages:
            self._write(message)

    def show_view(self, view: View) -> None:
        """Write what is new."""
        new = view.told - self._told
        if new <= 0:
            return
        self._told, self._messages = view.told, view.messages
        for message in view.messages[-new:]:
            self._write(message)

    def show_messages(self, messages: tuple[Message, ...]) -> None:
        """Write these and nothing else."""
        self.clear()
        self._told, self._messages = len(messages), messages
        for message in messages:
            self._write(message)

    def _write(self, message: Message) -> None:
        bar = self.verticalScrollBar()
        follow = bar.value() >= bar.maximum() - 2
        level = message.level
        self.appendHtml(
            f'<span style="color:{self._theme.dim}">{message.at:%H:%M:%S}</span> '
            f'<span style="color:{self._theme.level(level)}">{SIGN[level]}&nbsp;{escape(message.words)}</span>'
        )
        if follow:
            bar.setValue(bar.maximum())
