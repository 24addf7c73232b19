"""What a run gave, in the plot that suits it: amplitudes over frequency, a protocol's own points, or whole curves."""

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QStackedWidget, QWidget

from app.gui.plots.base import is_response_protocol
from app.gui.plots.curves_plot import CurvesPlot
from app.gui.plots.points_plot import PointsPlot
from app.gui.plots.response_plot import ResponsePlot
from app.gui.widgets.theme import Theme
from app.live.overlay import OverlayCurve as Modelled
from protocols.base.events import RunEnded
from protocols.base.protocol import Protocol
from protocols.base.records import ResultCurve


class ResultPlots(QStackedWidget):
    """Shows one of three; the two that are seldom needed are made when they are."""

    repeat_requested = Signal(tuple)

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._theme = theme
        self.response = ResponsePlot(theme)
        self.response.repeat_requested.connect(self.repeat_requested)
        self.addWidget(self.response)
        self._points: PointsPlot | None = None
        self._curves: CurvesPlot | None = None
        self._model_curve: Modelled | None = None
        self._points_selected = False

    @property
    def points(self) -> PointsPlot:
        """For points that are no amplitudes over frequency."""
        if self._points is None:
            self._points = PointsPlot(self._theme)
            self._points.repeat_requested.connect(self.repeat_requested)
            self.addWidget(self._points)
        return self._points

    @property
    def curves(self) -> CurvesPlot:
        """For what entries give beside their points."""
        if self._curves is None:
            self._curves = CurvesPlot(self._theme)
            self._curves.points_button.clicked.connect(lambda: self._show_points(points=True))
            self.points.curves_button.clicked.connect(lambda: self._show_points(points=False))
            self.addWidget(self._curves)
            if self._model_curve is not None:
                self._curves.show_model_curve(self._model_curve)
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
        curves: Sequence[ResultCurve] = (),
        outcome: RunEnded | None = None,
        simulated: bool = False,
        entries: Sequence[int] = (),
        can_run: bool = False,
    ) -> None:
        """Show what a run of a protocol gave so far."""
        plot = self.response if is_response_protocol(kind) else self.points
        if isinstance(plot, PointsPlot):
            plot.set_protocol(kind)
            plot.curves_button.setVisible(bool(curves))
            self.response.show_points(())  # nothing of the run before
        plot.show_points(points, entries, can_run)
        shown: list[ResponsePlot | PointsPlot | CurvesPlot] = [plot]
        if curves or self._curves is not None:
            self.curves.show_curves(curves, bare_tactor=not any(hasattr(point, "mass") for point in points))
            shown.append(self.curves)
        for each in shown:
            each.show_simulated(simulated)
            each.show_estimates(outcome)
        self.setCurrentWidget(self.curves if curves and not self._points_selected else plot)

    def show_model_curve(self, curve: Modelled) -> None:
        """Show the model's curve under them."""
        self._model_curve = curve
        self.response.show_model_curve(curve)
        if self._curves is not None:
            self._curves.show_model_curve(curve)

    def _show_points(self, points: bool) -> None:
        """Look at the points of a run that has curves, or at its curves."""
        self._points_selected = points
        self.setCurrentWidget(self.points if points else self.curves)
