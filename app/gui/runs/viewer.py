"""Viewer of a finished run: response with model curve, traces, log and results."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QWidget

from app.archive import LoadedRun
from app.common import OUTCOME_SYMBOLS, format_duration, format_estimate, format_outcome, outcome_severity
from app.gui.plots import ResultPlots
from app.gui.runs.trace_plot import TracePlot
from app.gui.widgets import SELECTABLE, LogPane, Theme, column, make_button, make_label, make_splitter, row
from app.live import OverlayCurve
from protocols.base import Outcome, RunEnded, RunStatus
from protocols.registry import PROTOCOLS


class RunViewer(QWidget):
    """Shows a finished run as the Measure page showed it."""

    back_pressed = Signal()
    explore_pressed = Signal()

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.run: LoadedRun | None = None
        self._theme = theme
        self.heading = make_label(kind="heading", wrap=False, name="run.heading")
        self.verdict_label = make_label(kind="caption", name="run.verdict", textInteractionFlags=SELECTABLE)
        self.facts_label = make_label(kind="note", name="run.facts", textInteractionFlags=SELECTABLE)
        self.plots, self.trace_plot, self.log = ResultPlots(theme), TracePlot(theme), LogPane(theme)
        self.back_button = make_button("← Back  (Esc)", self.back_pressed.emit, name="run.back")
        self.explore_button = make_button("Show in Explore  (E)", self.explore_pressed.emit, name="run.explore")
        parts = ((self.plots, 5), (self.trace_plot, 4), (self.log, 2))
        rows = make_splitter("runs/rows", *parts, orientation=Qt.Orientation.Vertical)
        head = row(self.back_button, (self.heading, 1), self.explore_button)
        column(head, self.verdict_label, self.facts_label, (rows, 1), parent=self, margins=(0, 2, 0, 0), spacing=4)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        if self.run is not None:
            self._color_verdict(self.run)
        for widget in (self.plots, self.trace_plot, self.log):
            widget.set_theme(theme)

    def show_run(self, run: LoadedRun) -> None:
        """Show a run; its model curve follows."""
        self.run = run
        self.heading.setText(run.title)
        self.verdict_label.setText(_verdict_text(run))
        self._color_verdict(run)
        estimates = "".join(f"   {format_estimate(e)}." for e in run.estimates)
        parameters = ", ".join(f"{name} {_format_value(value)}" for name, value in run.parameters.items())
        simulated = "SIMULATED.   " if run.simulated else ""
        self.facts_label.setText(
            f"{simulated}{run.start_time[:19].replace('T', ' ')} UTC, {format_duration(run.duration_s)}.{estimates}\n{parameters}"
        )
        # Points of an unknown protocol are drawn if they are amplitudes over frequency.
        kind = PROTOCOLS.get(run.protocol, PROTOCOLS["sine-dwell"])
        found = RunEnded(RunStatus.COMPLETED, "", "", run.estimates, run.verdict)
        self.plots.show_results(kind, run.points, run.curves, found, run.simulated)
        self.trace_plot.show_traces(run.traces, run.simulated)
        self.log.show_messages(run.messages)

    def _color_verdict(self, run: LoadedRun) -> None:
        color = self._theme.severity_color(outcome_severity(run.verdict.outcome))
        self.verdict_label.setStyleSheet(f"color: {color}")

    def show_model_curve(self, curve: OverlayCurve) -> None:
        """Show the model curve under the points."""
        self.plots.show_model_curve(curve)


def _verdict_text(run: LoadedRun) -> str:
    outcome = run.verdict.outcome
    if outcome is Outcome.NOT_JUDGED:
        return f"{OUTCOME_SYMBOLS[outcome]} {outcome}: {format_outcome(run.state, run.reason)}"
    return f"{OUTCOME_SYMBOLS[outcome]} {run.verdict.describe(run.reason)}"


def _format_value(value: object) -> str:
    text = ", ".join(f"{v:g}" for v in value) if isinstance(value, list) else str(value)
    return text if len(text) < 80 else f"{text[:77]}…"
