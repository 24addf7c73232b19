"""Points of several runs from the archive over frequency."""

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtWidgets import QVBoxLayout, QWidget

from app.archive.replay import MeasuredResponse
from app.gui.plots.base import (
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

MAX_LEGEND_ENTRIES = 12


class ComparePlot(QWidget):
    """Max - min over frequency of each run that is chosen, in a colour of its own."""

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme = theme
        self._runs: tuple[MeasuredResponse, ...] = ()
        self.canvas = pg.PlotWidget(enableMenu=False)
        self.plot = self.canvas.getPlotItem()
        style_axes(self.plot, self.font())
        self.plot.setContentsMargins(0, 0, 8, 0)
        self.plot.setLabel("left", "max − min (µm)")
        self.plot.setLabel("bottom", "frequency (Hz)")
        self._threshold_line = pg.InfiniteLine(FELT_THRESHOLD_UM, angle=0)
        self.plot.addItem(self._threshold_line)
        self.legend = self.plot.addLegend(offset=(8, 4), labelTextSize="9pt", verSpacing=-6)
        self.items: list[pg.PlotDataItem] = []
        self.simulated_label = simulated_label(self.plot, self.font())
        self.corner_label = CornerLabel(self.plot, "", self.font(), right=False)
        self.copy_buttons = PlotCopyButtons(self.canvas, self._table)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.canvas)
        self.plot.getViewBox().sigResized.connect(self._scale)
        self.set_theme(theme)

    def _table(self) -> str:
        shown = [
            PlotSeries(
                f"{run.label}{', SIMULATED' if run.simulated else ''}",
                run.frequency_hz,
                1e6 * run.peak_to_peak,
                1e6 * run.peak_to_peak_errors,
            )
            for run in self._runs
        ]
        return series_as_text(shown, "frequency (Hz)", "max − min (µm)", self.simulated_label.visible)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self._theme = theme
        self.canvas.setBackground(theme.panel)
        apply_plot_theme(self.plot, theme)
        self._threshold_line.setPen(pg.mkPen(theme.threshold, width=1))
        self.simulated_label.set_color(theme.simulated)
        self.corner_label.set_color(theme.secondary_text)
        self.legend.setLabelTextColor(theme.text)
        self.show_runs(self._runs, self.corner_label.text)

    def show_runs(self, runs: Sequence[MeasuredResponse], text: str = "") -> None:
        """Draw these, and no others."""
        self._runs = tuple(runs)
        self.corner_label.set_text(text)
        self.simulated_label.set_visible(any(run.simulated for run in runs))
        for item in self.items:
            self.legend.removeItem(item)
            self.plot.removeItem(item)
        self.items = []
        for at, run in enumerate(self._runs):
            colour = curve_color(at, self._theme)
            there = np.isfinite(run.peak_to_peak)  # an imported table may tell the fundamental only
            fills = [pg.mkBrush(colour if good else self._theme.panel) for good in run.usable[there]]
            item = pg.PlotDataItem(
                run.frequency_hz[there], 1e6 * run.peak_to_peak[there], pen=pg.mkPen(colour, width=1), symbol="o", symbolSize=7,
                symbolPen=pg.mkPen(colour, width=1.5), symbolBrush=fills,
            )  # fmt: skip
            self.plot.addItem(item)
            if 1 < len(self._runs) <= MAX_LEGEND_ENTRIES:  # one alone is named above the plot
                self.legend.addItem(item, run.label)
            self.items.append(item)
        self._scale()

    def _scale(self, *_: object) -> None:
        """All points, and above them room for the legend."""
        top = max([FELT_THRESHOLD_UM * 1.5, *(1e6 * finite_max(run.peak_to_peak) for run in self._runs)])
        right = max([100.0, *(float(run.frequency_hz.max()) for run in self._runs)])
        top *= 1.1 / (1 - legend_share(self.legend, self.plot))
        step = round_step(top, 6)
        self.plot.setYRange(0, step * np.ceil(top / step), padding=0)
        self.plot.setXRange(0, 1.04 * right, padding=0)
