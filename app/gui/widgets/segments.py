"""Segmented control: buttons side by side, one of which is chosen."""

from collections.abc import Iterable

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QButtonGroup, QPushButton, QWidget

from app.gui.widgets.layouts import configure, row


class Segments(QWidget):
    """Shows choices side by side; a list that opens would take the Stop key.

    Args:
        name: beginning of the buttons' object names.
        accessible_name: for screen readers.
        choices: texts with their data.
    """

    chosen = Signal(object)
    """The data of the choice that the user has made."""

    def __init__(self, name: str, accessible_name: str, choices: Iterable[tuple[str, object]]) -> None:
        super().__init__()
        configure(self, name, accessibleName=accessible_name)
        self._group = QButtonGroup(self)
        self.buttons: dict[object, QPushButton] = {}
        for text, data in choices:
            button = configure(QPushButton(text), f"{name}.{data}", kind="segment", checkable=True)
            button.setAccessibleName(f"{accessible_name}: {text}")
            button.clicked.connect(lambda _=False, data=data: self.chosen.emit(data))
            self._group.addButton(button)
            self.buttons[data] = button
        for at, end in ((0, "left"), (-1, "right")):
            list(self.buttons.values())[at].setProperty("end", end)
        row(*((button, 1) for button in self.buttons.values()), parent=self, spacing=0)

    @property
    def selected(self) -> object:
        """The data of the choice; None without one."""
        return next((data for data, button in self.buttons.items() if button.isChecked()), None)

    def select(self, data: object) -> None:
        """Show a choice without a signal; None: no choice."""
        self._group.setExclusive(False)
        for each, button in self.buttons.items():
            button.setChecked(each == data)
        self._group.setExclusive(True)
