"""Measure page: run panel on the left; response and live traces on the right."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, QSettings, QSize, Qt, QTimer
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QWidget

from app.common import Severity, UndoHistory, pluralize
from app.gui.face import class_of, px
from app.gui.measure.presets import PresetStore
from app.gui.measure.run_panel import BenchGetter, RunPanel
from app.gui.measure.runs_in_plot import RunsInPlot
from app.gui.plots import LivePane
from app.gui.widgets import BackgroundWorker, Mode, add_actions, at_end, choose_files, configure, tell
from app.identification import PAPER_MODEL
from app.live import CurveRequest, LiveEstimator, LiveFeed, Overlay, PreflightCheck, PreflightRequest, curve_request_for
from app.session import WindowState
from drivers import Sine
from model import AmplifierMap
from protocols import PROTOCOLS
from protocols.base import Protocol

if TYPE_CHECKING:
    from app.archive import MeasuredResponse

CALIBRATION_POLL_S = 1.0
"""Interval at which the specimen's calibration is checked."""


class MeasurePage(QWidget):
    """One page of the window."""

    title = "Measure"

    def __init__(
        self,
        protocol: Protocol,
        feed: LiveFeed,
        overlay: Overlay,
        amplifier: AmplifierMap,
        bench: BenchGetter,
        presets: PresetStore,
        shapes: int | None = None,
    ) -> None:
        super().__init__()
        self._overlay, self._estimator = overlay, LiveEstimator(amplifier, shapes)
        self._bench, self._preflight, self._active_model = bench, PreflightCheck(), PAPER_MODEL
        for each in (self._estimator, self._preflight):
            at_end(self, each.close)
        self._state: WindowState | None = None
        self._request: CurveRequest | None = None
        self._curve_started, self._last_poll_s = False, 0.0
        self.run_panel = RunPanel(protocol, bench, presets)
        self.live_pane = LivePane(feed, amplifier)
        configure(self, "measure", focusPolicy=Qt.FocusPolicy.ClickFocus)
        for part in (self.run_panel, self.live_pane):
            part.setParent(self)
        self.live_pane.setSizes([380, 250])
        self.live_pane.choose_runs = self._choose_runs
        self._worker = BackgroundWorker("added runs", self)
        self.live_pane.setObjectName("measure/rows")
        self.run_panel.changed.connect(self._update_request)
        self.runs_card = RunsInPlot(self._choose_runs)
        self.run_panel.result_layout.insertWidget(2, self.runs_card)
        self._fitted: tuple[object, ...] = ()
        self.history = FormHistory(self.run_panel, self)
        self._update_request()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        grid, height = class_of(self), self.height()
        left, right = px(grid.left), px(grid.result)  # never the widths that their texts would like
        panel, plots = self.run_panel, self.width() - left - right
        if not right:
            self.runs_card.hide()
        panel.place_result(self if right else None)
        panel.setGeometry(0, 0, left, height)
        gap = px(grid.gap) if right else 0
        self.live_pane.setGeometry(left, gap, plots, height - 2 * gap)
        self.live_pane.show_as_cards(grid.gap if right else 0)
        if right:
            panel.result_pane.setGeometry(left + plots + gap, gap, right - 2 * gap, height - 2 * gap)
            panel.result_card.set_room(height - 2 * gap)

    def _fit_runs(self) -> None:
        """Show the runs of the plot below the result, where both are whole."""
        card, runs = self.run_panel.result_card, self.live_pane.plots.runs
        if (fitted := (runs, card.summary, self.size(), card.isHidden())) == self._fitted:
            return
        if not self._fitted or runs is not self._fitted[0]:
            self.runs_card.show_runs(runs)
        self._fitted = fitted
        taken = 0 if card.isHidden() else card.heightForWidth(card.width()) + px(12)
        free = self.run_panel.result_pane.height() - taken
        is_beside = class_of(self).result > 0
        self.runs_card.setVisible(is_beside and len(runs) > 1 and self.runs_card.sizeHint().height() <= free)

    def minimumSizeHint(self) -> QSize:
        plots, panel, grid = self.live_pane.minimumSizeHint(), self.run_panel.minimumSizeHint(), class_of(self)
        return QSize(px(grid.left + grid.result) + plots.width(), max(plots.height(), panel.height()))

    def set_state(self, view: WindowState) -> None:
        """Show a window state."""
        self.run_panel.set_state(view)
        if view.busy and (self._state is None or self._state.protocol != view.protocol or not self._state.busy):
            self.live_pane.planned = self._planned_frequencies(view)
        self.live_pane.set_state(view, self.run_panel.kind)
        if view.busy and (self._state is None or view.points is not self._state.points or not self._state.busy):
            self._estimator.submit(view.points, self._active_model, PROTOCOLS.get(view.protocol, self.run_panel.kind))
        self._state = view

    def _planned_frequencies(self, view: WindowState) -> tuple[float, ...]:
        """Return the frequency of each entry of the form's protocol, which cannot be changed during a run."""
        protocol = self.run_panel.protocol
        if protocol is None or protocol.name != view.protocol:
            return ()
        return tuple(
            next((drive.frequency_hz for drive in entry.drives if isinstance(drive, Sine)), math.nan)
            for entry in protocol.plan(view.amplifier.rest_v)
        )

    def start_model_curve(self) -> None:
        """Compute the model curve from now on; its numerics take a while to import."""
        self._curve_started = True
        if self._state is None or not self._state.busy:
            self._estimator.submit(
                (), self._active_model, self.run_panel.kind
            )  # importing during a run would delay its first frames

    def activate(self) -> None:
        """Take the keyboard focus, but into no field: a stray key must not change a value."""
        self.setFocus()

    def tick(self) -> None:
        """Refresh values that change between events; called at every tick."""
        self.live_pane.tick()
        self._fit_runs()
        self.run_panel.result_card.show_update(self._estimator.latest, self._state)
        if self._curve_started and self._request is not None:
            self._overlay.submit(self._request)
            self._poll_calibration()
            self._run_preflight()
        if (curve := self._overlay.result()) is not None:
            self._active_model = curve.active_model
            self.live_pane.show_model_curve(curve)

    def _choose_runs(self) -> None:
        folder = str(self.run_panel.folder)
        choose_files(self, "Runs to add to the plot", self.add_runs, "Runs (*.h5)", folder, Mode.ExistingFiles)

    def add_runs(self, paths: Sequence[Path]) -> None:
        """Add recorded runs to the plot; they are read in the background."""

        def read() -> Sequence[MeasuredResponse]:
            from app.archive import measured_responses  # imports HDF5

            return measured_responses(paths)

        def show(runs: Sequence[MeasuredResponse]) -> None:
            if len(runs) < len(paths):
                tell(
                    self, f"{len(runs)} of {pluralize(len(paths), 'run')} have a response over frequency and are shown"
                )
            if runs:
                self.live_pane.plots.add_runs(runs)

        self._worker.submit(read, show, lambda error: tell(self, str(error), severity=Severity.ERROR))

    def _run_preflight(self) -> None:
        """Run the preflight check of the form, except during a run."""
        protocol, bench = self.run_panel.protocol, self._bench()
        if protocol is None or bench is None or self._state is None or self._state.busy:
            self.run_panel.show_warnings(())
        else:
            request = PreflightRequest(protocol, bench, self._active_model, self.run_panel.folder)
            self.run_panel.show_warnings(self._preflight.warnings(request))

    def _poll_calibration(self) -> None:
        """Check for another accepted calibration, for example from the command line."""
        now_s = time.monotonic()
        if now_s - self._last_poll_s > CALIBRATION_POLL_S:
            self._last_poll_s = now_s
            self._overlay.refresh()

    def _update_request(self) -> None:
        """Request the model curve of the form."""
        if self._state is not None:
            self.set_state(self._state)  # another protocol may need another plot
        if (protocol := self.run_panel.protocol) is not None:
            self._request = curve_request_for(protocol, self.run_panel.folder, self.run_panel.specimen)

    def restore_state(self, settings: QSettings, restore_form: bool) -> None:
        """Restore saved settings; `restore_form` also restores the form's protocol."""
        if restore_form and (protocol := _saved_form(settings)) is not None:
            self.run_panel.set_protocol(protocol)
        span = settings.value("measure/span")
        if isinstance(span, int | str) and str(span).isdigit():
            self.live_pane.first_span = int(span)

    def save_state(self, settings: QSettings) -> None:
        """Save settings."""
        if (protocol := self.run_panel.protocol) is not None:
            saved = {"protocol": protocol.name, "parameters": protocol.model_dump(mode="json")}
            settings.setValue("measure/form", json.dumps(saved))
        settings.setValue("measure/span", self.live_pane.time_plot.selected_span)


def _saved_form(settings: QSettings) -> Protocol | None:
    """Return the saved protocol; None if none is saved or this version rejects it."""
    try:
        saved = json.loads(str(settings.value("measure/form", "")))
        return PROTOCOLS[saved["protocol"]].model_validate(saved["parameters"])
    except (ValueError, KeyError, TypeError):
        return None


class FormHistory(QObject):
    """Remembers the valid protocols of a form. Text within a field has its own undo.

    Args:
        panel: holds the form.
        page: where the shortcuts of undo and redo work.
    """

    def __init__(self, panel: RunPanel, page: QWidget) -> None:
        super().__init__(page)
        self._panel = panel
        self._history: UndoHistory[Protocol | None] = UndoHistory(panel.protocol)
        # A preset fills one field after the other: only the form after the last change is remembered.
        self._settle_timer = QTimer(self, singleShot=True, interval=0)
        self._settle_timer.timeout.connect(self._remember)
        panel.changed.connect(self._settle_timer.start)
        add_actions(page, {"measure.undo": self.undo, "measure.redo": self.redo})

    def undo(self) -> None:
        """Show the previous protocol."""
        self._remember()
        self._step(self._history.undo)

    def redo(self) -> None:
        """Show the protocol that was undone."""
        self._step(self._history.redo)

    def _remember(self) -> None:
        if (protocol := self._panel.protocol) is not None:
            self._history.push(protocol, _changed_field(self._history.current, protocol))

    def _step(self, step: Callable[[], bool]) -> None:
        if self._panel.form.isEnabled() and step() and (protocol := self._history.current) is not None:
            self._panel.set_protocol(protocol)


def _changed_field(old: Protocol | None, new: Protocol) -> str:
    """Return the field that differs; empty if more than one does."""
    if type(old) is not type(new):
        return ""
    names = [name for name in type(new).model_fields if getattr(old, name) != getattr(new, name)]
    return names[0] if len(names) == 1 else ""
