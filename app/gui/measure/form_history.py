"""Undo and redo of the protocol form."""

from PySide6.QtCore import QObject, QTimer
from PySide6.QtWidgets import QWidget

from app.common import UndoHistory
from app.gui.measure.run_panel import RunPanel
from app.gui.widgets import add_actions
from protocols.base import Protocol


class FormHistory(QObject):
    """Remembers the valid protocols of a form. Text within a field has its own undo.

    Args:
        panel: holds the form.
        page: where the shortcuts of undo and redo work.
    """

    def __init__(self, panel: RunPanel, page: QWidget) -> None:
        super().__init__(page)
        self._panel = panel
        self._history: UndoHistory[Protocol | None] = UndoHistory(panel.protocol)
        # A preset fills one field after the other: only the form after the last change is remembered.
        self._settle_timer = QTimer(self, singleShot=True, interval=0)
        self._settle_timer.timeout.connect(self._remember)
        panel.changed.connect(self._settle_timer.start)
        add_actions(page, {"measure.undo": self.undo, "measure.redo": self.redo})

    def undo(self) -> None:
        """Show the previous protocol."""
        self._remember()
        if self._panel.form.isEnabled() and self._history.undo():
            self._show_protocol()

    def redo(self) -> None:
        """Show the protocol that was undone."""
        if self._panel.form.isEnabled() and self._history.redo():
            self._show_protocol()

    def _remember(self) -> None:
        if (protocol := self._panel.protocol) is not None:
            self._history.push(protocol, _changed_field(self._history.current, protocol))

    def _show_protocol(self) -> None:
        protocol = self._history.current
        if protocol is not None:
            self._panel.set_protocol(protocol)


def _changed_field(old: Protocol | None, new: Protocol) -> str:
    """Return the field that differs; empty if more than one does."""
    if type(old) is not type(new):
        return ""
    names = [name for name in type(new).model_fields if getattr(old, name) != getattr(new, name)]
    return names[0] if len(names) == 1 else ""
