"""What a run gave, in the plot that suits it: amplitudes over frequency, a protocol's own points, or whole curves."""

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QStackedWidget, QWidget

from app.gui.plots.base import draws
from app.gui.plots.curves_plot import CurvesPlot
from app.gui.plots.points_plot import PointsPlot
from app.gui.plots.response_plot import ResponsePlot
from app.gui.widgets.theme import Theme
from app.live.overlay import Curve as Modelled
from protocols.base.events import RunEnded
from protocols.base.protocol import Protocol
from protocols.base.records import Curve


class ResultPlots(QStackedWidget):
    """Shows one of three; the two that are seldom needed are made when they are."""

    again_pressed = Signal(tuple)

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme = theme
        self.response = ResponsePlot(theme)
        self.response.again_pressed.connect(self.again_pressed)
        self.addWidget(self.response)
        self._points: PointsPlot | None = None
        self._curves: CurvesPlot | None = None
        self._modelled: Modelled | None = None
        self._wants_points = False

    @property
    def points(self) -> PointsPlot:
        """For points that are no amplitudes over frequency."""
        if self._points is None:
            self._points = PointsPlot(self._theme)
            self._points.again_pressed.connect(self.again_pressed)
            self.addWidget(self._points)
        return self._points

    @property
    def curves(self) -> CurvesPlot:
        """For what entries give beside their points."""
        if self._curves is None:
            self._curves = CurvesPlot(self._theme)
            self._curves.to_points.clicked.connect(lambda: self._choose(points=True))
            self.points.to_curves.clicked.connect(lambda: self._choose(points=False))
            self.addWidget(self._curves)
            if self._modelled is not None:
                self._curves.show_curve(self._modelled)
        return self._curves

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self._theme = theme
        for plot in (self.response, self._points, self._curves):
            if plot is not None:
                plot.set_theme(theme)

    def show_results(
        self,
        kind: type[Protocol],
        points: Sequence[Any],
        curves: Sequence[Curve] = (),
        outcome: RunEnded | None = None,
        simulated: bool = False,
        entries: Sequence[int] = (),
        can_run: bool = False,
    ) -> None:
        """Show what a run of a protocol gave so far."""
        plot = self.response if draws(kind) else self.points
        if isinstance(plot, PointsPlot):
            plot.show_kind(kind)
            plot.to_curves.setVisible(bool(curves))
            self.response.show_points(())  # nothing of the run before
        plot.show_points(points, entries, can_run)
        shown: list[ResponsePlot | PointsPlot | CurvesPlot] = [plot]
        if curves or self._curves is not None:
            self.curves.show_curves(curves, bare=not any(hasattr(point, "mass") for point in points))
            shown.append(self.curves)
        for each in shown:
            each.show_simulated(simulated)
            each.show_found(outcome)
        self.setCurrentWidget(self.curves if curves and not self._wants_points else plot)

    def show_curve(self, curve: Modelled) -> None:
        """Show the model's curve under them."""
        self._modelled = curve
        self.response.show_curve(curve)
        if self._curves is not None:
            self._curves.show_curve(curve)

    def _choose(self, points: bool) -> None:
        """Look at the points of a run that has curves, or at its curves."""
        self._wants_points = points
        self.setCurrentWidget(self.points if points else self.curves)
