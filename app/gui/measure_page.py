"""The measuring page: what to run on the left; the response, the live traces and the log on the right."""

import math
from typing import Any

from PySide6.QtCore import QByteArray, QSettings, Qt, Signal
from PySide6.QtWidgets import QSplitter, QStackedWidget, QWidget

from app.gui.feed import LiveFeed
from app.gui.log_pane import LogPane
from app.gui.points_plot import PointsPlot
from app.gui.response_plot import ResponsePlot, draws
from app.gui.run_panel import GetAmplifier, RunPanel
from app.gui.theme import Theme
from app.gui.time_plot import TimePlot
from app.overlay import Overlay, Question
from app.presets import Presets
from app.view import View
from model.amplifier import AmplifierMap
from model.quantity import ParameterError
from protocols.protocol import Protocol
from protocols.registry import PROTOCOLS


class MeasurePage(QSplitter):
    """One page of the window."""

    title = "Measure"
    again_pressed = Signal(tuple)

    def __init__(
        self,
        protocol: Protocol,
        feed: LiveFeed,
        overlay: Overlay,
        map_: AmplifierMap,
        amplifier: GetAmplifier,
        presets: Presets,
        theme: Theme,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(Qt.Orientation.Horizontal, parent)
        self._overlay = overlay
        self._view: View | None = None
        self._question: Question | None = None
        self._begun = False
        self.panel = RunPanel(protocol, amplifier, presets)
        self.response = ResponsePlot(theme)
        self.points = PointsPlot(theme)
        self.plots = QStackedWidget()
        for plot in (self.response, self.points):
            self.plots.addWidget(plot)
            plot.again_pressed.connect(self.again_pressed)
        self.traces = TimePlot(feed, map_, theme)
        self.log = LogPane(theme)
        self.right = QSplitter(Qt.Orientation.Vertical)
        for widget, share in ((self.plots, 5), (self.traces, 4), (self.log, 2)):
            self.right.addWidget(widget)
            self.right.setStretchFactor(self.right.count() - 1, share)
            widget.setMinimumHeight(56)
        self.right.setChildrenCollapsible(False)
        self.setChildrenCollapsible(False)
        self.addWidget(self.panel)
        self.addWidget(self.right)
        self.setStretchFactor(0, 0)
        self.setStretchFactor(1, 1)
        self.setSizes([350, 900])
        self.right.setSizes([290, 210, 96])
        self.panel.setMinimumWidth(300)
        self.panel.changed.connect(self._ask)
        self._ask()

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        for widget in (self.response, self.points, self.traces, self.log):
            widget.set_theme(theme)

    def show_view(self, view: View) -> None:
        """Show a view."""
        self.panel.show_view(view)
        kind = PROTOCOLS.get(view.protocol, self.panel.kind) if view.busy or view.points else self.panel.kind
        plot = self.response if draws(kind) else self.points
        self.points.show_kind(kind)
        plot.show_simulated(view.simulated)
        plot.show_points(view.points, view.entries, view.can_run)
        plot.show_found(view.outcome)
        self.plots.setCurrentWidget(plot)
        self._view = view
        self.traces.show_simulated(view.simulated)
        self.log.show_view(view)

    def begin(self) -> None:
        """Want the model's curve from now on: its numerics take a while to import."""
        self._begun = True

    def refresh(self) -> None:
        """What moves between events: called at every tick."""
        self.traces.refresh()
        if self._begun and self._question is not None:
            self._overlay.ask(self._question)
        try:
            curve = self._overlay.ready()
        except ParameterError:  # the form admits what the model cannot answer: there is no curve, and nothing else
            return
        if curve is not None:
            self.response.show_curve(curve)

    def _ask(self) -> None:
        """Want the curve that belongs to the form."""
        if self._view is not None:
            self.show_view(self._view)  # another protocol may want another plot
        protocol: Any = self.panel.protocol
        if protocol is None:
            return
        frequencies = getattr(protocol, "frequencies_hz", (250.0,))
        top = 25.0 * math.ceil(1.04 * max(frequencies) / 25.0)
        self._question = Question(top, getattr(protocol, "peak_to_peak_v", 5.0) / 2)

    def restore(self, settings: QSettings) -> None:
        """Be as it was when it was last closed."""
        for key, splitter in (("columns", self), ("rows", self.right)):
            state = settings.value(f"measure/{key}")
            if isinstance(state, QByteArray):
                splitter.restoreState(state)
        span = settings.value("measure/span")
        if isinstance(span, int | str) and str(span).isdigit():
            self.traces.choose(int(span))

    def save(self, settings: QSettings) -> None:
        """Remember how it is."""
        settings.setValue("measure/protocol", self.panel.kind.name)
        settings.setValue("measure/columns", self.saveState())
        settings.setValue("measure/rows", self.right.saveState())
        settings.setValue("measure/span", self.traces.chosen)
