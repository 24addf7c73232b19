"""What is seen of a run while it goes on: the response or the protocol's own points, and below them the live traces."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QSplitter, QWidget

from app.gui.plots.curves_plot import CurvesPlot
from app.gui.plots.points_plot import PointsPlot
from app.gui.plots.response_plot import ResponsePlot
from app.gui.plots.result_plots import ResultPlots
from app.gui.plots.time_plot import TimePlot
from app.gui.widgets.theme import Theme
from app.live.feed import LiveFeed
from app.live.overlay import Curve
from app.session.state import View
from model.amplifier_map import AmplifierMap
from protocols.base.protocol import Protocol
from protocols.registry import PROTOCOLS

SHORTEST = 56


class LivePane(QSplitter):
    """The plots of one run; whoever shows them may add something below."""

    again_pressed = Signal(tuple)

    def __init__(self, feed: LiveFeed, map_: AmplifierMap, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(Qt.Orientation.Vertical, parent)
        self.plots = ResultPlots(theme)
        self.plots.again_pressed.connect(self.again_pressed)
        self.traces = TimePlot(feed, map_, theme)
        self.add(self.plots, 5)
        self.add(self.traces, 4)
        self.setChildrenCollapsible(False)

    @property
    def response(self) -> ResponsePlot:
        """Amplitudes over frequency."""
        return self.plots.response

    @property
    def points(self) -> PointsPlot:
        """Points that are no amplitudes over frequency."""
        return self.plots.points

    @property
    def curves(self) -> CurvesPlot:
        """What entries give beside their points."""
        return self.plots.curves

    def add(self, widget: QWidget, share: int) -> None:
        """Put something below what is there."""
        self.addWidget(widget)
        self.setStretchFactor(self.count() - 1, share)
        widget.setMinimumHeight(SHORTEST)

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self.plots.set_theme(theme)
        self.traces.set_theme(theme)

    def show_view(self, view: View, otherwise: type[Protocol]) -> None:
        """Show the present or last run; where there is none, the empty plot of the protocol `otherwise`."""
        kind = PROTOCOLS.get(view.protocol, otherwise) if view.busy or view.points else otherwise
        self.plots.show_results(
            kind, view.points, view.curves, view.outcome, view.simulated, view.entries, view.can_run
        )
        self.traces.show_simulated(view.simulated)

    def show_curve(self, curve: Curve) -> None:
        """Show the model's curve under the points."""
        self.plots.show_curve(curve)

    def refresh(self) -> None:
        """What moves between events: called at every tick."""
        self.traces.refresh()
