"""One run from the archive, opened: its response on the model's curve, its traces, what happened and what was found."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QSplitter, QVBoxLayout, QWidget

from app.archive.replay import Reopened
from app.common.formatting import duration, ended
from app.gui.plots.response_plot import ResponsePlot
from app.gui.plots.result_plots import ResultPlots
from app.gui.runs.trace_plot import RunTraces
from app.gui.widgets.log_pane import LogPane
from app.gui.widgets.theme import Theme
from app.live.overlay import Curve
from app.session.messages import estimate_words
from protocols.base.events import RunEnded, Status
from protocols.registry import PROTOCOLS


class RunView(QWidget):
    """Shows a reopened run as the measuring page showed it."""

    back_pressed = Signal()
    explore_pressed = Signal()

    def __init__(self, theme: Theme, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.run: Reopened | None = None
        self.heading, self.facts = QLabel(), QLabel()
        self.heading.setProperty("kind", "heading")
        self.facts.setProperty("kind", "note")
        self.facts.setWordWrap(True)
        for label in (self.heading, self.facts):
            label.setTextFormat(Qt.TextFormat.PlainText)
        self.facts.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.plots, self.traces, self.log = ResultPlots(theme), RunTraces(theme), LogPane(theme)
        self.back = QPushButton("← Back  (Esc)")
        self.explore = QPushButton("Show in Explore  (E)")
        self.back.clicked.connect(self.back_pressed)
        self.explore.clicked.connect(self.explore_pressed)
        head = QHBoxLayout()
        head.addWidget(self.back)
        head.addWidget(self.heading, 1)
        head.addWidget(self.explore)
        rows = QSplitter(Qt.Orientation.Vertical)
        for widget, share in ((self.plots, 5), (self.traces, 4), (self.log, 2)):
            rows.addWidget(widget)
            rows.setStretchFactor(rows.count() - 1, share)
        rows.setChildrenCollapsible(False)
        rows.setObjectName("runs/rows")
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 2, 0, 0)
        layout.setSpacing(4)
        layout.addLayout(head)
        layout.addWidget(self.facts)
        layout.addWidget(rows, 1)

    @property
    def response(self) -> ResponsePlot:
        """Amplitudes over frequency."""
        return self.plots.response

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        for widget in (self.plots, self.traces, self.log):
            widget.set_theme(theme)

    def show_run(self, run: Reopened) -> None:
        """Show a run; its curve follows."""
        self.run = run
        self.heading.setText(run.title)
        told = "".join(f"   {estimate_words(e)}." for e in run.estimates)
        parameters = ", ".join(f"{name} {_short(value)}" for name, value in run.parameters.items())
        simulated = "SIMULATED.   " if run.simulated else ""
        self.facts.setText(
            f"{simulated}{run.start_time[:19].replace('T', ' ')} UTC, {duration(run.duration_s)}, {ended(run.state, run.reason)}.{told}\n{parameters}"
        )
        # What a protocol that is not known here measured is drawn where it is an amplitude over frequency.
        kind = PROTOCOLS.get(run.protocol, PROTOCOLS["sine-dwell"])
        found = RunEnded(Status.COMPLETED, "", "", run.estimates)
        self.plots.show_results(kind, run.points, run.curves, found, run.simulated)
        self.traces.show_traces(run.traces, run.simulated)
        self.log.show_messages(run.messages)

    def show_curve(self, curve: Curve) -> None:
        """The model under the points."""
        self.plots.show_curve(curve)


def _short(value: object) -> str:
    text = ", ".join(f"{v:g}" for v in value) if isinstance(value, list) else str(value)
    return text if len(text) < 80 else f"{text[:77]}…"
