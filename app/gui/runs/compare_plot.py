"""Comparison plot: points of several recorded runs over frequency."""

from collections.abc import Iterable, Sequence

import numpy as np
import pyqtgraph as pg

from app.archive import MeasuredResponse
from app.gui.face import Tokens, follow_tokens, tokens
from app.gui.plots import (
    MAX_LEGEND_ENTRIES,
    SERIES,
    PlotBase,
    curve_color,
    curve_symbol,
    finite_max,
    legend_share,
    round_step,
)
from model import Series


class ComparePlot(PlotBase):
    """Max - min over frequency of the selected runs, each in its colour."""

    ACCESSIBLE_NAME = "plot: comparison of the selected runs"

    def __init__(self) -> None:
        super().__init__(axis_width=None)
        self._runs: tuple[MeasuredResponse, ...] = ()
        self.plot.setLabels(left="peak-to-peak displacement (µm)", bottom="frequency (Hz)")
        self._felt = self._add_threshold(labelled=False)
        self._add_legend()
        self.items: list[pg.PlotDataItem] = []
        self._add_head()
        self.plot.getViewBox().sigResized.connect(self._scale)
        follow_tokens(self, self.apply_theme)

    def _series(self) -> Iterable[Series]:
        peak_to_peak = SERIES[0]
        return [
            Series(r.frequency_hz, peak_to_peak.values_of(r), peak_to_peak.errors_of(r), name=r.title)
            for r in self._runs
        ]

    def apply_theme(self, theme: Tokens) -> None:
        """Apply a theme."""
        super().apply_theme(theme)
        self.corner_label.set_color(theme.text2)
        self.show_runs(self._runs, self.corner_label.text)

    def show_runs(self, runs: Sequence[MeasuredResponse], text: str = "") -> None:
        """Draw these runs."""
        self._runs = tuple(runs)
        self.corner_label.set_text(text)
        self.show_simulated(any(run.simulated for run in runs))
        for item in self.items:
            self.legend.removeItem(item)
            self.plot.removeItem(item)
        self.items = []
        for at, run in enumerate(self._runs):
            colour = curve_color(at)
            shown = run.peak_to_peak.at(
                np.isfinite(run.peak_to_peak.y)
            )  # an imported table may have the fundamental only
            fills = [pg.mkBrush(colour if good else tokens().surface) for good in shown.fit_rows]
            item = pg.PlotDataItem(
                shown.x, 1e6 * shown.y, pen=pg.mkPen(colour, width=1), symbol=curve_symbol(at), symbolSize=7,
                symbolPen=pg.mkPen(colour, width=1.5), symbolBrush=fills,
            )  # fmt: skip
            self.plot.addItem(item)
            if 1 < len(self._runs) <= MAX_LEGEND_ENTRIES:  # a single run is named above the plot
                self.legend.addItem(item, run.label)
            self.items.append(item)
        self._scale()

    def _scale(self, *_: object) -> None:
        """Fit the axes to all points, with space for the legend above them."""
        top = max([self._felt.top_um * 1.5, *(1e6 * finite_max(run.peak_to_peak.y) for run in self._runs)])
        right = max([100.0, *(float(run.frequency_hz.max()) for run in self._runs)])
        top *= 1.1 / (1 - legend_share(self.legend, self.plot))
        step = round_step(top, 6)
        self.plot.setYRange(0, step * np.ceil(top / step), padding=0)
        self.plot.setXRange(0, 1.04 * right, padding=0)
