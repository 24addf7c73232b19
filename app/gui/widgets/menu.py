"""Menu that leaves Stop in reach: an open menu takes the keyboard and the mouse from the window below it."""

from collections.abc import Callable, Iterable

from PySide6.QtGui import QAction, QKeyEvent, QKeySequence, QMouseEvent
from PySide6.QtWidgets import QAbstractButton, QMenu, QPushButton, QToolButton, QWidget


def give_menu(button: QPushButton | QToolButton, fill: Callable[["Menu"], object]) -> "Menu":
    """Give a button a menu that is filled whenever it is opened, and return it."""
    menu = Menu(button)

    def fill_anew() -> None:
        menu.clear()
        fill(menu)

    menu.aboutToShow.connect(fill_anew)
    button.setMenu(menu)
    return menu


class Menu(QMenu):
    """Closes and passes on the keys of Stop and Escape, and a click on a button outside it."""

    PASSED_ON = ("stop", "escape")
    """Actions of the window whose keys work in an open menu."""

    def add_named(self, owner: QWidget, names: Iterable[str]) -> None:
        """Add the existing actions of a widget by name; an empty name is a separator."""
        for name in names:
            if not name:
                self.addSeparator()
            elif (action := owner.findChild(QAction, name)) is not None:
                self.addAction(action)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        window, pressed = self._window(), QKeySequence(event.keyCombination())
        for name in self.PASSED_ON:
            action = window.findChild(QAction, name)
            if action is not None and pressed in action.shortcuts():
                self.close()
                # Escape stops a run that is active, and otherwise only closes the menu.
                if name == "stop" or getattr(getattr(window, "state", None), "busy", False):
                    action.trigger()
                return
        super().keyPressEvent(event)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        window = self._window()
        button = window.childAt(window.mapFromGlobal(event.globalPosition().toPoint()))
        if not self.rect().contains(event.position().toPoint()) and isinstance(button, QAbstractButton):
            self.close()
            button.click()
            return
        super().mousePressEvent(event)

    def _window(self) -> QWidget:
        parent = self.parentWidget()
        assert parent is not None
        return parent.window()
