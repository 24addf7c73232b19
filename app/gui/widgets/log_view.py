"""Log view: time-stamped messages that follow the newest one unless the user has scrolled up."""

from collections.abc import Iterable
from html import escape

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QPlainTextEdit

from app.common import Severity, pluralize, typeset
from app.gui.face import follow_tokens, tokens
from app.gui.widgets.layouts import configure, make_button
from app.session import LogLine

SEVERITY_MARKS = {Severity.INFO: " ", Severity.SUCCESS: "✓", Severity.WARNING: "!", Severity.ERROR: "✗"}


class LogView(QPlainTextEdit):
    """Shows messages. `following` is changed by the wheel, keys and drags only, never by a change of size."""

    def __init__(self) -> None:
        super().__init__()
        self.following, self._missed = True, 0
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
        self.newest_button = make_button("", self.show_newest, "choice", "Follow the log again", "log.newest")
        self.newest_button.setParent(self)
        self.newest_button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.newest_button.hide()
        # Of the user alone; the position follows in the same turn of the event loop.
        self.verticalScrollBar().actionTriggered.connect(lambda _: QTimer.singleShot(0, self, self._on_scrolled))
        follow_tokens(self, lambda _: self._write_all())

    def show_newest(self) -> None:
        """Scroll to the newest message, and follow the log again."""
        self.following, self._missed = True, 0
        self._follow()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._follow()

    def show_messages(self, messages: tuple[LogLine, ...]) -> None:
        """Show these messages only."""
        self._messages = messages
        self._write_all()

    def append_messages(self, messages: Iterable[LogLine]) -> None:
        added = tuple(messages)
        self._messages = (*self._messages, *added)[-self.maximumBlockCount() :]
        if not self.following:
            self._missed += len(added)
        self._write(added)

    def _on_scrolled(self) -> None:
        bar = self.verticalScrollBar()
        self.following = bar.value() >= bar.maximum()
        if self.following:
            self._missed = 0
        self._follow()

    def _follow(self) -> None:
        """Scroll to the newest message where the log follows, or show how many are below."""
        bar, button = self.verticalScrollBar(), self.newest_button
        if self.following:
            bar.setValue(bar.maximum())
        button.setVisible(not self.following)
        button.setText(f"{pluralize(self._missed, 'newer line')} ↓" if self._missed else "Newest ↓")
        button.adjustSize()
        area = self.viewport().geometry()
        button.move(area.right() - button.width() - 8, area.bottom() - button.height() - 6)

    def _write_all(self) -> None:
        self.clear()
        self._write(self._messages)

    def _write(self, messages: Iterable[LogLine]) -> None:
        colors = tokens()
        for message in messages:
            level = message.severity
            self.appendHtml(
                f'<span style="color:{colors.text2}">{message.time:%H:%M:%S}</span> '
                f'<span style="color:{colors.severity_color(level)}">{SEVERITY_MARKS[level]}&nbsp;{escape(typeset(message.text))}</span>'
            )
        self._follow()
