"""Result pane of an open campaign: the plot of the run under review, or the details of the selected item as text."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QComboBox, QStackedWidget, QWidget

import app.campaign as campaigns  # imports HDF5 when a name is first used: a background thread has done that
from app.gui.plots import RESIDUAL, ResultPlots
from app.gui.widgets import (
    SELECTABLE,
    ElidedLabel,
    Item,
    column,
    configure,
    fill_combo,
    make_button,
    make_combo,
    make_label,
    make_scroll_area,
    row,
)
from protocols import DEFAULT_PROTOCOL, PROTOCOLS
from protocols.base import RunEnded, RunStatus, Series

if TYPE_CHECKING:
    from pathlib import Path

    from app.archive import RunSummary
    from app.campaign import CampaignEstimates, ItemSummary, ResultReview


class ResultPane(QWidget):
    """Shows one item of the campaign."""

    run_selected = Signal(str)
    """File name of a run of the item that the user wants to see."""

    def __init__(self) -> None:
        super().__init__()
        self.review: ResultReview | None = None
        self._item: ItemSummary | None = None
        self._shown_state: object = None
        self._selected_run = ""
        self._series: tuple[Series, ...] = ()
        """Figures of a series over its parameter; the chosen one is drawn."""
        self.heading_label = configure(ElidedLabel(), "campaign.item", kind="heading")
        fitting = QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon
        self.run_box, self.figure_box = (
            make_combo(name, text, toolTip=tip, sizeAdjustPolicy=fitting, minimumContentsLength=12)
            for name, text, tip in (
                ("review.run", "runs of this measurement", "Every result of this measurement; accepting one makes it count"),
                ("review.figure", "figure over the varied parameter", "Quantity drawn over the parameter of the series"),
            )
        )  # fmt: skip
        tip = "State, settings, and what the item depends on"
        self.details_button = make_button("Details", self._show_part, "choice", tip, "campaign.details", checkable=True)
        self.plots = ResultPlots()
        self.plots.chart.has_title = False  # the heading above names it
        self.plots.choose_lower(RESIDUAL)
        self.plots.setMinimumSize(300, 190)
        self.details_area = make_scroll_area(
            accessibleName="details", horizontalScrollBarPolicy=Qt.ScrollBarPolicy.ScrollBarAlwaysOff
        )
        self.stack = QStackedWidget()
        for part in (self.plots, self.details_area, QWidget()):
            self.stack.addWidget(part)
        controls = (self.run_box, self.figure_box, self.details_button)
        head = row((self.heading_label, 1), *controls, margins=(12, 8, 8, 0), spacing=8)
        column(head, (self.stack, 1), parent=self, spacing=4)
        self.run_box.activated.connect(lambda _: self._select_run(self.run_box.currentData()))
        self.figure_box.activated.connect(lambda _: self._draw())

    @property
    def reviewed_path(self) -> Path | None:
        """The run under review: the selected run, or else the candidate or valid run."""
        if self._item is None or not self._item.state.results or self._item.state.run is None:
            return None
        reviewed = self._item.state.reviewed_run
        if self._selected_run:
            return self._item.state.run.parent / self._selected_run
        names = [run.name for run in self._item.state.results]
        return reviewed if reviewed is not None and reviewed.name in names else None

    @property
    def earlier_path(self) -> Path | None:
        """The result for comparison with the reviewed one: the valid one, or else the previous one."""
        path = self.reviewed_path
        if path is None or self._item is None:
            return None
        state = self._item.state
        if state.run is not None and state.run != path:
            return state.run
        names = [run.name for run in state.results if run.name not in state.item.rejected]
        at = names.index(path.name) if path.name in names else 0
        return path.parent / names[at - 1] if at > 0 else None

    @property
    def allowed_actions(self) -> set[str]:
        """The actions that the item and the run under review allow."""
        if self._item is None:
            return set()
        state = self._item.state
        allowed = {"skip"} if state.status != "running" else set()
        if state.next_action not in ("", "wait"):
            allowed.add("run")
        if state.run is None:
            return allowed
        counts = state.accepted and state.run.name == self._selected_run
        accepts = not counts if self._selected_run else state.awaits_acceptance
        return allowed | {"repeat", "reject", "open", "explore"} | ({"accept"} if accepts else set())

    def show_item(self, item: ItemSummary | None, estimates: CampaignEstimates | None, specimen: str) -> None:
        """Show an item; the plot of its run follows when it is read."""
        if (item, estimates, specimen) == self._shown_state:
            return
        self._shown_state = (item, estimates, specimen)
        before, self._item = self._item, item
        if item is None or before is None or (item.state.results, item.name) != (before.state.results, before.name):
            self._selected_run = ""
            self.details_button.setChecked(False)
        self.heading_label.setText("" if item is None else f"{item.name}: {item.state.title}")
        self._series = ()
        if item is not None:
            self._list_runs(item)
            self._show_details(item, estimates, specimen)
        self._show_part()

    @property
    def is_read(self) -> bool:
        """Whether the run under review is shown, and not still being read."""
        return self.review is not None and self.review.run.path == self.reviewed_path

    def show_review(self, review: ResultReview) -> None:
        """Show the run under review."""
        self.review = review
        self._draw()
        self._show_part()

    def _show_part(self) -> None:
        """Show the plot, or the details without a plot or on request; an empty page while a run is being read."""
        has_result = self.reviewed_path is not None
        self.details_button.setVisible(has_result)
        at = 1 if not has_result or self.details_button.isChecked() else 0 if self.is_read else 2
        self.stack.setCurrentIndex(at)

    def _select_run(self, name: str) -> None:
        self._selected_run = name
        self._show_part()
        self.run_selected.emit(name)

    def _list_runs(self, item: ItemSummary) -> None:
        """List the results of an item, newest first, and the figures of a series."""
        state = item.state
        label = campaigns.varied_label(state.item) if state.steps else ""
        curves = campaigns.series_curves(state)
        self._series = tuple(replace(each, x_axis=replace(each.x_axis, name=label)) for each in curves)
        names = [curve.y_axis.name for curve in reversed(self._series)]
        fill_combo(self.figure_box, zip(names, names, strict=True))
        self.figure_box.setVisible(len(self._series) > 1)
        counting = "" if state.run is None else state.run.name
        fill_combo(self.run_box, [(_describe_run(run, item, counting), run.name) for run in reversed(state.results)])
        self.run_box.setVisible(self.run_box.count() > 1)
        if (path := self.reviewed_path) is not None:
            self.run_box.setCurrentIndex(self.run_box.findData(path.name))

    def _show_details(self, item: ItemSummary, estimates: CampaignEstimates | None, specimen: str) -> None:
        content, sections = QWidget(), list[Item]()
        for section in campaigns.item_details(item, estimates, specimen):
            lines = make_label("\n".join(section.lines), textInteractionFlags=SELECTABLE)
            sections += [make_label(section.heading, "caption", wrap=False), lines, 8]
        column(*sections, None, parent=content, margins=(12, 0, 8, 0), spacing=2)
        self.details_area.setWidget(content)  # deletes the previous content
        content.setAutoFillBackground(False)

    def _draw(self) -> None:
        """Draw the run, or the results of a series over its parameter."""
        if self.review is None:
            return
        run, chosen = self.review.run, self.figure_box.currentText()
        series = tuple(sorted(self._series, key=lambda curve: curve.y_axis.name == chosen))
        kind = PROTOCOLS.get(run.record.protocol, PROTOCOLS[DEFAULT_PROTOCOL])
        # Without a verdict, so that a wiring check has its points: its checks are in the result card.
        ended = RunEnded(RunStatus.COMPLETED, "", "", () if series else run.record.estimates)
        curves = series or run.series
        self.plots.show_results(kind, run.points, curves, ended, run.record.simulated, curves_first=bool(series))


def _describe_run(run: RunSummary, item: ItemSummary, counting: str) -> str:
    """Return start, verdict and standing of a run."""
    state = item.state
    if run.name in state.item.rejected:
        standing = "rejected"
    elif run.name == counting:
        standing = "counts" + (", accepted" if state.accepted else "")
    elif state.candidate is not None and run.name == state.candidate.name:
        standing = "new"
    else:
        standing = "earlier"
    begun = f"{run.started_at:%d %b %H:%M:%S}" if run.started_at else run.name
    return f"{begun}  {run.symbol} {run.verdict_text}, {standing}"
