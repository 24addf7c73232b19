"""Result plots of a run: response over frequency, the protocol's own points, or whole curves in one plot; or a table of checks."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QStackedWidget

from app.common import natural_frequency_of
from app.gui.plots.chart import Chart
from app.gui.plots.curve_layers import LAYER_LABELS, NOTHING, RESIDUAL, layers_of
from app.gui.plots.picture import Picture
from app.gui.plots.response import LOWER, ResponseView, RunInPlot, Threshold
from app.gui.widgets import Menu, make_button
from app.live import ModelCurves
from protocols import DEFAULT_PROTOCOL, PROTOCOLS
from protocols.base import Protocol, RunEnded, Series
from protocols.runfile import is_response, point_columns

if TYPE_CHECKING:
    from app.archive import MeasuredResponse
    from app.gui.plots.check_table import CheckTable
    from app.gui.plots.results import CurvesView

RESPONSE = "points over frequency"
MIN_HEIGHT_OF_BOTH = 280
"""Smallest height of a plot with space for a lower panel."""


class ResultPlots(QStackedWidget):
    """Shows the plot of a run, or the checks of a protocol that passes or fails."""

    repeat_requested = Signal(tuple)

    def __init__(self) -> None:
        super().__init__()
        self.chart = Chart("result of the run")
        self.addWidget(self.chart)
        self.kind: type[Protocol] = PROTOCOLS[DEFAULT_PROTOCOL]
        self._points: Sequence[Any] = ()
        self._curves: Sequence[Series] = ()
        self._entries: Sequence[int] = ()
        self._outcome: RunEnded | None = None
        self._simulated = False
        self._model: ModelCurves | None = None
        self._preview: ModelCurves | None = None
        self._threshold = Threshold()
        self._curves_first = False
        self._points_selected: bool | None = None
        """Whether points were chosen instead of curves; None before a choice: the protocol's default."""
        self._lower: dict[str, str] = {}
        """Chosen contents of the lower panel by the kind of the plot."""
        self.earlier: Sequence[tuple[str, Sequence[Any], float]] = ()
        """Points of runs before, with their labels and natural frequencies, Hz; drawn with the next picture."""
        self.runs: Sequence[RunInPlot] = ()
        """The runs in a response over frequency."""
        self._added: tuple[MeasuredResponse, ...] = ()
        self.choose_runs: Callable[[], object] | None = None
        """Lets the user choose recorded runs to add to the plot; None: none can be added."""
        self.present = math.nan, ""
        """Frequency that is being measured, and its state; NaN without one."""
        self.coming: tuple[float, ...] = ()
        """Frequencies that are still to be measured."""
        self.selected: frozenset[int] = frozenset()
        """Selected entries of the plan."""
        tip = "A run that continues this one and measures the selected points again"
        self.repeat_button = make_button("", self._repeat_selected, tip=tip, visible=False)
        self.curves_button = make_button("Show the curves", self._swap, "choice")
        tip = "Plot below: measured less model"
        self.lower_button = make_button("Residual", None, "choice", tip, "plot.lower", checkable=True)
        self.lower_button.clicked.connect(lambda on: self.choose_lower(self._offered()[0] if on else NOTHING))
        for button in (self.repeat_button, self.curves_button, self.lower_button):
            self.chart.head_layout.insertWidget(3, button)
        self.chart.tools.fill_menu = self._fill_menu
        self.chart.point_picked.connect(self._on_picked)
        self.draw()

    @cached_property
    def checks(self) -> CheckTable:
        """The table of checks of a protocol that passes or fails."""
        from app.gui.plots.check_table import CheckTable

        table = CheckTable()
        self.addWidget(table)
        return table

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
        self.repeat_button.setEnabled(can_run)
        before = self.kind, self._points, self._curves, self._outcome, self._simulated, self._curves_first
        self.kind, self._points, self._curves, self._outcome = kind, points, curves, outcome
        self._simulated, self._entries, self._curves_first = simulated, entries, curves_first
        self._select(self.selected & set(entries))
        if kind.passes_or_fails and outcome is not None and outcome.verdict.checks:
            self.checks.show_verdict(outcome.verdict)
            self.setCurrentWidget(self.checks)
            return
        self.setCurrentWidget(self.chart)
        now = self.kind, self._points, self._curves, self._outcome, self._simulated, self._curves_first
        if any(one is not other for one, other in zip(before, now, strict=True)):
            self.draw()

    def show_model_curve(self, curve: ModelCurves, preview: ModelCurves | None = None) -> None:
        """Show the model's curve under the results, and a thin one for the settings of the next run."""
        if curve is not self._model or preview is not self._preview:
            self._model, self._preview = curve, preview
            self.draw()

    def show_threshold(self, threshold: Any) -> None:
        """Show a perception threshold; None is the abdomen's."""
        self._threshold = Threshold.of(threshold)
        self.draw()

    @property
    def shows_curves(self) -> bool:
        """Whether curves are drawn instead of points."""
        if not self._curves:
            return False
        default = self._curves_first or any(curve.name == self.kind.default_plot for curve in self._curves)
        return default if self._points_selected is None else not self._points_selected

    def draw(self) -> None:
        picture = self._picture()
        self.curves_button.setVisible(bool(self._curves))
        self.curves_button.setText("Show the points" if self.shows_curves else "Show the curves")
        offered = self._offered()
        self.lower_button.setVisible(len(offered) > 1)
        self.lower_button.setText(offered[0].capitalize())
        self.lower_button.setChecked(self.lower_panel != NOTHING)
        self.chart.show_picture(picture)

    def _picture(self) -> Picture:
        chosen = [
            bool(self._entries) and i < len(self._entries) and self._entries[i] in self.selected
            for i in range(len(self._points))
        ]
        estimates = () if self._outcome is None else self._outcome.estimates
        self.runs = ()
        if self.shows_curves:
            bare = "mass" not in point_columns(self.kind.point_type)
            return self._curves_view(self._model if bare else None, self.lower_panel).picture()
        if is_response(self.kind.point_type):
            # Points of other protocols, such as the wiring check, appear in the log only.
            at = [i for i, p in enumerate(self._points) if is_response(p)]
            natural = natural_frequency_of(estimates)
            response = ResponseView(
                [self._points[i] for i in at], [chosen[i] for i in at], self._model, self._preview, self.earlier, self._added, natural,
                *self.present, self.coming, self.lower_panel, self._threshold, self._simulated,
            )  # fmt: skip
            self.runs = response.runs()
            return response.picture()
        from app.gui.plots.results import PointsView

        is_over = self._outcome is not None
        return PointsView(
            self.kind, self._points, chosen, self._model, self.lower_panel, self._simulated, is_over
        ).picture()

    def _curves_view(self, model: ModelCurves | None = None, lower: str = NOTHING) -> CurvesView:
        from app.gui.plots.results import CurvesView

        return CurvesView(self._curves, model, lower, self._simulated)

    # -- lower panel -------------------------------------------------------------------------------------------------

    @property
    def _family(self) -> str:
        if self.shows_curves:
            return self._curves[-1].y_axis.name
        return RESPONSE if is_response(self.kind.point_type) else "points"

    def _offered(self) -> tuple[str, ...]:
        """Return the contents that the lower panel can have, the most useful first."""
        if self.shows_curves:
            return layers_of(self._curves_view().visible)
        return (*LOWER[1:], NOTHING) if self._family == RESPONSE else (RESIDUAL, NOTHING)

    @property
    def lower_panel(self) -> str:
        """Contents of the lower panel."""
        offered = self._offered()
        default = NOTHING if self._family == RESPONSE else offered[0]
        chosen = self._lower.get(self._family, default)
        return chosen if chosen in offered and self.height() >= MIN_HEIGHT_OF_BOTH else NOTHING

    def choose_lower(self, contents: str) -> None:
        """Choose the contents of the lower panel of the present kind of plot."""
        self._lower[self._family] = contents
        self.draw()

    def add_runs(self, runs: Sequence[MeasuredResponse]) -> None:
        """Add recorded runs as layers; none: remove those that were added."""
        self._added = tuple({run.path: run for run in (*self._added, *runs)}.values()) if runs else ()
        self.draw()

    def _fill_menu(self, menu: Menu) -> None:
        menu.addSeparator()
        if self.choose_runs is not None and self._family == RESPONSE:
            menu.addAction("Add runs …", self.choose_runs)
            menu.addAction("Remove the added runs", lambda: self.add_runs(())).setEnabled(bool(self._added))
        for contents in self._offered():
            action = menu.addAction(LAYER_LABELS[contents].capitalize(), partial(self.choose_lower, contents))
            action.setCheckable(True)
            action.setChecked(contents == self.lower_panel)

    def resizeEvent(self, event: Any) -> None:
        super().resizeEvent(event)
        if (event.size().height() >= MIN_HEIGHT_OF_BOTH) is not (event.oldSize().height() >= MIN_HEIGHT_OF_BOTH):
            self.draw()

    # -- points and curves -------------------------------------------------------------------------------------------

    def _swap(self) -> None:
        """Switch between the points and the curves of a run."""
        self._points_selected = self.shows_curves
        self.draw()

    def _on_picked(self, layer: str, index: int) -> None:
        found = self.chart.layer(layer)
        if found is None or not (found.symbol and found.texts) or self.shows_curves:
            return
        text = found.texts[index]
        from app.common import format_point

        at = next((i for i, p in enumerate(self._points) if format_point(p) == text), len(self._points))
        if at < len(self._entries):
            self._select(self.selected ^ {self._entries[at]})

    def _select(self, entries: frozenset[int]) -> None:
        """Select entries of the plan; the button that repeats them is visible while there are some."""
        if entries != self.selected:
            self.selected, count = entries, len(entries)
            self.repeat_button.setText(f"Measure {'this point' if count == 1 else f'these {count} points'} again")
            self.repeat_button.setVisible(count > 0)
            self.draw()

    def _repeat_selected(self) -> None:
        selected = tuple(sorted(self.selected))
        self._select(frozenset())
        self.repeat_requested.emit(selected)
