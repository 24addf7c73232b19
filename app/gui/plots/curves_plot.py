"""Plot of the curves that entries return in addition to points: frequency responses, decays, loops, with error bands."""

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QResizeEvent

from app.common import minmax_decimate
from app.gui.face import Tokens, follow_tokens, tokens
from app.gui.plots.base import (
    MAX_LEGEND_ENTRIES,
    BandFill,
    PlotBase,
    curve_color,
    legend_share,
    stable_range,
)
from app.gui.plots.curve_layers import (
    LAYER_LABELS,
    LESS_MEAN,
    NOTHING,
    RESIDUAL,
    displayed,
    isolated,
    layer_label,
    layer_series,
    layers_of,
)
from app.gui.plots.items import BarsItem, CurveItem, ScatterItem, linear_data
from app.gui.plots.lower_strip import MIN_HEIGHT_OF_BOTH, LowerStrip, make_layer_box
from app.gui.plots.series import series_of
from app.gui.widgets import ElidedLabel, configure, make_choice, row
from app.live import ModelCurves
from model import Array, shown_unit
from protocols.base import Series

MAX_DRAWN_POINTS = 4000
"""A longer curve is drawn as its min/max decimation to about this number of points."""

SIGMAS = 2.0

LEGEND_COLUMN_WIDTH = 190

MAX_MARKED_POINTS = 30
"""A curve of at most this number of points has a mark and an error bar at each."""


class CurvesPlot(PlotBase):
    """Curves of the run with the axes of the newest; the model's is added to a frequency response of the free tactor."""

    ACCESSIBLE_NAME = "plot: curves of the run"

    def __init__(self) -> None:
        super().__init__(grid=True)
        self._curves: Sequence[Series] = ()
        self._model_curve: ModelCurves | None = None
        self._bare_tactor = False
        self.model, self.band = CurveItem(antialias=True), BandFill(self.plot)
        self.plot.addItem(self.model)
        self._add_legend(left=False)
        self.drawn_curves: list[tuple[CurveItem, BandFill]] = []
        self._further_items: list[Any] = []
        """Fit lines, and error bars of lines that stand out."""
        self.layer_box = make_layer_box("Quantity drawn below the curves, on the same axis")
        self.layer_box.activated.connect(self._on_layer_chosen)
        self._chosen_layers: dict[str, str] = {}
        """Chosen layer by the names of a curve's axes."""
        self.caption = configure(ElidedLabel("Curves"), kind="caption")
        self.source = configure(ElidedLabel(), kind="note")
        self.points_button = make_choice("Show the points")
        self._add_head(row(self.caption, (self.source, 1), self.layer_box, self.points_button, spacing=10))
        self.plot.getViewBox().sigResized.connect(self._scale)
        follow_tokens(self, self.apply_theme)

    def apply_theme(self, theme: Tokens) -> None:
        super().apply_theme(theme)
        self.model.setPen(pg.mkPen(theme.model, width=1.5, style=Qt.PenStyle.DashLine))
        self.band.set_color(theme.model)
        self._draw()

    def show_curves(self, curves: Sequence[Series], bare_tactor: bool) -> None:
        """Draw the curves of the run; `bare_tactor`: without added mass or skin, as in the model's curve."""
        if curves is not self._curves:
            self._curves, self._bare_tactor = curves, bare_tactor
            self._draw()

    def show_model_curve(self, curve: ModelCurves) -> None:
        """Draw the model's curve under a frequency response."""
        if curve is not self._model_curve:
            self._model_curve = curve
            self._draw_model()
            self._scale()

    @property
    def _visible_curves(self) -> list[Series]:
        """Those with the axes of the newest curve."""
        last = self._curves[-1] if self._curves else None
        return [c for c in self._curves if last is not None and _axis_names(c) == _axis_names(last)]

    def _series(self) -> Iterable[Series]:
        """Return every point of the curves, including points left out of the drawing."""
        for curve in self._visible_curves:
            yield displayed(curve)
        yield from series_of(self.source.text(), self.model)

    def _draw(self) -> None:
        for line, fill in self.drawn_curves:
            self.plot.removeItem(line)
            self.plot.removeItem(fill)
        for item in self._further_items:
            self.plot.removeItem(item)
        self.drawn_curves, self._further_items = [], []
        self._replace_legend(self.legend.columnCount)
        shown = self._visible_curves
        for at, curve in enumerate(shown):
            colour = self._color(at, len(shown))
            drawn = displayed(curve)
            x, y, errors = drawn.x, drawn.plotted, drawn.errors
            line, fill = CurveItem(pen=pg.mkPen(colour, width=1)), BandFill(self.plot)
            line.setData(*decimate_to_drawn(x, y), connect="finite")
            self.plot.addItem(line)
            if few := x.size <= MAX_MARKED_POINTS:
                there = np.isfinite(y)
                self._add_further(ScatterItem(x=x[there], y=y[there], size=8, pen=None, brush=colour))
            fill.set_color(colour.name())
            if errors is not None:
                alone = np.isfinite(errors) if few else isolated(errors)
                half = np.where(alone, np.nan, SIGMAS * errors)
                (places, low), (_, high) = (decimate_to_drawn(x, y + side * half) for side in (-1, 1))
                fill.show_band(places, (low, high))
                if alone.any():
                    bars = BarsItem(
                        x=x[alone],
                        y=y[alone],
                        height=2 * SIGMAS * errors[alone],
                        beam=0.0,
                        pen=pg.mkPen(fill.brush().color()),
                    )
                    self._add_further(bars)
            if drawn.fit is not None:
                # A fit of one curve among several has its colour: the model's would hide which is which.
                pen = pg.mkPen(colour if len(shown) > 1 else tokens().model, width=1.5, style=Qt.PenStyle.DotLine)
                dotted = CurveItem(pen=pen)
                dotted.setData(*decimate_to_drawn(x, drawn.fit), connect="finite")
                self._add_further(dotted)
            if curve.label and at >= len(shown) - MAX_LEGEND_ENTRIES:
                self.legend.addItem(line, curve.label)
            self.drawn_curves.append((line, fill))
            self.caption.setText(curve.name.capitalize())
            for side, axis in (("bottom", curve.x_axis), ("left", curve.y_axis)):
                unit = shown_unit(axis.unit)[1]
                self.plot.setLabel(side, f"{axis.name} ({unit})" if unit else axis.name)
        self.legend.setOffset((8, 4) if any(curve.is_loop for curve in shown) else (-8, 4))  # a loop rises to the right
        self._draw_model()
        self._draw_layer()
        self._scale()

    def _replace_legend(self, columns: int) -> None:
        """Lay out the legend anew: after the removal of an entry pyqtgraph's legend would overlap others."""
        drawn = [line for line, _ in self.drawn_curves]
        entries = [(sample.item, label.text) for sample, label in self.legend.items if sample.item in drawn]
        offset = self.legend.offset
        self.legend.scene().removeItem(self.legend)
        self.plot.legend = None
        self._add_legend(left=False)
        self.legend.setColumnCount(columns)
        self.legend.setOffset(offset)
        self.legend.setLabelTextColor(tokens().text)
        for item, label in entries:
            self.legend.addItem(item, label)

    def _add_further(self, item: Any) -> None:
        self.plot.addItem(item)
        self._further_items.append(item)

    @cached_property
    def strip(self) -> LowerStrip:
        """The plot below the curves; created when first used."""
        return self._add_strip(LowerStrip(self.plot))

    @property
    def layer(self) -> str:
        """Contents of the lower plot."""
        shown = self._visible_curves
        offered = layers_of(shown)
        chosen = self._chosen_layers.get(shown[-1].y_axis.name, "") if shown else ""
        return chosen if chosen in offered else offered[0]

    def show_simulated(self, simulated: bool) -> None:
        super().show_simulated(simulated)
        if "strip" in vars(self):
            self.strip.simulated = simulated

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        if "strip" in vars(self):
            self.strip.setVisible(self.layer != NOTHING and self.height() >= MIN_HEIGHT_OF_BOTH)

    def _on_layer_chosen(self, index: int) -> None:
        if shown := self._visible_curves:
            self._chosen_layers[shown[-1].y_axis.name] = self.layer_box.itemData(index)
            self._draw_layer()

    def _draw_layer(self) -> None:
        """Draw the lower plot, and offer the layers that the curves have."""
        shown, layer = self._visible_curves, self.layer
        offered = layers_of(shown)
        if [self.layer_box.itemData(at) for at in range(self.layer_box.count())] != list(offered):
            self.layer_box.clear()
            for each in offered:
                self.layer_box.addItem(LAYER_LABELS[each], each)
        self.layer_box.setCurrentIndex(self.layer_box.findData(layer))
        self.layer_box.setVisible(len(offered) > 1)
        if layer == NOTHING and "strip" not in vars(self):
            return
        self.strip.setVisible(layer != NOTHING and self.height() >= MIN_HEIGHT_OF_BOTH)
        self._layout.setStretch(self._layout.indexOf(self.canvas), 1 if layer == LESS_MEAN else 3)
        self._layout.setStretch(self._layout.indexOf(self.strip), 1)
        drawn = [(at, series) for at, curve in enumerate(shown) if (series := layer_series(curve, layer)) is not None]
        colors = [self._color(at, len(shown)) for at, _ in drawn]
        label = layer_label(shown[-1], layer) if shown else ""
        zero = layer in (RESIDUAL, LESS_MEAN)
        self.strip.draw(
            [_thin(series) for _, series in drawn], colors, label, symbols=False, zero=zero, simulated=self.simulated
        )

    def _color(self, at: int, count: int) -> QColor:
        return QColor(tokens().ink) if count == 1 else curve_color(at)

    def _draw_model(self) -> None:
        """Draw the response to one volt at the amplifier's input: the curve's fundamental divided by its amplitude."""
        curve, shown = self._model_curve, self._visible_curves
        fits = self._bare_tactor and curve is not None and bool(shown) and shown[-1].y_axis.unit == "m/V"
        self.model.setVisible(fits)
        self.band.setVisible(fits)
        self.source.setText(f"dashed: {curve.active_model.description}" if fits and curve is not None else "")
        if not fits or curve is None:
            return
        factor = shown_unit("m/V")[0] / curve.request.amplitude_v
        drawn = curve.free["fundamental"].scaled(1.0, factor)
        self.model.setData(drawn.x, drawn.plotted)
        self.band.show_band(drawn.x, drawn.band)

    def _scale(self, *_: object) -> None:
        if not self.drawn_curves:
            return
        x, y = (np.concatenate([linear_data(line)[axis] for line, _ in self.drawn_curves]) for axis in (0, 1))
        x, y = x[np.isfinite(x)], y[np.isfinite(y)]
        if not (x.size and y.size):
            return
        if self.model.isVisible():
            y = np.concatenate((y, linear_data(self.model)[1], () if self.band.ends is None else self.band.ends[2]))
        # The legend has as many columns as fit side by side, and lies above the curves.
        columns = max(min(int(self.plot.getViewBox().width() // LEGEND_COLUMN_WIDTH), 4), 1)
        if columns != self.legend.columnCount:
            self._replace_legend(columns)
        low, high = min(float(y.min()), 0.0), float(y.max())
        high = low + (high - low) / (1 - legend_share(self.legend, self.plot))
        low, high = stable_range(low, high, None)
        self.plot.setXRange(float(x.min()), float(x.max()), padding=0.01)
        self.plot.setYRange(low if y.min() < 0 else 0.0, high, padding=0)


def _axis_names(curve: Series) -> tuple[str, str]:
    return curve.x_axis.name, curve.y_axis.name


def _thin(series: Series) -> Series:
    """Return a layer, decimated if it is long; then without errors."""
    if series.x.size <= MAX_DRAWN_POINTS:
        return series
    x, y = decimate_to_drawn(series.x, series.y)
    return Series(x, y, name=series.name)


def decimate_to_drawn(x: Array, y: Array) -> tuple[Array, Array]:
    """Return the curve itself, or its min/max decimation if it has more than `MAX_DRAWN_POINTS`."""
    if x.size <= MAX_DRAWN_POINTS:
        return x, y
    return minmax_decimate(x, y, samples_per_column=-(-2 * x.size // MAX_DRAWN_POINTS))
