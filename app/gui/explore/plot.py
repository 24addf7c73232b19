"""Curves over frequency: amplitude above, phase below it where asked for; kept curves, measured points, what is felt."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QVBoxLayout, QWidget

from app.archive.replay import Measured
from app.explore.engine import Array, Line, Picture
from app.explore.state import Kept
from app.gui.plots.base import (
    INKS,
    LABEL_ON_LINE,
    Corner,
    ink,
    largest,
    paint,
    quiet,
    round_step,
    share_of,
    simulated_mark,
)
from app.gui.plots.copy import Copying, Shown, as_text
from app.gui.plots.response_plot import FELT_UM
from app.gui.widgets.theme import Theme

AXIS_WIDTH = 62
SERIES = ("max − min", "2 × fundamental")


class ExplorePlot(QWidget):
    """Draws pictures; tells where its cursor was moved to."""

    cursor_moved = Signal(float)

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme = theme
        self._picture: Picture | None = None
        self._kept: tuple[Kept, ...] = ()
        self._measured: Sequence[Measured] = ()
        self._shown = (True, False)
        self._log = False
        self._top_hz = 250.0
        self.canvas, self.below = pg.PlotWidget(enableMenu=False), pg.PlotWidget(enableMenu=False)
        self.plot, self.phase = self.canvas.getPlotItem(), self.below.getPlotItem()
        # No grid: painting one takes longer than a frame, and this plot is painted with every move of a slider.
        for plot, words in ((self.plot, "amplitude (µm)"), (self.phase, "phase (°)")):
            quiet(plot, self.font())
            plot.setContentsMargins(0, 0, 8, 0)
            plot.getAxis("left").setWidth(AXIS_WIDTH)
            plot.setLabel("left", words)
            plot.setLabel("bottom", "frequency (Hz)")
        self.phase.setXLink(self.plot)
        words = f"{FELT_UM:g} µm: felt on the abdomen"
        self._felt = pg.InfiniteLine(FELT_UM, angle=0, label=words, labelOpts=LABEL_ON_LINE)
        self._felt.label.setFont(self.font())
        self.band = pg.PlotCurveItem(connect="finite")
        self.curves = [pg.PlotCurveItem(antialias=True) for _ in SERIES]
        self.turn = pg.PlotCurveItem(antialias=True)
        self._kept_curves: list[tuple[pg.PlotCurveItem, pg.PlotCurveItem]] = []
        self._points: list[tuple[Any, ...]] = []
        self.pointer = pg.InfiniteLine(160.0, angle=90, movable=True, bounds=(1, 4000))
        self.legend = self.plot.addLegend(offset=(8, 4), labelTextSize="9pt", verSpacing=-6)
        for item in (self._felt, self.band, self.pointer, *self.curves):
            self.plot.addItem(item)
        self.phase.addItem(self.turn)
        self.mark = simulated_mark(self.plot, self.font())
        self.words = Corner(self.plot, "", self.font(), right=False)
        self.mark.show(False)
        self.copying = [Copying(canvas, self._table) for canvas in (self.canvas, self.below)]
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(2)
        layout.addWidget(self.canvas, 5)
        layout.addWidget(self.below, 2)
        self.below.hide()
        self.plot.getViewBox().sigResized.connect(lambda _: self._scale())
        self.pointer.sigPositionChanged.connect(lambda line: self.cursor_moved.emit(float(line.value())))
        self.set_theme(theme)
        self._scale()

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self._theme = theme
        for canvas, plot in ((self.canvas, self.plot), (self.below, self.phase)):
            canvas.setBackground(theme.panel)
            paint(plot, theme)
        self._felt.setPen(pg.mkPen(theme.felt, width=1))
        self._felt.label.setColor(QColor(theme.felt))
        self.band.setPen(pg.mkPen(theme.felt, width=5))
        self.pointer.setPen(pg.mkPen(theme.dim, width=1, style=Qt.PenStyle.DotLine))
        self.pointer.setHoverPen(pg.mkPen(theme.accent, width=2))
        for curve, style in zip(self.curves, (Qt.PenStyle.SolidLine, Qt.PenStyle.DashLine), strict=True):
            curve.setPen(pg.mkPen(theme.model, width=2, style=style))
        self.turn.setPen(pg.mkPen(theme.model, width=2))
        self.mark.colour(theme.simulated)
        self.words.colour(theme.text)
        self.legend.setLabelTextColor(theme.text)
        ground = QColor(theme.panel)
        ground.setAlpha(210)
        self.legend.setBrush(ground)
        self._draw_kept()
        self._draw_measured()

    def show_picture(self, picture: Picture, kept: tuple[Kept, ...]) -> None:
        """Draw what is known by now."""
        before, self._picture = self._picture, picture
        line = picture.line
        if before is None or line is not before.line:
            for curve, values in zip(self.curves, self._amplitudes(line), strict=True):
                curve.setData(line.frequency_hz, values)
            self.turn.setData(line.frequency_hz, np.degrees(line.phase))
            self._say_felt(picture)
        if picture.kept is not None and (kept != self._kept or before is None or picture.kept != before.kept):
            self._kept = kept
            self._draw_kept()
        self._scale()

    def show_measured(self, measured: Sequence[Measured]) -> None:
        """Lay runs over the curves."""
        self._measured = tuple(measured)
        self.mark.show(any(run.simulated for run in measured))
        self._draw_measured()
        self._scale()

    def show_series(self, peak_to_peak: bool, fundamental: bool, phase: bool, log: bool) -> None:
        """What is drawn, and whether the amplitude's axis is logarithmic."""
        self._shown, self._log = (peak_to_peak, fundamental), log
        for curve, shown in zip(self.curves, self._shown, strict=True):
            curve.setVisible(shown)
        self.below.setVisible(phase)
        self.plot.getAxis("left").setLogMode(x=False, y=log)
        self.plot.getAxis("bottom").setStyle(showValues=not phase)
        self.plot.setLabel("bottom", "" if phase else "frequency (Hz)")
        self._felt.setValue(self._y(FELT_UM))
        if self._picture is not None:
            picture, self._picture = self._picture, None
            self.show_picture(picture, self._kept)
        self._draw_kept()
        self._draw_measured()
        self._scale()

    def show_range(self, top_hz: float) -> None:
        self._top_hz = top_hz
        self._scale()

    def _table(self) -> str:
        """Curves, kept curves and measured runs; amplitudes also where their axis is logarithmic, phases in degrees."""
        shown: list[Shown] = []
        lines: list[tuple[str, Line | Measured]] = []
        if self._picture is not None:
            kept = zip((k.label for k in self._kept), self._picture.kept or (), strict=False)
            lines = [("model", self._picture.line), *kept]
        simulated = [(f"{run.label}{', SIMULATED' if run.simulated else ''}", run) for run in self._measured]
        for name, line in (*lines, *simulated):
            errors = (
                (line.peak_to_peak_errors, 2 * line.fundamental_errors) if isinstance(line, Measured) else (None, None)
            )
            for words, y, error in zip(SERIES, (line.peak_to_peak, line.twice_fundamental), errors, strict=True):
                um = None if error is None else 1e6 * error
                shown.append(Shown(f"{name}: {words} (µm)", line.frequency_hz, 1e6 * y, um))
            shown.append(Shown(f"{name}: phase (°)", line.frequency_hz, np.degrees(line.phase)))
        return as_text(shown, "frequency (Hz)", "value", self.mark.visible)

    def _y(self, um: float) -> float:
        return float(np.log10(max(um, 1e-6))) if self._log else um

    def _amplitudes(self, line: Line | Measured) -> tuple[np.ndarray, np.ndarray]:
        both = 1e6 * line.peak_to_peak, 1e6 * line.twice_fundamental
        return tuple(np.log10(np.maximum(v, 1e-6)) for v in both) if self._log else both  # type: ignore[return-value]

    def _say_felt(self, picture: Picture) -> None:
        ends: list[float] = []
        for low, high in picture.bands:
            ends += [low, high, np.nan]
        self.band.setData(np.array(ends), np.full(len(ends), self._y(FELT_UM)))
        line = picture.line
        top = int(line.peak_to_peak.argmax())
        peak = f"peak {1e6 * line.peak_to_peak[top]:.0f} µm at {line.frequency_hz[top]:.0f} Hz"
        last = float(line.frequency_hz[-1])
        bands = ", ".join(
            f"{low:.0f} … {high:.0f} Hz" if high < last else f"{low:.0f} Hz and beyond" for low, high in picture.bands
        )
        self.words.say(f"{peak};   " + (f"felt {bands}" if bands else "nowhere felt"))

    def _draw_kept(self) -> None:
        for items in self._kept_curves:
            self.legend.removeItem(items[0])
            self.plot.removeItem(items[0])
            self.phase.removeItem(items[1])
        self._kept_curves = []
        lines = (self._picture.kept or ()) if self._picture else ()
        for at, (kept, line) in enumerate(zip(self._kept, lines, strict=False)):
            pen = pg.mkPen(ink(at, self._theme), width=1.5)
            upper, lower = pg.PlotCurveItem(antialias=True, pen=pen), pg.PlotCurveItem(antialias=True, pen=pen)
            upper.setData(line.frequency_hz, self._amplitudes(line)[0 if self._shown[0] else 1])
            lower.setData(line.frequency_hz, np.degrees(line.phase))
            self.plot.addItem(upper)
            self.phase.addItem(lower)
            self.legend.addItem(upper, kept.label)
            self._kept_curves.append((upper, lower))

    def _draw_measured(self) -> None:
        for upper, second, lower, spot in self._points:
            self.legend.removeItem(spot)
            self.plot.removeItem(upper)
            self.plot.removeItem(second)
            self.phase.removeItem(lower)
        self._points = []
        for at, run in enumerate(self._measured):
            pen = pg.mkPen(ink(len(INKS) - 1 - at, self._theme), width=1.5)
            solid, hollow = pg.mkBrush(ink(len(INKS) - 1 - at, self._theme)), pg.mkBrush(self._theme.panel)
            fills = [solid if good else hollow for good in run.usable]
            both = self._amplitudes(run)
            upper, second, lower = (
                _spots(run.frequency_hz, y, symbol=s, pen=pen, fills=fills)
                for y, s in ((both[0], "o"), (both[1], "s"), (np.degrees(run.phase), "o"))
            )
            self.plot.addItem(upper)
            self.plot.addItem(second)
            self.phase.addItem(lower)
            upper.setVisible(self._shown[0])
            second.setVisible(self._shown[1])
            symbol = "o" if self._shown[0] or not self._shown[1] else "s"
            # A legend cannot show brushes that differ from point to point.
            spot = pg.ScatterPlotItem(size=8, symbol=symbol, pen=pen, brush=solid)
            self.legend.addItem(spot, f"{run.label}{', SIMULATED' if run.simulated else ''}")
            self._points.append((upper, second, lower, spot))

    def _scale(self) -> None:
        tops, phases = [1.5 * FELT_UM], [-180.0, 0.0]
        picture = self._picture
        if picture is not None:
            for line in (picture.line, *(picture.kept or ())):
                tops += [1e6 * float(v.max()) for v in (line.peak_to_peak, line.twice_fundamental)]
            phases += [float(np.degrees(v)) for v in (picture.line.phase.min(), picture.line.phase.max())]
        tops += [1e6 * largest(run.peak_to_peak) for run in self._measured]
        tops += [1e6 * largest(run.twice_fundamental) for run in self._measured]
        self.plot.setXRange(0, self._top_hz, padding=0)
        if self._log:
            self.plot.setYRange(0.0, np.ceil(4 * np.log10(max(tops))) / 4, padding=0)
        else:
            top = 1.05 * max(tops) / (1 - share_of(self.legend, self.plot))
            step = round_step(top, 8)  # in steps, so that it stands still while a slider moves
            self.plot.setYRange(0, step * np.ceil(top / step), padding=0)
        self.phase.setYRange(90 * np.floor(min(phases) / 90), 90 * np.ceil(max(phases) / 90), padding=0.04)


def _spots(x: Array, y: Array, symbol: str, pen: Any, fills: Sequence[Any]) -> pg.PlotDataItem:
    """Points where there are some: an imported table may not tell a phase, or one of the amplitudes."""
    there = np.flatnonzero(np.isfinite(y))
    brushes = [fills[i] for i in there.tolist()]
    return pg.PlotDataItem(
        x[there], y[there], pen=None, symbol=symbol, symbolSize=8, symbolPen=pen, symbolBrush=brushes
    )
