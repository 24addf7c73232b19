"""Explore page: sliders for every parameter of the model, its response curves, and the motion of the beam."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QSettings, Qt, Signal, SignalInstance
from PySide6.QtGui import QDragEnterEvent, QDropEvent, QGuiApplication
from PySide6.QtWidgets import QScrollArea, QSplitter, QWidget

from app.common import ResultSummary
from app.explore import (
    PRESET_TITLES,
    ExploreFit,
    ExploreRequest,
    ExploreResult,
    ExploreSession,
    ExploreSetting,
    ResponseEngine,
    make_study,
    write_study,
)
from app.gui.explore.design_panel import DesignPanel
from app.gui.explore.overlaid_runs import FitRuns, OverlaidRuns
from app.gui.explore.plot import ExplorePlot
from app.gui.explore.shape_plot import ShapePlot
from app.gui.explore.sliders import SliderPanel
from app.gui.explore.toolbar import ExploreToolbar
from app.gui.results.card import ResultCard
from app.gui.widgets import (
    STRETCH,
    BackgroundWorker,
    Mode,
    StatusLine,
    WindowTheme,
    WrappingPane,
    add_actions,
    choose_files,
    column,
    dropped_runs,
    make_scroll_area,
    make_splitter,
)
from app.live import LatestOnlyWorker
from app.session import WindowState
from model import ParameterError

if TYPE_CHECKING:
    from model.response import PerceptionThreshold

LEFT_WIDTH = 424
"""Of the sliders with their numbers, units and a scroll bar."""

CARD_WIDTH = 250
PAINT_PAUSE_S = 0.02
"""Pause of the worker after the curve, so that it is painted before the motion is computed."""


class ExplorePage(QSplitter):
    """One page of the window.

    Args:
        fit: fits the model to the overlaid runs; without it there is no such button.
    """

    title = "Explore"
    runs_wanted = Signal()
    """The user wants to choose runs from the list of the page Runs."""
    _result_ready = Signal(object, object)

    def __init__(self, theme: WindowTheme, fit: FitRuns | None = None, parent: QWidget | None = None) -> None:
        super().__init__(Qt.Orientation.Horizontal, parent)
        self.session = ExploreSession()
        self.folder: Callable[[], Path] = Path
        """Returns the folder in which dialogs begin."""
        self.specimen: Callable[[], tuple[Path, str]] = lambda: (self.folder(), "")
        """Returns folder and name of the specimen whose calibration answers design questions."""
        self.result: ExploreResult | None = None
        self.shown_request: ExploreRequest | None = None
        """The request whose complete result is displayed."""
        self._requested: ExploreRequest | None = None
        self._sliders_stale = True
        self._study_worker = BackgroundWorker("explore study", self)
        self.overlaid = OverlaidRuns(fit, self)
        self._model_worker = LatestOnlyWorker(
            ResponseEngine().compute, self._result_ready.emit, "explore model", PAINT_PAUSE_S
        )
        self.sliders, self.plot, self.shape_plot = SliderPanel(), ExplorePlot(theme), ShapePlot(theme)
        self.toolbar = ExploreToolbar(PRESET_TITLES, fit is not None, self)
        self.card = ResultCard(theme, "explore.card", ("open", "report"), scrolls=True)
        """Result of the chosen overlaid run."""
        self.design = DesignPanel(self)
        self.status_line = StatusLine()
        self.addWidget(self._left_column())
        self.addWidget(self._right_column())
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

    # -- the interface of a page -----------------------------------------------------------------------------------------

    def set_state(self, view: WindowState) -> None:
        """Do nothing: the page does not depend on the bench."""

    def activate(self) -> None:
        """Take the keyboard focus."""
        self.setFocus()

    def tick(self) -> None:
        """Update the page; called at every tick while it is visible."""
        if self._requested is None:
            self._request_result()
        if self._sliders_stale:
            self._sliders_stale = False
            self.sliders.show_setting(self.setting)
            self.toolbar.show_setting(self.setting, self.session.history)
            self.design.ask()
        self.shape_plot.tick()

    def shutdown(self) -> None:
        """Stop background threads."""
        self._model_worker.close()
        self._study_worker.close()
        self.overlaid.shutdown()
        self.design.shutdown()

    def save_state(self, settings: QSettings) -> None:
        """Save settings."""
        settings.setValue("explore/setting", json.dumps(self.session.to_record()))

    def restore_state(self, settings: QSettings) -> None:
        """Restore saved settings."""
        try:
            self.session.restore_record(json.loads(str(settings.value("explore/setting", ""))))
        except (ValueError, KeyError, TypeError, AttributeError):
            return
        self._show_setting()

    # -- commands --------------------------------------------------------------------------------------------------------

    def set_value(self, name: str, value: float) -> None:
        """Set a slider, SI."""
        self._apply_change(lambda: self.session.set_value(name, value))

    def set_setting(self, setting: ExploreSetting) -> None:
        """Change the setting."""
        self._apply_change(lambda: self.session.set_setting(setting))

    def load_preset(self, name: str) -> None:
        """Start from a preset."""
        self._apply_change(lambda: self.session.load_preset(name))
        if self.session.kept_curves:
            self.toolbar.series[1].setChecked(True)  # the paper computes the fundamental
            self.toolbar.series[0].setChecked(False)
        self._request_result()

    def undo(self) -> None:
        self.session.history.undo()
        self._show_setting()

    def redo(self) -> None:
        self.session.history.redo()
        self._show_setting()

    def keep_curve(self) -> None:
        """Keep the current curve for comparison."""
        self.session.keep_curve()
        self._request_result()

    def clear_overlays(self) -> None:
        """Remove kept curves and measured runs."""
        self.session.kept_curves = ()
        self.overlaid.remove(*self.overlaid.runs)
        self._request_result()

    def fit_runs(self) -> None:
        """Fit the model to the overlaid runs; during a fit: cancel it."""
        self.overlaid.fit(self.setting)

    def copy(self, kind: str) -> None:
        """Copy the parameters as text for `--set`."""
        text = self.setting.as_json() if kind == "JSON" else self.setting.as_toml()
        QGuiApplication.clipboard().setText(text)
        self.status_line.show_message(
            f'copied as {kind}: tactor-bench model frequency-response --set @FILE, or --set "the text itself"'
        )

    def save_study(self, path: Path) -> None:
        """Save a study of the parameters that differ between the kept curves, else of the slider moved last."""
        self.status_line.show_message("computing the study …")
        setting, kept, variable = self.setting, self.session.kept_curves, self.session.study_variable
        frequencies: Sequence[float] = range(1, 251) if self.result is None else self.result.curve.frequency_hz.tolist()
        self._study_worker.submit(
            lambda: write_study(path, make_study(setting, kept, variable, frequencies), variable),
            lambda text: self.status_line.show_message(str(text)),
            self._on_error,
        )

    # -- internal --------------------------------------------------------------------------------------------------------

    def _on_fitted(self, result: ExploreFit) -> None:
        self.set_setting(result.setting)
        self.status_line.show_message(f"Fitted: {result.summary}", persistent=True)  # until the next change

    def _on_fitting(self, fitting: bool) -> None:
        self.toolbar.show_fitting(fitting)
        if fitting:
            self.status_line.show_message("fitting …", persistent=True)

    def _on_error(self, error: Exception) -> None:
        self.status_line.show_message(str(error), is_error=True)

    def _show_overlaid(self) -> None:
        self.plot.show_runs(self.overlaid.runs)
        self.toolbar.show_runs(self.overlaid.runs)
        if other := self.session.runs_with_other_drive(self.overlaid.runs):
            drives = ", ".join(f"{run.label} at {run.peak_to_peak_v:.3g} V" for run in other)
            self.status_line.show_message(
                f"{drives}; the curve is for {self.setting.peak_to_peak_v:.3g} V peak to peak", is_error=True
            )

    def _show_result_of(self, path: Path | None) -> None:
        """Show the result card of an overlaid run beside the plot; None hides it."""
        self._card_area.setVisible(path is not None)
        if path is not None:
            self.card.show_reading()
            self.overlaid.read_result(path, self._show_card)

    def _show_card(self, result: ResultSummary) -> None:
        if self.toolbar.chosen_run == Path(result.path):
            self.card.show_summary(result)
            self.card.show()

    def _apply_change(self, change: Callable[[], object]) -> None:
        """Change the setting; if the model rejects it, show why and keep the old one."""
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
        self._sliders_stale = True  # the curve first; the sliders follow in the next frame

    def _request_result(self) -> None:
        request = self.session.request
        if request != self._requested:
            self._requested = request
            self._model_worker.submit(request)

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

    def show_threshold(self, threshold: "PerceptionThreshold | None") -> None:
        """Take the threshold of the laboratory as that which is felt; None: there is none."""
        self.session.own_threshold = threshold
        self.toolbar.offer_laboratory(threshold is not None)
        self._request_result()

    def _choose_site(self, site: str) -> None:
        self.session.site = site
        self._request_result()

    def _update_series(self) -> None:
        *shown, log = (box.isChecked() for box in self.toolbar.series)
        self.plot.show_series(*shown)
        if log is not self.plot.log_axes[1]:
            self.plot.set_log_axes(self.plot.log_axes[0], log)

    def _choose_files(self) -> None:
        choose_files(self, "Runs to overlay", self.overlaid.add, "Runs (*.h5)", str(self.folder()), Mode.ExistingFiles)

    def _choose_study_file(self) -> None:
        choose_files(
            self, "Save as study", lambda paths: self.save_study(paths[0]), "Study (*.h5);;Sheet (*.csv)", str(self.folder() / "study.h5"),
            Mode.AnyFile,
        )  # fmt: skip

    def _left_column(self) -> QWidget:
        scroll = QScrollArea()
        scroll.setWidget(self.sliders)
        scroll.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        scroll.setWidgetResizable(True)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.viewport().setAutoFillBackground(False)
        self.sliders.setAutoFillBackground(False)
        left = QWidget()
        column(
            self.toolbar.start_row, (scroll, 1), self.status_line, self.toolbar.export_row,
            parent=left, margins=(0, 2, 4, 0), spacing=6,
        )  # fmt: skip
        left.setMinimumWidth(LEFT_WIDTH)
        return left

    def _right_column(self) -> QWidget:
        below, right = QWidget(), WrappingPane()
        self.plot.setMinimumSize(180, 150)
        self.shape_plot.setMinimumSize(180, 90)
        column(self.toolbar.motion_row, (self.shape_plot, 1), parent=below, margins=(0, 0, 0, 0), spacing=2)
        rows = make_splitter(
            "explore/rows", (self.plot, 0), (below, 0), orientation=Qt.Orientation.Vertical, sizes=[400, 210]
        )
        self._card_area = make_scroll_area(
            horizontalScrollBarPolicy=Qt.ScrollBarPolicy.ScrollBarAlwaysOff, minimumWidth=CARD_WIDTH
        )
        self._card_area.setAccessibleName("result of the chosen run")
        result = QWidget()
        column(self.card, STRETCH, parent=result, margins=(4, 0, 4, 0))
        result.setAutoFillBackground(False)
        self._card_area.setWidget(result)
        self._card_area.hide()
        columns = make_splitter("explore/result", (rows, 1), (self._card_area, 0), sizes=[600, CARD_WIDTH])
        column(
            self.toolbar.series_row, self.toolbar.overlay_row, self.toolbar.runs_row, self.design, (columns, 1),
            parent=right, margins=(0, 0, 0, 0), spacing=4,
        )  # fmt: skip
        return right

    def _connect_signals(self) -> None:
        bar = self.toolbar
        connections: tuple[tuple[SignalInstance, Callable[..., object]], ...] = (
            (self._result_ready, self._on_result),
            (self.overlaid.changed, self._show_overlaid),
            (self.overlaid.fitting, self._on_fitting),
            (self.overlaid.fitted, self._on_fitted),
            (self.overlaid.message, self.status_line.show_message),
            (self.sliders.value_changed, self.set_value),
            (self.sliders.reset_requested, lambda name: self.set_setting(self.setting.with_default(name))),
            (self.sliders.input_rejected, lambda text: self.status_line.show_message(text, is_error=True)),
            (self.plot.cursor_moved, self._on_cursor_moved),
            (self.plot.log_changed, bar.series[-1].setChecked),
            (bar.preset_chosen, self.load_preset),
            (bar.skin_chosen, lambda on: self.set_setting(replace(self.setting, on_skin=on))),
            (bar.frequency_chosen, self.plot.show_cursor),
            (bar.range_chosen, self._set_range),
            (bar.series_changed, self._update_series),
            (bar.site_chosen, self._choose_site),
            (bar.design_button.toggled, self.design.toggle),
            (bar.copy_chosen, self.copy),
            (bar.run_chosen, self._show_result_of),
            (bar.run_removed, self.overlaid.remove),
            (bar.undo_button.clicked, self.undo),
            (bar.redo_button.clicked, self.redo),
            (bar.keep_button.clicked, self.keep_curve),
            (bar.clear_button.clicked, self.clear_overlays),
            (bar.overlay_button.clicked, self.runs_wanted.emit),
            (bar.file_button.clicked, self._choose_files),
            (bar.fit_button.clicked, self.fit_runs),
            (bar.study_button.clicked, self._choose_study_file),
        )
        for signal, slot in connections:
            signal.connect(slot)
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
        self.overlaid.add(dropped_runs(event))
        event.acceptProposedAction()
