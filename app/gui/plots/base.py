"""What all plots share: quiet axes in the theme's colours, SIMULATED in the corner, and ranges that do not twitch.

The two ways to state an amplitude over frequency: their names, their symbols, and how a legend shows them.

What the plots of a run's results have in common: one plot under a head line, with what it says in its corners.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QSize, Qt
from PySide6.QtGui import QBrush, QColor, QFont, QFontMetricsF, QIcon, QPainter, QPainterPath, QPen, QPixmap
from PySide6.QtWidgets import QGraphicsPathItem, QGraphicsSimpleTextItem, QLayout, QVBoxLayout, QWidget

from app.gui.plots.copy import PlotCopyButtons
from app.gui.widgets.theme import Theme
from protocols.base.protocol import Protocol

Array = NDArray[np.float64]

MAX_LEGEND_SHARE = 0.5
"""Of a plot's height that a legend may take from what is drawn."""

TICK_LINES = 0.85
"""How many lines of writing a tick takes: figures are lower than a line."""

LABEL_ON_LINE = {"position": 0.01, "anchors": [(0, 1), (0, 1)]}
"""Where a line is named: at its left end, above it. A response comes down to it at the other."""

CURVE_COLORS = ("#8e44ad", "#b9770e", "#138d75", "#c2185b", "#5d6d7e", "#2e7d32", "#a0522d", "#00838f")


def trace_pen(color: str) -> QPen:
    """One pixel wide whatever the scaling: a wider pen costs more than the data (docs/decisions/0006-live-plot.md)."""
    pen = QPen(QColor(color))
    pen.setWidth(1)
    pen.setCosmetic(True)
    return pen


def curve_color(index: int, theme: Theme) -> QColor:
    """The colour of the n-th thing among several."""
    colour = QColor(CURVE_COLORS[index % len(CURVE_COLORS)])
    return colour.lighter(160) if theme.dark else colour


def style_axes(plot: Any, font: QFont) -> None:
    """Take from a plot item what a reader cannot use, and leave a strip above it for `CornerLabel`s."""
    plot.setMenuEnabled(False)
    plot.hideButtons()
    plot.setMouseEnabled(x=False, y=False)
    plot.disableAutoRange()
    strip = QFontMetricsF(font).height() + 2
    plot.titleLabel.setMaximumHeight(strip)
    plot.layout.setRowFixedHeight(0, strip)
    for side in ("left", "bottom"):
        axis = plot.getAxis(side)
        axis.enableAutoSIPrefix(False)
        axis.setStyle(tickFont=font)
        axis.label.setFont(font)
    plot.getViewBox().sigResized.connect(lambda box: _hide_long_name(plot.getAxis("left"), box.height()))


def _hide_long_name(axis: Any, height: float) -> None:
    """An axis that is lower than its name is long has none: half of it would be cut off."""
    axis.label.setVisible(bool(axis.labelText) and axis.label.boundingRect().width() <= height)


def apply_plot_theme(plot: Any, theme: Theme) -> None:
    """Give a plot item the theme's colours."""
    for side in ("left", "bottom"):
        axis = plot.getAxis(side)
        axis.setPen(pg.mkPen(theme.line))
        axis.setTextPen(pg.mkPen(theme.text))
        axis.label.setDefaultTextColor(QColor(theme.text))


class CornerLabel:
    """A word in the strip above a plot, at its left or right end, where no trace runs through it."""

    def __init__(self, plot: Any, text: str, font: QFont, right: bool) -> None:
        self._plot, self._right = plot, right
        self._text = text
        self._item = QGraphicsSimpleTextItem(text, plot)
        self._item.setFont(font)
        plot.getViewBox().sigResized.connect(self._place_label)
        self._place_label()

    def set_color(self, color: str) -> None:
        self._item.setBrush(QBrush(QColor(color)))

    def set_text(self, text: str) -> None:
        if text != self._text:
            self._text = text
            self._item.setText(text)
            self._place_label()

    @property
    def text(self) -> str:
        return self._text

    def set_visible(self, visible: bool) -> None:
        self._item.setVisible(visible)

    @property
    def visible(self) -> bool:
        return bool(self._item.isVisible())

    def _place_label(self, *_: object) -> None:
        box = self._plot.getViewBox().geometry()
        if not self._right:  # the other end is SIMULATED's
            room = max(box.width() - 8 * QFontMetricsF(self._item.font()).averageCharWidth() - 80, 40)
            metrics = QFontMetricsF(self._item.font())
            self._item.setText(metrics.elidedText(self._text, Qt.TextElideMode.ElideRight, room))
        left = box.right() - self._item.boundingRect().width() if self._right else box.left()
        self._item.setPos(max(left, 0), box.top() - self._item.boundingRect().height())


def simulated_label(plot: Any, font: QFont) -> CornerLabel:
    """SIMULATED in the corner of a plot, so that no picture of it can be taken for a measurement."""
    bold = QFont(font)
    bold.setBold(True)
    return CornerLabel(plot, "SIMULATED", bold, right=True)


def legend_share(legend: Any, plot: Any) -> float:
    """How much of a plot's height the legend in its upper corner takes, so that a range can leave that to it."""
    if not len(legend.items):
        return 0.0
    legend.updateSize()
    height = float(plot.getViewBox().height())
    return min((float(legend.boundingRect().height()) + 8) / max(height, 1.0), MAX_LEGEND_SHARE)


class BandFill(QGraphicsPathItem):
    """The ground between two curves, translucent: where a curve lies within its errors."""

    ALPHA = 56

    def __init__(self, plot: Any) -> None:
        super().__init__()
        self.setPen(QPen(Qt.PenStyle.NoPen))
        self.setZValue(-10)
        self.ends: tuple[Array, Array, Array] | None = None
        """What is drawn: x, lower and upper end, each (N,)."""
        plot.addItem(self, ignoreBounds=True)

    def set_color(self, color: str) -> None:
        fill = QColor(color)
        fill.setAlpha(self.ALPHA)
        self.setBrush(QBrush(fill))

    def show_between(self, x: Array, low: Array, high: Array) -> None:
        """Fill between two curves over x; a stretch where one of them is nowhere stays empty."""
        self.ends = (x, low, high)
        path = QPainterPath()
        there = np.isfinite(low) & np.isfinite(high)
        for part in np.split(np.arange(x.size), np.flatnonzero(np.diff(there)) + 1):
            if part.size > 1 and there[part[0]]:
                around = np.concatenate((low[part], high[part][::-1]))
                path.addPath(pg.arrayToQPath(np.concatenate((x[part], x[part][::-1])), around))
        self.setPath(path)

    def clear(self) -> None:
        """Nothing is known of the errors."""
        self.ends = None
        self.setPath(QPainterPath())


def stable_range(low: float, high: float, current: tuple[float, float] | None) -> tuple[float, float]:
    """Limits that hold `low..high`: the present ones while they still fit and are not three times too wide."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return current or (-1.0, 1.0)
    span = max(high - low, 1e-3)
    if current is not None and current[0] <= low and high <= current[1] and current[1] - current[0] <= 3 * span:
        return current
    step = round_step(span, 10)
    return math.floor((low - 0.08 * span) / step) * step, math.ceil((high + 0.08 * span) / step) * step


def tick_spacing(low: float, high: float, max_ticks: float = 4.0) -> float:
    """The spacing of two to four ticks, or of less: more would run into each other in a low plot."""
    return round_step(max(high - low, 1e-9), max_ticks)


def limit_ticks(plot: Any, font: QFont) -> None:
    """As few ticks on the left axis as its height has room for, whatever its range and height become."""
    box, line = plot.getViewBox(), TICK_LINES * QFontMetricsF(font).height()

    def space(*_: object) -> None:
        low, high = box.viewRange()[1]
        spacing = tick_spacing(low, high, max(min(box.height() / line, 4.0), 1.0))
        plot.getAxis("left").setTickSpacing(spacing, spacing)

    box.sigResized.connect(space)
    box.sigYRangeChanged.connect(space)
    space()


def round_step(span: float, max_steps: float) -> float:
    """The smallest of 1, 2, 5 times a power of ten of which at most `most` fit into `span`."""
    decade = 10.0 ** math.floor(math.log10(span / max_steps))
    return next(decade * m for m in (1.0, 2.0, 5.0, 10.0) if span / (decade * m) <= max_steps)


def finite_max(values: NDArray[np.float64]) -> float:
    """The largest of those that are numbers; 0 where none is."""
    return float(np.max(values, where=np.isfinite(values), initial=0.0))


LEGEND_ICON_SIZE = QSize(46, 14)
"""Size of a legend's sample."""


@dataclass(frozen=True, slots=True)
class AmplitudeSeries:
    """One way to state the amplitude: its name, its symbol, its line, and its column times a factor."""

    label: str
    symbol: str
    line: Qt.PenStyle
    size_px: int
    column: str
    factor: float


SERIES = (
    AmplitudeSeries("max − min", "o", Qt.PenStyle.SolidLine, 11, "peak_to_peak", 1e6),
    AmplitudeSeries("2 × fundamental", "s", Qt.PenStyle.DashLine, 6, "fundamental", 2e6),
)


def is_response_protocol(kind: type[Protocol]) -> bool:
    """Whether a protocol's points are amplitudes over frequency."""
    return all(hasattr(kind.point_type, series.column) for series in SERIES)


def legend_icon(series: AmplitudeSeries, line: str, color: str, ratio: float) -> QIcon:
    """Symbol and line as a legend shows them, on a screen with `ratio` pixels to a point."""
    pixmap = QPixmap(LEGEND_ICON_SIZE * ratio)
    pixmap.setDevicePixelRatio(ratio)
    pixmap.fill(Qt.GlobalColor.transparent)
    painter = QPainter(pixmap)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(QPen(QColor(line), 1.8, series.line))
    painter.drawLine(QPointF(15, 7), QPointF(45, 7))
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(QColor(color))
    if series.symbol == "o":
        painter.drawEllipse(QPointF(6, 7), 4.5, 4.5)
    else:
        painter.drawRect(3, 4, 6, 6)
    painter.end()
    return QIcon(pixmap)


AXIS_WIDTH = 62


class PlotBase(QWidget):
    """`_table` gives what it shows as text; `_add_head` is called with the head line once that is made."""

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme = theme
        self.canvas = pg.PlotWidget(enableMenu=False)
        self._plot = self.canvas.getPlotItem()
        style_axes(self._plot, self.font())
        self._plot.getAxis("left").setWidth(AXIS_WIDTH)
        self._plot.setContentsMargins(0, 0, 8, 0)
        self._plot.showGrid(x=True, y=True, alpha=0.12)  # drawn once a point, not once a frame
        self.simulated_label = simulated_label(self._plot, self.font())
        self.estimates_label = CornerLabel(self._plot, "", self.font(), right=False)
        self.copy_buttons = PlotCopyButtons(self.canvas, self._table)
        self._layout = QVBoxLayout(self)
        self._layout.setContentsMargins(0, 0, 0, 0)
        self._layout.setSpacing(2)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self._theme = theme
        self.canvas.setBackground(theme.panel)
        apply_plot_theme(self._plot, theme)
        self.simulated_label.set_color(theme.simulated)
        self.estimates_label.set_color(theme.text)

    def show_simulated(self, simulated: bool) -> None:
        self.simulated_label.set_visible(simulated)

    def _table(self) -> str:
        raise NotImplementedError

    def _add_head(self, head: QLayout) -> None:
        self._layout.addLayout(head)
        self._layout.addWidget(self.canvas, 1)
