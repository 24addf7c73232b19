"""Base class of all plots: theme, axes, corner labels, SIMULATED mark, legend, perception threshold, copying."""

import math
from collections.abc import Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtGui import QBrush, QColor, QFont, QFontMetrics, QFontMetricsF, QPainterPath, QPen
from PySide6.QtWidgets import QGraphicsPathItem, QGraphicsSimpleTextItem, QLabel, QLayout, QWidget

from app.common import typeset
from app.gui.face import Tokens, tokens
from app.gui.plots.copy import PlotCopyButtons
from app.gui.plots.items import LogPlaced, place, place_end
from app.gui.plots.series import series_as_text, series_of
from app.gui.plots.threshold_items import ThresholdItems
from app.gui.plots.tools import PlotTools
from app.gui.plots.zoom import ZoomBox
from app.gui.widgets import Menu, column, make_label
from model import Array, Series, format_estimate
from protocols.base import RunEnded

if TYPE_CHECKING:
    from model.response import PerceptionThreshold

THRESHOLD_HZ = np.geomspace(1.0, 4000.0, 300)
"""Number of frequencies of the curve of a perception threshold."""

AXIS_WIDTH = 62
"""Width of the left axis in pixels, so that plots above each other share their left edge."""

TRACE_AXIS_WIDTH = 48

AXIS_MARGIN = 14
"""Ticks, and the distances between them, their labels and the name of an axis, in pixels."""

LEGEND_STYLE: dict[str, Any] = {"labelTextSize": "9pt", "verSpacing": -6}
MAX_LEGEND_SHARE = 0.5
"""Largest share of a plot's height reserved for its legend."""

MAX_LEGEND_ENTRIES = 12

MAX_LABELLED_TICKS, LARGEST_POWER = 5, 100

TICK_LINES = 0.85
"""Height of a tick label in lines of text: digits are lower than a line."""

CURVE_COLORS = ("#8e44ad", "#b9770e", "#138d75", "#c2185b", "#5d6d7e", "#2e7d32", "#a0522d", "#00838f")

CURVE_SYMBOLS = ("o", "s", "t1", "d", "t", "p", "star", "h")


def trace_pen(color: str) -> QPen:
    """Return a pen of one pixel at any scaling: a wider one costs more than the data (docs/decisions/0006-live-plot.md)."""
    pen = QPen(QColor(color))
    pen.setWidth(1)
    pen.setCosmetic(True)
    return pen


def curve_color(index: int) -> QColor:
    """Return the colour of the n-th of several curves."""
    colour = QColor(CURVE_COLORS[index % len(CURVE_COLORS)])
    return colour.lighter(160) if tokens().dark else colour


def curve_symbol(index: int) -> str:
    """Return the symbol of the n-th of several curves: shapes are distinguishable without colours."""
    return CURVE_SYMBOLS[index % len(CURVE_SYMBOLS)]


def style_axes(plot: Any, font: QFont) -> None:
    """Disable the menu, mouse and auto-range of a plot item, and reserve a strip above it for `CornerLabel`s."""
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
        axis.logTickStrings = log_tick_texts
    box = plot.getViewBox()
    for changed in (box.sigResized, box.sigYRangeChanged):  # a new range comes with a new name
        changed.connect(lambda *_: _shorten_long_name(plot.getAxis("left"), box.height()))


def color_axes(plot: Any) -> None:
    """Draw the axes of a plot in the colours in use."""
    theme = tokens()
    for side in ("left", "bottom"):
        axis = plot.getAxis(side)
        axis.setPen(pg.mkPen(theme.line))
        axis.setTextPen(pg.mkPen(theme.text))
        axis.label.setDefaultTextColor(QColor(theme.text))


def log_tick_texts(values: Sequence[float], scale: float, _spacing: float) -> list[str]:
    """Return the labels of the ticks of a logarithmic axis: 1, 2 and 5 of each decade, or all where there are few."""
    texts = []
    for value in values:
        if abs(value) > LARGEST_POWER:  # of the range before the axis became logarithmic
            texts.append("")
            continue
        number = 10.0**value * scale
        digit = round(number / 10.0 ** math.floor(math.log10(number) + 1e-9))
        texts.append(f"{number:.6g}" if digit in (1, 2, 5, 10) or len(values) <= MAX_LABELLED_TICKS else "")
    return texts


def _shorten_long_name(axis: Any, height: float) -> None:
    """Show the unit alone at a vertical axis that is shorter than its name, which would be cut off."""
    name = axis.labelText or ""
    width_of = QFontMetricsF(axis.label.font()).horizontalAdvance
    fitting = [each for each in (name, name.rpartition("(")[2].rstrip(")")) if each and width_of(each) + 8 <= height]
    shown = fitting[0] if fitting else ""
    if shown and axis.label.toPlainText().strip() != shown:
        axis.label.setHtml(axis.labelString().replace(name, shown, 1))
    axis.label.setVisible(bool(shown))
    axis.resizeEvent()  # places the name in the middle


class CornerLabel:
    """A text in the strip above a plot, where no trace crosses it: at the left, elided, or at the right, bold."""

    def __init__(self, plot: Any, text: str, font: QFont, right: bool) -> None:
        self._plot, self._right, self.text = plot, right, text
        self._item = QGraphicsSimpleTextItem(text, plot)
        font = QFont(font)
        font.setBold(right)
        self._item.setFont(font)
        plot.getViewBox().sigResized.connect(self._place_label)
        self._place_label()

    def set_color(self, color: str) -> None:
        self._item.setBrush(QBrush(QColor(color)))

    def set_text(self, text: str) -> None:
        if text != self.text:
            self.text = text
            self._item.setText(text)
            self._place_label()

    def set_visible(self, visible: bool) -> None:
        self._item.setVisible(visible)

    @property
    def visible(self) -> bool:
        return bool(self._item.isVisible())

    def _place_label(self, *_: object) -> None:
        box = self._plot.getViewBox().geometry()
        if not self._right:  # the right end is kept free for SIMULATED
            metrics = QFontMetricsF(self._item.font())
            width = max(box.width() - 8 * metrics.averageCharWidth() - 80, 40)
            self._item.setText(metrics.elidedText(self.text, Qt.TextElideMode.ElideRight, width))
        left = box.right() - self._item.boundingRect().width() if self._right else box.left()
        self._item.setPos(max(left, 0), box.top() - self._item.boundingRect().height())


def legend_share(legend: Any, plot: Any) -> float:
    """Return the share of a plot's height that the legend in its upper corner covers, so that a range can leave it free."""
    if not len(legend.items):
        return 0.0
    legend.updateSize()
    height = float(plot.getViewBox().height())
    return min((float(legend.boundingRect().height()) + 8) / max(height, 1.0), MAX_LEGEND_SHARE)


class BandFill(LogPlaced, QGraphicsPathItem):
    """A translucent band between two curves: the error band of a curve."""

    ALPHA = 56

    def __init__(self, plot: Any) -> None:
        super().__init__()
        self.setPen(QPen(Qt.PenStyle.NoPen))
        self.setZValue(-10)
        self.ends: tuple[Array, Array, Array] | None = None
        """x, lower and upper ends, each (N,), in the units of the axes."""
        plot.addItem(self, ignoreBounds=True)

    def set_color(self, color: str) -> None:
        fill = QColor(color)
        fill.setAlpha(self.ALPHA)
        self.setBrush(QBrush(fill))

    def show_band(self, x: Array, ends: Iterable[Array] | None) -> None:
        """Fill between lower and upper end over x, except where one of them is not finite; None: draw no band."""
        path = QPainterPath()
        self.ends = None
        if ends is not None:
            low, high = ends
            self.ends = (x, low, high)
            x, low, high = place(x, self._log[0]), *(place_end(end, self._log[1]) for end in (low, high))
            there = np.isfinite(x) & np.isfinite(low) & np.isfinite(high)
            for part in np.split(np.arange(x.size), np.flatnonzero(np.diff(there)) + 1):
                if part.size > 1 and there[part[0]]:
                    around = np.concatenate((low[part], high[part][::-1]))
                    path.addPath(pg.arrayToQPath(np.concatenate((x[part], x[part][::-1])), around))
        self.setPath(path)

    def _place_again(self) -> None:
        if self.ends is not None:
            self.show_band(self.ends[0], self.ends[1:])


def stable_range(low: float, high: float, current: tuple[float, float] | None) -> tuple[float, float]:
    """Return axis limits around `low..high`: the current ones while they still fit and are at most three times too wide."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return current or (-1.0, 1.0)
    span = max(high - low, 1e-3)
    if current is not None and current[0] <= low and high <= current[1] and current[1] - current[0] <= 3 * span:
        return current
    step = round_step(span, 10)
    return math.floor((low - 0.08 * span) / step) * step, math.ceil((high + 0.08 * span) / step) * step


def tick_spacing(low: float, high: float, max_ticks: float = 4.0) -> float:
    """Return the spacing of two to four ticks or fewer: more would overlap in a low plot."""
    return round_step(max(high - low, 1e-9), max_ticks)


def needed_axis_width(plot: Any, metrics: QFontMetrics) -> int:
    """Return the width that the left axis of a plot needs for its tick labels and its name, in pixels."""
    axis, (low, high) = plot.getAxis("left"), plot.getViewBox().viewRange()[1]
    spacing = round_step(max(high - low, 1e-12), 8)
    ends = [spacing * math.floor(low / spacing), spacing * math.ceil(high / spacing)]
    # The axis's own ticks may still have the spacing of an earlier range: of a much larger range there would be millions.
    texts = axis.tickStrings(ends, axis.autoSIPrefixScale * axis.scale, spacing)
    name = metrics.height() if axis.labelText else 0
    return max(map(metrics.horizontalAdvance, texts), default=0) + name + AXIS_MARGIN


def limit_ticks(plot: Any, font: QFont) -> None:
    """Limit the number of ticks on the left axis to the space of its height, also after a resize or a new range."""
    box, line = plot.getViewBox(), TICK_LINES * QFontMetricsF(font).height()

    def space(*_: object) -> None:
        low, high = box.viewRange()[1]
        spacing = tick_spacing(low, high, max(min(box.height() / line, 4.0), 1.0))
        plot.getAxis("left").setTickSpacing(spacing, spacing)

    box.sigResized.connect(space)
    box.sigYRangeChanged.connect(space)
    space()


def _set_log(plot: Any, x: bool, y: bool) -> None:
    # As PlotItem.setLogMode, which would also turn the automatic range on.
    for check, on in ((plot.ctrl.logXCheck, x), (plot.ctrl.logYCheck, y)):
        with QSignalBlocker(check):
            check.setChecked(on)  # for items that are added later
    for item in plot.items:
        if hasattr(item, "setLogMode"):
            item.setLogMode(x, y)
    for side in ("left", "bottom"):
        plot.getAxis(side).setLogMode(x, y)
    if isinstance(box := plot.getViewBox(), ZoomBox):
        box.set_log(x, y)


def round_step(span: float, max_steps: float) -> float:
    """Return the smallest of 1, 2, 5 times a power of ten that fits at most `max_steps` times into `span`."""
    decade = 10.0 ** math.floor(math.log10(span / max_steps))
    return next(decade * m for m in (1.0, 2.0, 5.0, 10.0) if span / (decade * m) <= max_steps)


def finite_max(values: Array) -> float:
    """Return the largest finite value; 0 without one."""
    return float(np.max(values, where=np.isfinite(values), initial=0.0))


def caption_label(text: str = "") -> QLabel:
    """Return a label in the style of a caption."""
    return make_label(text, "caption", wrap=False)


S = TypeVar("S", bound="PlotBase")


class PlotBase(QWidget):
    """A canvas with one plot, or with several, below an optional head row.

    Subclasses implement `_series`, and `_column_names` where the axis labels do not name the columns of a copied table.

    Args:
        canvas: a pyqtgraph view; without one, a single plot is made.
        plots: the plot items of `canvas`.
        axis_width: of the left axes, in pixels; None for as wide as the labels need.
        grid: draw a grid. It is slow to paint: only for plots that are painted once a point, not once a frame.
    """

    MAX_ESTIMATES: int | None = 3
    """Number of identified quantities that are named above the plot; None for all."""

    ACCESSIBLE_NAME = "plot"
    """Accessible name for a screen reader."""

    LOG_AXES = (True, True)
    """Whether x and y can be logarithmic: not where values are below zero by nature, such as a trace's."""

    def __init__(
        self,
        parent: QWidget | None = None,
        *,
        canvas: Any = None,
        plots: Sequence[Any] = (),
        axis_width: int | None = AXIS_WIDTH,
        grid: bool = False,
    ) -> None:
        super().__init__(parent)
        self._canvases: list[Any] = []
        self._plots: list[Any] = []
        self.aligned_plots: list[Any] = []
        """Plots of other widgets, above or below, whose left edges are kept in line with these."""
        self.copy_buttons: list[PlotCopyButtons] = []
        self.tools: list[PlotTools] = []
        self.canvas = pg.PlotWidget(viewBox=ZoomBox(), enableMenu=False) if canvas is None else canvas
        self._add_canvas(self.canvas, plots or (self.canvas.getPlotItem(),), axis_width)
        self.plot = self._plots[0]
        if grid:
            self.plot.showGrid(x=True, y=True, alpha=0.12)
        self.legend: Any = None
        self.threshold: ThresholdItems | None = None
        """The perception threshold, in a plot over frequency."""
        self.simulated_labels = [CornerLabel(plot, "SIMULATED", self.font(), right=True) for plot in self._plots]
        self.corner_labels = [CornerLabel(plot, "", self.font(), right=False) for plot in self._plots]
        self.simulated = True
        """Whether data are marked as simulated, in the plot and in copied tables."""
        self._layout = column(parent=self, spacing=2)

    @property
    def simulated_label(self) -> "CornerLabel":
        return self.simulated_labels[0]

    @property
    def corner_label(self) -> "CornerLabel":
        """The text above the plot, at the left."""
        return self.corner_labels[0]

    def apply_theme(self, theme: Tokens) -> None:
        """Apply a theme."""
        for canvas in self._canvases:
            canvas.setBackground(theme.surface)
        for plot in self._plots:
            color_axes(plot)
        for tools in self.tools:
            tools.apply_theme(theme)
        for simulated, text in zip(self.simulated_labels, self.corner_labels, strict=True):
            simulated.set_color(theme.violet)
            text.set_color(theme.text)
        if self.legend is not None:
            self.legend.setLabelTextColor(theme.text)
        if self.threshold is not None:
            self.threshold.apply_theme(theme)

    def show_simulated(self, simulated: bool) -> None:
        """Mark the plot as simulated, or not."""
        self.simulated = simulated
        for label in self.simulated_labels:
            label.set_visible(simulated)

    def show_estimates(self, outcome: RunEnded | None) -> None:
        """Write the identified quantities above the plot."""
        self.corner_label.set_text(self._estimates_text(outcome))

    def _estimates_text(self, outcome: RunEnded | None) -> str:
        estimates = () if outcome is None else outcome.estimates[: self.MAX_ESTIMATES]
        return typeset(",   ".join(format_estimate(estimate) for estimate in estimates))

    def _series(self) -> Iterable[Series]:
        """Return the data that are copied as a table."""
        raise NotImplementedError

    def _column_names(self) -> tuple[str, str]:
        """Return the names of x and y in a copied table."""
        return self.plot.getAxis("bottom").labelText, self.plot.getAxis("left").labelText

    def _table(self) -> str:
        return series_as_text(self._series(), *self._column_names(), self.simulated)

    def _add_canvas(self, canvas: Any, plots: Sequence[Any], axis_width: int | None) -> None:
        """Style the plots of a canvas and give it copy buttons; the caller lays it out."""
        canvas.setAccessibleName(self.ACCESSIBLE_NAME)
        for plot in plots:
            style_axes(plot, self.font())
            if axis_width is not None:
                plot.getAxis("left").setWidth(axis_width)
                plot.getViewBox().sigYRangeChanged.connect(partial(self._fit_axes, axis_width))
            if isinstance(plot.getViewBox(), ZoomBox):
                plot.setMouseEnabled(x=True, y=True)
        if len(plots) == 1:
            plots[0].setContentsMargins(0, 0, 8, 0)
        self._canvases.append(canvas)
        self._plots += plots
        self.copy_buttons.append(PlotCopyButtons(canvas, self._table))
        log_axes = self if canvas is self.canvas and any(self.LOG_AXES) else None
        self.tools.append(PlotTools(canvas, plots, self.copy_buttons[-1], self._fill_menu, log_axes))

    @property
    def log_axes(self) -> tuple[bool, bool]:
        """Whether x and y are logarithmic."""
        box = self._plots[0].getViewBox()
        return box.log if isinstance(box, ZoomBox) else (False, False)

    def set_log_axes(self, x: bool, y: bool) -> None:
        """Make the axes logarithmic or linear."""
        _set_log(self._plots[0], x, y)
        for plot in (*self._plots[1:], *self.aligned_plots):  # which share the x axis
            _set_log(plot, x, False)
        if self.threshold is not None:
            self.threshold.set_log(x, y)
        self._rescale()

    def _rescale(self) -> None:
        """Set the range anew where it does not follow from the range that was set last."""

    def _add_strip(self, strip: S, shares: tuple[int, int] | None = None) -> S:
        """Lay out a plot below this one, with its left edge in line and its x axis like this one's; `shares` of the height."""
        self._layout.addWidget(strip)
        for widget, share in zip((self.canvas, strip), shares or (), strict=False):
            self._layout.setStretch(self._layout.indexOf(widget), share)
        self.aligned_plots.append(strip.plot)
        strip.aligned_plots.append(self.plot)
        _set_log(strip.plot, self.log_axes[0], False)
        return strip

    def _fit_axes(self, least: int, *_: object) -> None:
        """Widen the left axes to their longest tick label, all alike, so that no label is printed over the axis's name."""
        widths = {needed_axis_width(plot, self.fontMetrics()) for plot in self._plots}
        width = max(least, *widths, *(needed_axis_width(plot, self.fontMetrics()) for plot in self.aligned_plots))
        for plot in (*self._plots, *self.aligned_plots):
            if plot.getAxis("left").width() != width:
                plot.getAxis("left").setWidth(width)

    def _fill_menu(self, menu: Menu) -> None:
        """Add entries of this kind of plot to its context menu."""

    def _add_head(self, head: QLayout | None = None) -> None:
        """Lay out the canvas, below a head row if there is one."""
        if head is not None:
            self._layout.addLayout(head)
        self._layout.addWidget(self.canvas, 1)

    def _add_legend(self, left: bool = True) -> None:
        self.legend = self.plot.addLegend(offset=(8 if left else -8, 4), **LEGEND_STYLE)

    def _add_threshold(self, labelled: bool, width: float = 1.0) -> ThresholdItems:
        """Add the skin's perception threshold, and the shade where vibration is uncomfortable."""
        self.threshold = ThresholdItems(self.plot, self.font(), labelled, width)
        return self.threshold

    def show_threshold(self, threshold: "PerceptionThreshold | None") -> None:
        """Show a perception threshold where the plot has one; None is the abdomen's."""
        items = self.threshold
        if items is None:
            return
        if threshold is None:
            items.show_level()
        elif len(threshold.frequency_hz) == 1:
            items.show_level(1e6 * threshold.amplitude_m[0], threshold.line_label)
        else:
            items.show_curve(THRESHOLD_HZ, 1e6 * threshold.amplitude_at(THRESHOLD_HZ), threshold.line_label)
        self._rescale()


class TracePlotBase(PlotBase):
    """Displacement above drive on one time axis; `curves` are the two lines in this order."""

    NAMES = ("displacement (µm)", "drive at the amplifier (V)")
    LOG_AXES = (False, False)

    def __init__(self, parent: QWidget | None = None, *, zooms: bool = True) -> None:
        canvas = pg.GraphicsLayoutWidget()
        canvas.ci.setContentsMargins(0, 0, 10, 0)
        canvas.ci.setSpacing(0)
        boxes = [{"viewBox": ZoomBox()} if zooms else {} for _ in range(2)]
        plots = [canvas.addPlot(row=row, col=0, enableMenu=False, **box) for row, box in enumerate(boxes)]
        super().__init__(parent, canvas=canvas, plots=plots, axis_width=TRACE_AXIS_WIDTH)
        plots[1].setXLink(plots[0])
        plots[1].setMouseEnabled(x=False, y=False)  # it follows the upper plot
        plots[0].getAxis("bottom").setStyle(showValues=False)
        self.tools[0].units = ("µm", "V")
        # One-pixel pens, no grid, no antialiasing, never raw samples: docs/decisions/0006-live-plot.md.
        self.curves = [pg.PlotCurveItem(antialias=False, skipFiniteCheck=True) for _ in plots]
        for plot, curve, label, name in zip(plots, self.curves, self.corner_labels, self.NAMES, strict=True):
            plot.addItem(curve)
            label.set_text(name)

    def apply_theme(self, theme: Tokens) -> None:
        super().apply_theme(theme)
        for curve, label, color in zip(self.curves, self.corner_labels, (theme.ink, theme.ink), strict=True):
            curve.setPen(trace_pen(color))
            label.set_color(color)

    def _series(self) -> Iterable[Series]:
        return [one for name, curve in zip(self.NAMES, self.curves, strict=True) for one in series_of(name, curve)]
