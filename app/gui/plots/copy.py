"""Copy buttons of a plot: a picture or a table of its numbers on the clipboard."""

from collections.abc import Callable

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QGuiApplication, QPixmap
from PySide6.QtWidgets import QFrame, QLabel, QWidget

from app.gui.widgets import add_actions, make_button, row, set_style_kind, tooltip


class PlotCopyButtons(QWidget):
    """Two buttons in the lower corner of a canvas, shown while it has the mouse or the keyboard focus: Ctrl+P, Ctrl+D.

    Further actions on a plot are in its context menu (`app.gui.plots.tools`).

    Args:
        canvas: copied widget.
        text: function that returns its numbers as a table.
    """

    def __init__(self, canvas: QWidget, text: Callable[[], str]) -> None:
        super().__init__(canvas)
        self._canvas, self.table = canvas, text
        self._button_frame = QFrame(canvas)
        self._button_frame.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        set_style_kind(self._button_frame, "ring")
        self._button_frame.hide()
        add_actions(canvas, {"plot.copy-picture": self.copy_picture, "plot.copy-data": self.copy_data})
        canvas.installEventFilter(self)
        self.hide()

    def show_buttons(self) -> None:
        """Show the buttons; they are created when first shown."""
        if self.layout() is None:
            buttons = [
                make_button(text, action, "choice", f"{tooltip(action_id)} while the keyboard is in the plot")
                for text, action, action_id in (
                    ("Copy picture", self.copy_picture, "plot.copy-picture"),
                    ("Copy data", self.copy_data, "plot.copy-data"),
                )
            ]
            for button in buttons:
                button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
            row(*buttons, parent=self, spacing=4)
        self.show()
        self._place_buttons()

    def picture(self) -> QPixmap:
        """Return the plot as it is displayed, without buttons and read-out."""
        shown = [
            child
            for child in self._canvas.findChildren(QWidget)
            if child.parent() is self._canvas and child.isVisible()
        ]
        over = [child for child in shown if child in (self, self._button_frame) or isinstance(child, QLabel)]
        for child in over:
            child.hide()
        picture = self._canvas.grab()
        for child in over:
            child.show()
        return picture

    def copy_picture(self) -> None:
        """Copy the plot as it is displayed, without these buttons."""
        QGuiApplication.clipboard().setPixmap(self.picture())

    def copy_data(self) -> None:
        """Copy the numbers as a table."""
        QGuiApplication.clipboard().setText(self.table())

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if watched is self._canvas:
            match event.type():
                case QEvent.Type.FocusIn:
                    self._button_frame.setGeometry(self._canvas.rect())
                    self._button_frame.show()
                    self.show_buttons()
                case QEvent.Type.Enter:
                    self.show_buttons()
                case QEvent.Type.Leave if not self._canvas.hasFocus():
                    self.hide()
                case QEvent.Type.FocusOut:
                    self._button_frame.hide()
                    self.setVisible(self.isVisible() and self._canvas.underMouse())
                case QEvent.Type.Resize if self.isVisible():
                    self._button_frame.setGeometry(self._canvas.rect())
                    self._place_buttons()
        return False

    def _place_buttons(self) -> None:
        self.adjustSize()
        at = self._canvas.rect().bottomRight() - self.rect().bottomRight()
        self.move(at.x() - 6, at.y() - 4)
        self.raise_()
