"""What is seen of a run while it goes on: the response or the protocol's own points, and below them the live traces."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QSplitter, QStackedWidget, QWidget

from app.gui.curves_plot import CurvesPlot
from app.gui.feed import LiveFeed
from app.gui.points_plot import PointsPlot
from app.gui.response_plot import ResponsePlot
from app.gui.series import draws
from app.gui.theme import Theme
from app.gui.time_plot import TimePlot
from app.overlay import Curve
from app.view import View
from model.amplifier import AmplifierMap
from protocols.protocol import Protocol
from protocols.registry import PROTOCOLS

SHORTEST = 56


class LivePane(QSplitter):
    """The plots of one run; whoever shows them may add something below."""

    again_pressed = Signal(tuple)

    def __init__(self, feed: LiveFeed, map_: AmplifierMap, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(Qt.Orientation.Vertical, parent)
        self._theme = theme
        self.response = ResponsePlot(theme)
        self.response.again_pressed.connect(self.again_pressed)
        self.plots = QStackedWidget()
        self.plots.addWidget(self.response)
        self._points: PointsPlot | None = None
        self._curves: CurvesPlot | None = None
        self._curve: Curve | None = None
        self._wants_points = False
        self.traces = TimePlot(feed, map_, theme)
        self.add(self.plots, 5)
        self.add(self.traces, 4)
        self.setChildrenCollapsible(False)

    @property
    def points(self) -> PointsPlot:
        """For points that are no amplitudes over frequency; made when there is such a protocol."""
        if self._points is None:
            self._points = PointsPlot(self._theme)
            self._points.again_pressed.connect(self.again_pressed)
            self.plots.addWidget(self._points)
        return self._points

    @property
    def curves(self) -> CurvesPlot:
        """For what entries give beside their points; made when there is such a curve."""
        if self._curves is None:
            self._curves = CurvesPlot(self._theme)
            self._curves.to_points.clicked.connect(lambda: self._choose(points=True))
            self.points.to_curves.clicked.connect(lambda: self._choose(points=False))
            self.plots.addWidget(self._curves)
            if self._curve is not None:
                self._curves.show_curve(self._curve)
        return self._curves

    def add(self, widget: QWidget, share: int) -> None:
        """Put something below what is there."""
        self.addWidget(widget)
        self.setStretchFactor(self.count() - 1, share)
        widget.setMinimumHeight(SHORTEST)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self._theme = theme
        for widget in (self.response, self._points, self._curves, self.traces):
            if widget is not None:
                widget.set_theme(theme)

    def show_view(self, view: View, otherwise: type[Protocol]) -> None:
        """Show the present or last run; where there is none, the empty plot of the protocol `otherwise`."""
        kind = PROTOCOLS.get(view.protocol, otherwise) if view.busy or view.points else otherwise
        plot = self.response if draws(kind) else self.points
        if isinstance(plot, PointsPlot):
            plot.show_kind(kind)
            plot.to_curves.setVisible(bool(view.curves))
        plot.show_points(view.points, view.entries, view.can_run)
        shown: list[ResponsePlot | PointsPlot | CurvesPlot] = [plot]
        if view.curves or self._curves is not None:
            self.curves.show_curves(view.curves, bare=not any(hasattr(point, "mass") for point in view.points))
            shown.append(self.curves)
        for each in shown:
            each.show_simulated(view.simulated)
            each.show_found(view.outcome)
        self.plots.setCurrentWidget(self.curves if view.curves and not self._wants_points else plot)
        self.traces.show_simulated(view.simulated)

    def show_curve(self, curve: Curve) -> None:
        """Show the model's curve under the points."""
        self._curve = curve
        self.response.show_curve(curve)
        if self._curves is not None:
            self._curves.show_curve(curve)

    def _choose(self, points: bool) -> None:
        """Look at the points of a run that has curves, or at its curves."""
        self._wants_points = points
        self.plots.setCurrentWidget(self.points if points else self.curves)

    def refresh(self) -> None:
        """What moves between events: called at every tick."""
        self.traces.refresh()
