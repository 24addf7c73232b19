"""The measuring page: what to run on the left; the response, the live traces and the log on the right."""

import json
import time
from pathlib import Path

from PySide6.QtCore import QSettings, Qt, Signal
from PySide6.QtWidgets import QSplitter, QWidget

from app.gui.measure.form_history import FormHistory
from app.gui.measure.presets import Presets
from app.gui.measure.run_panel import GetBench, RunPanel
from app.gui.plots.live_pane import LivePane
from app.gui.plots.points_plot import PointsPlot
from app.gui.widgets.log_pane import LogPane
from app.gui.widgets.theme import Theme
from app.identification.active_model import PAPER
from app.live.estimates import LiveEstimates
from app.live.feed import LiveFeed
from app.live.overlay import Overlay, Question, question_of
from app.live.preflight import Foresight, Intent
from app.session.state import View
from model.amplifier_map import AmplifierMap
from model.parameter_spec import ParameterError
from protocols.base.protocol import Protocol
from protocols.registry import PROTOCOLS

LOOK_S = 1.0
"""How often the specimen's calibration is looked at."""


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
        bench: GetBench,
        presets: Presets,
        theme: Theme,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(Qt.Orientation.Horizontal, parent)
        self._overlay, self._live = overlay, LiveEstimates(map_)
        self._bench, self._foresight = bench, Foresight()
        self._believed = PAPER
        self._view: View | None = None
        self._question: Question | None = None
        self._begun = False
        self._looked_s = 0.0
        self.panel = RunPanel(protocol, bench, presets, theme)
        self.right = LivePane(feed, map_, theme)
        self.right.again_pressed.connect(self.again_pressed)
        self.response, self.plots = self.right.response, self.right.plots
        self.traces = self.right.traces
        self.log = LogPane(theme)
        self.right.add(self.log, 2)
        self.setChildrenCollapsible(False)
        self.setFocusPolicy(Qt.FocusPolicy.ClickFocus)
        self.addWidget(self.panel)
        self.addWidget(self.right)
        self.setStretchFactor(0, 0)
        self.setStretchFactor(1, 1)
        self.setSizes([350, 900])
        self.right.setSizes([290, 210, 96])
        self.setObjectName("measure/columns")
        self.right.setObjectName("measure/rows")
        self.panel.setMinimumWidth(300)
        self.panel.changed.connect(self._ask)
        self.history = FormHistory(self.panel, self)
        self._ask()

    @property
    def points(self) -> PointsPlot:
        """The plot of points that are no amplitudes over frequency."""
        return self.right.points

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self.right.set_theme(theme)
        self.log.set_theme(theme)
        self.panel.told.set_theme(theme)

    def show_view(self, view: View) -> None:
        """Show a view."""
        self.panel.show_view(view)
        self.right.show_view(view, self.panel.kind)
        if view.busy and (self._view is None or view.points is not self._view.points or not self._view.busy):
            self._live.ask(view.points, self._believed)
        self._view = view
        self.log.show_view(view)

    def begin(self) -> None:
        """Want the model's curve from now on: its numerics take a while to import."""
        self._begun = True
        if self._view is None or not self._view.busy:
            self._live.ask((), self._believed)  # what it imports would hold up a run's first frames

    def enter(self) -> None:
        """Take the keyboard, into no field: a stray key shall change nothing."""
        self.setFocus()

    def refresh(self) -> None:
        """What moves between events: called at every tick."""
        self.right.refresh()
        self.panel.told.show_told(self._live.newest)
        if self._begun and self._question is not None:
            self._overlay.ask(self._question)
            self._look_again()
            self._foresee()
        try:
            curve = self._overlay.ready()
        except ParameterError:  # the form admits what the model cannot answer: there is no curve, and nothing else
            return
        if curve is not None:
            self._believed = curve.believed
            self.right.show_curve(curve)

    def _foresee(self) -> None:
        """Rehearse the form with the model; while a run goes on there is nothing to decide."""
        protocol, bench = self.panel.protocol, self._bench()
        if protocol is None or bench is None or self._view is None or self._view.busy:
            self.panel.show_cautions(())
            return
        self._foresight.ask(Intent(protocol, bench, self._believed, self._folder))
        self.panel.show_cautions(self._foresight.words)

    def _look_again(self) -> None:
        """Somebody may have accepted another calibration meanwhile, here or at a command line."""
        now_s = time.monotonic()
        if now_s - self._looked_s > LOOK_S:
            self._looked_s = now_s
            self._overlay.look_again()

    def _ask(self) -> None:
        """Want the curve that belongs to the form."""
        if self._view is not None:
            self.show_view(self._view)  # another protocol may want another plot
        if (protocol := self.panel.protocol) is not None:
            self._question = question_of(protocol, self._folder, self.panel.specimen.text().strip())

    @property
    def _folder(self) -> Path:
        return Path(self.panel.folder.text().strip()).expanduser()

    def end(self) -> None:
        """End what works beside the window."""
        self._live.close()
        self._foresight.close()

    def restore(self, settings: QSettings, form: bool) -> None:
        """Be as it was when it was last closed; `form`: what it said, too."""
        if form and (protocol := _kept(settings)) is not None:
            self.panel.fill(protocol)
        span = settings.value("measure/span")
        if isinstance(span, int | str) and str(span).isdigit():
            self.traces.choose(int(span))

    def save(self, settings: QSettings) -> None:
        """Remember how it is."""
        if (protocol := self.panel.protocol) is not None:
            said = {"protocol": protocol.name, "parameters": protocol.model_dump(mode="json")}
            settings.setValue("measure/form", json.dumps(said))
        settings.setValue("measure/span", self.traces.chosen)


def _kept(settings: QSettings) -> Protocol | None:
    """What the form said last; None where that is gone, or no protocol of this version."""
    try:
        said = json.loads(str(settings.value("measure/form", "")))
        return PROTOCOLS[said["protocol"]].model_validate(said["parameters"])
    except (ValueError, KeyError, TypeError):
        return None
