"""Plot of the points of any protocol over its axes, with error bars."""

import math
from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import cached_property
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QColor, QResizeEvent

from app.common import axis_name, format_point
from app.gui.face import Tokens, follow_tokens, tokens
from app.gui.plots.base import PlotBase, caption_label
from app.gui.plots.curve_layers import LAYER_LABELS, NOTHING, RESIDUAL
from app.gui.plots.items import BarsItem, CurveItem, ScatterItem
from app.gui.plots.lower_strip import MIN_HEIGHT_OF_BOTH, LowerStrip, make_layer_box
from app.gui.plots.response_plot import EntrySelection, hover_text
from app.gui.plots.series import series_of
from app.gui.widgets import ElidedLabel, configure, make_choice, row
from app.live import ModelCurves
from model import ParameterError, shown_unit
from protocols.base import Protocol, Quality, RunEnded, Series
from protocols.runfile import RunReadError, point_columns

HOLLOW_HINT = "hollow: not usable, point at it for the reason"
EMPTY_TEXT = "Points appear here as they are measured"

MODEL_PLACES = 40
"""Number of abscissae of the model's curve."""

MAX_WIDENING = 3.0
"""Largest widening of the range of the points for their error bars."""


class PointsPlot(PlotBase):
    """One symbol per point, hollow if no fit may use it; its text is shown on hover, a click selects it."""

    ACCESSIBLE_NAME = "plot: points of the run"

    repeat_requested = Signal(tuple)

    def __init__(self) -> None:
        super().__init__(grid=True)
        self._kind: type[Protocol] | None = None
        self._points: Sequence[Any] = ()
        self._entries: Sequence[int] = ()
        self._shown_indices: Sequence[int] = ()
        self._outcome: RunEnded | None = None
        self._lines: tuple[Series, ...] = ()
        self.line_items: list[CurveItem] = []
        self._bars = BarsItem(beam=0.0)
        self.model = CurveItem(antialias=True)
        self._model_curve: ModelCurves | None = None
        self.scatter = ScatterItem(size=9, antialias=True, hoverable=True, hoverSize=14, tip=hover_text)
        for item in (self.model, self._bars, self.scatter):
            self.plot.addItem(item)
        self.caption, self.fit_label = caption_label(), configure(ElidedLabel(), kind="note")
        self.hint_label = configure(ElidedLabel(HOLLOW_HINT), kind="note", toolTip=HOLLOW_HINT)
        self.strip_box = make_layer_box()
        self.strip_box.addItems([LAYER_LABELS[layer] for layer in (RESIDUAL, NOTHING)])
        self.strip_box.currentIndexChanged.connect(lambda _: self._draw())
        self.curves_button = make_choice("Show the curves")
        self.curves_button.hide()
        self.selection = EntrySelection(self._draw, self.repeat_requested.emit)
        self.scatter.sigClicked.connect(lambda _, spots: self.selection.toggle(self._shown_indices, spots))
        self._add_head(
            row(
                self.caption,
                (self.fit_label, 1),
                self.selection.button,
                self.hint_label,
                self.strip_box,
                self.curves_button,
                spacing=10,
            )
        )
        follow_tokens(self, self.apply_theme)

    def apply_theme(self, theme: Tokens) -> None:
        super().apply_theme(theme)
        self._bars.setData(pen=pg.mkPen(theme.ink))
        self.model.setPen(pg.mkPen(theme.model, width=1.5, style=Qt.PenStyle.DashLine))
        self._draw()

    def set_protocol(self, kind: type[Protocol]) -> None:
        """Show the axes of a protocol, without points yet."""
        if kind is self._kind:
            return
        self._kind, self._points, self._entries = kind, (), ()
        self.caption.setText(kind.title)
        for side, name, (_, shown) in zip(("bottom", "left"), kind.axes, _shown_units(kind), strict=True):
            self.plot.setLabel(side, axis_name(name) + (f" ({shown})" if shown else ""))
        self._draw()

    def show_points(self, points: Sequence[Any], entries: Sequence[int], can_run: bool) -> None:
        """Draw the points of the run."""
        self.selection.button.setEnabled(can_run)
        if points is not self._points:
            self._points, self._entries = points, entries
            self.selection.retain(entries)
            self._draw()

    def show_model_curve(self, curve: ModelCurves) -> None:
        """Draw the curve of the model under the points, where the protocol has one."""
        if curve is not self._model_curve:
            self._model_curve = curve
            self._draw_model()
            self._rescale()

    def _draw_model(self) -> None:
        """Draw the model over the range of the points."""
        curve, kind, drawn = self._model_curve, self._kind, self.scatter.linear
        x = np.empty(0) if drawn is None else drawn[0]
        over_axes = None if curve is None or kind is None or curve.request.protocol != kind.name else curve.over_axes
        y = None
        if over_axes is not None and kind is not None and x.size:
            (x_factor, _), (y_factor, _) = _shown_units(kind)
            grid = np.linspace(x.min(), x.max(), MODEL_PLACES)
            with suppress(ParameterError, RunReadError):  # outside the range of the model, or failed aspects
                y = over_axes(grid / x_factor)
            if y is not None:
                self.model.setData(grid, y_factor * y)
        self.model.setVisible(y is not None)
        texts = [f"line: {', '.join(line.label for line in self._lines)}"] if self._lines else []
        if y is not None and curve is not None:
            texts.append(f"dashed: {curve.active_model.description}")
        self.fit_label.setText("; ".join(texts))

    def show_estimates(self, outcome: RunEnded | None) -> None:
        """Write the identified quantities above the points, or why there are none."""
        self._outcome = outcome
        empty = "" if self._shown_indices else EMPTY_TEXT if outcome is None else "no points were measured"
        self.corner_label.set_text(self._estimates_text(outcome) or empty)

    @cached_property
    def strip(self) -> LowerStrip:
        """The residual below the points; created when first used."""
        return self._add_strip(LowerStrip(self.plot), (3, 1))

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        if "strip" in vars(self):
            self._show_strip()

    def _show_strip(self) -> None:
        is_visible = bool(self._lines) and self.strip_box.currentIndex() == 0
        self.strip.setVisible(is_visible and self.height() >= MIN_HEIGHT_OF_BOTH)

    def _draw_lines(self, points: Sequence[Any]) -> None:
        """Draw the fit lines through the points, and the residuals."""
        assert self._kind is not None
        for item in self.line_items:
            self.plot.removeItem(item)
        self.line_items = []
        self._lines = lines = self._kind.fit_lines(points) if points else ()
        self.strip_box.setVisible(bool(lines))
        if not lines and "strip" not in vars(self):
            return
        (x_factor, _), (y_factor, unit) = _shown_units(self._kind)
        residuals = []
        for line in lines:
            item = CurveItem(pen=pg.mkPen(tokens().model, width=1.5))
            item.setData(x_factor * line.x, y_factor * line.y)
            item.setZValue(-5)
            self.plot.addItem(item)
            self.line_items.append(item)
            x, y, errors = (
                np.array([float(getattr(points[i], name, np.nan)) for i in line.fitted_rows])
                for name in (*self._kind.axes, f"{self._kind.axes[1]}_errors")
            )
            residuals.append(
                Series(x_factor * x, y_factor * (y - np.interp(x, line.x, line.y)), y_factor * errors, name=line.label)
            )
        colors = [QColor(tokens().ink)] * len(residuals)
        label = f"residual ({unit})" if unit else "residual"
        self.strip.draw(residuals, colors, label, symbols=True, zero=True, simulated=self.simulated)
        self._show_strip()

    def _rescale(self) -> None:
        self.plot.autoRange(padding=0.08)
        if self.log_axes[1] or self.scatter.linear is None or not self.scatter.linear[1].size:
            return
        # The bars are not cut either, unless one is so wide that nothing else would be seen.
        y, errors = self.scatter.linear[1], self._bars.errors
        low, high = self.plot.getViewBox().viewRange()[1]
        ends = min(low, float((y - errors).min())), max(high, float((y + errors).max()))
        if ends != (low, high) and ends[1] - ends[0] <= MAX_WIDENING * (high - low):
            self.plot.setYRange(*ends, padding=0.02)

    def _series(self) -> Iterable[Series]:
        yield from series_of(self.caption.text(), self.scatter, self._bars)
        yield from series_of("model", self.model)

    def _draw(self) -> None:
        if self._kind is None:
            return
        kind, (x_name, y_name) = self._kind.point_type, self._kind.axes
        at = [i for i, p in enumerate(self._points) if isinstance(p, kind) and _has_position(p, x_name, y_name)]
        points: list[Any] = [self._points[i] for i in at]
        (x_factor, _), (y_factor, _) = _shown_units(self._kind)
        x, y, errors = (
            factor * np.array([float(getattr(p, name, 0.0)) for p in points])
            for name, factor in ((x_name, x_factor), (y_name, y_factor), (f"{y_name}_errors", y_factor))
        )
        ink = QColor(tokens().ink)
        usable = [Quality(p.quality).usable for p in points]
        self._shown_indices = [self._entries[i] if i < len(self._entries) else -1 for i in at]
        chosen = [entry in self.selection.entries for entry in self._shown_indices]
        pens = [pg.mkPen(QColor(tokens().accent if taken else ink), width=4 if taken else 2) for taken in chosen]
        fills = [pg.mkBrush(ink if good else tokens().surface) for good in usable]
        texts = [format_point(p) for p in points]
        self.scatter.setData(x=x, y=y, symbol="o", pen=pens, brush=fills, data=texts)
        self._bars.setData(x=x, y=y, height=2 * np.nan_to_num(errors))
        self.hint_label.setVisible(not all(usable))
        for side in ("left", "bottom"):  # without points the limits mean nothing
            self.plot.getAxis(side).setStyle(showValues=bool(points))
        self._draw_lines(points)
        self._draw_model()
        self._rescale()
        self.show_estimates(self._outcome)


def _shown_units(kind: type[Protocol]) -> list[tuple[float, str]]:
    """Return factor and name of the units in which x and y of a protocol are displayed."""
    columns = point_columns(kind.point_type)
    return [shown_unit(columns[name][0])[:2] for name in kind.axes]


def _has_position(point: Any, *names: str) -> bool:
    """Return whether a point can be drawn: Qt crashes when it paints a point that is not finite."""
    return all(math.isfinite(float(getattr(point, name))) for name in names)
