"""Axes of a plot: round ticks with space between them, horizontal titles with units, horizontal grid lines, no box."""

import math
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QFontMetricsF, QPainter

from app.common import number_text
from app.gui.face import LABEL_PX, px, text_font, text_width
from app.gui.plots.labels import Label
from app.gui.plots.picture import color_of

X_GAP_PX, Y_GAP_PX = 48, 28
"""Least distance of two ticks with labels."""

MOST_TICKS = {"left": 8, "bottom": 12}

DATE_STEPS = (("D", 1, (1, 2, 7, 14)), ("M", 28, (1, 2, 3, 6)), ("Y", 365, (1, 2, 5, 10, 20, 50, 100, 1000)))
"""Units of dates as numpy names them, their least length in days, and the numbers of them between two ticks."""

WIDEST_DATE, LAST_DATE_S = "28 Mar 88", 2.5e11

LEFT_PX, RIGHT_PX, TITLE_PX, TITLE_ROW_PX, TICK_PX = 44, 12, 25, 17, 4
"""Width of the left axis and of the space at the right, height of the rows of a vertical and of a horizontal axis' title, length of a tick."""

LABEL_GAP_PX = 12
"""Space between two dates; numbers that are moved into view keep half of it."""

DAY_S = 86400.0
ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)
ROUND_ON_LOG = (1.0, 2.0, 5.0)


def round_step(span: float, max_steps: float) -> float:
    """Return the smallest of 1, 2, 2.5, 5 times a power of ten that fits at most `max_steps` times into `span`."""
    decade = 10.0 ** math.floor(math.log10(span / max_steps))
    return next(decade * each for each in (*ROUND, 20.0) if span / (decade * each) <= max_steps * (1 + 1e-9))


def stable_range(low: float, high: float, current: tuple[float, float] | None) -> tuple[float, float]:
    """Return axis limits around `low..high`: the current ones while they still fit and are at most three times too wide."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return current or (-1.0, 1.0)
    span = max(high - low, 1e-3 * max(abs(low), abs(high)), 1e-12)
    if current is not None and current[0] <= low and high <= current[1] and current[1] - current[0] <= 3 * span:
        return current
    step = round_step(span, 10)
    return math.floor((low - 0.08 * span) / step) * step, math.ceil((high + 0.08 * span) / step) * step


class PlotAxis(pg.AxisItem):  # type: ignore[misc]  # pyqtgraph has no types
    """The horizontal axis has its line, ticks and title; the vertical one labels only, and the panel's grid lines at them."""

    def __init__(self, side: str) -> None:
        self._side = side
        super().__init__(side)
        self.enableAutoSIPrefix(False)
        # Half of a label lies beyond the end of a horizontal axis: what reaches further than this is not painted.
        self.setStyle(autoExpandTextSpace=False, autoReduceTextSpace=False, hideOverlappingLabels=px(X_GAP_PX))
        self.is_log = self.has_dates = False
        self.scale_by = 1.0
        """Factor of the labels."""
        self.fixed: tuple[float, ...] = ()
        self.labelled = True
        self.ends_above = False
        """Whether another panel's title follows below a vertical axis."""
        self.heading = Label(self)
        """Title of the horizontal axis, at its right end below its labels: it covers no number."""
        self.show_theme()

    def show_theme(self) -> None:
        """Use the colours and the text size in use."""
        self.setTickFont(text_font())
        self.setPen(pg.mkPen(color_of("outline")))
        self.setTextPen(pg.mkPen(color_of("text2")))
        if self._side == "bottom":
            self.show_title(self.heading.text())

    def show_title(self, title: str) -> None:
        self.heading.show_text(title if self.labelled else "")
        rows = px(LABEL_PX) + px(8) + px(TITLE_ROW_PX) * bool(title)
        self.setHeight(rows + px(TICK_PX) if self.labelled else 1)
        self.picture = None
        self.update()

    def update(self, *_part: Any) -> None:
        """Paint everything anew: of a cached item that is moved and changed at once, Qt paints the newly visible part only."""
        self.setCacheMode(self.CacheMode.NoCache)
        self.setCacheMode(self.CacheMode.DeviceCoordinateCache)
        super().update()

    def resizeEvent(self, _event: Any = None) -> None:
        if "heading" not in vars(self):  # pyqtgraph sets its size while it is made
            return
        self.picture = None  # its labels are at the places of the size before
        self.update()
        size = self.heading.boundingRect()
        self.heading.setPos(self.size().width() - size.width(), px(TICK_PX) + px(TITLE_ROW_PX))

    def places(self) -> list[tuple[float, str]]:
        """Return the ticks: the place on the axis, in view coordinates, and its label."""
        low, high = self.range
        length = self.size().width() if self._side == "bottom" else self.size().height()
        if not (math.isfinite(low) and math.isfinite(high)) or high <= low or length <= 0:
            return []
        if self.fixed:
            least = px(Y_GAP_PX) / 2
            values = [v for v in self.fixed if low <= v <= high]
            if any((b - a) / (high - low) * length < least for a, b in pairwise(values)):
                values = values[len(values) // 2 :][:1]
            return [(v, number_text(v * self.scale_by)) for v in values]
        gap: float = px(X_GAP_PX if self._side == "bottom" else Y_GAP_PX)
        if self.has_dates:
            gap = px(LABEL_GAP_PX) + text_width(WIDEST_DATE)
        count = min(max(length / gap, 1.0), MOST_TICKS[self._side])
        if self.is_log:
            return _log_places(low, high, count)
        if self.has_dates:
            return _date_places(low, high, count)
        span = (high - low) * self.scale_by
        step = round_step(span, count)
        first, last = math.ceil(low * self.scale_by / step - 1e-9), math.floor(high * self.scale_by / step + 1e-9)
        digits = 2 + math.ceil(math.log10(max(abs(first), abs(last), 1) + 1))
        return [(at * step / self.scale_by, number_text(at * step, max(digits, 3))) for at in range(first, last + 1)]

    def generateDrawSpecs(self, _painter: QPainter) -> Any:
        """Return line, ticks and labels as pyqtgraph draws them."""
        bounds = self.mapRectFromParent(self.geometry())
        low, high = self.range
        metrics = QFontMetricsF(text_font())
        ticks, texts = [], []
        flags = Qt.AlignmentFlag.AlignVCenter
        for value, text in self.places():
            share, width = (value - low) / (high - low), metrics.horizontalAdvance(text) + 2
            if self._side == "left":
                y = bounds.bottom() - share * bounds.height()
                if self.ends_above and bounds.bottom() - y < metrics.height() / 2:
                    continue
                rect = QRectF(bounds.right() - px(6) - width, y - metrics.height() / 2, width, metrics.height())
                texts.append((rect, flags | Qt.AlignmentFlag.AlignRight, text))
                continue
            x = bounds.left() + share * bounds.width()
            ticks.append((self.pen(), QPointF(x, bounds.top()), QPointF(x, bounds.top() + px(TICK_PX))))
            rect = QRectF(x - width / 2, bounds.top() + px(TICK_PX) + 1, width, metrics.height())
            rect.moveRight(min(rect.right(), bounds.right() + px(RIGHT_PX) - 2))
            reaches_out = self.has_dates and rect.left() < bounds.left()  # onto the lowest label of the vertical axis
            touches = bool(texts) and rect.left() < texts[-1][0].right() + px(LABEL_GAP_PX) / 2
            if self.labelled and not reaches_out and not touches:
                texts.append((rect, flags | Qt.AlignmentFlag.AlignHCenter, text))
        none = pg.mkPen(None)
        pen = self.pen() if self._side == "bottom" and self.labelled else none
        return (pen, bounds.topLeft(), bounds.topRight()), ticks if self.labelled else [], texts

    def needed_width(self) -> int:
        """Return the width that the labels of a vertical axis need."""
        metrics = QFontMetricsF(text_font())
        widths = (metrics.horizontalAdvance(text) for _, text in self.places())
        return max(px(LEFT_PX), math.ceil(max(widths, default=0.0)) + px(10))


def _log_places(low: float, high: float, count: float) -> list[tuple[float, str]]:
    decades = range(math.floor(low), math.ceil(high) + 1)
    every = [(d + math.log10(m), m * 10.0**d) for d in decades for m in ROUND_ON_LOG]
    shown = [(place, value) for place, value in every if low - 1e-9 <= place <= high + 1e-9]
    if len(shown) > count:
        shown = [(p, v) for p, v in shown if abs(p - round(p)) < 1e-9]
    stride = max(math.ceil(len(shown) / max(count, 1)), 1)
    return [(p, number_text(v, 3)) for p, v in shown[::stride]]


def _date_places(low: float, high: float, count: float) -> list[tuple[float, str]]:
    """Return the first moments of days, months or years between two times in seconds since 1970, about `count` of them."""
    days = (high - low) / DAY_S
    unit, step = next(
        ((unit, step) for unit, length, steps in DATE_STEPS for step in steps if days <= count * length * step),
        ("Y", DATE_STEPS[-1][-1][-1]),
    )
    first, last = np.array([low, high]).astype("datetime64[s]").astype(f"datetime64[{unit}]").astype(int)
    units = np.arange(math.ceil(first / step) * step, last + 1, step)
    dates = units.astype(f"datetime64[{unit}]")
    times = dates.astype("datetime64[s]").astype(float)
    shown = zip(times, dates, strict=True)
    return [
        (float(t), str(date) if unit == "Y" else _day(t))
        for t, date in shown
        if max(low, 0.0) <= t <= min(high, LAST_DATE_S)
    ]


def _day(time_s: float) -> str:
    at = datetime.fromtimestamp(time_s, UTC)
    return f"{at.day} {at:%b}" if at.year == datetime.now(UTC).year else f"{at.day} {at:%b %y}"
