"""What a plot shows, taken elsewhere: a picture or its numbers on the clipboard, from buttons in its corner or by a key."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QFrame, QHBoxLayout, QPushButton, QWidget

from app.gui.widgets.actions import add_actions, tooltip
from app.gui.widgets.form import set_style_kind

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PlotSeries:
    """One thing a plot shows: x, y and where there is one its standard error, each (N,), in the units of the axes."""

    name: str
    x: Array
    y: Array
    errors: Array | None = None


def series_as_text(series: Iterable[PlotSeries], x_label: str, y_label: str, simulated: bool) -> str:
    """A table with tabs between its columns, as spreadsheets take it; it begins with SIMULATED where that is so."""
    lines = ["SIMULATED"] if simulated else []
    lines.append(f"series\t{x_label}\t{y_label}\tstandard error")
    for one in series:
        errors = np.full(len(one.y), np.nan) if one.errors is None else one.errors
        lines += [
            f"{one.name}\t{x:.10g}\t{y:.10g}\t{'' if np.isnan(error) else f'{error:.6g}'}"
            for x, y, error in zip(one.x, one.y, errors, strict=True)
            if np.isfinite(x) and np.isfinite(y)
        ]
    return "\n".join(lines) + "\n"


def series_of(name: str, item: Any, bars: Any = None) -> Iterable[PlotSeries]:
    """What an item of a plot shows, with the bars that belong to it; nothing where it is hidden or empty."""
    x, y = item.getData()
    if item.isVisible() and x is not None and len(x):
        errors = None if bars is None else np.asarray(bars.opts["height"], float) / 2
        yield PlotSeries(name, np.asarray(x, float) + item.pos().x(), np.asarray(y, float), errors)


class PlotCopyButtons(QWidget):
    """Two buttons in the lower corner of a canvas, there while the mouse or the keyboard is in it: Ctrl+P, Ctrl+D.

    No menu that drops down: that would keep the Stop key to itself.

    Args:
        canvas: what is copied.
        text: its numbers as a table.
    """

    def __init__(self, canvas: QWidget, text: Callable[[], str]) -> None:
        super().__init__(canvas)
        self._canvas, self._text = canvas, text
        self._button_frame = QFrame(canvas)
        self._button_frame.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        set_style_kind(self._button_frame, "ring")
        self._button_frame.hide()
        add_actions(canvas, {"plot.copy-picture": self.copy_picture, "plot.copy-data": self.copy_data})
        canvas.installEventFilter(self)
        self.hide()

    def show_buttons(self) -> None:
        """Show the buttons, which are made when the mouse comes for the first time."""
        if self.layout() is None:
            row = QHBoxLayout(self)
            row.setContentsMargins(0, 0, 0, 0)
            row.setSpacing(4)
            for words, do, action_id in (
                ("Copy picture", self.copy_picture, "plot.copy-picture"),
                ("Copy data", self.copy_data, "plot.copy-data"),
            ):
                button = QPushButton(words)
                set_style_kind(button, "choice")
                button.setToolTip(f"{tooltip(action_id)} while the keyboard is in the plot")
                button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
                button.clicked.connect(do)
                row.addWidget(button)
        self.show()
        self._place_buttons()

    def copy_picture(self) -> None:
        """The plot as it is seen, without these buttons."""
        seen, ringed = self.isVisible(), self._button_frame.isVisible()
        self.hide()
        self._button_frame.hide()
        QGuiApplication.clipboard().setPixmap(self._canvas.grab())
        self.setVisible(seen)
        self._button_frame.setVisible(ringed)

    def copy_data(self) -> None:
        """The numbers."""
        QGuiApplication.clipboard().setText(self._text())

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
