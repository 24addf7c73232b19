"""Review pane of a campaign item: plot with model and residual, quality indicators, and its values beside the compared ones."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QComboBox, QLabel, QWidget

import app.campaign as campaigns  # imports HDF5 when a name is first used: a background thread has done that
from app.common import SEVERITY_SYMBOLS
from app.gui.face import follow_tokens, px, set_length, tokens
from app.gui.plots import RESIDUAL, ResultPlots
from app.gui.results import ResultCard
from app.gui.widgets import (
    column,
    fill_combo,
    fill_table,
    make_combo,
    make_label,
    make_pane,
    make_read_only_table,
    make_splitter,
    row,
    set_tone,
)
from protocols import DEFAULT_PROTOCOL, PROTOCOLS
from protocols.base import RunEnded, RunStatus, Series

if TYPE_CHECKING:
    from app.archive import RunSummary
    from app.campaign import ItemSummary, ResultReview

COLUMNS = ("", "quantity", "this run (± noise)", "limits", "before", "paper's model", "other specimens")
TOOLTIPS = {
    "this run (± noise)": "± one standard error of this run's noise; the uncertainties of calibration and dimensions come with Identify …",
    "limits": "Limits of the protocol's own checks",
    "before": "The valid result, or the previous one, and the change since then",
    "paper's model": "The model with the paper's Table I and this bench's amplifier: free tactor with 7.73 g; and the deviation from it",
    "other specimens": "Their newest results by the same protocol in this folder",
}
MAX_INDICATORS = 5
MIN_PLOT_WIDTH = 420
DECISION_WIDTH, WIDE_ENOUGH = 260, 740
"""Width of the result card beside the plot, and of a pane with place for it; a narrower one has the rows above it alone."""
MIN_PLOT_HEIGHT, MIN_TABLE_HEIGHT = 190, 84
MAX_COLUMN_WIDTH = 230


class ReviewPane(QWidget):
    """Shows the result of one run of an item."""

    run_selected = Signal(str)
    """File name of a run of the item that the user wants to see."""

    def __init__(self) -> None:
        super().__init__()
        self.review: ResultReview | None = None
        self._series: tuple[Series, ...] = ()
        """Figures of a series over its parameter; the last one is drawn."""
        self.figure_box = make_combo(
            "review.figure",
            "figure over the varied parameter",
            toolTip="Quantity drawn over the parameter of the series",
        )
        self.figure_box.activated.connect(lambda _: self._draw())
        self.plots = ResultPlots()
        self.plots.choose_lower(RESIDUAL)
        self.plots.setMinimumSize(MIN_PLOT_WIDTH, MIN_PLOT_HEIGHT)
        self.card = ResultCard("review", ("report",))
        self.indicator_labels = [make_label(wrap=False, name=f"review.indicator-{at}") for at in range(MAX_INDICATORS)]
        self.run_box = make_combo(
            "review.run",
            "runs of this measurement",
            toolTip="Every result of this measurement; accepting one makes it count",
            sizeAdjustPolicy=QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon,
            minimumContentsLength=16,
        )
        self.run_box.activated.connect(lambda _: self.run_selected.emit(self.run_box.currentData()))
        self.table = make_read_only_table(
            COLUMNS, "review.table", "values", stretched="none", minimumHeight=MIN_TABLE_HEIGHT
        )
        for at, name in enumerate(COLUMNS):
            if (title := self.table.horizontalHeaderItem(at)) is not None:
                title.setToolTip(TOOLTIPS.get(name, ""))
        self.table.verticalHeader().setDefaultSectionSize(self.fontMetrics().height() + 6)
        self.table.horizontalHeader().setMaximumSectionSize(MAX_COLUMN_WIDTH)
        runs_label = QLabel("run")
        runs_label.setBuddy(self.run_box)
        parts = make_splitter(
            "campaign/review", (self.plots, 3), (self.table, 1), orientation=Qt.Orientation.Vertical, sizes=[420, 110]
        )
        self._parts = parts
        policy = parts.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        parts.setSizePolicy(policy)
        self._decision = make_pane(self.card, None)
        set_length(self._decision, width=DECISION_WIDTH)
        self._indicators = indicators = row(*self.indicator_labels, None, self.figure_box, spacing=16)
        shown = row((parts, 1), self._decision, spacing=12)
        column(
            row(runs_label, (self.run_box, 1), spacing=8), indicators, (shown, 1), parent=self, margins=(0, 4, 0, 0),
            spacing=4,
        )  # fmt: skip
        follow_tokens(self, lambda _: self._show_review())

    def minimumSizeHint(self) -> QSize:
        """Return the least size without the result card, which a narrow pane leaves out."""
        width = max(self._indicators.minimumSize().width(), self._parts.minimumSizeHint().width())
        return QSize(width, super().minimumSizeHint().height())

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._decision.setVisible(self.width() >= px(WIDE_ENOUGH))
        self.card.set_room(self._parts.height())

    def show_runs(self, item: ItemSummary, shown: str) -> None:
        """List the results of an item, newest first, and select the displayed one."""
        state = item.state
        label = campaigns.varied_label(state.item) if state.steps else ""
        self._series = tuple(_with_x_label(curve, label) for curve in campaigns.series_curves(state))
        names = [curve.y_axis.name for curve in reversed(self._series)]
        fill_combo(self.figure_box, zip(names, names, strict=True))
        self.figure_box.setVisible(len(self._series) > 1)
        counting = "" if state.run is None else state.run.name
        fill_combo(self.run_box, [(_describe_run(run, item, counting), run.name) for run in reversed(state.results)])
        self.run_box.setCurrentIndex(self.run_box.findData(shown))

    def show_reading(self, name: str) -> None:
        """Show that a run is being read, and hide the result of the run before."""
        if self.review is None or self.review.run.path.name != name:
            self.card.show_reading()
            self.card.show()
            self._parts.hide()
            self.table.setRowCount(0)
            for label in self.indicator_labels:
                label.hide()

    def show_review(self, review: ResultReview) -> None:
        self.review = review
        self._show_review()

    def _show_review(self) -> None:
        if (review := self.review) is None:
            return
        self._parts.show()
        run = review.run
        self.card.show_summary(run.result)
        for at, label in enumerate(self.indicator_labels):
            shown = at < len(review.indicators)
            label.setVisible(shown)
            if shown:
                indicator = review.indicators[at]
                label.setText(f"{SEVERITY_SYMBOLS[indicator.severity]} {indicator.text}")
                set_tone(label, indicator.severity)
        self.card.show()
        self._draw()
        self._fill_table(review)

    def _draw(self) -> None:
        """Draw the run, or the results of a series over its parameter."""
        if self.review is None:
            return
        run, chosen = self.review.run, self.figure_box.currentText()
        series = tuple(sorted(self._series, key=lambda curve: curve.y_axis.name == chosen))
        kind = PROTOCOLS.get(run.record.protocol, PROTOCOLS[DEFAULT_PROTOCOL])
        # Without a verdict, so that a wiring check has its points: its checks are in the table.
        ended = RunEnded(RunStatus.COMPLETED, "", "", () if series else run.record.estimates)
        curves = series or run.series
        self.plots.show_results(kind, run.points, curves, ended, run.record.simulated, curves_first=bool(series))

    def _fill_table(self, review: ResultReview) -> None:
        marks = ["" if not line.limits else "✓" if line.passed else "✕" for line in review.rows]
        rows = [
            (mark, line.name, line.value, line.limits, line.before, line.paper, line.others)
            for mark, line in zip(marks, review.rows, strict=True)
        ]

        def color(at: int, place: int) -> str:
            passed = review.rows[at].passed
            return tokens().passed_color(passed) if marks[at] and (place == 0 or not passed) else ""

        fill_table(self.table, rows, color)
        for at, texts in enumerate(rows):
            for place, text in enumerate(texts):
                if (cell := self.table.item(at, place)) is not None:
                    cell.setToolTip(review.rows[at].remedy or text)
        for place, texts in list(enumerate(zip(*rows, strict=True)))[2:]:  # nothing to compare with: no empty column
            self.table.setColumnHidden(place, not any(texts))


def _with_x_label(curve: Series, label: str) -> Series:
    """Return a curve whose x column has another name, as the axis is called."""
    return replace(curve, x_axis=replace(curve.x_axis, name=label))


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
