"""Live strips of further input channels: one small plot each, below drive and displacement."""

from typing import Any

import pyqtgraph as pg

from app.gui.face import Tokens, follow_tokens, tokens
from app.gui.plots.base import (
    TRACE_AXIS_WIDTH,
    CornerLabel,
    color_axes,
    curve_color,
    limit_ticks,
    stable_range,
    style_axes,
    trace_pen,
)
from app.live import LiveFeed, TimeSpan
from model import shown_unit

STRIP_HEIGHT = 64
"""Height of a strip in pixels."""


class ChannelStrips(pg.GraphicsLayoutWidget):  # type: ignore[misc]
    """The further channels of the acquisition over the displayed span; hidden where there are none."""

    def __init__(self, feed: LiveFeed) -> None:
        super().__init__()
        self.setAccessibleName("plot: further channels")
        self.ci.setContentsMargins(0, 0, 10, 0)
        self.ci.setSpacing(0)
        self._feed = feed
        self._shown: tuple[tuple[str, str], ...] = ()
        self.curves: list[Any] = []
        self._plots: list[Any] = []
        self._labels: list[CornerLabel] = []
        self._ranges: list[tuple[float, float] | None] = []
        self.setVisible(False)
        follow_tokens(self, self.apply_theme)

    def apply_theme(self, theme: Tokens) -> None:
        """Apply a theme."""
        self.setBackground(theme.surface)
        for at, (plot, curve, label) in enumerate(zip(self._plots, self.curves, self._labels, strict=True)):
            color = curve_color(at).name()
            curve.setPen(trace_pen(color))
            label.set_color(color)
            color_axes(plot)

    def draw(self, span: TimeSpan, shown_s: float, fresh: bool) -> None:
        """Draw the channels so that `shown_s`, bench time of the stream, is the right edge; `fresh` with new samples."""
        if self._feed.channels != self._shown:
            self._rebuild()
            fresh = True
        for curve in self.curves:
            curve.setPos(-shown_s, 0)
        if not fresh:
            return
        for at, (plot, curve, trace) in enumerate(
            zip(self._plots, self.curves, self._feed.channel_traces(span), strict=False)
        ):
            time_s, values = trace.decimated_curve()
            values = shown_unit(self._shown[at][1]).factor * values
            curve.setData(time_s, values)
            plot.setXRange(-span.shown_s, 0, padding=0)
            if values.size:
                self._ranges[at] = limits = stable_range(float(values.min()), float(values.max()), self._ranges[at])
                plot.setYRange(*limits, padding=0)

    def _rebuild(self) -> None:
        self.clear()
        self._shown = self._feed.channels
        self._plots = [self.addPlot(row=row, col=0, enableMenu=False) for row in range(len(self._shown))]
        self._ranges = [None] * len(self._plots)
        self.curves, self._labels = [], []
        for plot, (name, unit) in zip(self._plots, self._shown, strict=True):
            style_axes(plot, self.font())
            limit_ticks(plot, self.font())
            plot.getAxis("left").setWidth(TRACE_AXIS_WIDTH)
            plot.getAxis("bottom").setStyle(showValues=False)
            curve = pg.PlotCurveItem(antialias=False, skipFiniteCheck=True)
            plot.addItem(curve)
            self.curves.append(curve)
            self._labels.append(CornerLabel(plot, f"{name} ({shown_unit(unit).unit})", self.font(), right=False))
        self.setFixedHeight(STRIP_HEIGHT * max(len(self._plots), 1))
        self.setVisible(bool(self._plots))
        self.apply_theme(tokens())
