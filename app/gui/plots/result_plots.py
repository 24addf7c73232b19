"""Result plots of a run: response over frequency, the protocol's own points, whole curves, or a table of checks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QStackedWidget

from app.gui.plots.base import PlotBase
from app.gui.plots.points_plot import PointsPlot
from app.gui.plots.response_plot import ResponsePlot
from app.live import ModelCurves
from protocols.base import Protocol, RunEnded, Series
from protocols.runfile import is_response, point_columns

if TYPE_CHECKING:
    from app.gui.plots.check_table import CheckTable
    from app.gui.plots.curves_plot import CurvesPlot


class ResultPlots(QStackedWidget):
    """Shows one of three plots, or the checks of a protocol that passes or fails; points, curves and table are created when first used."""

    repeat_requested = Signal(tuple)

    def __init__(self) -> None:
        super().__init__()
        self.response = ResponsePlot()
        self.response.repeat_requested.connect(self.repeat_requested)
        self.addWidget(self.response)
        self._plot_of_points: ResponsePlot | PointsPlot = self.response
        self._model_curve: ModelCurves | None = None
        self._points_selected: bool | None = None
        """Chosen plot; None before a choice: the protocol's default."""

    @cached_property
    def points(self) -> PointsPlot:
        """The plot of points that are not amplitudes over frequency."""
        plot = PointsPlot()
        plot.repeat_requested.connect(self.repeat_requested)
        self.addWidget(plot)
        if self._model_curve is not None:
            plot.show_model_curve(self._model_curve)
        return plot

    @cached_property
    def curves(self) -> CurvesPlot:
        """The plot of the curves that entries return in addition to points."""
        from app.gui.plots.curves_plot import CurvesPlot

        plot = CurvesPlot()
        plot.points_button.clicked.connect(lambda: self._show_points(points=True))
        self.points.curves_button.clicked.connect(lambda: self._show_points(points=False))
        self.response.curves_button.clicked.connect(lambda: self._show_points(points=False))
        self.addWidget(plot)
        if self._model_curve is not None:
            plot.show_model_curve(self._model_curve)
        return plot

    @cached_property
    def checks(self) -> CheckTable:
        """The table of checks of a protocol that passes or fails."""
        from app.gui.plots.check_table import CheckTable

        table = CheckTable()
        self.addWidget(table)
        return table

    @property
    def _plots(self) -> list[ResponsePlot | PointsPlot | CurvesPlot]:
        """The plots that exist so far."""
        widgets = (self.widget(at) for at in range(self.count()))
        return [cast("ResponsePlot | PointsPlot | CurvesPlot", each) for each in widgets if isinstance(each, PlotBase)]

    def show_results(
        self,
        kind: type[Protocol],
        points: Sequence[Any],
        curves: Sequence[Series] = (),
        outcome: RunEnded | None = None,
        simulated: bool = False,
        entries: Sequence[int] = (),
        can_run: bool = False,
        curves_first: bool = False,
    ) -> None:
        """Show the points, curves and estimates of a run so far; `curves_first` also where the protocol states its points."""
        self._plot_of_points = plot = self.response if is_response(kind.point_type) else self.points
        plot.curves_button.setVisible(bool(curves))
        if isinstance(plot, PointsPlot):
            plot.set_protocol(kind)
            self.response.show_points(())  # of the run before
        plot.show_points(points, entries, can_run)
        if curves or "curves" in vars(self):
            self.curves.show_curves(curves, bare_tactor="mass" not in point_columns(kind.point_type))
        for each in self._plots:
            each.show_simulated(simulated)
            each.show_estimates(outcome)
        if kind.passes_or_fails and outcome is not None and outcome.verdict.checks:
            self.checks.show_verdict(outcome.verdict)
            self.setCurrentWidget(self.checks)
        else:
            default = curves_first or any(curve.name == kind.default_plot for curve in curves)
            shown = default if self._points_selected is None else not self._points_selected
            self.setCurrentWidget(self.curves if curves and shown else plot)

    def show_model_curve(self, curve: ModelCurves) -> None:
        """Show the model's curve under the results."""
        self._model_curve = curve
        for plot in self._plots:
            plot.show_model_curve(curve)

    def _show_points(self, points: bool) -> None:
        """Switch between the points and the curves of a run."""
        self._points_selected = points
        self.setCurrentWidget(self._plot_of_points if points else self.curves)
