"""Undo and redo of what a form said: a field, a preset, another protocol."""

from PySide6.QtCore import QObject, QTimer
from PySide6.QtWidgets import QWidget

from app.common.undo import History
from app.gui.measure.run_panel import RunPanel
from app.gui.widgets.shortcuts import HERE, bind
from protocols.base.protocol import Protocol


class FormHistory(QObject):
    """Remembers the protocols that the form of a page said, faulty ones left out. A field's own text has its own undo.

    Args:
        panel: holds the form.
        page: where the keys of undo and redo work.
    """

    def __init__(self, panel: RunPanel, page: QWidget) -> None:
        super().__init__(page)
        self._panel = panel
        self._history: History[Protocol | None] = History(panel.protocol)
        # A preset fills one field after the other: what counts is how the form stands when all of that is over.
        self._settled = QTimer(self, singleShot=True, interval=0)
        self._settled.timeout.connect(self._remember)
        panel.changed.connect(self._settled.start)
        bind(page, "Undo in the form", self.undo, "Ctrl+Z", context=HERE, repeats=True)
        bind(page, "Redo in the form", self.redo, "Ctrl+Shift+Z", "Ctrl+Y", context=HERE, repeats=True)

    def undo(self) -> None:
        """Show what the form said before."""
        self._remember()
        if self._panel.form.isEnabled() and self._history.undo():
            self._show()

    def redo(self) -> None:
        """Show what was taken back."""
        if self._panel.form.isEnabled() and self._history.redo():
            self._show()

    def _remember(self) -> None:
        if (protocol := self._panel.protocol) is not None:
            self._history.go(protocol, _changed(self._history.now, protocol))

    def _show(self) -> None:
        protocol = self._history.now
        if protocol is not None:
            self._panel.fill(protocol)


def _changed(before: Protocol | None, after: Protocol) -> str:
    """The field that is another one; empty where it is more than one."""
    if type(before) is not type(after):
        return ""
    names = [name for name in type(after).model_fields if getattr(before, name) != getattr(after, name)]
    return names[0] if len(names) == 1 else ""
