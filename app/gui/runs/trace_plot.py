"""Trace plot of a recorded run: min/max decimated overview, raw samples when zoomed in."""

import numpy as np
from PySide6.QtCore import QTimer, Signal

from app.archive import TraceWindow
from app.gui.plots import DRIVE_TITLE, SOLID, Chart, Panel, Picture, layer
from app.gui.widgets import add_actions

SETTLE_MS = 80
"""Delay between the last turn of the wheel and reading the file."""

ZOOM_IN, ZOOM_OUT = 0.5, 2.0


class TracePlot(Chart):
    """Displacement and drive. The wheel zooms, a double click shows everything; Ctrl with + - 0 and arrows too."""

    range_viewed = Signal(float, float)
    """The visible range in seconds; the receiver reads it and calls `show_window`."""

    def __init__(self) -> None:
        super().__init__("traces of the run")
        self._whole: TraceWindow | None = None
        self._simulated = False
        self._settle_timer = QTimer(self, singleShot=True, interval=SETTLE_MS)
        self._settle_timer.timeout.connect(self._emit_range)
        add_actions(
            self,
            {
                "traces.zoom-in": lambda: self.zoom_time(ZOOM_IN),
                "traces.zoom-out": lambda: self.zoom_time(ZOOM_OUT),
                "traces.whole": self.show_whole,
                "traces.later": lambda: self.pan(0.25),
                "traces.earlier": lambda: self.pan(-0.25),
            },
        )

    def show_traces(self, traces: TraceWindow, simulated: bool) -> None:
        """Draw the traces of a run."""
        self._simulated = simulated
        self._whole = traces if traces.time_s.size else None
        self._draw_traces(traces)
        box = self.panels[0].box
        box.setMouseEnabled(x=True, y=False)
        box.sigXRangeChanged.connect(self._settle_timer.start)
        if self._whole is not None:
            first, last = self._full_range
            for drawn in self.panels:
                drawn.box.setLimits(xMin=first, xMax=max(last, first + 1e-6))
            self.show_whole()

    def show_window(self, traces: TraceWindow) -> None:
        """Draw the visible range, as requested by `range_viewed`."""
        if traces.time_s.size > 1:
            self._draw_traces(traces)

    def zoom_time(self, factor: float) -> None:
        """Scale the visible range around its middle."""
        low, high = self.visible_range
        middle, half = (low + high) / 2, factor * (high - low) / 2
        self.show_range(middle - half, middle + half)

    def pan(self, share: float) -> None:
        """Move the visible range by a share of its width; later if positive."""
        low, high = self.visible_range
        step = share * (high - low)
        self.show_range(low + step, high + step)

    def show_range(self, first_s: float, last_s: float) -> None:
        """Show a range of time."""
        self.panels[0].box.zoomed = True
        self.panels[0].box.setXRange(first_s, last_s, padding=0)

    @property
    def visible_range(self) -> tuple[float, float]:
        """First and last visible time in seconds."""
        low, high = self.panels[0].box.viewRange()[0]
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
            self._draw_traces(self._whole)
        else:
            self.range_viewed.emit(low, high)

    def _draw_traces(self, traces: TraceWindow) -> None:
        layers = []
        title, scale = ("Displacement, µm", 1.0) if traces.unit == "m" else ("Velocity, mm/s", 1e-3)
        titles = title, DRIVE_TITLE
        if traces.time_s.size > 1:
            # Samples that were not stored are a gap, not a line.
            apart = np.diff(traces.time_s, prepend=traces.time_s[0])
            usual = float(np.median(apart[1:] if traces.raw else apart[2::2]))
            gaps = np.flatnonzero(apart > 3 * usual)
            time_s = np.insert(traces.time_s, gaps, np.nan)
            for at, values in enumerate((scale * traces.displacement_um, traces.drive_v)):
                y = np.insert(np.asarray(values, float), gaps, np.nan)
                layers.append(layer(name=titles[at], x=time_s, y=y, line=SOLID, width=1.0, panel=at))
        about = "every sample" if traces.raw else "lowest and highest of each column; closer: wheel, Ctrl++"
        self.show_picture(
            Picture(
                title="Traces", note=about, x_title="Since the stream began, s", layers=tuple(layers),
                panels=tuple(Panel(title=title, x_labels=at == 1) for at, title in enumerate(titles)),
                x=None if self._whole is None else self._full_range, log=(False, False), simulated=self._simulated,
            )
        )  # fmt: skip
