"""Drive and displacement over the last moments: two plots on one time axis, two values a pixel column."""

import math
import time

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtWidgets import QButtonGroup, QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from app.gui.plots.base import (
    TICK_LINES,
    CornerLabel,
    apply_plot_theme,
    limit_ticks,
    simulated_label,
    stable_range,
    style_axes,
    trace_pen,
)
from app.gui.plots.copy import PlotCopyButtons, series_as_text, series_of
from app.gui.widgets.theme import Theme
from app.live.feed import SPANS, LiveFeed, TimeSpan
from model.amplifier_map import AmplifierMap

Array = NDArray[np.float64]

AXIS_WIDTH = 48
SMOOTHING_S = 0.08
"""How far the picture trails behind the samples, so that it flows although they come in blocks."""


INITIAL_RANGE_UM = 100.0


class TimePlot(QWidget):
    """The live traces. `refresh` is called at every tick of the window and draws only what is new.

    The shortest span stands still like an oscilloscope triggered by the drive; the longer ones flow.
    """

    def __init__(self, feed: LiveFeed, amplifier: AmplifierMap, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._feed, self._rest_v = feed, amplifier.rest_v
        self.frames = 0
        """How often the picture changed."""
        self._range: tuple[float, float] | None = None
        self._version = -1
        self._end_s = self._shown_s = 0.0
        self._last_tick_s = time.monotonic()
        self._spans = QButtonGroup(self)
        self._axis_label = QLabel()
        self._canvas = pg.GraphicsLayoutWidget()
        self._canvas.ci.setContentsMargins(0, 0, 10, 0)
        self._canvas.ci.setSpacing(0)
        self._displacement_plot, self._drive_plot = (
            self._canvas.addPlot(row=row, col=0, enableMenu=False) for row in (0, 1)
        )
        self._drive_plot.setXLink(self._displacement_plot)
        self._displacement_plot.getAxis("bottom").setStyle(showValues=False)
        for plot in (self._displacement_plot, self._drive_plot):
            style_axes(plot, self.font())
            plot.getAxis("left").setWidth(AXIS_WIDTH)
        margin = 0.06 * (amplifier.high_v - amplifier.low_v)
        self._drive_plot.setYRange(amplifier.low_v - margin, amplifier.high_v + margin, padding=0)
        self._levels = (amplifier.low_v, amplifier.rest_v, amplifier.high_v)
        limit_ticks(self._displacement_plot, self.font())
        self._drive_plot.getViewBox().sigResized.connect(self._mark_levels)
        self._scale(-INITIAL_RANGE_UM, INITIAL_RANGE_UM)
        self._rest = pg.InfiniteLine(amplifier.rest_v, angle=0)
        self._drive_plot.addItem(self._rest)
        # Pens of one pixel, no grid, no antialiasing, and never the raw samples: docs/decisions/0006-live-plot.md.
        self.curves = [pg.PlotCurveItem(antialias=False, skipFiniteCheck=True) for _ in range(2)]
        self._drive_plot.addItem(self.curves[0])
        self._displacement_plot.addItem(self.curves[1])
        self._corner_labels = [
            CornerLabel(plot, words, self.font(), right=False)
            for plot, words in (
                (self._drive_plot, "drive at the amplifier (V)"),
                (self._displacement_plot, "displacement (µm)"),
            )
        ]
        self.simulated_labels = [
            simulated_label(plot, self.font()) for plot in (self._drive_plot, self._displacement_plot)
        ]
        self.copy_buttons = PlotCopyButtons(self._canvas, self._table)
        self._build()
        self.set_theme(theme)
        self._spans.idToggled.connect(self._on_span_toggled)
        self.select_span(0)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self._canvas.setBackground(theme.panel)
        for plot in (self._displacement_plot, self._drive_plot):
            apply_plot_theme(plot, theme)
        self._rest.setPen(trace_pen(theme.line))
        for curve, name, ink in zip(self.curves, self._corner_labels, (theme.second, theme.measured), strict=True):
            curve.setPen(trace_pen(ink))
            name.set_color(ink)
        for mark in self.simulated_labels:
            mark.set_color(theme.simulated)

    def show_simulated(self, simulated: bool) -> None:
        for mark in self.simulated_labels:
            mark.set_visible(simulated)

    @property
    def span(self) -> TimeSpan:
        return SPANS[self.selected_span]

    @property
    def selected_span(self) -> int:
        """Which of `SPANS` is shown."""
        return max(self._spans.checkedId(), 0)

    def select_span(self, index: int) -> None:
        """Show one of `SPANS`."""
        self._spans.button(min(max(index, 0), len(SPANS) - 1)).setChecked(True)

    def tick(self) -> None:
        """Take what is new and let the picture flow towards it."""
        now = time.monotonic()
        elapsed, self._last_tick_s = now - self._last_tick_s, now
        fresh = self._feed.traces(self.span)[1].version != self._version
        if fresh:
            self._update_data()
        behind = self._end_s - self._shown_s
        if self.span.triggered or behind < 0 or behind > self.span.shown_s:  # also a new stream, or a hurried bench
            self._shown_s = self._end_s
        elif behind > 1e-4 * self.span.shown_s:
            self._shown_s += behind * (1 - math.exp(-elapsed / SMOOTHING_S))
        elif not fresh:
            return
        if fresh or behind:
            self.frames += 1
            for curve in self.curves:
                curve.setPos(-self._shown_s, 0)

    def _update_data(self) -> None:
        drive, moved = self._feed.traces(self.span)
        self._version = moved.version
        drive_s, drive_v = drive.decimated_curve()
        time_s, displacement_um = moved.decimated_curve()
        self.curves[0].setData(drive_s, drive_v)
        self.curves[1].setData(time_s, displacement_um)
        self._end_s = float(time_s[-1]) if time_s.size else 0.0
        if not time_s.size:
            return
        if self.span.triggered:
            self._end_s = trigger_time(drive_s, drive_v, self._rest_v, self.span.shown_s)
        self._scale(float(displacement_um.min()), float(displacement_um.max()))

    def _scale(self, low: float, high: float) -> None:
        wanted = stable_range(low, high, self._range)
        if wanted != self._range:
            self._range = wanted
            self._displacement_plot.setYRange(*wanted, padding=0)

    def _mark_levels(self, *_: object) -> None:
        """Lowest, rest and highest on the drive's axis; rest alone where three would run into each other."""
        room = self._drive_plot.getViewBox().height() / self.fontMetrics().height()
        shown = self._levels if room >= 2.2 * TICK_LINES else self._levels[1:2]
        self._drive_plot.getAxis("left").setTicks([[(level, f"{level:g}") for level in shown]])

    def _table(self) -> str:
        shown = [
            *series_of("displacement (µm)", self.curves[1]),
            *series_of("drive at the amplifier (V)", self.curves[0]),
        ]
        return series_as_text(
            shown,
            f"s before {self._axis_label.text().partition(' before ')[2]}",
            "value",
            self.simulated_labels[0].visible,
        )

    def _on_span_toggled(self, _at: int, checked: bool) -> None:
        if not checked:
            return
        self._version, self._range = -1, None
        short = self.span.shown_s < 1.0
        axis = self._drive_plot.getAxis("bottom")
        axis.setScale(1000.0 if short else 1.0)
        since = "the drive's last rise" if self.span.triggered else "now"
        self._axis_label.setText(f"{'milliseconds' if short else 'seconds'} before {since}")
        self._displacement_plot.setXRange(-self.span.shown_s, 0, padding=0)

    def _build(self) -> None:
        head = QHBoxLayout()
        caption = QLabel("Live traces")
        caption.setProperty("kind", "caption")
        self._axis_label.setProperty("kind", "note")
        head.setSpacing(12)
        head.addWidget(caption)
        head.addWidget(self._axis_label)
        head.addStretch()
        # Buttons and no list that drops down: an open list would keep the Stop key to itself.
        for at, span in enumerate(SPANS):
            button = QPushButton(f"{span.shown_s:g} s" + (" standing" if span.triggered else ""))
            button.setCheckable(True)
            button.setProperty("kind", "choice")
            button.setToolTip(
                f"Show the last {span.shown_s:g} s"
                + (", the cycles of the drive lined up like an oscilloscope's" if span.triggered else "")
            )
            self._spans.addButton(button, at)
            head.addWidget(button)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(2)
        layout.addLayout(head)
        layout.addWidget(self._canvas, 1)


def trigger_time(time_s: Array, drive_v: Array, level_v: float, shown_s: float) -> float:
    """The time at which the drive last rose through a level, if a whole picture lies before it; else the last time.

    `drive_v` is low, high, low, high ... as `MinMaxTrace.curve` gives it.
    """
    centre = 0.5 * (drive_v[0::2] + drive_v[1::2]) - level_v
    rises = np.flatnonzero((centre[:-1] < 0) & (centre[1:] >= 0))
    last = float(time_s[-1])
    if rises.size:
        at, after = int(rises[-1]), int(rises[-1]) + 1
        share = -centre[at] / (centre[after] - centre[at])
        edge = float(time_s[2 * at] + share * (time_s[2 * after] - time_s[2 * at]))
        if edge - float(time_s[0]) >= shown_s:
            return edge
    return last
