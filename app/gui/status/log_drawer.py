"""Log drawer: every message of the session, from below, with filters."""

from collections.abc import Callable

from PySide6.QtWidgets import QWidget

from app.common import Severity
from app.gui.widgets import LogView, OverlayCard, Place, column, make_button, make_label, row
from app.session import LogLine, WindowState

FILTERS: dict[str, tuple[str, Callable[[LogLine], bool]]] = {
    "points": ("Points", lambda line: " Hz: " in line.text or "point" in line.text),
    "prompts": ("Prompts", lambda line: line.text.startswith(("Asked: ", "Answered: "))),
    "faults": ("Faults", lambda line: line.severity is Severity.ERROR or line.text.startswith("Fault ")),
}
"""Titles of the filters, and which lines they show; without one all lines are shown."""


class LogDrawer(OverlayCard):
    """Opened with Ctrl+J; right of the left column, so that Run stays free."""

    def __init__(self) -> None:
        content = QWidget()
        super().__init__("log.drawer", content, Place.BOTTOM)
        self.view = LogView()
        self._messages: tuple[LogLine, ...] = ()
        self._written_count = 0
        self.filter_buttons = {
            name: make_button(
                title, None, "choice", f"Show these lines only: {title.lower()}", f"log.{name}", checkable=True
            )
            for name, (title, _) in FILTERS.items()
        }
        close = make_button("Close", self.leave, "link", name="log.close")
        head = row(make_label("Log", "heading", wrap=False), *self.filter_buttons.values(), None, close, spacing=8)
        column(head, (self.view, 1), parent=content, margins=(12, 8, 12, 8), spacing=8)
        for button in self.filter_buttons.values():
            button.toggled.connect(lambda _: self.view.show_messages(self._shown))

    @property
    def _shown(self) -> tuple[LogLine, ...]:
        chosen = [FILTERS[name][1] for name, button in self.filter_buttons.items() if button.isChecked()]
        return tuple(line for line in self._messages if not chosen or any(shows(line) for shows in chosen))

    def set_state(self, view: WindowState) -> None:
        new = view.message_count - self._written_count
        if new <= 0:
            return
        self._written_count, self._messages = view.message_count, view.messages
        shown = set(map(id, self._shown))
        self.view.append_messages(line for line in view.messages[-new:] if id(line) in shown)
