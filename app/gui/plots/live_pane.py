"""Live plots of a run: its results, and below them the live traces."""

import time
from functools import cached_property

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QSplitter, QWidget

from app.gui.plots.result_plots import ResultPlots
from app.gui.plots.time_plot import TimePlot
from app.gui.widgets import column
from app.live import LiveFeed, ModelCurves
from app.session import WindowState
from model import AmplifierMap
from protocols import PROTOCOLS
from protocols.base import Protocol, Series

MIN_PLOT_HEIGHT = 56

IDLE_TICK_S = 0.2
"""Time between two redraws of the traces while no run is in progress."""


class LivePane(QSplitter):
    """The plots of one run; a page may add widgets below.

    They are made when the pane is first shown or used: the window may show another page first.
    """

    repeat_requested = Signal(tuple)

    def __init__(self, feed: LiveFeed, amplifier: AmplifierMap) -> None:
        super().__init__(Qt.Orientation.Vertical)
        self._feed, self._amplifier = feed, amplifier
        self._places = []
        for share in (5, 4):
            place = QWidget()
            self._places.append(column(parent=place))
            self.add_widget(place, share)
        self.setChildrenCollapsible(False)
        self._state: tuple[WindowState, type[Protocol]] | None = None
        self._running: Series | None = None
        self._curve: ModelCurves | None = None
        self._span, self._ticked_s = 0, 0.0
        self._outdated = False

    @cached_property
    def plots(self) -> ResultPlots:
        """The results of the run, above."""
        plots = ResultPlots()
        plots.repeat_requested.connect(self.repeat_requested)
        self._places[0].addWidget(plots)
        if self._curve is not None:
            plots.show_model_curve(self._curve)
        return plots

    @cached_property
    def time_plot(self) -> TimePlot:
        """The live traces, below."""
        plot = TimePlot(self._feed, self._amplifier)
        self._places[1].addWidget(plot)
        plot.select_span(self._span)
        return plot

    @property
    def selected_span(self) -> int:
        """Index of the span of the live traces."""
        return self.time_plot.selected_span if "time_plot" in vars(self) else self._span

    def select_span(self, index: int) -> None:
        """Choose the span of the live traces."""
        self._span = index
        if "time_plot" in vars(self):
            self.time_plot.select_span(index)

    def add_widget(self, widget: QWidget, share: int) -> None:
        """Add a widget at the bottom."""
        self.addWidget(widget)
        self.setStretchFactor(self.count() - 1, share)
        widget.setMinimumHeight(MIN_PLOT_HEIGHT)

    def set_state(self, view: WindowState, otherwise: type[Protocol]) -> None:
        """Show the current or last run; without one, the empty plot of the protocol `otherwise`.

        On a page that is not selected it is drawn when the page is: two pages show the same run.
        """
        self._state = (view, otherwise)
        self._outdated = not self.isVisible()
        if not self._outdated:
            self._draw(view, otherwise)

    def prepare(self) -> None:
        """Make the plots and draw changes, as when the pane is shown."""
        if self._outdated and self._state is not None:
            self._outdated = False
            self._draw(*self._state)

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self.prepare()

    def _draw(self, view: WindowState, otherwise: type[Protocol]) -> None:
        self._running = self._feed.running_curve.latest if view.busy else None
        kind = PROTOCOLS.get(view.protocol, otherwise) if view.busy or view.points else otherwise
        curves = view.curves if self._running is None else (*view.curves, self._running)
        self.plots.show_results(
            kind,
            view.points,
            curves,
            view.outcome,
            view.simulated,
            view.entries,
            view.can_run,
            curves_first=self._running is not None,
        )
        self.time_plot.show_simulated(view.simulated)
        self.time_plot.is_calm = not view.busy

    def show_model_curve(self, curve: ModelCurves) -> None:
        """Show the model's curve under the points."""
        self._curve = curve
        if "plots" in vars(self):
            self.plots.show_model_curve(curve)

    def tick(self) -> None:
        """Redraw the live traces and the response of a running sweep; called at every tick of the window."""
        busy = self._state is not None and self._state[0].busy
        if self._state is not None and busy and self._running is not self._feed.running_curve.latest:
            self.set_state(*self._state)
        if busy or time.monotonic() - self._ticked_s >= IDLE_TICK_S:
            self._ticked_s = time.monotonic()
            self.time_plot.tick()
