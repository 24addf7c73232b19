"""Explore page: sliders for every parameter of the model, its response curves, and the motion of the beam."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal, SignalInstance
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QWidget

from app.common import ResultSummary
from app.explore import ExploreFit, ExploreRequest, ExploreResult
from app.gui.explore.answer import AnswerColumn
from app.gui.explore.design_panel import DesignPanel
from app.gui.explore.model import ExploreModel
from app.gui.explore.overlaid_runs import FitRuns, OverlaidRuns
from app.gui.explore.plot import ExplorePlot
from app.gui.explore.shape_plot import ShapePlot
from app.gui.explore.sliders import SliderPanel
from app.gui.explore.toolbar import ANSWER, MOTION, PARAMETERS, ExploreToolbar
from app.gui.face import class_of, px, set_length
from app.gui.results import ResultCard
from app.gui.widgets import (
    RUN_SUFFIXES,
    UPRIGHT,
    FileDrops,
    Mode,
    StatusLine,
    WrappingPane,
    add_actions,
    choose_file,
    choose_files,
    column,
    make_label,
    make_panel,
    make_scroll_area,
    make_splitter,
    row,
)
from app.session import WindowState

if TYPE_CHECKING:
    from model.response import PerceptionThreshold

LEFT_WIDTH, ANSWER_WIDTH = 426, 300
"""Of the sliders with their numbers, units and a scroll bar, and of the answer."""
LEAST_WIDTH, LEAST_HEIGHT = 1140, 570
"""Of a page with sliders, response, motion and answer; a smaller one has the response and one of the others."""


class ExplorePage(QWidget):
    """One page of the window.

    Args:
        fit: fits the model to the overlaid runs.
    """

    title = "Explore"
    runs_requested = Signal()
    """The user wants to choose runs from the list of the page Runs."""

    def __init__(self, fit: FitRuns) -> None:
        super().__init__()
        self.model = ExploreModel(self)
        self.save_state, self.restore_state = self.model.save_state, self.model.restore_state
        self.folder: Callable[[], Path] = Path
        """Returns the folder in which dialogs begin."""
        self.specimen: Callable[[], tuple[Path, str]] = lambda: (self.folder(), "")
        """Returns folder and name of the specimen whose calibration answers design questions."""
        self.result: ExploreResult | None = None
        self.shown_request: ExploreRequest | None = None
        """The request whose complete result is displayed."""
        self._sliders_stale = True
        self.overlaid = OverlaidRuns(fit, self)
        self.sliders, self.plot, self.shape_plot = SliderPanel(), ExplorePlot(), ShapePlot()
        self.toolbar = ExploreToolbar(self)
        self.card = ResultCard("explore.card", ("open", "report"))
        """Result of the chosen overlaid run."""
        self.design = DesignPanel(self)
        self.status_line = StatusLine()
        self.left = self._left_column()
        self._make_right_columns()
        self._columns = row(self.left, (self.rows, 1), self.answer_area, parent=self, margins=(4, 4, 4, 4), spacing=12)
        self._connect_signals()
        FileDrops(self, RUN_SUFFIXES, self.overlaid.add)
        self.setFocusPolicy(Qt.FocusPolicy.ClickFocus)
        self._update_series()
        self._show_setting()

    # -- the interface of a page -----------------------------------------------------------------------------------------

    def set_state(self, view: WindowState) -> None:
        """Do nothing: the page does not depend on the bench."""

    def activate(self) -> None:
        self.setFocus()

    def tick(self) -> None:
        if self.model.requested is None:
            self.model.compute()
        if self._sliders_stale:
            self._sliders_stale = False
            self.sliders.show_setting(self.model.setting)
            self.toolbar.show_setting(self.model.setting, self.model.session.history)
            self.design.ask()

    # -- commands --------------------------------------------------------------------------------------------------------

    def load_preset(self, name: str) -> None:
        self.model.load_preset(name)
        if self.model.session.kept_curves:
            self.toolbar.series[1].setChecked(True)  # the paper computes the fundamental
            self.toolbar.series[0].setChecked(False)

    def clear_overlays(self) -> None:
        """Remove kept curves and measured runs."""
        self.model.session.kept_curves = ()
        self.overlaid.remove(*self.overlaid.runs)
        self.model.compute()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.answer_area.setFixedWidth(px(max(ANSWER_WIDTH, class_of(self).result - 32)))
        is_small = self.width() < px(LEAST_WIDTH) or self.height() < px(LEAST_HEIGHT)
        self.rows.setOrientation(Qt.Orientation.Horizontal if is_small else Qt.Orientation.Vertical)
        if is_small is self.toolbar.side.isHidden():
            self._columns.insertWidget(1 if is_small else 2, self.answer_area)
            self.toolbar.side.setVisible(is_small)
            self._show_side()

    def _show_side(self) -> None:
        """Show parameters, answer and motion; a small window has place for one of them beside the response."""
        for part, choice in ((self.left, PARAMETERS), (self.answer_area, ANSWER), (self.motion, MOTION)):
            part.setVisible(self.toolbar.side.isHidden() or choice == self.toolbar.side.selected)

    # -- internal --------------------------------------------------------------------------------------------------------

    def _on_fitted(self, result: ExploreFit) -> None:
        self.model.set_setting(result.setting)
        self.status_line.show_message(f"Fitted: {result.summary}", persistent=True)  # until the next change

    def _on_fitting(self, fitting: bool) -> None:
        self.toolbar.fit_button.setText("Cancel the fit" if fitting else "Fit to the runs")
        if fitting:
            self.status_line.show_message("fitting …", persistent=True)

    def _show_overlaid(self) -> None:
        self.plot.show_runs(self.overlaid.runs)
        self.toolbar.show_runs(self.overlaid.runs)
        if other := self.model.session.runs_with_other_drive(self.overlaid.runs):
            drives = ", ".join(f"{run.label} at {run.peak_to_peak_v:.3g} V" for run in other)
            self.status_line.show_message(
                f"{drives}; the curve is for {self.model.setting.peak_to_peak_v:.3g} V peak to peak", is_error=True
            )

    def show_result_of(self, path: Path | None) -> None:
        """Show the result card of an overlaid run beside the plot; None hides it."""
        self.card.hide()
        if path is not None:
            self.card.show_reading()
            self.overlaid.read_result(path, self._show_card)

    def _show_card(self, result: ResultSummary) -> None:
        if self.toolbar.chosen_run == Path(result.path):
            self.card.show_summary(result)

    def _show_setting(self) -> None:
        if self.isVisible():
            self.model.compute()
        else:
            self.model.requested = None
        self._sliders_stale = True  # the curve first; the sliders follow in the next frame

    def _on_result(self, request: ExploreRequest, result: ExploreResult | Exception) -> None:
        if isinstance(result, Exception):
            self.status_line.show_message(
                f"the model cannot be computed so: {result}; move a slider back", is_error=True
            )
            return
        self.result = result
        self.plot.show_result(result, request.kept_curves)
        self.answer.show_result(request, result)
        if result.motion is not None:
            self.shape_plot.show_motion(result.motion, request.cursor_hz)
            self.shown_request = request

    def _on_cursor_moved(self, hz: float) -> None:
        self.model.session.cursor_hz = float(f"{hz:.4g}")
        self.toolbar.show_frequency(self.model.session.cursor_hz)
        self.model.compute()

    def set_range(self, max_hz: float) -> None:
        """Show frequencies up to a limit."""
        self.model.session.max_hz = max_hz
        self.plot.show_range(max_hz)
        self.model.compute()

    def show_threshold(self, threshold: "PerceptionThreshold | None") -> None:
        """Use the laboratory's threshold of perception; None: no threshold."""
        self.model.session.own_threshold = threshold
        self.toolbar.offer_laboratory(threshold is not None)
        self.model.compute()

    def _update_series(self) -> None:
        *shown, log = (box.isChecked() for box in self.toolbar.series)
        self.plot.show_series(*shown)
        if log is not self.plot.log_axes[1]:
            self.plot.set_log_axes(self.plot.log_axes[0], log)

    def choose_files(self) -> None:
        """Ask for run files to overlay."""
        choose_files(self, "Runs to overlay", self.overlaid.add, "Runs (*.h5)", str(self.folder()), Mode.ExistingFiles)

    def choose_study_file(self) -> None:
        """Ask for a file, and save the study."""
        choose_file(
            self, "Save as study", lambda path: self.model.save_study(path, self.result), "Study (*.h5);;Sheet (*.csv)", str(self.folder() / "study.h5"),
            Mode.AnyFile,
        )  # fmt: skip

    def _left_column(self) -> QWidget:
        scroll = make_scroll_area(**UPRIGHT)
        scroll.setWidget(self.sliders)
        self.sliders.setAutoFillBackground(False)
        bar = self.toolbar
        left = make_panel(bar.start_row, (scroll, 1), self.status_line, bar.export_row, margins=(12, 12, 4, 8))
        set_length(left, width=LEFT_WIDTH)
        return left

    def _make_right_columns(self) -> None:
        bar, choices = self.toolbar, WrappingPane()
        column(bar.series_row, parent=choices, margins=(12, 8, 12, 0))
        self.plot.setMinimumSize(180, 150)
        self.shape_plot.setMinimumHeight(90)
        set_length(self.shape_plot, least_width=300)
        self.shape_plot.head_layout.insertWidget(1, bar.frequency)
        response = make_panel(choices, (self.plot, 1), margins=(1, 1, 1, 1), spacing=0)
        self.motion = make_panel(self.shape_plot, margins=(1, 1, 1, 1))
        self.rows = make_splitter(
            "explore/rows", (response, 0), (self.motion, 0), orientation=Qt.Orientation.Vertical, sizes=[420, 210]
        )
        runs = WrappingPane()
        column(bar.runs_row, bar.overlay_row, self.design, parent=runs, spacing=8)
        self.answer = AnswerColumn(bar.site_box, make_panel(make_label("Runs and design", "heading"), runs), self.card)
        self.answer_area = make_scroll_area(
            self.answer,
            horizontalScrollBarPolicy=Qt.ScrollBarPolicy.ScrollBarAlwaysOff,
            accessibleName="answer of the model",
        )

    def _connect_signals(self) -> None:
        bar = self.toolbar
        connections: tuple[tuple[SignalInstance, Callable[..., object]], ...] = (
            (self.model.computed, self._on_result),
            (self.model.changed, self._show_setting),
            (self.model.message, self.status_line.show_message),
            (self.overlaid.changed, self._show_overlaid),
            (self.overlaid.fitting, self._on_fitting),
            (self.overlaid.fitted, self._on_fitted),
            (self.overlaid.message, self.status_line.show_message),
            (self.sliders.value_changed, self.model.set_value),
            (self.sliders.reset_requested, lambda name: self.model.set_setting(self.model.setting.with_default(name))),
            (self.sliders.input_rejected, lambda text: self.status_line.show_message(text, is_error=True)),
            (self.plot.cursor_moved, self._on_cursor_moved),
            (self.plot.log_changed, bar.series[-1].setChecked),
            *((box.toggled, self._update_series) for box in bar.series),
            (bar.design_button.toggled, self.design.toggle),
            (bar.side.chosen, lambda _: self._show_side()),
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
