"""Overlay with a search: a heading, a search field, what is found, and a button that closes it."""

from PySide6.QtWidgets import QWidget

from app.gui.widgets import ACTIONS, Item, OverlayCard, Place, column, make_button, make_label, make_line_edit, row


class SearchOverlay(OverlayCard):
    """Base of searchable overlays. Subclasses implement `_fill`, which is called after every change of the search.

    Args:
        name: name of the action that opens and closes it, and prefix of the object names.
        heading: heading of the overlay.
        hint: hint in the search field.
        accessible_name: accessible name of the search field.
        place: place of the overlay in the window.
    """

    def __init__(self, name: str, heading: str, hint: str, accessible_name: str, place: Place = Place.RIGHT) -> None:
        super().__init__(f"{name}.drawer", QWidget(), place)
        self._name, self._heading = name, heading
        self.search = make_line_edit(f"{name}.search", accessible_name, placeholderText=hint, clearButtonEnabled=True)
        self.search.textChanged.connect(self._fill)

    def search_for(self, text: str = "") -> None:
        """Show the matches of a text, and give the search field the keyboard focus."""
        self.search.setText(text)
        self._fill()
        self.search.setFocus()

    def _lay_out(self, content: QWidget, *buttons: Item) -> None:
        close = make_button("Close", self.leave, name=f"{self._name}.close", key=ACTIONS[self._name].shortcut)
        head = row(make_label(self._heading, "heading", wrap=False), None, *buttons, close, spacing=8)
        column(head, self.search, (content, 1), parent=self.content, margins=(16, 12, 16, 12), spacing=8)

    def _matches(self, text: str) -> bool:
        """Return whether every word of the search occurs in a text."""
        return all(word in text.casefold() for word in self.search.text().casefold().split())

    def _fill(self) -> None:
        raise NotImplementedError
