"""Lower plot under points or curves, on the same horizontal axis: residual, phase, coherence."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QComboBox, QSizePolicy

from app.gui.face import Tokens, follow_tokens
from app.gui.plots.base import BandFill, PlotBase, limit_ticks
from app.gui.plots.items import BarsItem, CurveItem, ScatterItem
from app.gui.widgets import make_combo
from model import Mask, Series

MIN_HEIGHT = 60
MIN_HEIGHT_OF_BOTH = 250
"""Smallest height of a page's plot with space for a lower one."""


def make_layer_box(tip: str = "") -> QComboBox:
    """Return an empty list of the choices of a lower plot."""
    return make_combo(
        "",
        "lower plot",
        minimumContentsLength=10,
        sizeAdjustPolicy=QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon,
        sizePolicy=QSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Fixed),
        toolTip=tip,
    )


class StripBase(PlotBase):
    """Shares the horizontal axis of `main_plot`, which stands above it; hidden at first."""

    LOG_AXES = (False, False)  # x follows the plot above

    def __init__(self, main_plot: Any) -> None:
        super().__init__(grid=True)
        self.plot.layout.setRowFixedHeight(0, 4)
        self.simulated_label.set_visible(False)  # the plot above it is marked
        limit_ticks(self.plot, self.font())
        self.plot.getAxis("bottom").setStyle(showValues=False)
        self.plot.setXLink(main_plot)
        self.plot.setMouseEnabled(x=False, y=False)  # it follows the upper plot
        self._add_head()
        self.hide()


class LowerStrip(StripBase):
    """Series as points with error bars, or as lines with bands."""

    def __init__(self, main_plot: Any) -> None:
        super().__init__(main_plot)
        self._main = main_plot
        self.setMinimumHeight(MIN_HEIGHT)
        self._zero = pg.InfiniteLine(0.0, angle=0)
        self.plot.addItem(self._zero)
        self._items: list[Any] = []
        self.series: tuple[Series, ...] = ()
        follow_tokens(self, self.apply_theme)

    def apply_theme(self, theme: Tokens) -> None:
        super().apply_theme(theme)
        self._zero.setPen(pg.mkPen(theme.model, width=1.5))

    def draw(
        self,
        series: Sequence[Series],
        colors: Sequence[QColor],
        label: str,
        *,
        symbols: bool,
        zero: bool,
        simulated: bool,
    ) -> None:
        """Draw series, each in its colour; `zero` marks zero."""
        for item in self._items:
            self.plot.removeItem(item)
        self._items, self.series, self.simulated = [], tuple(series), simulated
        self.plot.setLabel("left", label)
        self._zero.setVisible(zero)
        for one, color in zip(series, colors, strict=True):
            there = np.isfinite(one.x) & np.isfinite(one.y)  # Qt crashes when it paints a point that is not finite
            if not there.any():
                continue
            (self._add_points if symbols else self._add_line)(one, there, color)
        self._scale(symbols)

    def _add_points(self, one: Series, there: Mask, color: QColor) -> None:
        errors = np.zeros(one.y.size) if one.errors is None else np.nan_to_num(one.errors)
        bars = BarsItem(x=one.x[there], y=one.y[there], height=2 * errors[there], beam=0.0, pen=pg.mkPen(color))
        points = ScatterItem(x=one.x[there], y=one.y[there], size=7, pen=pg.mkPen(color), brush=pg.mkBrush(color))
        self._keep(bars, points)

    def _add_line(self, one: Series, there: Mask, color: QColor) -> None:
        if one.errors is not None:
            band = BandFill(self.plot)
            band.set_color(color.name())
            band.show_band(one.x, (one.y - one.errors, one.y + one.errors))
            self._items.append(band)
        line = CurveItem(pen=pg.mkPen(color, width=1))
        line.setData(one.x, np.where(there, one.y, np.nan), connect="finite")
        self._keep(line)

    def _keep(self, *items: Any) -> None:
        for item in items:
            self.plot.addItem(item)
            self._items.append(item)

    def _scale(self, with_errors: bool) -> None:
        ends = []
        for one in self.series:
            half = np.nan_to_num(one.errors) if with_errors and one.errors is not None else np.zeros(one.y.size)
            ends += [one.y - half, one.y + half]
        every = np.concatenate(ends) if ends else np.empty(0)
        every = every[np.isfinite(every)]
        low, high = (float(every.min()), float(every.max())) if every.size else (-1.0, 1.0)
        margin = 0.08 * (high - low) or abs(high) * 1e-3 or 1e-9
        self.plot.setYRange(low - margin, high + margin, padding=0)

    def _series(self) -> Iterable[Series]:
        return self.series

    def _column_names(self) -> tuple[str, str]:
        return self._main.getAxis("bottom").labelText, self.plot.getAxis("left").labelText
