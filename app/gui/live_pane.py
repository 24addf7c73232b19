"""What is seen of a run while it goes on: the response or the protocol's own points, and below them the live traces."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QPushButton, QSplitter, QStackedWidget, QWidget

from app.gui.curves_plot import CurvesPlot
from app.gui.feed import LiveFeed
from app.gui.form import mark
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
        self.response = ResponsePlot(theme)
        self.points = PointsPlot(theme)
        self.plots = QStackedWidget()
        self.curves = CurvesPlot(theme)
        self.to_curves, self.to_points = _button("Show the curves"), _button("Show the points")
        self._wants_points = False
        self.points.head.addWidget(self.to_curves)
        self.curves.head.addWidget(self.to_points)
        self.to_curves.clicked.connect(lambda: self._choose(points=False))
        self.to_points.clicked.connect(lambda: self._choose(points=True))
        self.plots.addWidget(self.curves)
        for plot in (self.response, self.points):
            self.plots.addWidget(plot)
            plot.again_pressed.connect(self.again_pressed)
        self.traces = TimePlot(feed, map_, theme)
        self.add(self.plots, 5)
        self.add(self.traces, 4)
        self.setChildrenCollapsible(False)

    def add(self, widget: QWidget, share: int) -> None:
        """Put something below what is there."""
        self.addWidget(widget)
        self.setStretchFactor(self.count() - 1, share)
        widget.setMinimumHeight(SHORTEST)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        for widget in (self.response, self.points, self.curves, self.traces):
            widget.set_theme(theme)

    def show_view(self, view: View, otherwise: type[Protocol]) -> None:
        """Show the present or last run; where there is none, the empty plot of the protocol `otherwise`."""
        kind = PROTOCOLS.get(view.protocol, otherwise) if view.busy or view.points else otherwise
        plot = self.response if draws(kind) else self.points
        self.points.show_kind(kind)
        plot.show_points(view.points, view.entries, view.can_run)
        self.curves.show_curves(view.curves, bare=not any(hasattr(point, "mass") for point in view.points))
        for each in (plot, self.curves):
            each.show_simulated(view.simulated)
            each.show_found(view.outcome)
        self.to_curves.setVisible(bool(view.curves))
        self.plots.setCurrentWidget(self.curves if view.curves and not self._wants_points else plot)
        self.traces.show_simulated(view.simulated)

    def show_curve(self, curve: Curve) -> None:
        """Show the model's curve under the points."""
        self.response.show_curve(curve)
        self.curves.show_curve(curve)

    def _choose(self, points: bool) -> None:
        """Look at the points of a run that has curves, or at its curves."""
        self._wants_points = points
        self.plots.setCurrentWidget(self.points if points else self.curves)

    def refresh(self) -> None:
        """What moves between events: called at every tick."""
        self.traces.refresh()


def _button(words: str) -> QPushButton:
    button = QPushButton(words)
    mark(button, "choice")
    return button
