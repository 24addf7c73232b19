"""Viewer of a finished run: response with model curve, traces, log and result card."""

from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QWidget

from app.archive import LoadedRun, run_settings
from app.common import format_duration, format_outcome
from app.gui.face import class_of, px
from app.gui.plots import ResultPlots
from app.gui.results import ResultCard
from app.gui.runs.trace_plot import TracePlot
from app.gui.widgets import (
    SELECTABLE,
    LogView,
    Segments,
    column,
    make_button,
    make_label,
    make_scroll_area,
    make_splitter,
    row,
)
from protocols import DEFAULT_PROTOCOL, PROTOCOLS
from protocols.base import Outcome, RunEnded, RunStatus

CARD_WIDTH = 270
MIN_PLOT_WIDTH = 400
LEAST_HEIGHT = 700
"""Of response, traces and log above each other; a lower viewer has one of them."""
RESPONSE, TRACES, LOG = "Response", "Traces", "Log"


class RunViewer(QWidget):
    """Shows a finished run as the Measure page showed it."""

    def __init__(self) -> None:
        super().__init__()
        self.run: LoadedRun | None = None
        self.heading = make_label(kind="heading", wrap=False, name="run.heading")
        self.facts_label = make_label(kind="note", name="run.facts", textInteractionFlags=SELECTABLE)
        self.plots, self.trace_plot, self.log = ResultPlots(), TracePlot(), LogView()
        self.card = ResultCard("run.card", ("next", "report"))
        self.back_button = make_button("Back", name="run.back", key="Esc")
        self.explore_button = make_button("Show in Explore", name="run.explore", key="E")
        self._parts = {RESPONSE: self.plots, TRACES: self.trace_plot, LOG: self.log}
        self.part = Segments("run.part", "part of the run", ((each, each) for each in self._parts))
        self.part.select(RESPONSE)
        self.part.chosen.connect(lambda _: self._show_parts())
        self.plots.setMinimumWidth(MIN_PLOT_WIDTH)
        parts = zip(self._parts.values(), (6, 4, 2), strict=True)
        rows = make_splitter("runs/rows", *parts, orientation=Qt.Orientation.Vertical, sizes=[350, 240, 90])
        self._card_area = make_scroll_area(
            self.card,
            self.facts_label,
            None,
            margins=(4, 0, 4, 0),
            spacing=6,
            accessibleName="result of the run",
            horizontalScrollBarPolicy=Qt.ScrollBarPolicy.ScrollBarAlwaysOff,
        )
        columns = make_splitter("runs/run", (rows, 1), (self._card_area, 0), sizes=[900, CARD_WIDTH])
        head = row(self.back_button, (self.heading, 1), self.part, self.explore_button)
        column(head, (columns, 1), parent=self, margins=(0, 2, 0, 0), spacing=4)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._card_area.setMinimumWidth(px(max(CARD_WIDTH, class_of(self).result)))
        self._show_parts()

    def _show_parts(self) -> None:
        is_low = self.height() < px(LEAST_HEIGHT)
        self.part.setVisible(is_low)
        for name, part in self._parts.items():
            part.setVisible(not is_low or name == self.part.selected)

    def show_run(self, run: LoadedRun) -> None:
        """Show a run; its model curve follows."""
        self.run = run
        self.heading.setText(run.record.title)
        self.card.show_summary(run.result)
        judged = run.record.verdict.outcome is not Outcome.NOT_JUDGED
        how = "" if judged else format_outcome(run.record.state, run.record.reason)
        begun = f"{run.record.start_time[:19].replace('T', ' ')} UTC, {format_duration(run.record.duration_s)}"
        parameters = "; ".join(f"{name} {value}" for name, value in run_settings(run.record).items())
        self.facts_label.setText("\n".join(line for line in (how, begun, parameters) if line))
        # Points of an unknown protocol are drawn if they are amplitudes over frequency.
        kind = PROTOCOLS.get(run.record.protocol, PROTOCOLS[DEFAULT_PROTOCOL])
        ended = RunEnded(RunStatus.COMPLETED, "", "", run.record.estimates, run.record.verdict)
        self.plots.show_results(kind, run.points, run.series, ended, run.record.simulated)
        self.trace_plot.show_traces(run.traces, run.record.simulated)
        self.log.show_messages(run.messages)
