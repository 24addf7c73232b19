"""The traces of a run from the archive: two values a pixel column of the whole, the raw samples of what one looks at closely."""

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import QVBoxLayout, QWidget

from app.archive.replay import TraceWindow
from app.gui.plots.base import CornerLabel, apply_plot_theme, limit_ticks, simulated_label, style_axes, trace_pen
from app.gui.plots.copy import PlotCopyButtons, series_as_text, series_of
from app.gui.widgets.actions import add_actions
from app.gui.widgets.theme import Theme

SETTLE_MS = 80
"""The file is read when the wheel has stood still for so long."""

TIME_LABEL = "time since the stream began (s)"
ZOOM_IN, ZOOM_OUT = 0.5, 2.0


class TracePlot(QWidget):
    """Displacement and drive. The wheel zooms, a drag moves along, a double click shows the whole; Ctrl with + - 0 and arrows too."""

    range_viewed = Signal(float, float)
    """Seconds from and to which somebody looks: `show_window` is wanted."""

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._whole: TraceWindow | None = None
        self.canvas = pg.GraphicsLayoutWidget()
        self.canvas.ci.setContentsMargins(0, 0, 10, 0)
        self.canvas.ci.setSpacing(0)
        self._plots = [self.canvas.addPlot(row=row, col=0, enableMenu=False) for row in (0, 1)]
        self._plots[1].setXLink(self._plots[0])
        self.curves = [pg.PlotCurveItem(skipFiniteCheck=True) for _ in self._plots]
        self._simulated_labels = []
        self._corner_labels = []
        for plot, curve, words in zip(
            self._plots, self.curves, ("displacement (µm)", "drive at the amplifier (V)"), strict=True
        ):
            style_axes(plot, self.font())
            plot.setMouseEnabled(x=True, y=False)
            plot.getAxis("left").setWidth(48)
            limit_ticks(plot, self.font())
            plot.addItem(curve)
            self._simulated_labels.append(simulated_label(plot, self.font()))
            self._corner_labels.append(CornerLabel(plot, words, self.font(), right=False))
        self._plots[0].getAxis("bottom").setStyle(showValues=False)
        self.canvas.setToolTip(
            "Wheel: closer. Drag: along. Double click: the whole. Ctrl with +, -, 0 and arrows as well"
        )
        self.copy_buttons = PlotCopyButtons(self.canvas, self._table)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.canvas)
        self._settle_timer = QTimer(self, singleShot=True, interval=SETTLE_MS)
        self._settle_timer.timeout.connect(self._emit_range)
        self._plots[0].sigXRangeChanged.connect(lambda *_: self._settle_timer.start())
        self.canvas.scene().sigMouseClicked.connect(lambda event: self.show_whole() if event.double() else None)
        add_actions(
            self,
            {
                "traces.zoom-in": lambda: self.zoom(ZOOM_IN),
                "traces.zoom-out": lambda: self.zoom(ZOOM_OUT),
                "traces.whole": self.show_whole,
                "traces.later": lambda: self.pan(0.25),
                "traces.earlier": lambda: self.pan(-0.25),
            },
        )
        self._label_axes(raw=False)
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self.canvas.setBackground(theme.panel)
        for plot, curve, mark, words, colour in zip(
            self._plots,
            self.curves,
            self._simulated_labels,
            self._corner_labels,
            (theme.measured, theme.second),
            strict=True,
        ):
            apply_plot_theme(plot, theme)
            curve.setPen(trace_pen(colour))
            mark.set_color(theme.simulated)
            words.set_color(colour)

    def show_traces(self, traces: TraceWindow, simulated: bool) -> None:
        """Draw a run."""
        for mark in self._simulated_labels:
            mark.set_visible(simulated)
        self._whole = traces if traces.time_s.size else None
        if self._whole is None:
            for curve in self.curves:
                curve.setData([], [])  # nothing of the run that was shown before
        else:
            first, last = self._full_range
            for plot in self._plots:
                plot.setLimits(xMin=first, xMax=max(last, first + 1e-6))
            self._draw(traces)
            self.show_whole()

    def show_window(self, traces: TraceWindow) -> None:
        """Draw what is looked at, as it was asked for."""
        if traces.time_s.size > 1:
            self._draw(traces)

    def show_whole(self) -> None:
        """Look at all of it again."""
        if self._whole is not None:
            self._plots[0].setXRange(*self._full_range, padding=0)

    def zoom(self, factor: float) -> None:
        """Closer around the middle, or further away."""
        low, high = self.visible_range
        middle, half = (low + high) / 2, factor * (high - low) / 2
        self._plots[0].setXRange(middle - half, middle + half, padding=0)

    def pan(self, share: float) -> None:
        """Later by a share of what is seen, or earlier."""
        low, high = self.visible_range
        step = share * (high - low)
        self._plots[0].setXRange(low + step, high + step, padding=0)

    @property
    def visible_range(self) -> tuple[float, float]:
        """Seconds from and to which is looked."""
        low, high = self._plots[0].getViewBox().viewRange()[0]
        return float(low), float(high)

    @property
    def _full_range(self) -> tuple[float, float]:
        assert self._whole is not None
        return float(self._whole.time_s[0]), float(self._whole.time_s[-1])

    def _emit_range(self) -> None:
        if self._whole is None:
            return
        (first, last), (low, high) = self._full_range, self.visible_range
        if high - low > 0.98 * (last - first):
            self._draw(self._whole)
        else:
            self.range_viewed.emit(low, high)

    def _draw(self, traces: TraceWindow) -> None:
        apart = np.diff(traces.time_s, append=traces.time_s[-1])
        usual = float(np.median(apart if traces.raw else apart[1::2]))
        for plot, curve, values in zip(self._plots, self.curves, (traces.displacement_um, traces.drive_v), strict=True):
            # What was not kept is a gap, not a line.
            curve.setData(traces.time_s, values, connect=apart <= 3 * usual)
            low, high = float(np.nanmin(values)), float(np.nanmax(values))
            edge = 0.06 * max(high - low, 1e-3)
            plot.setYRange(low - edge, high + edge, padding=0)
        self._label_axes(traces.raw)

    def _label_axes(self, raw: bool) -> None:
        what = "every sample" if raw else "lowest and highest of each column; closer: wheel, Ctrl++"
        self._plots[1].setLabel("bottom", f"{TIME_LABEL}: {what}")

    def _table(self) -> str:
        names = ("displacement (µm)", "drive at the amplifier (V)")
        shown = [one for name, curve in zip(names, self.curves, strict=True) for one in series_of(name, curve)]
        return series_as_text(shown, TIME_LABEL, "value", self._simulated_labels[0].visible)
