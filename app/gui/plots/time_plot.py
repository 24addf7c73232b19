"""Live traces: drive and displacement over the last moments, min/max decimated to two values per pixel column."""

import math
import time

import numpy as np
import pyqtgraph as pg
from PySide6.QtWidgets import QButtonGroup

from app.common import format_duration
from app.gui.face import Tokens, follow_tokens, tokens
from app.gui.plots.base import (
    TICK_LINES,
    TracePlotBase,
    caption_label,
    limit_ticks,
    stable_range,
    trace_pen,
)
from app.gui.plots.channel_strips import ChannelStrips
from app.gui.plots.copy import PlotCopyButtons
from app.gui.widgets import ElidedLabel, configure, make_choice, make_label, row
from app.live import SPANS, LiveFeed, TimeSpan
from model import AmplifierMap, Array

SMOOTHING_S = 0.03
"""Time constant with which the display follows `LiveFeed.displayed_s`, whose rate changes slightly with every block."""

LEAST_MOTION = 1e-4
"""Of the span: less is no motion on the screen."""

INITIAL_RANGE_UM = 100.0

CALM_S = 0.2
"""Interval between two redraws at rest."""

HELD_AFTER_S = 1.0
"""Traces without a new sample for this long are drawn in grey, with their age."""


class TimePlot(TracePlotBase):
    """The live traces. `tick` is called at every tick of the window and draws only changes.

    The shortest span is triggered by the drive, like an oscilloscope; the longer ones scroll. Both follow the clock between
    two blocks of samples, about a block behind the newest (docs/decisions/0006-live-plot.md).
    """

    ACCESSIBLE_NAME = "plot: live traces"

    def __init__(self, feed: LiveFeed, amplifier: AmplifierMap) -> None:
        super().__init__()
        self._feed, self._rest_v = feed, amplifier.rest_v
        self.is_calm = False
        """Whether nothing is driven: a few redraws a second are enough."""
        self.frames = 0
        """Number of redraws."""
        self._range: tuple[float, float] | None = None
        self._version = -1
        self._shown_s = self._right_s = 0.0
        """Bench times of the displayed samples and of the right edge: if triggered, the drive's last rising edge before it."""
        self._samples = ((np.empty(0), np.empty(0)),) * 2
        self._edges_s = np.empty(0)
        self._last_tick_s = time.monotonic()
        self._streamed_s = feed.streamed_s
        self._held_s = 0
        """Age of held traces in whole seconds; 0 while samples arrive, and without any."""
        self._spans = QButtonGroup(self)
        self.strips = ChannelStrips(feed)
        self.copy_buttons.append(PlotCopyButtons(self.strips, self._table))
        self._axis_label = configure(ElidedLabel(), kind="note")
        self.held_label = make_label(kind="note", wrap=False, name="traces.held")
        self._displacement_plot, self._drive_plot = self._plots
        margin = 0.06 * (amplifier.high_v - amplifier.low_v)
        self._drive_plot.setYRange(amplifier.low_v - margin, amplifier.high_v + margin, padding=0)
        self._levels = (amplifier.low_v, amplifier.rest_v, amplifier.high_v)
        limit_ticks(self._displacement_plot, self.font())
        self._drive_plot.getViewBox().sigResized.connect(self._mark_levels)
        self._scale(-INITIAL_RANGE_UM, INITIAL_RANGE_UM)
        self._rest = pg.InfiniteLine(amplifier.rest_v, angle=0)
        self._rest.setZValue(-1)  # below the trace
        self._drive_plot.addItem(self._rest)
        self._build()
        follow_tokens(self, self.apply_theme)
        self._spans.idToggled.connect(self._on_span_toggled)
        self.select_span(0)

    def apply_theme(self, theme: Tokens) -> None:
        super().apply_theme(theme)
        self._rest.setPen(trace_pen(theme.line))
        if self._held_s:
            for curve in self.curves:
                curve.setPen(trace_pen(theme.text2))

    @property
    def span(self) -> TimeSpan:
        return SPANS[self.selected_span]

    @property
    def selected_span(self) -> int:
        """The index in `SPANS`."""
        return max(self._spans.checkedId(), 0)

    def select_span(self, index: int) -> None:
        """Show one of `SPANS`."""
        self._spans.button(min(max(index, 0), len(SPANS) - 1)).setChecked(True)

    def tick(self) -> None:
        """Take new samples and scroll towards them; at rest a few times a second."""
        now = time.monotonic()
        if self.is_calm and now - self._last_tick_s < CALM_S:
            return
        elapsed, self._last_tick_s = now - self._last_tick_s, now
        fresh = self._feed.traces(self.span)[1].version != self._version
        if fresh:
            self._update_data()
        self._streamed_s, age_s = self._feed.streamed_s, now - self._feed.last_block_s
        self._show_age(int(age_s) if age_s >= HELD_AFTER_S else 0)
        self._shown_s = self._advance(self._feed.displayed_s(now), elapsed)
        right_s = self._trigger(self._shown_s) if self.span.triggered else self._shown_s
        if fresh or right_s != self._right_s:
            self._right_s = right_s
            self.frames += 1
            self._draw(fresh)
            self.strips.draw(self.span, right_s, fresh)

    def _advance(self, goal_s: float, elapsed_s: float) -> float:
        """Return the bench time to show next: towards a goal, or the newest sample if it is not within the span."""
        if (
            not 0.0 <= self._streamed_s - self._shown_s <= self.span.buffer_s - self.span.shown_s
        ):  # a new stream, a pause
            return goal_s
        ahead_s = goal_s - self._shown_s
        if ahead_s <= LEAST_MOTION * self.span.shown_s:
            return self._shown_s if ahead_s <= 0.0 else goal_s
        return self._shown_s + ahead_s * (1 - math.exp(-elapsed_s / SMOOTHING_S))

    def _draw(self, fresh: bool) -> None:
        """Move the curves so that `_right_s` is at the right edge; a triggered span draws the displayed part only."""
        for curve, (time_s, values) in zip(self.curves, self._samples, strict=True):
            curve.setPos(-self._right_s, 0)
            if self.span.triggered:
                ends = np.searchsorted(time_s, (self._right_s - self.span.shown_s, self._right_s), "right")
                begin, end = max(int(ends[0]) - 2, 0), int(ends[1]) + 2  # with a column beyond each edge
                curve.setData(time_s[begin:end], values[begin:end])
            elif fresh:
                curve.setData(time_s, values)

    def _trigger(self, shown_s: float) -> float:
        """Return the last rising edge of the drive before a time, if a whole span lies before it; else that time."""
        at = int(np.searchsorted(self._edges_s, shown_s, "right")) - 1
        return float(self._edges_s[at]) if at >= 0 else shown_s

    def _update_data(self) -> None:
        drive, moved = self._feed.traces(self.span)
        self._version = moved.version
        drive_s, drive_v = drive.decimated_curve()
        time_s, displacement_um = moved.decimated_curve()
        self._samples = (time_s, displacement_um), (drive_s, drive_v)
        if not time_s.size:
            return
        if self.span.triggered:
            edges_s = rising_edges(drive_s, drive_v, self._rest_v)
            self._edges_s = edges_s[edges_s - drive_s[0] >= self.span.shown_s]
        self._scale(float(displacement_um.min()), float(displacement_um.max()))

    def _show_age(self, held_s: int) -> None:
        """Draw held traces in grey and state their age; live ones in their colours."""
        if held_s == self._held_s:
            return
        was_held, self._held_s = bool(self._held_s), held_s
        self.held_label.setText(f"held: {format_duration(held_s)} old" if held_s else "")
        if bool(held_s) is not was_held:
            self.apply_theme(tokens())

    def _scale(self, low: float, high: float) -> None:
        limits = stable_range(low, high, self._range)
        if limits != self._range:
            self._range = limits
            self._displacement_plot.setYRange(*limits, padding=0)

    def _mark_levels(self, *_: object) -> None:
        """Label lowest, rest and highest on the drive's axis; rest alone if three labels would overlap."""
        lines = self._drive_plot.getViewBox().height() / self.fontMetrics().height()
        shown = self._levels if lines >= 2.2 * TICK_LINES else self._levels[1:2]
        self._drive_plot.getAxis("left").setTicks([[(level, f"{level:g}") for level in shown]])

    def _column_names(self) -> tuple[str, str]:
        return f"s before {self._axis_label.text().partition(' before ')[2]}", "value"

    def _on_span_toggled(self, _at: int, checked: bool) -> None:
        if not checked:
            return
        self._version, self._range = -1, None
        self.tools[0].show_whole()  # a zoom belongs to the span before
        short = self.span.shown_s < 1.0
        axis = self._drive_plot.getAxis("bottom")
        axis.setScale(1000.0 if short else 1.0)
        since = "the drive's last rising edge" if self.span.triggered else "now"
        self._axis_label.setText(f"{'milliseconds' if short else 'seconds'} before {since}")
        self._axis_label.setToolTip(self._axis_label.text())
        self._displacement_plot.setXRange(-self.span.shown_s, 0, padding=0)

    def _build(self) -> None:
        # Buttons instead of a drop-down list: an open list would take the Stop key.
        for at, span in enumerate(SPANS):
            tip = f"Show the last {span.shown_s:g} s"
            tip += ", the cycles of the drive lined up like an oscilloscope's" if span.triggered else ""
            text = f"{span.shown_s:g} s" + (", triggered" if span.triggered else "")
            self._spans.addButton(make_choice(text, tip, checkable=True), at)
        title = caption_label("Live traces")
        self._add_head(row(title, self._axis_label, self.held_label, None, *self._spans.buttons(), spacing=12))
        self._layout.addWidget(self.strips)


def rising_edges(time_s: Array, drive_v: Array, level_v: float) -> Array:
    """Return the times at which the drive rises through a level.

    `drive_v` is low, high, low, high ... as from `MinMaxTrace.decimated_curve`.
    """
    centre = 0.5 * (drive_v[0::2] + drive_v[1::2]) - level_v
    at = np.flatnonzero((centre[:-1] < 0) & (centre[1:] >= 0))
    share = -centre[at] / (centre[at + 1] - centre[at])
    edges: Array = time_s[2 * at] + share * (time_s[2 * at + 2] - time_s[2 * at])
    return edges
