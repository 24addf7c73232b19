"""The measuring page: what to run on the left; the response, the live traces and the log on the right."""

from PySide6.QtCore import QByteArray, QSettings, Qt, Signal
from PySide6.QtWidgets import QSplitter, QWidget

from app.gui.feed import LiveFeed
from app.gui.live_pane import LivePane
from app.gui.log_pane import LogPane
from app.gui.run_panel import GetAmplifier, RunPanel
from app.gui.theme import Theme
from app.overlay import Overlay, Question, question_of
from app.presets import Presets
from app.view import View
from model.amplifier import AmplifierMap
from model.quantity import ParameterError
from protocols.protocol import Protocol


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
        self.right = LivePane(feed, map_, theme)
        self.right.again_pressed.connect(self.again_pressed)
        self.response, self.points, self.plots = self.right.response, self.right.points, self.right.plots
        self.traces = self.right.traces
        self.log = LogPane(theme)
        self.right.add(self.log, 2)
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
        self.right.set_theme(theme)
        self.log.set_theme(theme)

    def show_view(self, view: View) -> None:
        """Show a view."""
        self.panel.show_view(view)
        self.right.show_view(view, self.panel.kind)
        self._view = view
        self.log.show_view(view)

    def begin(self) -> None:
        """Want the model's curve from now on: its numerics take a while to import."""
        self._begun = True

    def refresh(self) -> None:
        """What moves between events: called at every tick."""
        self.right.refresh()
        if self._begun and self._question is not None:
            self._overlay.ask(self._question)
        try:
            curve = self._overlay.ready()
        except ParameterError:  # the form admits what the model cannot answer: there is no curve, and nothing else
            return
        if curve is not None:
            self.right.show_curve(curve)

    def _ask(self) -> None:
        """Want the curve that belongs to the form."""
        if self._view is not None:
            self.show_view(self._view)  # another protocol may want another plot
        if (protocol := self.panel.protocol) is not None:
            self._question = question_of(protocol)

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
