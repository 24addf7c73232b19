"""Icon view: one icon of the design in the colour of a token."""

from PySide6.QtCore import QRectF
from PySide6.QtGui import QColor, QPaintEvent
from PySide6.QtWidgets import QWidget

from app.gui.face import draw_icon, painting, set_length, tokens


class IconView(QWidget):
    """Shows an icon.

    Args:
        side: of its square, in lengths of the design.
        icon: its name; empty for none.
        color: token of its colour, or a colour.
    """

    def __init__(self, side: int, icon: str = "", color: str = "text") -> None:
        super().__init__()
        self._icon, self._color = icon, color
        set_length(self, side, side)

    def show_icon(self, icon: str, color: str) -> None:
        self._icon, self._color = icon, color
        self.update()

    def paintEvent(self, _event: QPaintEvent) -> None:
        if self._icon:
            color = str(getattr(tokens(), self._color, self._color))
            with painting(self) as painter:
                draw_icon(painter, self._icon, QRectF(self.rect()).adjusted(1, 1, -1, -1), color, over(color))


def over(color: str) -> str:
    """Return black or white, whichever is told apart better on a colour."""
    return "#000000" if QColor(color).lightnessF() > 0.6 or QColor(color).name() == "#ffc21a" else "#ffffff"
