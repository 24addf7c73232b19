"""Curves that entries give beside their points - frequency responses, decays - as they arrive, each within its errors."""

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QWidget

from app.common.units import display_unit
from app.gui.plots.base import BandFill, PlotBase, curve_color, stable_range
from app.gui.plots.copy import PlotSeries, series_as_text, series_of
from app.gui.widgets.form import set_style_kind
from app.gui.widgets.theme import Theme
from app.live.overlay import OverlayCurve as Modelled
from app.session.messages import format_estimate
from protocols.base.events import RunEnded
from protocols.base.records import ResultCurve

Array = NDArray[np.float64]

MAX_DRAWN_POINTS = 4000
"""More points than this are drawn as the smallest and largest of each stretch."""

SIGMAS = 2.0
MAX_LEGEND_ENTRIES = 12


class CurvesPlot(PlotBase):
    """The newest kind of curve of the present run; under a frequency response of the bare tactor lies the model's."""

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(theme, parent)
        self._curves: Sequence[ResultCurve] = ()
        self._model_curve: Modelled | None = None
        self._bare_tactor = False
        self.model, self.band = pg.PlotCurveItem(antialias=True), BandFill(self._plot)
        self._plot.addItem(self.model)
        self.legend = self._plot.addLegend(offset=(-8, 4), labelTextSize="9pt", verSpacing=-6)
        self.drawn_curves: list[tuple[pg.PlotCurveItem, BandFill]] = []
        self.caption, self.source = QLabel("Curves"), QLabel()
        set_style_kind(self.caption, "caption")
        set_style_kind(self.source, "note")
        self.points_button = QPushButton("Show the points")
        set_style_kind(self.points_button, "choice")
        head = QHBoxLayout()
        head.setSpacing(14)
        head.addWidget(self.caption)
        head.addWidget(self.source)
        head.addStretch()
        head.addWidget(self.points_button)
        self._add_head(head)
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        super().set_theme(theme)
        self.model.setPen(pg.mkPen(theme.model, width=1.5, style=Qt.PenStyle.DashLine))
        self.band.set_color(theme.model)
        self.legend.setLabelTextColor(theme.text)
        self._draw()

    def show_curves(self, curves: Sequence[ResultCurve], bare_tactor: bool) -> None:
        """Draw the curves of the present run; `bare`: of the tactor as the model's curve has it, without a mass or skin."""
        if curves is not self._curves:
            self._curves, self._bare_tactor = curves, bare_tactor
            self._draw()

    def show_model_curve(self, curve: Modelled) -> None:
        """The model under a frequency response."""
        if curve is not self._model_curve:
            self._model_curve = curve
            self._draw_model()
            self._scale()

    def show_estimates(self, outcome: RunEnded | None) -> None:
        """Write what was identified."""
        self.estimates_label.set_text(
            "" if outcome is None else ",   ".join(format_estimate(e) for e in outcome.estimates[:3])
        )

    @property
    def _visible_curves(self) -> list[ResultCurve]:
        """Those that have the axes of the newest."""
        last = self._curves[-1] if self._curves else None
        return [c for c in self._curves if last is not None and (c.x, c.y) == (last.x, last.y)]

    def _table(self) -> str:
        """Every line of the curves, also those that are too many to be drawn."""
        shown = []
        for curve in self._visible_curves:
            across, factor = (display_unit(curve.columns[name].unit)[0] for name in (curve.x, curve.y))
            errors = curve.columns.get(f"{curve.y}_errors")
            x, y = across * curve.columns[curve.x].values, factor * curve.columns[curve.y].values
            name = f"{curve.name} {curve.label}".strip()
            shown.append(PlotSeries(name, x, y, None if errors is None else factor * errors.values))
        across, up = (self._plot.getAxis(side).labelText for side in ("bottom", "left"))
        return series_as_text(
            (*shown, *series_of(self.source.text(), self.model)), across, up, self.simulated_label.visible
        )

    def _draw(self) -> None:
        for line, fill in self.drawn_curves:
            self.legend.removeItem(line)
            self._plot.removeItem(line)
            self._plot.removeItem(fill)
        self.drawn_curves = []
        shown = self._visible_curves
        for at, curve in enumerate(shown):
            colour = QColor(self._theme.measured) if len(shown) == 1 else curve_color(at, self._theme)
            (across, x_unit), (factor, y_unit) = (display_unit(curve.columns[name].unit) for name in (curve.x, curve.y))
            x, y = across * curve.columns[curve.x].values, factor * curve.columns[curve.y].values
            errors = curve.columns.get(f"{curve.y}_errors")
            line, fill = pg.PlotCurveItem(pen=pg.mkPen(colour, width=1)), BandFill(self._plot)
            line.setData(*minmax_decimate(x, y), connect="finite")
            self._plot.addItem(line)
            fill.set_color(colour.name())
            if errors is not None:
                reach = SIGMAS * factor * errors.values
                (places, low), (_, high) = minmax_decimate(x, y - reach), minmax_decimate(x, y + reach)
                fill.show_between(places, low, high)
            if curve.label and at >= len(shown) - MAX_LEGEND_ENTRIES:
                self.legend.addItem(line, curve.label)
            self.drawn_curves.append((line, fill))
            self.caption.setText(curve.name.capitalize())
            for side, name, unit in (("bottom", curve.x, x_unit), ("left", curve.y, y_unit)):
                self._plot.setLabel(side, f"{name} ({unit})" if unit else name)
        left = any((np.diff(curve.columns[curve.x].values) < 0).any() for curve in shown)  # a loop rises to the right
        self.legend.setOffset((8, 4) if left else (-8, 4))
        self._draw_model()
        self._scale()

    def _draw_model(self) -> None:
        """A response to a volt at the amplifier's input: the fundamental of the curve by its amplitude."""
        curve, shown = self._model_curve, self._visible_curves
        fits = self._bare_tactor and curve is not None and bool(shown) and shown[-1].columns[shown[-1].y].unit == "m/V"
        self.model.setVisible(fits)
        self.band.setVisible(fits)
        self.source.setText(f"dashed: {curve.active_model.description}" if fits and curve is not None else "")
        if not fits or curve is None:
            return
        factor = display_unit("m/V")[0] / curve.request.amplitude_v
        self.model.setData(curve.frequency_hz, factor * curve.fundamental)
        if curve.band is None:
            self.band.clear()
        else:
            low, high = curve.band.fundamental
            self.band.show_between(curve.frequency_hz, factor * low, factor * high)

    def _scale(self) -> None:
        if not self.drawn_curves:
            return
        x, y = (np.concatenate([line.getData()[axis] for line, _ in self.drawn_curves]) for axis in (0, 1))
        x, y = x[np.isfinite(x)], y[np.isfinite(y)]
        if not (x.size and y.size):
            return
        if self.model.isVisible():
            y = np.concatenate((y, self.model.getData()[1], () if self.band.ends is None else self.band.ends[2]))
        low, high = stable_range(min(float(y.min()), 0.0), float(y.max()), None)
        self._plot.setXRange(float(x.min()), float(x.max()), padding=0.01)
        self._plot.setYRange(low if y.min() < 0 else 0.0, high, padding=0)


def minmax_decimate(x: Array, y: Array) -> tuple[Array, Array]:
    """At most about `MAX_DRAWN_POINTS` points: the smallest and the largest of each stretch."""
    per = -(-2 * x.size // MAX_DRAWN_POINTS)
    if x.size <= MAX_DRAWN_POINTS:
        return x, y
    edges = np.arange(0, x.size, per)
    pairs = np.stack((np.minimum.reduceat(y, edges), np.maximum.reduceat(y, edges)), axis=1)
    return np.repeat(x[edges], 2), pairs.ravel()
