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

from app.gui.plots.copy import Copying
from app.gui.widgets.theme import Theme
from protocols.base.protocol import Protocol

Array = NDArray[np.float64]

MOST_OF_IT = 0.5
"""Of a plot's height that a legend may take from what is drawn."""

TICK_LINES = 0.85
"""How many lines of writing a tick takes: figures are lower than a line."""

LABEL_ON_LINE = {"position": 0.01, "anchors": [(0, 1), (0, 1)]}
"""Where a line is named: at its left end, above it. A response comes down to it at the other."""

INKS = ("#8e44ad", "#b9770e", "#138d75", "#c2185b", "#5d6d7e", "#2e7d32", "#a0522d", "#00838f")


def trace_pen(colour: str) -> QPen:
    """One pixel wide whatever the scaling: a wider pen costs more than the data (docs/decisions/0006-live-plot.md)."""
    pen = QPen(QColor(colour))
    pen.setWidth(1)
    pen.setCosmetic(True)
    return pen


def ink(at: int, theme: Theme) -> QColor:
    """The colour of the n-th thing among several."""
    colour = QColor(INKS[at % len(INKS)])
    return colour.lighter(160) if theme.dark else colour


def quiet(plot: Any, font: QFont) -> None:
    """Take from a plot item what a reader cannot use, and leave a strip above it for `Corner`s."""
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
    plot.getViewBox().sigResized.connect(lambda box: _name_where_it_fits(plot.getAxis("left"), box.height()))


def _name_where_it_fits(axis: Any, height: float) -> None:
    """An axis that is lower than its name is long has none: half of it would be cut off."""
    axis.label.setVisible(bool(axis.labelText) and axis.label.boundingRect().width() <= height)


def paint(plot: Any, theme: Theme) -> None:
    """Give a plot item the theme's colours."""
    for side in ("left", "bottom"):
        axis = plot.getAxis(side)
        axis.setPen(pg.mkPen(theme.line))
        axis.setTextPen(pg.mkPen(theme.text))
        axis.label.setDefaultTextColor(QColor(theme.text))


class Corner:
    """A word in the strip above a plot, at its left or right end, where no trace runs through it."""

    def __init__(self, plot: Any, words: str, font: QFont, right: bool) -> None:
        self._plot, self._right = plot, right
        self._words = words
        self._item = QGraphicsSimpleTextItem(words, plot)
        self._item.setFont(font)
        plot.getViewBox().sigResized.connect(self._place)
        self._place()

    def colour(self, ink: str) -> None:
        self._item.setBrush(QBrush(QColor(ink)))

    def say(self, words: str) -> None:
        if words != self._words:
            self._words = words
            self._item.setText(words)
            self._place()

    @property
    def words(self) -> str:
        return self._words

    def show(self, visible: bool) -> None:
        self._item.setVisible(visible)

    @property
    def visible(self) -> bool:
        return bool(self._item.isVisible())

    def _place(self, *_: object) -> None:
        box = self._plot.getViewBox().geometry()
        if not self._right:  # the other end is SIMULATED's
            room = max(box.width() - 8 * QFontMetricsF(self._item.font()).averageCharWidth() - 80, 40)
            metrics = QFontMetricsF(self._item.font())
            self._item.setText(metrics.elidedText(self._words, Qt.TextElideMode.ElideRight, room))
        left = box.right() - self._item.boundingRect().width() if self._right else box.left()
        self._item.setPos(max(left, 0), box.top() - self._item.boundingRect().height())


def simulated_mark(plot: Any, font: QFont) -> Corner:
    """SIMULATED in the corner of a plot, so that no picture of it can be taken for a measurement."""
    bold = QFont(font)
    bold.setBold(True)
    return Corner(plot, "SIMULATED", bold, right=True)


def share_of(legend: Any, plot: Any) -> float:
    """How much of a plot's height the legend in its upper corner takes, so that a range can leave that to it."""
    if not len(legend.items):
        return 0.0
    legend.updateSize()
    height = float(plot.getViewBox().height())
    return min((float(legend.boundingRect().height()) + 8) / max(height, 1.0), MOST_OF_IT)


class Fill(QGraphicsPathItem):
    """The ground between two curves, translucent: where a curve lies within its errors."""

    ALPHA = 56

    def __init__(self, plot: Any) -> None:
        super().__init__()
        self.setPen(QPen(Qt.PenStyle.NoPen))
        self.setZValue(-10)
        self.ends: tuple[Array, Array, Array] | None = None
        """What is drawn: x, lower and upper end, each (N,)."""
        plot.addItem(self, ignoreBounds=True)

    def colour(self, ink: str) -> None:
        fill = QColor(ink)
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

    def empty(self) -> None:
        """Nothing is known of the errors."""
        self.ends = None
        self.setPath(QPainterPath())


def calm_range(low: float, high: float, present: tuple[float, float] | None) -> tuple[float, float]:
    """Limits that hold `low..high`: the present ones while they still fit and are not three times too wide."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return present or (-1.0, 1.0)
    span = max(high - low, 1e-3)
    if present is not None and present[0] <= low and high <= present[1] and present[1] - present[0] <= 3 * span:
        return present
    step = round_step(span, 10)
    return math.floor((low - 0.08 * span) / step) * step, math.ceil((high + 0.08 * span) / step) * step


def few_ticks(low: float, high: float, most: float = 4.0) -> float:
    """The spacing of two to four ticks, or of less: more would run into each other in a low plot."""
    return round_step(max(high - low, 1e-9), most)


def keep_ticks_apart(plot: Any, font: QFont) -> None:
    """As few ticks on the left axis as its height has room for, whatever its range and height become."""
    box, line = plot.getViewBox(), TICK_LINES * QFontMetricsF(font).height()

    def space(*_: object) -> None:
        low, high = box.viewRange()[1]
        spacing = few_ticks(low, high, max(min(box.height() / line, 4.0), 1.0))
        plot.getAxis("left").setTickSpacing(spacing, spacing)

    box.sigResized.connect(space)
    box.sigYRangeChanged.connect(space)
    space()


def round_step(span: float, most: float) -> float:
    """The smallest of 1, 2, 5 times a power of ten of which at most `most` fit into `span`."""
    decade = 10.0 ** math.floor(math.log10(span / most))
    return next(decade * m for m in (1.0, 2.0, 5.0, 10.0) if span / (decade * m) <= most)


def largest(values: NDArray[np.float64]) -> float:
    """The largest of those that are numbers; 0 where none is."""
    return float(np.max(values, where=np.isfinite(values), initial=0.0))


SAMPLE = QSize(46, 14)
"""Size of a legend's sample."""


@dataclass(frozen=True, slots=True)
class Series:
    """One way to state the amplitude: its name, its symbol, its line, and its column times a factor."""

    words: str
    symbol: str
    line: Qt.PenStyle
    size_px: int
    column: str
    factor: float


SERIES = (
    Series("max − min", "o", Qt.PenStyle.SolidLine, 11, "peak_to_peak", 1e6),
    Series("2 × fundamental", "s", Qt.PenStyle.DashLine, 6, "fundamental", 2e6),
)


def draws(kind: type[Protocol]) -> bool:
    """Whether a protocol's points are amplitudes over frequency."""
    return all(hasattr(kind.point_type, series.column) for series in SERIES)


def sample(series: Series, line: str, ink: str, ratio: float) -> QIcon:
    """Symbol and line as a legend shows them, on a screen with `ratio` pixels to a point."""
    pixmap = QPixmap(SAMPLE * ratio)
    pixmap.setDevicePixelRatio(ratio)
    pixmap.fill(Qt.GlobalColor.transparent)
    painter = QPainter(pixmap)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(QPen(QColor(line), 1.8, series.line))
    painter.drawLine(QPointF(15, 7), QPointF(45, 7))
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(QColor(ink))
    if series.symbol == "o":
        painter.drawEllipse(QPointF(6, 7), 4.5, 4.5)
    else:
        painter.drawRect(3, 4, 6, 6)
    painter.end()
    return QIcon(pixmap)


AXIS_WIDTH = 62


class FramedPlot(QWidget):
    """`_table` gives what it shows as text; `_under` is called with the head line once that is made."""

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme = theme
        self.canvas = pg.PlotWidget(enableMenu=False)
        self._plot = self.canvas.getPlotItem()
        quiet(self._plot, self.font())
        self._plot.getAxis("left").setWidth(AXIS_WIDTH)
        self._plot.setContentsMargins(0, 0, 8, 0)
        self._plot.showGrid(x=True, y=True, alpha=0.12)  # drawn once a point, not once a frame
        self.mark = simulated_mark(self._plot, self.font())
        self.found = Corner(self._plot, "", self.font(), right=False)
        self.copying = Copying(self.canvas, self._table)
        self._layout = QVBoxLayout(self)
        self._layout.setContentsMargins(0, 0, 0, 0)
        self._layout.setSpacing(2)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self._theme = theme
        self.canvas.setBackground(theme.panel)
        paint(self._plot, theme)
        self.mark.colour(theme.simulated)
        self.found.colour(theme.text)

    def show_simulated(self, simulated: bool) -> None:
        self.mark.show(simulated)

    def _table(self) -> str:
        raise NotImplementedError

    def _under(self, head: QLayout) -> None:
        self._layout.addLayout(head)
        self._layout.addWidget(self.canvas, 1)
