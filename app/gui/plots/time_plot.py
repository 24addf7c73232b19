"""Live traces: drive, displacement and further channels over the last moments, min/max decimated to two values per pixel column."""

import math
import time
from dataclasses import replace

import numpy as np
import pyqtgraph as pg
from PySide6.QtGui import QColor, QPen, QResizeEvent
from PySide6.QtWidgets import QFrame

from app.common import format_duration, number_text, typeset
from app.gui.face import CLASS_S, Tokens, class_of, follow_tokens, set_length, tokens
from app.gui.plots.axes import stable_range
from app.gui.plots.chart import Chart
from app.gui.plots.drawn_panel import DrawnPanel
from app.gui.plots.picture import DOTTED, Panel, Picture, Rule, axis_title, color_of, curve_tone
from app.gui.plots.series import series_as_text
from app.gui.widgets import Segments, column, configure, make_label, set_style_kind
from app.live import SPANS, LiveFeed, TimeSpan
from model import AmplifierMap, Array, Series, shown_unit

SMOOTHING_S = 0.03
"""Time constant with which the display follows `LiveFeed.displayed_s`, whose rate changes slightly with every block."""

LEAST_MOTION = 1e-4
"""Of the span: less is no motion on the screen."""

INITIAL_RANGE_UM = 100.0

CALM_S = 0.15
"""Shortest interval between two redraws at rest; the window then ticks 5 times a second, unless something wakes it."""

CALM_SPANS = 2.5
"""Spans of samples that are taken at rest: the one that is shown, and one before it for the trigger."""

HELD_AFTER_S = 1.0
"""Traces without a new sample for this long are drawn in grey, with their age."""

VALUES_S = 0.2
"""Part of the traces that the present values describe, and the interval between two of them."""

STILL = 0.05
"""Of a range of volts or micrometres: a smaller swing is noise about one value."""

DRIVE_TITLE, FIXED_PANELS = "Drive at the amplifier's input, V", 2
VALUE_WIDTH = 160


def trace_pen(color: str) -> QPen:
    """Return a pen of one pixel at any scaling: a wider one costs more than the data (docs/decisions/0006-live-plot.md)."""
    pen = QPen(QColor(color))
    pen.setWidth(1)
    pen.setCosmetic(True)
    return pen


class PresentValue(QFrame):
    """A present value, large, with its name above and one line about it below."""

    def __init__(self, title: str) -> None:
        super().__init__()
        self.title, self.about = make_label(title, "note", wrap=False), make_label("", "note", wrap=False)
        self.value = make_label("–", "present", wrap=False)
        for label, height in ((self.title, 16), (self.value, 34), (self.about, 16)):
            set_length(label, width=VALUE_WIDTH - 12, height=height)  # another value lays nothing out again
        column(self.title, self.value, self.about, parent=self, margins=(12, 0, 0, 0), spacing=0)

    def show_values(self, values: Array, unit: str, places: int, least: float) -> None:
        """Show the mean of values that stand still, else their peak to peak."""

        def text(value: float) -> str:
            shown = 0 if abs(value) >= 100 else places
            return typeset(f"{value:z.{shown}f}")

        if not values.size:
            self.value.setText("–")
            self.about.setText("")
            return
        low, high = float(values.min()), float(values.max())
        if high - low > least:
            self.value.setText(f"{text(high - low)} {unit}")
            self.about.setText(f"from {text(low)} to {text(high)} {unit}")
        else:
            self.value.setText(f"{text(float(values.mean()))} {unit}")
            self.about.setText(f"varies by {number_text(high - low, 2)} {unit}")


class TimePlot(Chart):
    """The live traces. `tick` is called at every tick of the window and draws only changes.

    The shortest span is triggered by the drive, like an oscilloscope; the longer ones scroll. Both follow the clock between
    two blocks of samples, about a block behind the newest (docs/decisions/0006-live-plot.md).
    """

    few_tools = True

    def __init__(self, feed: LiveFeed, amplifier: AmplifierMap) -> None:
        self._trace_ranges: list[tuple[float, float] | None] = []
        super().__init__("live traces")
        self._feed, self._amplifier = feed, amplifier
        self.is_calm = False
        """Whether nothing is driven: a few redraws a second are enough."""
        self.frames = 0
        """Number of redraws."""
        self.curves: list[pg.PlotCurveItem] = []
        """Displacement, drive and the further channels."""
        self._version = -1
        self._channels: tuple[tuple[str, str], ...] | None = None
        """Names and units of the sensor's quantity and of the further channels."""
        self._shown_s = self._right_s = 0.0
        """Bench times of the displayed samples and of the right edge: if triggered, the drive's last rising edge before it."""
        self._samples: list[tuple[Array, Array]] = []
        self._lines: dict[int, tuple[float, float]] = {}
        """Lowest and highest value of the traces that were drawn from edge to edge at rest, by panel."""
        self._edges_s = np.empty(0)
        self._last_tick_s = self._last_values_s = time.monotonic()
        self._streamed_s = feed.streamed_s
        self._simulated = False
        self._held_s = 0
        """Age of held traces in whole seconds; 0 while samples arrive, and without any."""
        self._spans = Segments("traces.span", "span", ((f"{each.shown_s:g} s", at) for at, each in enumerate(SPANS)))
        self.held_label = make_label(kind="note", wrap=False, name="traces.held")
        self.values = [PresentValue("Displacement"), PresentValue("Drive")]
        self._build()
        follow_tokens(self, self._color_traces)
        self.tools.values_at = self._values_at
        self._spans.chosen.connect(self.select_span)
        self.select_span(0)

    def _build(self) -> None:
        for span, button in zip(SPANS, self._spans.buttons.values(), strict=True):
            lined_up = ", the cycles of the drive lined up like an oscilloscope's" if span.triggered else ""
            button.setToolTip(f"Show the last {span.shown_s:g} s{lined_up}")
        self.head_layout.insertWidget(1, self.held_label)
        self.head_layout.addWidget(self._spans)
        aside = configure(QFrame(), "traces.values")
        set_length(aside, width=VALUE_WIDTH)
        column(*self.values, None, parent=aside, spacing=12)
        self.canvas_row.addWidget(aside)

    def _color_traces(self, theme: Tokens) -> None:
        for at, curve in enumerate(self.curves):
            color = theme.ink if at < FIXED_PANELS else color_of(curve_tone(at - FIXED_PANELS)).name()
            curve.setPen(trace_pen(theme.text2 if self._held_s else color))

    def show_simulated(self, simulated: bool) -> None:
        """Mark exported pictures and tables as simulated, or not."""
        if simulated is not self._simulated:
            self._simulated = simulated
            self._show_axes()

    @property
    def span(self) -> TimeSpan:
        return SPANS[self.selected_span]

    @property
    def selected_span(self) -> int:
        """The index in `SPANS`."""
        return int(str(self._spans.selected or 0))

    def select_span(self, index: int) -> None:
        """Show one of `SPANS`."""
        self._spans.select(min(max(index, 0), len(SPANS) - 1))
        self._show_axes()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        for value in self.values:
            small = class_of(self) is CLASS_S or self.height() < 150
            set_style_kind(value.value, "value" if small else "present")
            set_length(value.value, VALUE_WIDTH - 12, 20 if small else 34)
            value.about.setVisible(self.height() >= 130)

    def _y_range(self, at: int, drawn: DrawnPanel) -> tuple[float, float]:
        given = self._trace_ranges[at] if at < len(self._trace_ranges) else None
        return super()._y_range(at, drawn) if given is None else given

    def _show_axes(self) -> None:
        """Make the panels and their axes: after another span, and with other channels."""
        self._channels = (self._feed.moved, *self._feed.channels)
        self.values[0].title.setText(self._feed.moved[0])
        span, low, high = self.span, self._amplifier.low_v, self._amplifier.high_v
        margin, short = 0.06 * (high - low), self.span.shown_s < 1.0
        ticks = (low, self._amplifier.rest_v, high)
        drive = Panel(title=DRIVE_TITLE, low=low - margin, high=high + margin, ticks=ticks)
        further = [Panel(title=axis_title(name, shown_unit(unit).unit)) for name, unit in self._channels[1:]]
        panels = [Panel(title=", ".join(self._feed.moved)), drive, *further]
        panels = [replace(each, x_labels=each is panels[-1]) for each in panels]
        self._trace_ranges = [(-INITIAL_RANGE_UM, INITIAL_RANGE_UM), None, *(None for _ in further)]
        since = "rising edge" if span.triggered else "now"
        self.show_picture(
            Picture(
                title="Live", x_title=f"Time from {since}, {'ms' if short else 's'}", panels=tuple(panels),
                rules=(Rule(at=self._amplifier.rest_v, along_y=True, panel=1, style=DOTTED),),
                x=(-span.shown_s, 0.0), log=(False, False), simulated=self._simulated,
            )
        )  # fmt: skip
        if len(self.curves) != len(panels) or any(c.getViewBox() is None for c in self.curves):
            self.curves = [pg.PlotCurveItem(antialias=False, skipFiniteCheck=True) for _ in panels]
            for drawn, curve in zip(self.panels, self.curves, strict=True):
                drawn.plot.addItem(curve, ignoreBounds=True)
        for drawn in self.panels:
            drawn.axes["bottom"].scale_by = 1000.0 if short else 1.0
            drawn.box.setMouseEnabled(x=False, y=False)
        self._version, self._lines = -1, {}
        self._color_traces(tokens())

    def tick(self) -> None:
        """Take new samples and scroll towards them; at rest a few times a second."""
        now = time.monotonic()
        if self.is_calm and now - self._last_tick_s < CALM_S:
            return
        elapsed, self._last_tick_s = now - self._last_tick_s, now
        if (self._feed.moved, *self._feed.channels) != self._channels:
            self._show_axes()
        fresh = self._feed.traces(self.span)[1].version != self._version
        if fresh:
            self._update_data()
        self._streamed_s, age_s = self._feed.streamed_s, now - self._feed.last_block_s
        self._show_age(int(age_s) if age_s >= HELD_AFTER_S else 0)
        # The fit of block times that makes the motion even is not visible at a few redraws a second.
        goal_s = self._streamed_s if self.is_calm else self._feed.displayed_s(now)
        self._shown_s = goal_s if self.is_calm else self._advance(goal_s, elapsed)
        right_s = self._trigger(self._shown_s) if self.span.triggered else self._shown_s
        if fresh or right_s != self._right_s:
            self._right_s = right_s
            self.frames += 1
            self._draw_traces(fresh)
            if (self.is_calm or now - self._last_values_s >= VALUES_S) and not self._held_s:
                self._last_values_s = now
                self._show_values()
            if self.tools.cursors:
                self.tools.update_read_out()

    def _values_at(self, x: float) -> list[tuple[str, float, float, str]]:
        """Return the traces' values at a place, for the read-out of the cursor."""
        found = []
        for panel, (time_s, values) in zip(self.picture.panels, self._samples, strict=False):
            if time_s.size:
                name, _, unit = panel.title.rpartition(", ")
                found.append((name, float(np.interp(x + self._right_s, time_s, values)), math.nan, unit))
        return found

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

    def _draw_traces(self, fresh: bool) -> None:
        """Move the curves so that `_right_s` is at the right edge; a triggered span draws the displayed part only."""
        if not self.is_calm:
            self._lines = {}
        for at, (curve, (time_s, values)) in enumerate(zip(self.curves, self._samples, strict=False)):
            left_s = self._right_s - self.span.shown_s
            ends = np.searchsorted(time_s, (left_s, self._right_s), "right")
            begin, end = max(int(ends[0]) - 2, 0), int(ends[1]) + 2  # with a column beyond each edge
            if self.is_calm and self._is_same_line(at, values[begin:end], fills=bool(ends[0])):
                continue
            curve.setPos(-self._right_s, 0)
            if self.span.triggered:
                curve.setData(time_s[begin:end], values[begin:end])
            elif fresh:
                curve.setData(time_s, values)

    def _is_same_line(self, at: int, shown: Array, fills: bool) -> bool:
        """Return whether a trace is the horizontal line that is drawn already, to a pixel; `fills`: from edge to edge."""
        low, high = (float(shown.min()), float(shown.max())) if shown.size else (-math.inf, math.inf)
        box = self.panels[at].box
        (bottom, top), (before_low, before_high) = box.viewRange()[1], self._lines.get(at, (-math.inf, math.inf))
        pixel = (top - bottom) / max(box.height(), 1.0)
        if max(high, before_high) - min(low, before_low) < pixel and fills:
            return True
        self._lines[at] = (low, high) if fills else (-math.inf, math.inf)
        return False

    def _trigger(self, shown_s: float) -> float:
        """Return the last rising edge of the drive before a time, if a whole span lies before it; else that time."""
        at = int(np.searchsorted(self._edges_s, shown_s, "right")) - 1
        return float(self._edges_s[at]) if at >= 0 else shown_s

    def _update_data(self) -> None:
        drive, moved = self._feed.traces(self.span)
        self._version = moved.version
        seconds = CALM_SPANS * self.span.shown_s if self.is_calm else math.inf
        drive_s, drive_v = drive.decimated_curve(seconds)
        self._samples = [moved.decimated_curve(seconds), (drive_s, drive_v)]
        for (_, unit), trace in zip((self._channels or ())[1:], self._feed.channel_traces(self.span), strict=False):
            time_s, values = trace.decimated_curve(seconds)
            self._samples.append((time_s, shown_unit(unit).factor * values))
        if not drive_s.size:
            return
        if self.span.triggered:
            edges_s = rising_edges(drive_s, drive_v, self._amplifier.rest_v)
            self._edges_s = edges_s[edges_s - drive_s[0] >= self.span.shown_s]
        for at, (_, values) in enumerate(self._samples):
            if at != 1 and values.size:
                self._scale_trace(at, float(values.min()), float(values.max()))

    def _scale_trace(self, at: int, low: float, high: float) -> None:
        limits = stable_range(low, high, self._trace_ranges[at])
        if limits != self._trace_ranges[at] or self.panels[at].box.viewRange()[1] != list(limits):
            self._trace_ranges[at] = limits
            self.panels[at].box.set_whole((-self.span.shown_s, 0.0), limits)
            self.align()

    def _show_values(self) -> None:
        spans = (INITIAL_RANGE_UM, self._amplifier.high_v - self._amplifier.low_v)
        shown = zip(self.values, self._samples, (self._feed.moved[1], "V"), (1, 3), spans, strict=False)
        for value, (time_s, samples), unit, places, span in shown:
            begin = np.searchsorted(time_s, self._streamed_s - VALUES_S, "right")
            value.show_values(samples[begin:], unit, places, STILL * span)

    def _show_age(self, held_s: int) -> None:
        """Draw held traces in grey and state their age; live ones in their colours."""
        if held_s == self._held_s:
            return
        was_held, self._held_s = bool(self._held_s), held_s
        self.held_label.setText(f"held: {format_duration(held_s)} old" if held_s else "")
        for value in self.values if held_s else ():
            value.about.setText(f"held, {format_duration(held_s)} old")
        if bool(held_s) is not was_held:
            self._color_traces(tokens())

    def table(self) -> str:
        """Return the displayed traces as a tab-separated table."""
        traces = (
            Series(time_s - self._right_s, values, name=panel.title)
            for panel, (time_s, values) in zip(self.picture.panels, self._samples, strict=False)
        )
        about = self.picture.x_title.rpartition(", ")[0]
        return series_as_text(traces, f"{about}, s", "value", self._simulated)


def rising_edges(time_s: Array, drive_v: Array, level_v: float) -> Array:
    """Return the times at which the drive rises through a level.

    `drive_v` is low, high, low, high ... as from `MinMaxTrace.decimated_curve`.
    """
    centre = 0.5 * (drive_v[0::2] + drive_v[1::2]) - level_v
    at = np.flatnonzero((centre[:-1] < 0) & (centre[1:] >= 0))
    share = -centre[at] / (centre[at + 1] - centre[at])
    edges: Array = time_s[2 * at] + share * (time_s[2 * at + 2] - time_s[2 * at])
    return edges
