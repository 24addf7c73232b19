"""Explore plot: amplitude and phase of the model over frequency, kept curves, measured runs, felt bands."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QWidget

from app.archive import MeasuredResponse
from app.explore import ExploreResult, KeptCurve
from app.gui.face import Tokens, follow_tokens, tokens
from app.gui.plots import (
    AXIS_WIDTH,
    CURVE_COLORS,
    SERIES,
    CurveItem,
    PlotBase,
    ZoomBox,
    curve_color,
    finite_max,
    legend_share,
    place,
    round_step,
)
from model import Array, Series
from model.response import PeriodicResponse

CURSOR_HZ = (1, 4000)


class ExplorePlot(PlotBase):
    """Draws results of the model; emits where the cursor was moved to."""

    ACCESSIBLE_NAME = "plot: response of the model"

    cursor_moved = Signal(float)
    """Frequency in Hz."""
    log_changed = Signal(bool)
    """Whether the axis of the amplitude is logarithmic."""

    def __init__(self, parent: QWidget | None = None) -> None:
        # No grid: painting one takes longer than a frame, and this plot is painted with every move of a slider.
        super().__init__(parent)
        self._result: ExploreResult | None = None
        self._kept_settings: tuple[KeptCurve, ...] = ()
        self._runs: Sequence[MeasuredResponse] = ()
        self._shown_series = (True, False)
        self._max_hz = 250.0
        self.phase_canvas = pg.PlotWidget(viewBox=ZoomBox(), enableMenu=False)
        self.phase = self.phase_canvas.getPlotItem()
        self._add_canvas(self.phase_canvas, [self.phase], AXIS_WIDTH)
        for plot, label in ((self.plot, "peak-to-peak displacement (µm)"), (self.phase, "phase (°)")):
            plot.setLabel("left", label)
            plot.setLabel("bottom", "frequency (Hz)")
        self.phase.setXLink(self.plot)
        self.phase.setMouseEnabled(x=False, y=False)  # it follows the upper plot
        self._felt = self._add_threshold(labelled=True, width=1.5)
        self.band = CurveItem(connect="finite")
        self.curves = [CurveItem(antialias=True) for _ in SERIES]
        self.phase_curve = CurveItem(antialias=True)
        self._kept_curves: list[tuple[CurveItem, CurveItem]] = []
        self._points: list[tuple[Any, ...]] = []
        self.cursor_line = pg.InfiniteLine(160.0, angle=90, movable=True, bounds=CURSOR_HZ)
        self._add_legend()
        for item in (self.band, self.cursor_line, *self.curves):
            self.plot.addItem(item)
        self.phase.addItem(self.phase_curve)
        self.show_simulated(False)
        self._layout.addWidget(self.canvas, 5)
        self._layout.addWidget(self.phase_canvas, 2)
        self.phase_canvas.hide()
        self.plot.getViewBox().sigResized.connect(lambda _: self._scale())
        self.cursor_line.sigPositionChanged.connect(
            lambda line: self.cursor_moved.emit(self._frequency_at(line.value()))
        )
        follow_tokens(self, self.apply_theme)
        self._scale()

    def apply_theme(self, theme: Tokens) -> None:
        super().apply_theme(theme)
        self.band.setPen(pg.mkPen(theme.text2, width=5))
        self.cursor_line.setPen(pg.mkPen(theme.text2, width=1, style=Qt.PenStyle.DotLine))
        self.cursor_line.setHoverPen(pg.mkPen(theme.accent, width=2))
        for curve, series in zip(self.curves, SERIES, strict=True):
            curve.setPen(pg.mkPen(theme.model, width=2, style=series.line))
        self.phase_curve.setPen(pg.mkPen(theme.model, width=2))
        ground = QColor(theme.surface)
        ground.setAlpha(210)
        self.legend.setBrush(ground)
        self._draw_kept_curves()
        self._draw_runs()

    def show_result(self, result: ExploreResult, kept_curves: tuple[KeptCurve, ...]) -> None:
        """Draw the results so far."""
        before, self._result = self._result, result
        line = result.curve
        if before is None or line is not before.curve:
            for curve, series in zip(self.curves, SERIES, strict=True):
                curve.setData(line.frequency_hz, series.values_of(line))
            self.phase_curve.setData(line.frequency_hz, np.degrees(line.phase))
        if before is None or line is not before.curve or result.threshold_m is not before.threshold_m:
            self._label_felt_bands(result)
        if result.kept_curves is not None and (
            kept_curves != self._kept_settings or before is None or result.kept_curves != before.kept_curves
        ):
            self._kept_settings = kept_curves
            self._draw_kept_curves()
        self._scale()

    def show_runs(self, runs: Sequence[MeasuredResponse]) -> None:
        """Draw measured runs over the curves."""
        self._runs = tuple(runs)
        self.show_simulated(any(run.simulated for run in runs))
        self._draw_runs()
        self._scale()

    def show_series(self, peak_to_peak: bool, fundamental: bool, phase: bool) -> None:
        """Set the visible series."""
        self._shown_series = (peak_to_peak, fundamental)
        for curve, shown in zip(self.curves, self._shown_series, strict=True):
            curve.setVisible(shown)
        self.phase_canvas.setVisible(phase)
        self.plot.getAxis("bottom").setStyle(showValues=not phase)
        self.plot.setLabel("bottom", "" if phase else "frequency (Hz)")
        self._draw_kept_curves()
        self._draw_runs()
        self._scale()

    def show_range(self, max_hz: float) -> None:
        self._max_hz = max_hz
        self._scale()

    def _series(self) -> Iterable[Series]:
        """Return curves, kept curves and runs: amplitudes in µm, also on a logarithmic axis, and phases in degrees."""
        lines: list[tuple[str, PeriodicResponse | MeasuredResponse]] = []
        if self._result is not None:
            kept = zip((k.label for k in self._kept_settings), self._result.kept_curves or (), strict=False)
            lines = [("model", self._result.curve), *kept]
        for name, line in (*lines, *((run.title, run) for run in self._runs)):
            for series in SERIES:
                y, errors = series.values_of(line), series.errors_of(line)
                yield Series(line.frequency_hz, y, errors, name=f"{name}: {series.label} (µm)")
            yield Series(line.frequency_hz, np.degrees(line.phase), name=f"{name}: phase (°)")

    def _column_names(self) -> tuple[str, str]:
        return "frequency (Hz)", "value"

    def set_log_axes(self, x: bool, y: bool) -> None:
        frequency_hz = self._frequency_at(self.cursor_line.value())
        super().set_log_axes(x, y)
        self.cursor_line.setBounds(tuple(place(CURSOR_HZ, x)))
        self.show_cursor(frequency_hz)
        self.log_changed.emit(y)

    def show_cursor(self, frequency_hz: float) -> None:
        """Move the cursor to a frequency."""
        self.cursor_line.setValue(float(place(frequency_hz, self.log_axes[0])))

    def _frequency_at(self, value: float) -> float:
        return float(10.0**value if self.log_axes[0] else value)

    def _label_felt_bands(self, result: ExploreResult) -> None:
        line, threshold_um = result.curve, 1e6 * result.threshold_m
        flat = bool(np.ptp(threshold_um) == 0)
        if flat:
            self._felt.show_level(float(threshold_um[0]), result.threshold_label)
        else:
            self._felt.show_curve(line.frequency_hz, threshold_um, result.threshold_label)
        stretches = [np.append(np.linspace(low, high, 2 if flat else 50), np.nan) for low, high in result.felt_bands]
        felt_hz = np.concatenate(stretches) if stretches else np.zeros(0)
        self.band.setData(felt_hz, np.interp(felt_hz, line.frequency_hz, threshold_um))
        top = int(line.peak_to_peak.argmax())
        peak = f"peak {1e6 * line.peak_to_peak[top]:.0f} µm at {line.frequency_hz[top]:.0f} Hz"
        last = float(line.frequency_hz[-1])
        bands = ", ".join(
            f"{low:.0f} … {high:.0f} Hz" if high < last else f"from {low:.0f} Hz" for low, high in result.felt_bands
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
            pen = pg.mkPen(curve_color(at), width=1.5)
            upper, lower = CurveItem(antialias=True, pen=pen), CurveItem(antialias=True, pen=pen)
            upper.setData(line.frequency_hz, SERIES[0 if self._shown_series[0] else 1].values_of(line))
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
            color = curve_color(len(CURVE_COLORS) - 1 - at)
            pen, solid, hollow = pg.mkPen(color, width=1.5), pg.mkBrush(color), pg.mkBrush(tokens().surface)
            fills = [solid if good else hollow for good in run.peak_to_peak.fit_rows]
            amplitudes = [(series.values_of(run), series.symbol) for series in SERIES]
            upper, second, lower = (
                _point_item(run.frequency_hz, y, symbol=symbol, pen=pen, fills=fills)
                for y, symbol in (*amplitudes, (np.degrees(run.phase), "o"))
            )
            self.plot.addItem(upper)
            self.plot.addItem(second)
            self.phase.addItem(lower)
            upper.setVisible(self._shown_series[0])
            second.setVisible(self._shown_series[1])
            symbol = "o" if self._shown_series[0] or not self._shown_series[1] else "s"
            # A legend cannot show brushes that differ from point to point.
            spot = pg.ScatterPlotItem(size=8, symbol=symbol, pen=pen, brush=solid)
            self.legend.addItem(spot, run.title)
            self._points.append((upper, second, lower, spot))

    def _scale(self) -> None:
        tops, phases = [1.5 * self._felt.top_um], [-180.0, 0.0]
        result = self._result
        lines: list[PeriodicResponse | MeasuredResponse] = [*self._runs]
        if result is not None:
            lines += (result.curve, *(result.kept_curves or ()))
            phases += [float(np.degrees(v)) for v in (result.curve.phase.min(), result.curve.phase.max())]
        tops += [finite_max(series.values_of(line)) for line in lines for series in SERIES]
        self.plot.setXRange(0, self._max_hz, padding=0)
        top = 1.05 * max(tops) / (1 - legend_share(self.legend, self.plot))
        step = round_step(top, 8)  # in steps, so that the axis does not change while a slider moves
        self.plot.setYRange(0, step * np.ceil(top / step), padding=0)
        self.phase.setYRange(90 * np.floor(min(phases) / 90), 90 * np.ceil(max(phases) / 90), padding=0.04)


def _point_item(x: Array, y: Array, symbol: str, pen: Any, fills: Sequence[Any]) -> pg.PlotDataItem:
    """Make an item of the finite points: an imported table may have no phase, or one of the amplitudes only."""
    there = np.flatnonzero(np.isfinite(y))
    brushes = [fills[i] for i in there.tolist()]
    return pg.PlotDataItem(
        x[there], y[there], pen=None, symbol=symbol, symbolSize=8, symbolPen=pen, symbolBrush=brushes
    )
