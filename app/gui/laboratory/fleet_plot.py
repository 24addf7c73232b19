"""Plot of a quantity of many specimens over time, by group, with mean, spread, limits and outliers."""

from collections.abc import Iterable

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QWidget

from app.common import typeset
from app.fleet import FleetValue, FleetView
from app.gui.face import Tokens, follow_tokens, tokens
from app.gui.plots import (
    MAX_LEGEND_ENTRIES,
    BarsItem,
    PlotBase,
    ScatterItem,
    ZoomBox,
    curve_color,
    curve_symbol,
    legend_share,
)
from model import Series, format_quantity, shown_unit

MAX_BARS = 400
"""Largest number of values with error bars: more bars hide the points."""


class FleetPlot(PlotBase):
    """A symbol for each value, ringed if the specimen is an outlier or selected."""

    ACCESSIBLE_NAME = "plot: values of many specimens over time"
    LOG_AXES = (False, False)

    def __init__(self, parent: QWidget | None = None) -> None:
        canvas = pg.PlotWidget(viewBox=ZoomBox(), enableMenu=False, axisItems={"bottom": pg.DateAxisItem()})
        super().__init__(parent, canvas=canvas, grid=True)
        self._view: FleetView | None = None
        self._specimen = ""
        self._add_legend()
        self.scatters: list[ScatterItem] = []
        self._bars: list[BarsItem] = []
        self.lines: list[pg.InfiniteLine] = []
        self.outliers, self.selected = (ScatterItem(size=size, brush=None) for size in (15, 19))
        for item in (self.outliers, self.selected):
            item.setZValue(5)
            self.plot.addItem(item)
        self._add_head()
        self.plot.getViewBox().sigResized.connect(self._rescale)
        follow_tokens(self, self.apply_theme)

    def apply_theme(self, theme: Tokens) -> None:
        super().apply_theme(theme)
        self.show_view(self._view)

    def show_view(self, view: FleetView | None) -> None:
        """Draw the values of a view."""
        self._view = view
        for item in (*self.scatters, *self._bars, *self.lines):
            self.plot.removeItem(item)
        self.legend.clear()
        self.scatters, self._bars, self.lines = [], [], []
        self.show_simulated(view is not None and view.simulated)
        if view is None:
            self.corner_label.set_text("")
            self.outliers.clear()
            self.selected.clear()
            return
        factor, unit = shown_unit(view.selection.unit, view.selection.name)
        name = typeset(view.selection.label)
        self.plot.setLabel("left", f"{name} ({unit})" if unit else name)
        self.corner_label.set_text(view.selection.about)
        with_bars = sum(group.x.size for group, _ in view.groups) <= MAX_BARS
        for at, (group, values) in enumerate(view.groups):
            color = curve_color(at)
            there = np.isfinite(group.x) & np.isfinite(group.y)
            x, y = group.x[there], factor * group.y[there]
            sources = np.array(values, object)[there]
            scatter = ScatterItem(
                size=7, symbol=curve_symbol(at), hoverable=True, hoverSize=11, tip=_describe, pen=pg.mkPen(color)
            )
            scatter.setBrush(pg.mkBrush(color))
            scatter.setData(x=x, y=y, data=sources)
            self.plot.addItem(scatter)
            self.scatters.append(scatter)
            if with_bars and group.total_errors is not None:
                bars = BarsItem(beam=0.0, pen=pg.mkPen(color))
                bars.setData(x=x, y=y, height=2 * factor * np.nan_to_num(group.total_errors[there]))
                self.plot.addItem(bars)
                self._bars.append(bars)
            if 1 < len(view.groups) <= MAX_LEGEND_ENTRIES:
                self.legend.addItem(scatter, group.name)
        self._draw_lines(view, factor)
        self._draw_rings()
        self._rescale()

    def show_specimen(self, specimen: str) -> None:
        """Ring the values of a specimen; empty for none."""
        self._specimen = specimen
        self._draw_rings()

    def _draw_lines(self, view: FleetView, factor: float) -> None:
        mean, sd = factor * view.spread.mean, factor * view.spread.sd
        styles = [(mean, "mean", tokens().text, Qt.PenStyle.SolidLine)]
        if np.isfinite(sd):
            styles += [
                (
                    mean + side * sd,
                    f"{'+' if side > 0 else '−'}1 sd",
                    tokens().text2,
                    Qt.PenStyle.DotLine,
                )
                for side in (1, -1)
            ]
        for value, name in zip(view.bounds or (), ("lower limit", "upper limit"), strict=False):
            if value is not None:
                styles.append((factor * value, name, tokens().red_text, Qt.PenStyle.DashLine))
        for value, name, color, style in styles:
            line = pg.InfiniteLine(
                value,
                angle=0,
                pen=pg.mkPen(color, style=style),
                label=name,
                labelOpts={"position": 0.995, "anchors": [(1, 1), (1, 1)], "color": QColor(color)},
            )
            self.plot.addItem(line, ignoreBounds=True)
            self.lines.append(line)

    def _draw_rings(self) -> None:
        view = self._view
        if view is None:
            return
        factor = shown_unit(view.selection.unit, view.selection.name)[0]
        newest = [v for v in view.selection.newest if v.specimen in view.outliers]
        chosen = [v for v in view.selection.values if v.specimen == self._specimen] if self._specimen else []
        for item, values, color in (
            (self.outliers, newest, tokens().amber_text),
            (self.selected, chosen, tokens().accent),
        ):
            shown = [v for v in values if np.isfinite(v.time_s)]
            item.setPen(pg.mkPen(color, width=2))
            item.setData(
                x=np.array([v.time_s for v in shown], float), y=factor * np.array([v.value for v in shown], float)
            )

    def _rescale(self, *_: object) -> None:
        """Show all values and the lines, with space for the legend above them."""
        groups = self._view.groups if self._view is not None else ()
        if not groups or self._view is None:
            return
        factor = shown_unit(self._view.selection.unit, self._view.selection.name)[0]
        x, y = (np.concatenate(parts) for parts in zip(*((g.x, factor * g.y) for g, _ in groups), strict=True))
        x = x[np.isfinite(x)]
        ends = [float(y.min()), float(y.max()), *(float(line.value()) for line in self.lines)]
        low, high = min(ends), max(ends)
        margin = 0.06 * ((high - low) or abs(high) or 1.0)
        low, high = low - margin, high + margin
        high = low + (high - low) / (1 - legend_share(self.legend, self.plot))
        if x.size:
            day = 86400.0
            self.plot.setXRange(float(x.min()) - day, float(x.max()) + day, padding=0.04)
        self.plot.setYRange(low, high, padding=0)

    def _series(self) -> Iterable[Series]:
        groups = self._view.groups if self._view is not None else ()
        factor = shown_unit(self._view.selection.unit, self._view.selection.name)[0] if self._view is not None else 1.0
        return [group.scaled(1.0, factor) for group, _ in groups]

    def _column_names(self) -> tuple[str, str]:
        return "seconds since 1970", self.plot.getAxis("left").labelText


def _describe(x: float, y: float, data: FleetValue) -> str:  # noqa: ARG001 - as pyqtgraph calls it
    """Return the text of a point, only for the point at the pointer, because there may be ten thousand."""
    value = data
    figure = format_quantity(value.value, value.total, value.unit, value.name)
    return f"{value.specimen}, {value.start_time[:10]}: {figure}\n{value.batch}, {value.sensor or value.protocol}"
