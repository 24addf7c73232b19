"""Painting of own widgets: their painter, texts, rounded boxes, and the ring around the one that has the keyboard."""

from collections.abc import Iterator
from contextlib import contextmanager

from PySide6.QtCore import QPointF, QRect, QRectF, Qt
from PySide6.QtGui import QColor, QPaintDevice, QPainter, QPen

from app.gui.face.typeface import px, text_font

LEFT = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter
CENTRE = Qt.AlignmentFlag.AlignCenter
RING_PX = 2.0


@contextmanager
def painting(device: QPaintDevice) -> Iterator[QPainter]:
    """Yield the painter of a widget or picture, with smooth edges, and end it."""
    painter = QPainter(device)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    try:
        yield painter
    finally:
        painter.end()


def draw_text(
    painter: QPainter,
    area: QRectF | QRect,
    text: str,
    color: str | QColor,
    kind: str = "",
    align: Qt.AlignmentFlag = LEFT,
) -> int:
    """Draw a text of one of `KINDS`, and return its width."""
    painter.setFont(text_font(kind))
    painter.setPen(QColor(color))
    painter.drawText(QRectF(area), align, text)
    return painter.fontMetrics().horizontalAdvance(text)


def draw_box(
    painter: QPainter, area: QRectF, radius: float, fill: str | QColor, edge: str | QColor = "transparent", width: float = 1.0
) -> None:  # fmt: skip
    """Fill a box with rounded corners, and draw its edge."""
    painter.setBrush(QColor(fill))
    painter.setPen(QPen(QColor(edge), width))
    painter.drawRoundedRect(area, radius, radius)


def draw_ring(painter: QPainter, area: QRectF | QRect, color: str | QColor) -> None:
    """Draw the keyboard focus ring inside an area, at a fixed offset from the focused item."""
    draw_box(painter, QRectF(area).adjusted(1, 1, -1, -1), px(4), "transparent", color, RING_PX)


def draw_hatch(painter: QPainter, area: QRectF, color: str | QColor, ground: QColor, step: float = 16.0) -> None:
    """Fill an area with diagonal stripes on a ground."""
    painter.save()
    painter.setClipRect(area)
    painter.fillRect(area, ground)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    width, over = px(step), px(step)
    painter.setPen(QPen(QColor(color), width * 0.5))
    height, at = area.height() + 2 * over, area.left() - area.height() - over
    while at < area.right() + over:
        painter.drawLine(QPointF(at, area.bottom() + over), QPointF(at + height, area.bottom() + over - height))
        at += 1.42 * width
    painter.restore()
