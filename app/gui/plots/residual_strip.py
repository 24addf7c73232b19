"""A low plot under the response: what the model leaves of the points, or their phase."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtGui import QColor

from app.gui.plots.base import apply_plot_theme, limit_ticks, stable_range, style_axes
from app.gui.plots.copy import PlotCopyButtons, series_as_text, series_of
from app.gui.widgets.theme import Theme
from app.live.overlay import OverlayCurve
from protocols.base.quality import Quality

NOTHING, RESIDUAL, PHASE = "nothing", "residual", "phase"
STRIP_QUANTITIES = (NOTHING, RESIDUAL, PHASE)
HEIGHT = 96


class ResidualStrip(pg.PlotWidget):  # type: ignore[misc]  # pyqtgraph has no types
    """Shares the frequency axis of the response."""

    def __init__(self, main_plot: Any, axis_width: int, theme: Theme) -> None:
        super().__init__(enableMenu=False)
        self.quantity = NOTHING
        self._plot = self.getPlotItem()
        style_axes(self._plot, self.font())
        self._plot.layout.setRowFixedHeight(0, 4)
        self._plot.setContentsMargins(0, 0, 8, 0)
        self._plot.getAxis("left").setWidth(axis_width)
        limit_ticks(self._plot, self.font())
        self._plot.getAxis("bottom").setStyle(showValues=False)
        self._plot.setXLink(main_plot)
        self._plot.showGrid(x=True, y=True, alpha=0.12)
        self.setFixedHeight(HEIGHT)
        self._line = pg.PlotCurveItem(antialias=True, connect="finite")
        self._bars = pg.ErrorBarItem(beam=0.0)
        self.scatter = pg.ScatterPlotItem(size=8, antialias=True)
        for item in (self._line, self._bars, self.scatter):
            self._plot.addItem(item)
        self._simulated = False
        self.copy_buttons = PlotCopyButtons(self, self._table)
        self._theme = theme
        self.hide()

    def set_theme(self, theme: Theme) -> None:
        """Take other colours; `draw` comes next."""
        self._theme = theme
        self.setBackground(theme.panel)
        apply_plot_theme(self._plot, theme)
        self._line.setPen(pg.mkPen(theme.model, width=1.5))
        self._bars.setData(pen=pg.mkPen(theme.measured))

    def _table(self) -> str:
        shown = [*series_of("measured", self.scatter, self._bars), *series_of("model", self._line)]
        return series_as_text(shown, "frequency (Hz)", self._plot.getAxis("left").labelText, self._simulated)

    def draw(self, points: Sequence[Any], curve: OverlayCurve | None, colors: Sequence[QColor]) -> None:
        """Draw what is wanted of points, each in its ink, and curve."""
        self.setVisible(self.quantity != NOTHING)
        self._simulated = any(Quality.SIMULATED in Quality(p.quality) for p in points)
        if self.quantity == NOTHING:
            return
        x = np.array([p.frequency for p in points])
        residual = self.quantity == RESIDUAL
        y, errors, line = _residual(points, curve) if residual else _phase(points, curve)
        self._plot.setLabel("left", "Δ (%)" if residual else "phase (°)")
        self._line.setData(*line)
        there = np.isfinite(y)  # Qt does not survive painting what is nowhere
        seen = [(p, ink) for p, ink, is_there in zip(points, colors, there, strict=True) if is_there]
        fills = [pg.mkBrush(ink if Quality(p.quality).usable else self._theme.panel) for p, ink in seen]
        pens = [pg.mkPen(ink, width=2) for _, ink in seen]
        self.scatter.setData(x=x[there], y=y[there], symbol="o", pen=pens, brush=fills)
        half = np.nan_to_num(errors[there])
        self._bars.setData(x=x[there], y=y[there], height=2 * half)
        modelled = np.asarray(line[1])
        every = np.concatenate([y[there] - half, y[there] + half, modelled[np.isfinite(modelled)]])
        lowest, highest = (float(every.min()), float(every.max())) if every.size else (-1.0, 1.0)
        low, high = stable_range(lowest, highest, None)
        self._plot.setYRange(low, high, padding=0.02)


def _residual(points: Sequence[Any], curve: OverlayCurve | None) -> tuple[Any, Any, tuple[Any, Any]]:
    """Measured max - min less the model's, in per cent of the model's."""
    if curve is None:
        nothing = np.full(len(points), np.nan)
        return nothing, nothing, ([], [])
    model = np.array([_model_peak_to_peak(point, curve) for point in points])
    y = 100 * (np.array([p.peak_to_peak for p in points]) / model - 1)
    return y, 100 * np.array([p.peak_to_peak_errors for p in points]) / model, (curve.frequency_hz[[0, -1]], [0.0, 0.0])


def _model_peak_to_peak(point: Any, curve: OverlayCurve) -> float:
    """The model's max - min at a point, on the membrane as it was then; NaN where there is no such curve."""
    own = curve.at_elongation(getattr(point, "elongation", None))
    return math.nan if own is None else float(np.interp(point.frequency, own.frequency_hz, own.peak_to_peak))


def _phase(points: Sequence[Any], curve: OverlayCurve | None) -> tuple[Any, Any, tuple[Any, Any]]:
    """Phase of the fundamental behind the drive, in degrees, unwrapped downwards from zero."""
    y = np.degrees([(p.phase + 0.5) % (2 * np.pi) - 2 * np.pi - 0.5 if p.phase > 0.5 else p.phase for p in points])
    errors = np.degrees([p.phase_errors for p in points])
    if curve is None:
        return y, errors, ([], [])
    # One line behind the other, with a gap between: free, then on the membrane.
    gap, every = [np.nan], (curve, *curve.on_membrane)
    x = np.concatenate([part for one in every for part in (one.frequency_hz, gap)])
    return y, errors, (x, np.concatenate([part for one in every for part in (np.degrees(np.unwrap(one.phase)), gap)]))
