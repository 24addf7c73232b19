"""Symbols of signs and lamps, drawn because no font is sure to contain them."""

from collections.abc import Callable

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QPainter, QPen, QPolygonF

Draw = Callable[[QPainter, QRectF], None]
"""Draws in the painter's pen, inside a square."""


def _pen(painter: QPainter, box: QRectF) -> None:
    pen = QPen(painter.pen().color(), max(box.width() * 0.1, 1.5))
    pen.setCapStyle(Qt.PenCapStyle.RoundCap)
    pen.setJoinStyle(Qt.PenJoinStyle.RoundJoin)
    painter.setPen(pen)


def _polygon(box: QRectF, *points: tuple[float, float]) -> QPolygonF:
    return QPolygonF([QPointF(box.left() + x * box.width(), box.top() + y * box.height()) for x, y in points])


def _bolt(painter: QPainter, box: QRectF) -> None:
    painter.setBrush(painter.pen().color())
    painter.drawPolygon(_polygon(box, (0.62, 0.0), (0.16, 0.58), (0.46, 0.58), (0.34, 1.0), (0.84, 0.4), (0.53, 0.4)))


def _rest(painter: QPainter, box: QRectF) -> None:
    _pen(painter, box)
    painter.drawPolyline(_polygon(box, (0.12, 0.52), (0.4, 0.8), (0.9, 0.2)))


def _arrow_down(painter: QPainter, box: QRectF) -> None:
    _pen(painter, box)
    painter.drawPolyline(_polygon(box, (0.5, 0.05), (0.5, 0.7)))
    painter.drawPolyline(_polygon(box, (0.22, 0.44), (0.5, 0.72), (0.78, 0.44)))
    painter.drawPolyline(_polygon(box, (0.1, 0.95), (0.9, 0.95)))


def _danger(painter: QPainter, box: QRectF) -> None:
    _pen(painter, box)
    painter.drawPolygon(_polygon(box, (0.5, 0.06), (0.98, 0.94), (0.02, 0.94)))
    painter.drawPolyline(_polygon(box, (0.5, 0.38), (0.5, 0.62)))
    painter.drawPolyline(_polygon(box, (0.5, 0.78), (0.5, 0.79)))


def _nothing(painter: QPainter, box: QRectF) -> None:
    _pen(painter, box)
    painter.drawEllipse(box.adjusted(3, 3, -3, -3))
    painter.drawPolyline(_polygon(box, (0.2, 0.8), (0.8, 0.2)))


def _dots(painter: QPainter, box: QRectF) -> None:
    painter.setBrush(painter.pen().color())
    for x in (0.15, 0.5, 0.85):
        centre = QPointF(box.left() + x * box.width(), box.center().y())
        painter.drawEllipse(centre, box.width() * 0.1, box.width() * 0.1)


def _open(painter: QPainter, box: QRectF) -> None:
    _pen(painter, box)
    painter.drawRect(box.adjusted(4, 4, -4, -4))


def _cross(painter: QPainter, box: QRectF) -> None:
    _pen(painter, box)
    painter.drawPolyline(_polygon(box, (0.2, 0.2), (0.8, 0.8)))
    painter.drawPolyline(_polygon(box, (0.2, 0.8), (0.8, 0.2)))


def _question(painter: QPainter, box: QRectF) -> None:
    _pen(painter, box)
    painter.drawPolyline(_polygon(box, (0.28, 0.26), (0.5, 0.12), (0.74, 0.28), (0.52, 0.5), (0.5, 0.64)))
    painter.drawPolyline(_polygon(box, (0.5, 0.86), (0.5, 0.87)))


def _hand(painter: QPainter, box: QRectF) -> None:
    """An arrow that points to the answer buttons."""
    _pen(painter, box)
    painter.drawPolyline(_polygon(box, (0.08, 0.5), (0.86, 0.5)))
    painter.drawPolyline(_polygon(box, (0.56, 0.2), (0.88, 0.5), (0.56, 0.8)))


def _pause(painter: QPainter, box: QRectF) -> None:
    painter.setBrush(painter.pen().color())
    for x in (0.2, 0.58):
        painter.drawRect(_polygon(box, (x, 0.12), (x + 0.22, 0.88)).boundingRect())


def _again(painter: QPainter, box: QRectF) -> None:
    """A circle with an arrow head: repeat."""
    _pen(painter, box)
    painter.drawArc(box.adjusted(2, 2, -2, -2), 60 * 16, 290 * 16)
    painter.drawPolyline(_polygon(box, (0.48, 0.02), (0.74, 0.14), (0.6, 0.4)))


def _play(painter: QPainter, box: QRectF) -> None:
    painter.setBrush(painter.pen().color())
    painter.drawPolygon(_polygon(box, (0.2, 0.08), (0.92, 0.5), (0.2, 0.92)))


SYMBOLS: dict[str, Draw] = {
    "bolt": _bolt,
    "rest": _rest,
    "pause": _pause,
    "down": _arrow_down,
    "danger": _danger,
    "nothing": _nothing,
    "dots": _dots,
    "open": _open,
    "again": _again,
    "play": _play,
    "tick": _rest,
    "cross": _cross,
    "hand": _hand,
    "question": _question,
}
