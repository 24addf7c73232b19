"""Key caps: the key of a button's action as a small cap beside its text."""

import weakref

from PySide6.QtCore import QRect, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QIcon, QPainter
from PySide6.QtWidgets import QAbstractButton

from app.gui.face import CENTRE, PaintedIcon, draw_box, draw_text, px, text_width, tokens

GAP = 5
"""Between the text and the cap, in lengths of the design."""

FILLED = ("go", "stop")
"""Kinds of buttons on whose ground text is white."""


class _Cap(PaintedIcon):
    def __init__(self, key: str, button: "weakref.ref[QAbstractButton]") -> None:
        super().__init__()
        self._key, self._button = key, button

    def paint(self, painter: QPainter, rect: QRect, mode: QIcon.Mode, _state: QIcon.State) -> None:
        rect = rect.adjusted(px(GAP), 0, 0, 0)
        colors, button = tokens(), self._button()
        is_filled = button is not None and button.isEnabled() and button.property("kind") in FILLED
        is_chosen = button is not None and button.isChecked()
        ink = "#ffffff" if is_filled or is_chosen else colors.text2
        edge, fill = QColor(ink if is_filled else colors.outline), QColor(ink)
        edge.setAlpha(150)
        fill.setAlpha(38 if is_filled else 14)
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        draw_box(painter, QRectF(rect).adjusted(0.5, 0.5, -0.5, -0.5), px(4), fill, edge)
        shown = ink if mode is not QIcon.Mode.Disabled else colors.text2
        draw_text(painter, rect, self._key, shown, "key", CENTRE)
        painter.restore()

    def clone(self) -> "_Cap":
        return _Cap(self._key, self._button)


def show_key(button: QAbstractButton, shortcut: str) -> None:
    """Show the key of a button's action right of its text; none if it is empty."""
    key = shortcut.replace("+", " ")
    button.setProperty("cap", key)
    if not key:
        button.setIcon(QIcon())
        return
    width = text_width(key, "key") + px(10 + GAP)
    button.setIconSize(QSize(round(width), px(18)))
    button.setIcon(QIcon(_Cap(key, weakref.ref(button))))
    button.setLayoutDirection(Qt.LayoutDirection.RightToLeft)  # the cap follows the text
