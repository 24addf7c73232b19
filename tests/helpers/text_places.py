"""Texts of a window with their places: widgets, and the texts and tick labels of plots; which of them are cut or overlap."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import QPoint, QRect, QRectF, Qt
from PySide6.QtGui import QPainter, QPicture
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractScrollArea,
    QGraphicsSimpleTextItem,
    QGraphicsTextItem,
    QGraphicsView,
    QLabel,
    QWidget,
)

SLACK_PX = 2
"""Overlap that nobody sees: texts have empty space around their letters."""


@dataclass(frozen=True)
class Place:
    """A text and where it stands."""

    text: str
    area: QRect
    clip: QRect
    """What its view shows."""
    group: int
    """Texts of different groups may lie over each other: an overlay covers a page."""


def visible_part(widget: QWidget) -> QRect:
    """Return the part of a widget that its ancestors show, in its own coordinates."""
    return widget.visibleRegion().boundingRect()


def plot_texts(view: QGraphicsView) -> Iterator[Place]:
    """Yield the texts of a plot in the coordinates of its viewport."""
    scene, clip = view.scene(), view.viewport().rect()
    for item in scene.items():
        if not item.isVisible() or item.opacity() == 0:
            continue
        if isinstance(item, pg.AxisItem):
            yield from _ticks(view, item)
        elif isinstance(item, QGraphicsTextItem | QGraphicsSimpleTextItem):
            text = item.toPlainText() if isinstance(item, QGraphicsTextItem) else item.text()
            if text.strip():
                yield Place(text, _in_view(view, item, item.boundingRect()), clip, id(view))


def _ticks(view: QGraphicsView, axis: Any) -> Iterator[Place]:
    picture = QPicture()
    painter = QPainter(picture)
    painter.setFont(axis.style["tickFont"] or axis.font())
    specs = axis.generateDrawSpecs(painter)
    painter.end()
    for rect, flags, text in specs[2] if specs is not None else ():
        if text:
            width = axis_text_width(axis, text)
            tight = QRectF(rect)
            if flags & Qt.AlignmentFlag.AlignRight:
                tight.setLeft(rect.right() - width)
            yield Place(text, _in_view(view, axis, tight), view.viewport().rect(), id(view))


def axis_text_width(axis: Any, text: str) -> float:
    """Return the width of a tick label."""
    from PySide6.QtGui import QFontMetricsF

    return QFontMetricsF(axis.style["tickFont"] or axis.font()).horizontalAdvance(text)


def _in_view(view: QGraphicsView, item: Any, rect: QRectF) -> QRect:
    return view.mapFromScene(item.mapRectToScene(rect)).boundingRect()


def faults_of_plot(view: QGraphicsView) -> Iterator[str]:
    """Yield the texts of a plot that are cut, or overlap."""
    places = list(plot_texts(view))
    for place in places:
        if not place.clip.adjusted(-SLACK_PX, -SLACK_PX, SLACK_PX, SLACK_PX).contains(place.area):
            yield f"{place.text!r} is cut: {place.area.getRect()} of {place.clip.getRect()}"
    yield from _overlaps(places)


def widget_texts(window: QWidget) -> Iterator[Place]:
    """Yield the texts of labels and buttons with what is seen of them, in the coordinates of the window."""
    for widget in window.findChildren(QWidget):
        if not widget.isVisible() or not isinstance(widget, QLabel | QAbstractButton):
            continue
        text = widget.text()
        seen = visible_part(widget)
        if text and not seen.isEmpty():
            where = seen.translated(widget.mapTo(window, QPoint(0, 0)))
            yield Place(text, where, window.rect(), _layer(widget))


def _layer(widget: QWidget) -> int:
    """Return what a widget lies in: an overlay, a scroll area, or the window."""
    from app.gui.widgets import OverlayCard

    at: QWidget | None = widget
    while at is not None:
        if isinstance(at, OverlayCard | QAbstractScrollArea):
            return id(at)
        at = at.parentWidget()
    return 0


def faults_of_window(window: QWidget) -> Iterator[str]:
    """Yield the texts of a window that overlap, and the faults of its visible plots."""
    yield from _overlaps(list(widget_texts(window)))
    for view in window.findChildren(QGraphicsView):
        if view.isVisible() and not view.visibleRegion().isEmpty():
            for fault in faults_of_plot(view):
                yield f"{view.accessibleName() or type(view).__name__}: {fault}"


def _overlaps(places: list[Place]) -> Iterator[str]:
    for one, other in combinations(places, 2):
        if one.group != other.group:
            continue
        shared = one.area.intersected(other.area)
        if shared.width() > SLACK_PX and shared.height() > SLACK_PX:
            yield f"{one.text!r} overlaps {other.text!r} by {shared.width()} x {shared.height()}"
