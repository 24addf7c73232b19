"""Trace plot of a recorded run: min/max decimated overview, raw samples when zoomed in."""

import numpy as np
from PySide6.QtCore import QTimer, Signal

from app.archive import TraceWindow
from app.gui.face import follow_tokens
from app.gui.plots import TracePlotBase, limit_ticks
from app.gui.widgets import add_actions

SETTLE_MS = 80
"""Delay between the last turn of the wheel and reading the file."""

TIME_LABEL = "time since the stream began (s)"
ZOOM_IN, ZOOM_OUT = 0.5, 2.0


class TracePlot(TracePlotBase):
    """Displacement and drive. The wheel zooms, a drag pans, a double click shows everything; Ctrl with + - 0 and arrows too."""

    ACCESSIBLE_NAME = "plot: traces of the run"

    range_viewed = Signal(float, float)
    """The visible range in seconds; the receiver reads it and calls `show_window`."""

    def __init__(self) -> None:
        super().__init__(zooms=False)
        self._whole: TraceWindow | None = None
        for plot in self._plots:
            plot.setMouseEnabled(x=True, y=False)
            limit_ticks(plot, self.font())
        self.canvas.setToolTip(
            "Wheel: closer. Drag: along. Double click: the whole. Ctrl with +, -, 0 and arrows as well"
        )
        self._add_head()
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
        follow_tokens(self, self.apply_theme)

    def show_traces(self, traces: TraceWindow, simulated: bool) -> None:
        """Draw the traces of a run."""
        self.show_simulated(simulated)
        self._whole = traces if traces.time_s.size else None
        if self._whole is None:
            for curve in self.curves:
                curve.setData([], [])  # of the run before
        else:
            first, last = self._full_range
            for plot in self._plots:
                plot.setLimits(xMin=first, xMax=max(last, first + 1e-6))
            self._draw(traces)
            self.show_whole()

    def show_window(self, traces: TraceWindow) -> None:
        """Draw the visible range, as requested by `range_viewed`."""
        if traces.time_s.size > 1:
            self._draw(traces)

    def show_whole(self) -> None:
        """Zoom out to the whole run."""
        if self._whole is not None:
            self._plots[0].setXRange(*self._full_range, padding=0)

    def zoom(self, factor: float) -> None:
        """Scale the visible range around its middle."""
        low, high = self.visible_range
        middle, half = (low + high) / 2, factor * (high - low) / 2
        self._plots[0].setXRange(middle - half, middle + half, padding=0)

    def pan(self, share: float) -> None:
        """Move the visible range by a share of its width; later if positive."""
        low, high = self.visible_range
        step = share * (high - low)
        self._plots[0].setXRange(low + step, high + step, padding=0)

    @property
    def visible_range(self) -> tuple[float, float]:
        """First and last visible time in seconds."""
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
            # Samples that were not stored are a gap, not a line.
            curve.setData(traces.time_s, values, connect=apart <= 3 * usual)
            low, high = float(np.nanmin(values)), float(np.nanmax(values))
            edge = 0.06 * max(high - low, 1e-3)
            plot.setYRange(low - edge, high + edge, padding=0)
        self._label_axes(traces.raw)

    def _label_axes(self, raw: bool) -> None:
        contents = "every sample" if raw else "lowest and highest of each column; closer: wheel, Ctrl++"
        self._plots[1].setLabel("bottom", f"{TIME_LABEL}: {contents}")

    def _column_names(self) -> tuple[str, str]:
        return TIME_LABEL, "value"
