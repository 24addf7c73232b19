"""The Explore page: sliders for every number of the model, and at once what the skin would feel.

Where everything of the Explore page stands: sliders at the left, the curves and the motion at the right.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QSettings, Qt, Signal
from PySide6.QtGui import QDragEnterEvent, QDropEvent, QGuiApplication
from PySide6.QtWidgets import QScrollArea, QSplitter, QVBoxLayout, QWidget

from app.archive.replay import MeasuredResponse
from app.explore.engine import ExploreRequest, ExploreResult, ResponseEngine
from app.explore.fit import ExploreFit
from app.explore.session import ExploreSession, write_study
from app.explore.state import PRESET_TITLES, ExploreSetting, make_study
from app.gui.explore.overlaid_runs import FitRuns, OverlaidRuns
from app.gui.explore.plot import ExplorePlot
from app.gui.explore.shape_plot import ShapePlot
from app.gui.explore.sliders import SliderPanel
from app.gui.explore.toolbar import ExploreToolbar
from app.gui.widgets.actions import add_actions
from app.gui.widgets.background import BackgroundWorker
from app.gui.widgets.dropped_files import dropped_runs
from app.gui.widgets.file_dialog import Mode, choose_files
from app.gui.widgets.status_line import StatusLine
from app.gui.widgets.theme import Theme
from app.live.latest_only import LatestOnlyWorker
from app.session.state import WindowState
from model.parameter_spec import ParameterError


def explore_columns(
    sliders: SliderPanel, status_line: StatusLine, plot: ExplorePlot, shape: ShapePlot, toolbar: ExploreToolbar
) -> tuple[QWidget, QWidget]:
    """The left and the right side."""
    return _left_column(sliders, status_line, toolbar), _right_column(plot, shape, toolbar)


def _left_column(sliders: SliderPanel, status_line: StatusLine, toolbar: ExploreToolbar) -> QWidget:
    scroll = QScrollArea()
    scroll.setWidget(sliders)
    scroll.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    scroll.setWidgetResizable(True)
    scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    scroll.viewport().setAutoFillBackground(False)
    sliders.setAutoFillBackground(False)
    left, column = _empty_column(6)
    column.setContentsMargins(0, 2, 4, 0)
    column.addLayout(toolbar.start_row())
    column.addWidget(scroll, 1)
    column.addWidget(status_line)
    column.addLayout(toolbar.export_row())
    left.setMinimumWidth(400)
    return left


def _right_column(plot: ExplorePlot, shape: ShapePlot, toolbar: ExploreToolbar) -> QWidget:
    right, column = _empty_column(4)
    column.addLayout(toolbar.series_row())
    column.addLayout(toolbar.overlay_row())
    rows = QSplitter(Qt.Orientation.Vertical)
    rows.addWidget(plot)
    below, beam = _empty_column(2)
    beam.addLayout(toolbar.motion_row())
    beam.addWidget(shape, 1)
    rows.addWidget(below)
    rows.setSizes([400, 210])
    rows.setObjectName("explore/rows")
    rows.setChildrenCollapsible(False)
    column.addWidget(rows, 1)
    return right


def _empty_column(spacing: int) -> tuple[QWidget, QVBoxLayout]:
    """An empty column that fills its place."""
    widget = QWidget()
    column = QVBoxLayout(widget)
    column.setContentsMargins(0, 0, 0, 0)
    column.setSpacing(spacing)
    return widget, column


PAINT_PAUSE_S = 0.02
"""After the curve the worker waits so long for it to be painted, before it goes on with the motion."""


class ExplorePage(QSplitter):
    """One page of the window.

    Args:
        fit: identifies from the runs laid over; without one there is no such button.
    """

    title = "Explore"
    _result_ready = Signal(object, object)

    def __init__(self, theme: Theme, fit: FitRuns | None = None, parent: QWidget | None = None) -> None:
        super().__init__(Qt.Orientation.Horizontal, parent)
        self.session = ExploreSession()
        self.result: ExploreResult | None = None
        self.shown_request: ExploreRequest | None = None
        """The question whose whole answer is on the screen."""
        self._requested: ExploreRequest | None = None
        self._sliders_stale = True
        self._study_worker = BackgroundWorker("explore study", self)
        self.overlaid = OverlaidRuns(fit, self)
        self._model_worker: LatestOnlyWorker[ExploreRequest, ExploreResult] | None = None
        self.sliders, self.plot, self.shape_plot = SliderPanel(), ExplorePlot(theme), ShapePlot(theme)
        self.toolbar = ExploreToolbar(PRESET_TITLES, fit is not None, self)
        self.status_line = StatusLine()
        for side in explore_columns(self.sliders, self.status_line, self.plot, self.shape_plot, self.toolbar):
            self.addWidget(side)
        self.setStretchFactor(0, 0)
        self.setStretchFactor(1, 1)
        self.setSizes([430, 820])
        self.setObjectName("explore/columns")
        self.setChildrenCollapsible(False)
        self._connect_signals()
        self.setAcceptDrops(True)
        self.setFocusPolicy(Qt.FocusPolicy.ClickFocus)
        self._update_series()
        self._show_setting()

    @property
    def setting(self) -> ExploreSetting:
        return self.session.setting

    @property
    def overlaid_responses(self) -> tuple[MeasuredResponse, ...]:
        """The runs that lie over the curves."""
        return self.overlaid.runs

    # -- what the window does with a page ------------------------------------------------------------------------------

    def set_state(self, view: WindowState) -> None:
        """Nothing here depends on the bench."""

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self.plot.set_theme(theme)
        self.shape_plot.set_theme(theme)

    def activate(self) -> None:
        """Take the keyboard."""
        self.setFocus()

    def tick(self) -> None:
        """Called at every tick while the page is seen."""
        if self._requested is None:
            self._request_result()
        if self._sliders_stale:
            self._sliders_stale = False
            self.sliders.show_setting(self.setting)
            self.toolbar.show_setting(self.setting, self.session.history)
        self.shape_plot.tick()

    def shutdown(self) -> None:
        """End what works beside the window."""
        if self._model_worker is not None:
            self._model_worker.close()
        self._study_worker.close()
        self.overlaid.shutdown()

    def save_state(self, settings: QSettings) -> None:
        """Remember how it is."""
        settings.setValue("explore/setting", json.dumps(self.session.to_record()))

    def restore_state(self, settings: QSettings) -> None:
        """Be as it was."""
        try:
            self.session.restore_record(json.loads(str(settings.value("explore/setting", ""))))
        except (ValueError, KeyError, TypeError, AttributeError):
            return
        self._show_setting()

    # -- what a person wants -------------------------------------------------------------------------------------------

    def set_value(self, name: str, value: float) -> None:
        """One slider to a value, SI."""
        self._apply_change(lambda: self.session.set_value(name, value))

    def reset_value(self, name: str) -> None:
        """One slider back."""
        self._apply_change(lambda: self.session.reset_value(name))

    def set_setting(self, setting: ExploreSetting) -> None:
        """Another setting."""
        self._apply_change(lambda: self.session.set_setting(setting))

    def load_preset(self, name: str) -> None:
        """Begin from a preset."""
        self._apply_change(lambda: self.session.load_preset(name))
        if self.session.kept_curves:
            self.toolbar.series[1].setChecked(True)  # the paper's theory is the fundamental
            self.toolbar.series[0].setChecked(False)
        self._request_result()

    def undo(self) -> None:
        self.session.history.undo()
        self._show_setting()

    def redo(self) -> None:
        self.session.history.redo()
        self._show_setting()

    def keep_curve(self) -> None:
        """Let the present curve stay while the sliders move on."""
        self.session.keep_curve()
        self._request_result()

    def clear_overlays(self) -> None:
        """Take kept curves and measured runs away."""
        self.session.kept_curves = ()
        self.overlaid.clear()
        self._request_result()

    def overlay_runs(self, paths: Sequence[Path]) -> None:
        """Measured runs over the curves."""
        self.overlaid.add(paths)

    def fit_runs(self) -> None:
        """Let the sliders go where the runs are met best; while that goes on: cancel it."""
        self.overlaid.fit(self.setting)

    def copy(self, kind: str) -> None:
        """The numbers as text for `--set`."""
        text = self.setting.as_json() if kind == "JSON" else self.setting.as_toml()
        QGuiApplication.clipboard().setText(text)
        self.status_line.show_message(
            f'copied as {kind}: tactor-bench model frequency-response --set @FILE, or --set "the text itself"'
        )

    def save_study(self, path: Path) -> None:
        """What the kept curves vary, or the slider moved last, as a study file."""
        self.status_line.show_message("computing the study …")
        setting, kept, variable = self.setting, self.session.kept_curves, self.session.study_variable
        frequencies: Any = range(1, 251) if self.result is None else self.result.curve.frequency_hz
        self._study_worker.submit(
            lambda: write_study(path, make_study(setting, kept, variable, frequencies), variable),
            lambda words: self.status_line.show_message(str(words)),
            self._on_error,
        )

    # -- inside --------------------------------------------------------------------------------------------------------

    def _on_fitted(self, result: ExploreFit) -> None:
        self.set_setting(result.setting)
        self.status_line.show_message(f"Fitted: {result.summary}", persistent=True)  # until a slider is moved

    def _on_fitting(self, fitting: bool) -> None:
        self.toolbar.show_fitting(fitting)
        if fitting:
            self.status_line.show_message("fitting …", persistent=True)

    def _on_error(self, error: Exception) -> None:
        self.status_line.show_message(str(error), is_error=True)

    def _show_overlaid(self) -> None:
        self.plot.show_runs(self.overlaid_responses)
        self.toolbar.show_runs(self.overlaid_responses, self.overlaid.remove)
        if other := self.session.runs_with_other_drive(self.overlaid_responses):
            drives = ", ".join(f"{run.label} at {run.peak_to_peak_v:.3g} V" for run in other)
            self.status_line.show_message(
                f"{drives}; the curve is for {self.setting.peak_to_peak_v:.3g} V peak to peak", is_error=True
            )

    def _apply_change(self, change: Callable[[], object]) -> None:
        """Do what moves sliders; where the model refuses, say why: they stay where they were."""
        try:
            change()
        except ParameterError as error:
            self.status_line.show_message(str(error), is_error=True)
        else:
            self.status_line.show_message("")
        self._show_setting()

    def _show_setting(self) -> None:
        if self.isVisible():
            self._request_result()
        else:
            self._requested = None
        self._sliders_stale = True  # the curve first; the sliders follow with the next frame

    def _request_result(self) -> None:
        question = self.session.request
        if question == self._requested:
            return
        self._requested = question
        if self._model_worker is None:  # not before somebody looks: it loads the linear algebra
            self._model_worker = LatestOnlyWorker(
                ResponseEngine().compute, self._result_ready.emit, "explore model", PAINT_PAUSE_S
            )
        self._model_worker.submit(question)

    def _on_result(self, request: ExploreRequest, result: ExploreResult | Exception) -> None:
        if isinstance(result, Exception):
            self.status_line.show_message(
                f"the model cannot be computed so: {result}; move a slider back", is_error=True
            )
            return
        self.result = result
        self.plot.show_result(result, request.kept_curves)
        if result.motion is not None:
            self.shape_plot.show_motion(result.motion, request.cursor_hz)
            self.shown_request = request

    def _on_cursor_moved(self, hz: float) -> None:
        self.session.cursor_hz = float(f"{hz:.4g}")
        self.toolbar.show_frequency(self.session.cursor_hz)
        self._request_result()

    def _set_range(self, max_hz: float) -> None:
        self.session.max_hz = max_hz
        self.plot.show_range(max_hz)
        self._request_result()

    def _update_series(self) -> None:
        self.plot.show_series(*(box.isChecked() for box in self.toolbar.series))

    def _choose_runs(self) -> None:
        choose_files(self, "Runs to lay over", self.overlay_runs, "Runs (*.h5)", mode=Mode.ExistingFiles)

    def _choose_study_file(self) -> None:
        choose_files(
            self, "Save as study", lambda paths: self.save_study(paths[0]), "Study (*.h5);;Sheet (*.csv)", "study.h5",
            Mode.AnyFile,
        )  # fmt: skip

    def _connect_signals(self) -> None:
        bar = self.toolbar
        self._result_ready.connect(self._on_result)
        self.overlaid.changed.connect(self._show_overlaid)
        self.overlaid.fitting.connect(self._on_fitting)
        self.overlaid.fitted.connect(self._on_fitted)
        self.overlaid.message.connect(self.status_line.show_message)
        self.sliders.value_changed.connect(self.set_value)
        self.sliders.reset_requested.connect(self.reset_value)
        self.sliders.input_rejected.connect(lambda words: self.status_line.show_message(words, is_error=True))
        self.plot.cursor_moved.connect(self._on_cursor_moved)
        bar.preset_chosen.connect(self.load_preset)
        bar.skin_chosen.connect(lambda on: self._apply_change(lambda: self.session.set_on_skin(on)))
        bar.frequency_chosen.connect(self.plot.cursor_line.setValue)
        bar.range_chosen.connect(self._set_range)
        bar.series_changed.connect(self._update_series)
        bar.copy_chosen.connect(self.copy)
        for button, do in (
            (bar.undo_button, self.undo),
            (bar.redo_button, self.redo),
            (bar.keep_button, self.keep_curve),
            (bar.clear_button, self.clear_overlays),
            (bar.overlay_button, self._choose_runs),
            (bar.fit_button, self.fit_runs),
            (bar.study_button, self._choose_study_file),
        ):
            button.clicked.connect(do)
        add_actions(
            self,
            {
                "explore.undo": bar.undo_button.click,
                "explore.redo": bar.redo_button.click,
                "explore.keep": bar.keep_button.click,
                "explore.copy-json": bar.copy_json_button.click,
                "explore.overlay": bar.overlay_button.click,
                "explore.fit": bar.fit_button.click,
                "explore.skin": bar.toggle_skin,
                "explore.study": bar.study_button.click,
            },
        )

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        if dropped_runs(event):
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        self.overlay_runs(dropped_runs(event))
        event.acceptProposedAction()
