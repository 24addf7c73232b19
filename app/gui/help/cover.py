"""Cover with a search: a page that lies over the pages of the window, with a heading, a search field and a button that closes it."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from app.gui.widgets import Item, column, make_button, make_label, make_line_edit, row, shortcut_label


class SearchCover(QWidget):
    """Base of searchable pages. Subclasses implement `_fill`, which is called after every change of the search.

    Args:
        name: name of the action that shows and closes the page, and prefix of the object names.
        heading: heading of the page.
        hint: hint in the search field.
        accessible_name: accessible name of the search field.
    """

    closed = Signal()

    def __init__(self, name: str, heading: str, hint: str, accessible_name: str) -> None:
        super().__init__()
        self._name, self._heading = name, heading
        self.search = make_line_edit(f"{name}.search", accessible_name, placeholderText=hint, clearButtonEnabled=True)
        self.search.textChanged.connect(self._fill)

    def search_for(self, text: str = "") -> None:
        """Show the matches of a text, and give the search field the keyboard focus."""
        self.search.setText(text)
        self._fill()
        self.search.setFocus()

    def _lay_out(self, content: QWidget, *buttons: Item) -> None:
        close = make_button(shortcut_label("Close", self._name), self.closed.emit, name=f"{self._name}.close")
        head = row(make_label(self._heading, "heading", wrap=False), (self.search, 1), *buttons, close, spacing=14)
        column(head, (content, 1), parent=self, margins=(16, 12, 16, 8), spacing=10)

    def _matches(self, text: str) -> bool:
        """Return whether every word of the search occurs in a text."""
        return all(word in text.casefold() for word in self.search.text().casefold().split())

    def _fill(self) -> None:
        raise NotImplementedError
