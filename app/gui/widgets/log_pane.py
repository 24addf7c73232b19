"""Log pane: time-stamped messages, scrolled to the newest unless the user has scrolled up."""

from html import escape

from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QPlainTextEdit

from app.common import Severity, typeset
from app.gui.widgets.layouts import configure, make_button
from app.gui.widgets.theme import WindowTheme
from app.session import LogLine, WindowState

SEVERITY_MARKS = {Severity.INFO: " ", Severity.SUCCESS: "✓", Severity.WARNING: "!", Severity.ERROR: "✕"}


class LogPane(QPlainTextEdit):
    """Shows the log messages of a window state."""

    def __init__(self, theme: WindowTheme) -> None:
        super().__init__()
        self._theme, self._written_count = theme, 0
        self._messages: tuple[LogLine, ...] = ()
        configure(
            self,
            "log",
            readOnly=True,
            contextMenuPolicy=Qt.ContextMenuPolicy.NoContextMenu,  # an open menu would keep the Stop key to itself
            maximumBlockCount=1000,
            accessibleName="log",
            placeholderText="Messages appear here.",
        )
        self.newest_button = make_button("↓ newest", self.show_newest, "choice", "Follow the log again", "log.newest")
        self.newest_button.setParent(self)
        self.newest_button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.newest_button.hide()
        bar = self.verticalScrollBar()
        bar.valueChanged.connect(lambda _: self._place_button())
        bar.rangeChanged.connect(lambda *_: self._place_button())
        theme.changed.connect(self._write_all)

    def show_newest(self) -> None:
        """Scroll to the newest message, and follow the log again."""
        bar = self.verticalScrollBar()
        bar.setValue(bar.maximum())

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._place_button()

    def _place_button(self) -> None:
        """Show the button in the lower right corner while newer messages are below."""
        bar, button = self.verticalScrollBar(), self.newest_button
        button.setVisible(bar.value() < bar.maximum() - 2)
        button.adjustSize()
        area = self.viewport().geometry()
        button.move(area.right() - button.width() - 4, area.bottom() - button.height() - 2)

    def set_state(self, view: WindowState) -> None:
        """Append the new messages."""
        new = view.message_count - self._written_count
        if new > 0:
            self._written_count, self._messages = view.message_count, view.messages
            self._write(view.messages[-new:])

    def show_messages(self, messages: tuple[LogLine, ...]) -> None:
        """Show these messages only."""
        self._written_count, self._messages = len(messages), messages
        self._write_all()

    def _write_all(self) -> None:
        self.clear()
        self._write(self._messages)

    def _write(self, messages: tuple[LogLine, ...]) -> None:
        bar = self.verticalScrollBar()
        for message in messages:
            follow = bar.value() >= bar.maximum() - 2
            level = message.severity
            self.appendHtml(
                f'<span style="color:{self._theme.colors.secondary_text}">{message.time:%H:%M:%S}</span> '
                f'<span style="color:{self._theme.colors.severity_color(level)}">{SEVERITY_MARKS[level]}&nbsp;{escape(typeset(message.text))}</span>'
            )
            if follow:
                bar.setValue(bar.maximum())
