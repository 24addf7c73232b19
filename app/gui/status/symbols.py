"""Symbols of signs and lamps, drawn because no font is sure to contain them."""

from collections.abc import Callable

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QPainter, QPen, QPolygonF

Draw = Callable[[QPainter, QRectF], object]
"""Draws in the painter's pen, inside a square."""


Points = tuple[tuple[float, float], ...]
"""In parts of the square's sides, from its upper left corner."""


def _polygon(box: QRectF, points: Points) -> QPolygonF:
    return QPolygonF([QPointF(box.left() + x * box.width(), box.top() + y * box.height()) for x, y in points])


def _lines(*lines: Points, outline: Draw = lambda *_: None) -> Draw:
    """Return a symbol of lines with round ends; a line that ends where it begins is closed."""

    def draw(painter: QPainter, box: QRectF) -> None:
        pen = QPen(painter.pen().color(), max(box.width() * 0.1, 1.5))
        pen.setCapStyle(Qt.PenCapStyle.RoundCap)
        pen.setJoinStyle(Qt.PenJoinStyle.RoundJoin)
        painter.setPen(pen)
        outline(painter, box)
        for points in lines:
            closed = points[0] == points[-1]
            (painter.drawPolygon if closed else painter.drawPolyline)(_polygon(box, points[:-1] if closed else points))

    return draw


def _filled(*shapes: Points) -> Draw:
    """Return a symbol of filled polygons."""

    def draw(painter: QPainter, box: QRectF) -> None:
        painter.setBrush(painter.pen().color())
        for points in shapes:
            painter.drawPolygon(_polygon(box, points))

    return draw


def _bar(left: float) -> Points:
    return (left, 0.12), (left + 0.22, 0.12), (left + 0.22, 0.88), (left, 0.88)


def _dots(painter: QPainter, box: QRectF) -> None:
    painter.setBrush(painter.pen().color())
    for x in (0.15, 0.5, 0.85):
        centre = QPointF(box.left() + x * box.width(), box.center().y())
        painter.drawEllipse(centre, box.width() * 0.1, box.width() * 0.1)


TICK = _lines(((0.12, 0.52), (0.4, 0.8), (0.9, 0.2)))
RISING = (0.2, 0.8), (0.8, 0.2)

SYMBOLS: dict[str, Draw] = {
    "bolt": _filled(((0.62, 0.0), (0.16, 0.58), (0.46, 0.58), (0.34, 1.0), (0.84, 0.4), (0.53, 0.4))),
    "rest": TICK,
    "pause": _filled(_bar(0.2), _bar(0.58)),
    "down": _lines(((0.5, 0.05), (0.5, 0.7)), ((0.22, 0.44), (0.5, 0.72), (0.78, 0.44)), ((0.1, 0.95), (0.9, 0.95))),
    "danger": _lines(
        ((0.5, 0.06), (0.98, 0.94), (0.02, 0.94), (0.5, 0.06)), ((0.5, 0.38), (0.5, 0.62)), ((0.5, 0.78), (0.5, 0.79))
    ),
    "nothing": _lines(RISING, outline=lambda painter, box: painter.drawEllipse(box.adjusted(3, 3, -3, -3))),
    "dots": _dots,
    "open": _lines(outline=lambda painter, box: painter.drawRect(box.adjusted(4, 4, -4, -4))),
    "again": _lines(
        ((0.48, 0.02), (0.74, 0.14), (0.6, 0.4)),
        outline=lambda painter, box: painter.drawArc(box.adjusted(2, 2, -2, -2), 60 * 16, 290 * 16),
    ),
    "play": _filled(((0.2, 0.08), (0.92, 0.5), (0.2, 0.92))),
    "tick": TICK,
    "cross": _lines(((0.2, 0.2), (0.8, 0.8)), RISING),
    # An arrow that points to the answer buttons.
    "hand": _lines(((0.08, 0.5), (0.86, 0.5)), ((0.56, 0.2), (0.88, 0.5), (0.56, 0.8))),
    "question": _lines(((0.28, 0.26), (0.5, 0.12), (0.74, 0.28), (0.52, 0.5), (0.5, 0.64)), ((0.5, 0.86), (0.5, 0.87))),
}
