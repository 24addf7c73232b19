"""A button with the sets of parameters of a protocol: the paper's, the lab's own, and what can be done with them."""

from collections.abc import Callable
from functools import partial

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QInputDialog, QMenu, QMessageBox, QToolButton, QWidget

from app.gui.form import mark
from app.presets import PresetError, Presets
from protocols.protocol import Protocol


class PresetButton(QToolButton):
    """Its menu is made when it is opened."""

    taken = Signal(object)

    def __init__(self, presets: Presets, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._presets = presets
        self._kind: type[Protocol] | None = None
        self._present: Callable[[], Protocol | None] = lambda: None
        self.setText("Presets")
        mark(self, "tool")
        self.setToolTip("The paper's parameters, or your own")
        self.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        menu = QMenu(self)
        menu.aboutToShow.connect(self._fill)
        self.setMenu(menu)

    def show_for(self, kind: type[Protocol], present: Callable[[], Protocol | None]) -> None:
        """Serve a protocol; `present` is what its form says."""
        self._kind, self._present = kind, present

    def _fill(self) -> None:
        menu, kind = self.menu(), self._kind
        menu.clear()
        if kind is None:
            return
        menu.addAction("The paper's", lambda: self.taken.emit(kind.model_validate({})))
        try:
            names = self._presets.names(kind.name)
        except PresetError as error:
            menu.addAction(str(error)).setEnabled(False)
            return
        for name in names:
            menu.addAction(name, partial(self._take, kind, name))
        menu.addSeparator()
        keep = menu.addAction("Keep these as …", self._keep)
        keep.setEnabled(self._present() is not None)
        if names:
            away = menu.addMenu("Forget")
            for name in names:
                away.addAction(name, partial(self._forget, kind, name))

    def _keep(self) -> None:
        protocol = self._present()
        if protocol is None:
            return
        name, given = QInputDialog.getText(self, "Keep these parameters", "Name of the preset")
        if given and name.strip():
            self._try(lambda: self._presets.keep(name.strip(), protocol))

    def _take(self, kind: type[Protocol], name: str) -> None:
        self._try(lambda: self.taken.emit(self._presets.get(kind, name)))

    def _forget(self, kind: type[Protocol], name: str) -> None:
        self._try(lambda: self._presets.forget(kind.name, name))

    def _try(self, do: Callable[[], object]) -> None:
        try:
            do()
        except PresetError as error:
            QMessageBox.warning(self, "Presets", str(error))
