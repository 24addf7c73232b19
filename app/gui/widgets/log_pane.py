"""Log pane: time-stamped messages, scrolled to the newest unless the user has scrolled up."""

from html import escape

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QPlainTextEdit, QWidget

from app.gui.widgets.theme import Theme
from app.session.messages import LogLine, Severity
from app.session.state import WindowState

SEVERITY_MARKS = {Severity.INFO: " ", Severity.SUCCESS: "✓", Severity.WARNING: "!", Severity.ERROR: "✕"}


class LogPane(QPlainTextEdit):
    """Shows the log messages of a window state."""

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme, self._written_count = theme, 0
        self._messages: tuple[LogLine, ...] = ()
        self.setReadOnly(True)
        self.setContextMenuPolicy(Qt.ContextMenuPolicy.NoContextMenu)  # an open menu would keep the Stop key to itself
        self.setMaximumBlockCount(1000)
        self.setAccessibleName("log")
        self.setPlaceholderText("What happens is written here.")

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme, also to the lines that are already written."""
        self._theme = theme
        self.clear()
        for message in self._messages:
            self._write(message)

    def set_state(self, view: WindowState) -> None:
        """Append the new messages."""
        new = view.message_count - self._written_count
        if new <= 0:
            return
        self._written_count, self._messages = view.message_count, view.messages
        for message in view.messages[-new:]:
            self._write(message)

    def show_messages(self, messages: tuple[LogLine, ...]) -> None:
        """Show these messages only."""
        self.clear()
        self._written_count, self._messages = len(messages), messages
        for message in messages:
            self._write(message)

    def _write(self, message: LogLine) -> None:
        bar = self.verticalScrollBar()
        follow = bar.value() >= bar.maximum() - 2
        level = message.severity
        self.appendHtml(
            f'<span style="color:{self._theme.secondary_text}">{message.time:%H:%M:%S}</span> '
            f'<span style="color:{self._theme.severity_color(level)}">{SEVERITY_MARKS[level]}&nbsp;{escape(message.text)}</span>'
        )
        if follow:
            bar.setValue(bar.maximum())
