"""Texts of a plot: with a halo of the ground, placed beside their curves where they cover neither data nor each other."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QBrush, QFont, QFontMetricsF, QPainter, QPainterPath, QPen
from PySide6.QtWidgets import QGraphicsSimpleTextItem

from app.gui.face import px, text_font
from app.gui.plots.picture import color_of
from model import Array

HALO_PX, LABEL_SEPARATOR = 4, "  "
GAP_PX = 5
PLACES_ALONG = 24
"""Number of places along a curve at which its label may stand."""

FREE_PX = 2
"""Distance of a label from another one."""

SAME_PX = 1.0
"""Curves that are not further apart are drawn as one, and a label may stand at either."""


class Label(QGraphicsSimpleTextItem):
    """A text with a halo, so that it can be read over lines."""

    def __init__(self, parent: Any, kind: str = "key") -> None:
        super().__init__(parent)
        self._kind, self.tone = kind, "text"
        self.setZValue(20)
        self.setCacheMode(self.CacheMode.DeviceCoordinateCache)  # a halo costs more than a curve

    def show_text(self, text: str, tone: str = "text") -> QRectF:
        """Set text and colour in the font in use; return its rectangle."""
        self.tone = tone
        self.setFont(text_font(self._kind))
        self.setText(text)
        self.setBrush(QBrush(color_of(tone)))
        return self.boundingRect()

    def paint(self, painter: QPainter, option: Any, widget: Any = None) -> None:
        path = QPainterPath()
        path.addText(QPointF(0, QFontMetricsF(self.font()).ascent()), self.font(), self.text())
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.strokePath(path, QPen(color_of("surface"), px(HALO_PX)))
        super().paint(painter, option, widget)


class Placer:
    """Places texts in an area, in pixels; `obstacles` are the points (N, 2) of the drawn curves and symbols."""

    def __init__(self, area: QRectF, obstacles: Array) -> None:
        self.area, self._obstacles = area, obstacles
        self.taken: list[QRectF] = []

    def place(self, size: QRectF, wishes: Iterable[QPointF], covers: bool = True) -> QPointF | None:
        """Return the wished place, best first, that covers least, or without `covers` nothing; None if each lies over a text or the edge."""
        best: tuple[float, QPointF] | None = None
        for rank, at in enumerate(wishes):
            rect = QRectF(at, size.size())
            if not self.area.contains(rect) or any(rect.intersects(each) for each in self.taken):
                continue
            covered = self._covered(rect)
            cost = covered + 0.02 * rank
            if (covers or not covered) and (best is None or cost < best[0]):
                best = cost, at
            if cost < 0.5:
                break
        if best is None:
            return None
        self.take(QRectF(best[1], size.size()))
        return best[1]

    def avoid(self, points: Sequence[tuple[float, float]]) -> None:
        """Add obstacles."""
        self._obstacles = np.concatenate((self._obstacles, np.reshape(points, (-1, 2))))

    def take(self, rect: QRectF) -> None:
        """Keep other texts off a rectangle."""
        self.taken.append(rect.adjusted(-FREE_PX, -FREE_PX, FREE_PX, FREE_PX))

    def _covered(self, rect: QRectF) -> float:
        if not self._obstacles.size:
            return 0.0
        x, y = self._obstacles.T
        inside = (x > rect.left()) & (x < rect.right()) & (y > rect.top()) & (y < rect.bottom())
        return float(inside.sum())


def beside(at: QPointF, size: QRectF, area: QRectF, first: str = "right") -> list[QPointF]:
    """Return the places of a text beside a point of an area; the preferred side is the first."""
    gap, width, height = px(GAP_PX) + px(8), size.width(), size.height()
    left, right, middle = at.x() - gap - width, at.x() + gap, at.y() - height / 2
    centre = min(max(at.x() - width / 2, area.left()), area.right() - width)
    above, below = at.y() - gap - height, at.y() + gap
    places = {
        "right": QPointF(right, middle),
        "left": QPointF(left, middle),
        "above": QPointF(centre, above),
        "right-above": QPointF(right, above),
        "left-above": QPointF(left, above),
    }
    lower = (QPointF(x, below + rows * height / 2) for rows in range(4) for x in (right, left, centre))
    return [places.pop(first), *places.values(), *lower]


def along(points: Array, size: QRectF, from_left: bool) -> Iterator[QPointF]:
    """Yield the places of a text along a curve, (N, 2) in pixels: above and below it, from one end."""
    gap, width, height = px(GAP_PX), size.width(), size.height()
    for at in np.linspace(*((0.1, 0.95) if from_left else (0.88, 0.05)), PLACES_ALONG) * (len(points) - 1):
        x, y = points[round(at)]
        yield QPointF(x + gap, y - gap - height)
        yield QPointF(x - gap - width, y - gap - height)
        yield QPointF(x - gap - width, y + gap)
        yield QPointF(x + gap, y + gap)


def nearest_to(own: Array, others: Array, places: Iterable[QPointF], size: QRectF) -> Iterator[QPointF]:
    """Yield the places at which a text is as near to its own curve as to any other; curves are points (N, 2) in pixels."""
    for at in places:
        rect = QRectF(at, size.size())
        if not others.size or _distance(rect, own) <= _distance(rect, others) + SAME_PX:
            yield at


def _distance(rect: QRectF, points: Array) -> float:
    x, y = points.T
    across = np.maximum(np.maximum(rect.left() - x, x - rect.right()), 0.0)
    return float(np.hypot(across, np.maximum(np.maximum(rect.top() - y, y - rect.bottom()), 0.0)).min())


def fitting_text(text: str, width: float, font: QFont) -> str:
    """Return the text if it fits into a width, else its last word, else nothing."""
    metrics = QFontMetricsF(font)
    for each in (text, text.rpartition(" ")[2]):
        if metrics.horizontalAdvance(each) <= width:
            return each
    return ""
