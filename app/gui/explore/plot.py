"""Curves over frequency: amplitude above, phase below it where asked for; kept curves, measured points, what is felt."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QVBoxLayout, QWidget

from app.archive.replay import MeasuredResponse
from app.explore.engine import Array, ExploreCurve, ExploreResult
from app.explore.state import KeptCurve
from app.gui.plots.base import (
    CURVE_COLORS,
    LABEL_ON_LINE,
    CornerLabel,
    apply_plot_theme,
    curve_color,
    finite_max,
    legend_share,
    round_step,
    simulated_label,
    style_axes,
)
from app.gui.plots.copy import PlotCopyButtons, PlotSeries, series_as_text
from app.gui.plots.response_plot import FELT_THRESHOLD_UM
from app.gui.widgets.theme import Theme

AXIS_WIDTH = 62
SERIES = ("max − min", "2 × fundamental")


class ExplorePlot(QWidget):
    """Draws pictures; tells where its cursor was moved to."""

    cursor_moved = Signal(float)

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme = theme
        self._result: ExploreResult | None = None
        self._kept_settings: tuple[KeptCurve, ...] = ()
        self._runs: Sequence[MeasuredResponse] = ()
        self._shown_series = (True, False)
        self._log = False
        self._max_hz = 250.0
        self.canvas, self.phase_canvas = pg.PlotWidget(enableMenu=False), pg.PlotWidget(enableMenu=False)
        self.plot, self.phase = self.canvas.getPlotItem(), self.phase_canvas.getPlotItem()
        # No grid: painting one takes longer than a frame, and this plot is painted with every move of a slider.
        for plot, words in ((self.plot, "amplitude (µm)"), (self.phase, "phase (°)")):
            style_axes(plot, self.font())
            plot.setContentsMargins(0, 0, 8, 0)
            plot.getAxis("left").setWidth(AXIS_WIDTH)
            plot.setLabel("left", words)
            plot.setLabel("bottom", "frequency (Hz)")
        self.phase.setXLink(self.plot)
        words = f"{FELT_THRESHOLD_UM:g} µm: felt on the abdomen"
        self._threshold_line = pg.InfiniteLine(FELT_THRESHOLD_UM, angle=0, label=words, labelOpts=LABEL_ON_LINE)
        self._threshold_line.label.setFont(self.font())
        self.band = pg.PlotCurveItem(connect="finite")
        self.curves = [pg.PlotCurveItem(antialias=True) for _ in SERIES]
        self.phase_curve = pg.PlotCurveItem(antialias=True)
        self._kept_curves: list[tuple[pg.PlotCurveItem, pg.PlotCurveItem]] = []
        self._points: list[tuple[Any, ...]] = []
        self.cursor_line = pg.InfiniteLine(160.0, angle=90, movable=True, bounds=(1, 4000))
        self.legend = self.plot.addLegend(offset=(8, 4), labelTextSize="9pt", verSpacing=-6)
        for item in (self._threshold_line, self.band, self.cursor_line, *self.curves):
            self.plot.addItem(item)
        self.phase.addItem(self.phase_curve)
        self.simulated_label = simulated_label(self.plot, self.font())
        self.corner_label = CornerLabel(self.plot, "", self.font(), right=False)
        self.simulated_label.set_visible(False)
        self.copy_buttons = [PlotCopyButtons(canvas, self._table) for canvas in (self.canvas, self.phase_canvas)]
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(2)
        layout.addWidget(self.canvas, 5)
        layout.addWidget(self.phase_canvas, 2)
        self.phase_canvas.hide()
        self.plot.getViewBox().sigResized.connect(lambda _: self._scale())
        self.cursor_line.sigPositionChanged.connect(lambda line: self.cursor_moved.emit(float(line.value())))
        self.set_theme(theme)
        self._scale()

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self._theme = theme
        for canvas, plot in ((self.canvas, self.plot), (self.phase_canvas, self.phase)):
            canvas.setBackground(theme.panel)
            apply_plot_theme(plot, theme)
        self._threshold_line.setPen(pg.mkPen(theme.threshold, width=1))
        self._threshold_line.label.setColor(QColor(theme.threshold))
        self.band.setPen(pg.mkPen(theme.threshold, width=5))
        self.cursor_line.setPen(pg.mkPen(theme.secondary_text, width=1, style=Qt.PenStyle.DotLine))
        self.cursor_line.setHoverPen(pg.mkPen(theme.accent, width=2))
        for curve, style in zip(self.curves, (Qt.PenStyle.SolidLine, Qt.PenStyle.DashLine), strict=True):
            curve.setPen(pg.mkPen(theme.model, width=2, style=style))
        self.phase_curve.setPen(pg.mkPen(theme.model, width=2))
        self.simulated_label.set_color(theme.simulated)
        self.corner_label.set_color(theme.text)
        self.legend.setLabelTextColor(theme.text)
        ground = QColor(theme.panel)
        ground.setAlpha(210)
        self.legend.setBrush(ground)
        self._draw_kept_curves()
        self._draw_runs()

    def show_result(self, result: ExploreResult, kept_curves: tuple[KeptCurve, ...]) -> None:
        """Draw what is known by now."""
        before, self._result = self._result, result
        line = result.curve
        if before is None or line is not before.curve:
            for curve, values in zip(self.curves, self._amplitudes(line), strict=True):
                curve.setData(line.frequency_hz, values)
            self.phase_curve.setData(line.frequency_hz, np.degrees(line.phase))
            self._label_felt_bands(result)
        if result.kept_curves is not None and (
            kept_curves != self._kept_settings or before is None or result.kept_curves != before.kept_curves
        ):
            self._kept_settings = kept_curves
            self._draw_kept_curves()
        self._scale()

    def show_runs(self, runs: Sequence[MeasuredResponse]) -> None:
        """Lay runs over the curves."""
        self._runs = tuple(runs)
        self.simulated_label.set_visible(any(run.simulated for run in runs))
        self._draw_runs()
        self._scale()

    def show_series(self, peak_to_peak: bool, fundamental: bool, phase: bool, log: bool) -> None:
        """What is drawn, and whether the amplitude's axis is logarithmic."""
        self._shown_series, self._log = (peak_to_peak, fundamental), log
        for curve, shown in zip(self.curves, self._shown_series, strict=True):
            curve.setVisible(shown)
        self.phase_canvas.setVisible(phase)
        self.plot.getAxis("left").setLogMode(x=False, y=log)
        self.plot.getAxis("bottom").setStyle(showValues=not phase)
        self.plot.setLabel("bottom", "" if phase else "frequency (Hz)")
        self._threshold_line.setValue(self._y(FELT_THRESHOLD_UM))
        if self._result is not None:
            picture, self._result = self._result, None
            self.show_result(picture, self._kept_settings)
        self._draw_kept_curves()
        self._draw_runs()
        self._scale()

    def show_range(self, max_hz: float) -> None:
        self._max_hz = max_hz
        self._scale()

    def _table(self) -> str:
        """Curves, kept curves and measured runs; amplitudes also where their axis is logarithmic, phases in degrees."""
        shown: list[PlotSeries] = []
        lines: list[tuple[str, ExploreCurve | MeasuredResponse]] = []
        if self._result is not None:
            kept = zip((k.label for k in self._kept_settings), self._result.kept_curves or (), strict=False)
            lines = [("model", self._result.curve), *kept]
        simulated = [(f"{run.label}{', SIMULATED' if run.simulated else ''}", run) for run in self._runs]
        for name, line in (*lines, *simulated):
            errors = (
                (line.peak_to_peak_errors, 2 * line.fundamental_errors)
                if isinstance(line, MeasuredResponse)
                else (None, None)
            )
            for words, y, error in zip(SERIES, (line.peak_to_peak, line.twice_fundamental), errors, strict=True):
                um = None if error is None else 1e6 * error
                shown.append(PlotSeries(f"{name}: {words} (µm)", line.frequency_hz, 1e6 * y, um))
            shown.append(PlotSeries(f"{name}: phase (°)", line.frequency_hz, np.degrees(line.phase)))
        return series_as_text(shown, "frequency (Hz)", "value", self.simulated_label.visible)

    def _y(self, um: float) -> float:
        return float(np.log10(max(um, 1e-6))) if self._log else um

    def _amplitudes(self, line: ExploreCurve | MeasuredResponse) -> tuple[np.ndarray, np.ndarray]:
        both = 1e6 * line.peak_to_peak, 1e6 * line.twice_fundamental
        return tuple(np.log10(np.maximum(v, 1e-6)) for v in both) if self._log else both  # type: ignore[return-value]

    def _label_felt_bands(self, result: ExploreResult) -> None:
        ends: list[float] = []
        for low, high in result.felt_bands:
            ends += [low, high, np.nan]
        self.band.setData(np.array(ends), np.full(len(ends), self._y(FELT_THRESHOLD_UM)))
        line = result.curve
        top = int(line.peak_to_peak.argmax())
        peak = f"peak {1e6 * line.peak_to_peak[top]:.0f} µm at {line.frequency_hz[top]:.0f} Hz"
        last = float(line.frequency_hz[-1])
        bands = ", ".join(
            f"{low:.0f} … {high:.0f} Hz" if high < last else f"{low:.0f} Hz and beyond"
            for low, high in result.felt_bands
        )
        self.corner_label.set_text(f"{peak};   " + (f"felt {bands}" if bands else "nowhere felt"))

    def _draw_kept_curves(self) -> None:
        for items in self._kept_curves:
            self.legend.removeItem(items[0])
            self.plot.removeItem(items[0])
            self.phase.removeItem(items[1])
        self._kept_curves = []
        lines = (self._result.kept_curves or ()) if self._result else ()
        for at, (kept, line) in enumerate(zip(self._kept_settings, lines, strict=False)):
            pen = pg.mkPen(curve_color(at, self._theme), width=1.5)
            upper, lower = pg.PlotCurveItem(antialias=True, pen=pen), pg.PlotCurveItem(antialias=True, pen=pen)
            upper.setData(line.frequency_hz, self._amplitudes(line)[0 if self._shown_series[0] else 1])
            lower.setData(line.frequency_hz, np.degrees(line.phase))
            self.plot.addItem(upper)
            self.phase.addItem(lower)
            self.legend.addItem(upper, kept.label)
            self._kept_curves.append((upper, lower))

    def _draw_runs(self) -> None:
        for upper, second, lower, spot in self._points:
            self.legend.removeItem(spot)
            self.plot.removeItem(upper)
            self.plot.removeItem(second)
            self.phase.removeItem(lower)
        self._points = []
        for at, run in enumerate(self._runs):
            pen = pg.mkPen(curve_color(len(CURVE_COLORS) - 1 - at, self._theme), width=1.5)
            solid, hollow = (
                pg.mkBrush(curve_color(len(CURVE_COLORS) - 1 - at, self._theme)),
                pg.mkBrush(self._theme.panel),
            )
            fills = [solid if good else hollow for good in run.usable]
            both = self._amplitudes(run)
            upper, second, lower = (
                _point_item(run.frequency_hz, y, symbol=s, pen=pen, fills=fills)
                for y, s in ((both[0], "o"), (both[1], "s"), (np.degrees(run.phase), "o"))
            )
            self.plot.addItem(upper)
            self.plot.addItem(second)
            self.phase.addItem(lower)
            upper.setVisible(self._shown_series[0])
            second.setVisible(self._shown_series[1])
            symbol = "o" if self._shown_series[0] or not self._shown_series[1] else "s"
            # A legend cannot show brushes that differ from point to point.
            spot = pg.ScatterPlotItem(size=8, symbol=symbol, pen=pen, brush=solid)
            self.legend.addItem(spot, f"{run.label}{', SIMULATED' if run.simulated else ''}")
            self._points.append((upper, second, lower, spot))

    def _scale(self) -> None:
        tops, phases = [1.5 * FELT_THRESHOLD_UM], [-180.0, 0.0]
        picture = self._result
        if picture is not None:
            for line in (picture.curve, *(picture.kept_curves or ())):
                tops += [1e6 * float(v.max()) for v in (line.peak_to_peak, line.twice_fundamental)]
            phases += [float(np.degrees(v)) for v in (picture.curve.phase.min(), picture.curve.phase.max())]
        tops += [1e6 * finite_max(run.peak_to_peak) for run in self._runs]
        tops += [1e6 * finite_max(run.twice_fundamental) for run in self._runs]
        self.plot.setXRange(0, self._max_hz, padding=0)
        if self._log:
            self.plot.setYRange(0.0, np.ceil(4 * np.log10(max(tops))) / 4, padding=0)
        else:
            top = 1.05 * max(tops) / (1 - legend_share(self.legend, self.plot))
            step = round_step(top, 8)  # in steps, so that it stands still while a slider moves
            self.plot.setYRange(0, step * np.ceil(top / step), padding=0)
        self.phase.setYRange(90 * np.floor(min(phases) / 90), 90 * np.ceil(max(phases) / 90), padding=0.04)


def _point_item(x: Array, y: Array, symbol: str, pen: Any, fills: Sequence[Any]) -> pg.PlotDataItem:
    """Points where there are some: an imported table may not tell a phase, or one of the amplitudes."""
    there = np.flatnonzero(np.isfinite(y))
    brushes = [fills[i] for i in there.tolist()]
    return pg.PlotDataItem(
        x[there], y[there], pen=None, symbol=symbol, symbolSize=8, symbolPen=pen, symbolBrush=brushes
    )
