"""Live plots of a run: its results, and below them the live traces."""

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QFrame, QSplitter

from app.common import natural_frequency_of
from app.gui.face import px, set_margins
from app.gui.plots.result_plots import ResultPlots
from app.gui.plots.time_plot import TimePlot
from app.gui.widgets import column, set_style_kind
from app.live import LiveFeed, ModelCurves
from app.session import BenchState, WindowState
from drivers import Sine
from model import AmplifierMap
from protocols import PROTOCOLS
from protocols.base import Protocol, Series
from protocols.runfile import is_response

MIN_PLOT_HEIGHT = 56


class LivePane(QSplitter):
    """The plots of one run.

    They are made when the pane is first shown or used: the window may show another page first. The model's curve of a run is the
    one of its settings: a curve of other settings, for the next run, is a preview.
    """

    repeat_requested = Signal(tuple)

    def __init__(self, feed: LiveFeed, amplifier: AmplifierMap) -> None:
        super().__init__(Qt.Orientation.Vertical)
        self._feed, self._amplifier = feed, amplifier
        self._cards = QFrame(), QFrame()
        self._places = [column(parent=card) for card in self._cards]
        for at, (card, share) in enumerate(zip(self._cards, (5, 3), strict=True)):
            self.addWidget(card)
            self.setStretchFactor(at, share)
            card.setMinimumHeight(MIN_PLOT_HEIGHT)
        self.setChildrenCollapsible(False)
        self._state: tuple[WindowState, type[Protocol]] | None = None
        self._running: Series | None = None
        self._curve: ModelCurves | None = None
        """Model curves of the displayed run; before the first run, of the run that is being set up."""
        self._newest: ModelCurves | None = None
        self.choose_runs: Callable[[], object] | None = None
        """Lets the user choose recorded runs to add to the plot."""
        self.planned: tuple[float, ...] = ()
        """Frequency of each entry of the present run; NaN of one without a sine."""
        self.first_span = 0
        """Index of the span of the live traces when they are made."""
        self._outdated = False
        self._threshold: Any = None
        self._before: tuple[str, Any, float] | None = None

    def show_as_cards(self, gap: int) -> None:
        """Show the plots as cards with a gap in pixels of the design between them; 0: side by side without an edge."""
        self.setHandleWidth(px(gap) or 1)
        for card, place in zip(self._cards, self._places, strict=True):
            set_style_kind(card, "panel" if gap else "")
            set_margins(place, (2, 4, 2, 4) if gap else (0, 0, 0, 0))

    @cached_property
    def plots(self) -> ResultPlots:
        """The results of the run, above."""
        plots = ResultPlots()
        plots.repeat_requested.connect(self.repeat_requested)
        plots.choose_runs = self.choose_runs
        self._places[0].addWidget(plots)
        plots.show_threshold(self._threshold)
        self._show_curves(plots)
        return plots

    @cached_property
    def time_plot(self) -> TimePlot:
        """The live traces, below."""
        plot = TimePlot(self._feed, self._amplifier)
        self._places[1].addWidget(plot)
        plot.select_span(self.first_span)
        return plot

    def show_threshold(self, threshold: Any) -> None:
        """Take the perception threshold of plots that are not made yet; None is the abdomen's."""
        self._threshold = threshold

    def set_state(self, view: WindowState, otherwise: type[Protocol]) -> None:
        """Show the current or last run; without one, the empty plot of the protocol `otherwise`.

        On a page that is not selected it is drawn when the page is: two pages show the same run.
        """
        before, self._state = self._state, (view, otherwise)
        if before is not None and before[0].points and not view.points:
            self._keep_earlier(before[0])
        if self._newest is not None and (view.busy or not self._has_run):
            self._curve = self._newest  # the form cannot be changed during a run: the newest curve is the run's
        self._outdated = not self.isVisible()
        if not self._outdated:
            self._draw(view, otherwise)

    def _keep_earlier(self, view: WindowState) -> None:
        """Keep the points of the present run as a layer in the plot of the next run."""
        points = tuple(filter(is_response, view.points))
        if len(points) > 1:
            volts = f"{2 * float(points[0].drive_amplitude):.3g} V"
            natural_hz = math.nan if view.outcome is None else natural_frequency_of(view.outcome.estimates)
            self._before = f"Run before, {volts}", points, natural_hz

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
        present = math.nan, ""
        if view.bench_state in (BenchState.LIVE, BenchState.PAUSING) and isinstance(view.drive, Sine):
            present = view.drive.frequency_hz, "measuring"
        left = enumerate(self.planned) if view.busy else ()
        coming = tuple(hz for at, hz in left if at not in view.entries and math.isfinite(hz) and hz != present[0])
        changed = (self.plots.present, self.plots.coming) != (present, coming)
        self.plots.coming = coming
        self.plots.present, self.plots.earlier = present, () if self._before is None else (self._before,)
        self._show_curves(self.plots)
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
        if changed:
            self.plots.draw()
        self.time_plot.show_simulated(view.simulated)
        self.time_plot.is_calm = not view.busy

    @property
    def _has_run(self) -> bool:
        """Whether a run with points or curves is displayed."""
        view = None if self._state is None else self._state[0]
        return view is not None and bool(view.points or view.curves)

    def show_model_curve(self, curve: ModelCurves) -> None:
        """Take the model's curve for the settings of the form."""
        if curve is self._newest:
            return
        self._newest = curve
        busy = self._state is not None and self._state[0].busy
        if self._curve is None or busy or not self._has_run or curve.request == self._curve.request:
            self._curve = curve
        if "plots" in vars(self):
            self._show_curves(self.plots)

    def _show_curves(self, plots: ResultPlots) -> None:
        if self._curve is not None:
            plots.show_model_curve(self._curve, None if self._newest is self._curve else self._newest)

    def tick(self) -> None:
        """Redraw the live traces and the response of a running sweep; called at every tick of the window."""
        if self._state is not None and self._state[0].busy and self._running is not self._feed.running_curve.latest:
            self.set_state(*self._state)
        self.time_plot.tick()
