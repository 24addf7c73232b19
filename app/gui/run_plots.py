"""Pictures of runs from the archive: points of several over frequency, and the traces of one."""

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtWidgets import QVBoxLayout, QWidget

from app.explore_answer import Measured
from app.gui.plots import Corner, few_ticks, ink, paint, quiet, round_step, simulated_mark, trace_pen
from app.gui.response_plot import FELT_UM
from app.gui.theme import Theme
from app.reopening import Traces


class ComparePlot(QWidget):
    """Max - min over frequency of each run that is chosen, in a colour of its own."""

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme = theme
        self._runs: tuple[Measured, ...] = ()
        self.canvas = pg.PlotWidget(enableMenu=False)
        self.plot = self.canvas.getPlotItem()
        quiet(self.plot, self.font())
        self.plot.setContentsMargins(0, 0, 8, 0)
        self.plot.setLabel("left", "max − min (µm)")
        self.plot.setLabel("bottom", "frequency (Hz)")
        self._felt = pg.InfiniteLine(FELT_UM, angle=0)
        self.plot.addItem(self._felt)
        self.legend = self.plot.addLegend(offset=(8, 4), labelTextSize="9pt", verSpacing=-6)
        self.items: list[pg.PlotDataItem] = []
        self.mark = simulated_mark(self.plot, self.font())
        self.words = Corner(self.plot, "", self.font(), right=False)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.canvas)
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self._theme = theme
        self.canvas.setBackground(theme.panel)
        paint(self.plot, theme)
        self._felt.setPen(pg.mkPen(theme.felt, width=1))
        self.mark.colour(theme.simulated)
        self.words.colour(theme.dim)
        self.legend.setLabelTextColor(theme.text)
        self.show_runs(self._runs, self.words.words)

    def show_runs(self, runs: Sequence[Measured], words: str = "") -> None:
        """Draw these, and no others."""
        self._runs = tuple(runs)
        self.words.say(words)
        self.mark.show(any(run.simulated for run in runs))
        for item in self.items:
            self.legend.removeItem(item)
            self.plot.removeItem(item)
        self.items = []
        for at, run in enumerate(self._runs):
            colour = ink(at, self._theme)
            fills = [pg.mkBrush(colour if good else self._theme.panel) for good in run.usable]
            item = pg.PlotDataItem(
                run.frequency_hz, 1e6 * run.peak_to_peak, pen=pg.mkPen(colour, width=1), symbol="o", symbolSize=7,
                symbolPen=pg.mkPen(colour, width=1.5), symbolBrush=fills,
            )  # fmt: skip
            self.plot.addItem(item)
            if len(self._runs) <= 12:
                self.legend.addItem(item, run.label)
            self.items.append(item)
        top = max([FELT_UM * 1.5, *(1e6 * float(np.nanmax(run.peak_to_peak)) for run in self._runs)])
        right = max([100.0, *(float(run.frequency_hz.max()) for run in self._runs)])
        step = round_step(1.1 * top, 6)
        self.plot.setYRange(0, step * np.ceil(1.1 * top / step), padding=0)
        self.plot.setXRange(0, 1.04 * right, padding=0)


class RunTraces(QWidget):
    """Displacement and drive of a whole run, two values a pixel column."""

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.canvas = pg.GraphicsLayoutWidget()
        self.canvas.ci.setContentsMargins(0, 0, 10, 0)
        self.canvas.ci.setSpacing(0)
        self._plots = [self.canvas.addPlot(row=row, col=0, enableMenu=False) for row in (0, 1)]
        self._plots[1].setXLink(self._plots[0])
        self.curves = [pg.PlotCurveItem(skipFiniteCheck=True) for _ in self._plots]
        self._marks = []
        self._words = []
        for plot, curve, words in zip(
            self._plots, self.curves, ("displacement (µm)", "drive at the amplifier (V)"), strict=True
        ):
            quiet(plot, self.font())
            plot.getAxis("left").setWidth(48)
            plot.addItem(curve)
            self._marks.append(simulated_mark(plot, self.font()))
            self._words.append(Corner(plot, words, self.font(), right=False))
        self._plots[0].getAxis("bottom").setStyle(showValues=False)
        self._plots[1].setLabel("bottom", "time since the stream began (s)")
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.canvas)
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self.canvas.setBackground(theme.panel)
        for plot, curve, mark, words, colour in zip(
            self._plots, self.curves, self._marks, self._words, (theme.measured, theme.second), strict=True
        ):
            paint(plot, theme)
            curve.setPen(trace_pen(colour))
            mark.colour(theme.simulated)
            words.colour(colour)

    def show_traces(self, traces: Traces, simulated: bool) -> None:
        """Draw a run."""
        for mark in self._marks:
            mark.show(simulated)
        if not traces.time_s.size:
            return
        for plot, curve, values in zip(self._plots, self.curves, (traces.displacement_um, traces.drive_v), strict=True):
            # What was not kept is a gap, not a line.
            apart = np.diff(traces.time_s, append=traces.time_s[-1])
            curve.setData(traces.time_s, values, connect=apart <= 3 * np.median(apart[1::2]))
            low, high = float(np.nanmin(values)), float(np.nanmax(values))
            edge = 0.06 * max(high - low, 1e-3)
            plot.setYRange(low - edge, high + edge, padding=0)
            spacing = few_ticks(low, high) if high > low else 1.0
            plot.getAxis("left").setTickSpacing(spacing, spacing)
        self._plots[0].setXRange(float(traces.time_s[0]), float(traces.time_s[-1]), padding=0)
