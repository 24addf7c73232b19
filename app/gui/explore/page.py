"""Explore page: sliders for every parameter of the model, its response curves, and the motion of the beam."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QSettings, Qt, Signal, SignalInstance
from PySide6.QtWidgets import QSplitter, QWidget

from app.common import ResultSummary
from app.explore import ExploreFit, ExploreRequest, ExploreResult
from app.gui.explore.design_panel import DesignPanel
from app.gui.explore.model import ExploreModel
from app.gui.explore.overlaid_runs import FitRuns, OverlaidRuns
from app.gui.explore.plot import ExplorePlot
from app.gui.explore.shape_plot import ShapePlot
from app.gui.explore.sliders import SliderPanel
from app.gui.explore.toolbar import ExploreToolbar
from app.gui.results import ResultCard
from app.gui.widgets import (
    RUN_SUFFIXES,
    STRETCH,
    FileDrops,
    Mode,
    StatusLine,
    WrappingPane,
    add_actions,
    choose_files,
    column,
    configure,
    make_pane,
    make_scroll_area,
    make_splitter,
)
from app.session import WindowState

if TYPE_CHECKING:
    from model.response import PerceptionThreshold

LEFT_WIDTH = 424
"""Of the sliders with their numbers, units and a scroll bar."""

CARD_WIDTH = 250


class ExplorePage(QSplitter):
    """One page of the window.

    Args:
        fit: fits the model to the overlaid runs; without it there is no such button.
    """

    title, moves = "Explore", True
    runs_requested = Signal()
    """The user wants to choose runs from the list of the page Runs."""

    def __init__(self, fit: FitRuns | None = None, parent: QWidget | None = None) -> None:
        super().__init__(Qt.Orientation.Horizontal, parent)
        self.model = ExploreModel(self)
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
        self.toolbar = ExploreToolbar(self, fit is not None)
        self.card = ResultCard("explore.card", ("open", "report"), scrolls=True)
        """Result of the chosen overlaid run."""
        self.design = DesignPanel(self)
        self.status_line = StatusLine()
        self.addWidget(self._left_column())
        self.addWidget(self._right_column())
        self.setStretchFactor(0, 0)
        self.setStretchFactor(1, 1)
        self.setSizes([430, 820])
        configure(self, "explore/columns", childrenCollapsible=False)
        self._connect_signals()
        FileDrops(self, {RUN_SUFFIXES: self.overlaid.add})
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
        self.shape_plot.tick()

    def shutdown(self) -> None:
        self.model.shutdown()
        self.overlaid.shutdown()
        self.design.shutdown()

    def save_state(self, settings: QSettings) -> None:
        self.model.save_state(settings)

    def restore_state(self, settings: QSettings) -> None:
        self.model.restore_state(settings)

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

    # -- internal --------------------------------------------------------------------------------------------------------

    def _on_fitted(self, result: ExploreFit) -> None:
        self.model.set_setting(result.setting)
        self.status_line.show_message(f"Fitted: {result.summary}", persistent=True)  # until the next change

    def _on_fitting(self, fitting: bool) -> None:
        self.toolbar.show_fitting(fitting)
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
        self._card_area.setVisible(path is not None)
        if path is not None:
            self.card.show_reading()
            self.overlaid.read_result(path, self._show_card)

    def _show_card(self, result: ResultSummary) -> None:
        if self.toolbar.chosen_run == Path(result.path):
            self.card.show_summary(result)
            self.card.show()

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
        choose_files(
            self, "Save as study", lambda paths: self.model.save_study(paths[0], self.result), "Study (*.h5);;Sheet (*.csv)", str(self.folder() / "study.h5"),
            Mode.AnyFile,
        )  # fmt: skip

    def _left_column(self) -> QWidget:
        scroll = make_scroll_area(
            focusPolicy=Qt.FocusPolicy.NoFocus, horizontalScrollBarPolicy=Qt.ScrollBarPolicy.ScrollBarAlwaysOff
        )
        scroll.setWidget(self.sliders)
        self.sliders.setAutoFillBackground(False)
        left = make_pane(
            self.toolbar.start_row, (scroll, 1), self.status_line, self.toolbar.export_row,
            margins=(0, 2, 4, 0), spacing=6,
        )  # fmt: skip
        left.setMinimumWidth(LEFT_WIDTH)
        return left

    def _right_column(self) -> QWidget:
        right = WrappingPane()
        self.plot.setMinimumSize(180, 150)
        self.shape_plot.setMinimumSize(180, 90)
        below = make_pane(self.toolbar.motion_row, (self.shape_plot, 1), spacing=2)
        rows = make_splitter(
            "explore/rows", (self.plot, 0), (below, 0), orientation=Qt.Orientation.Vertical, sizes=[400, 210]
        )
        self._card_area = make_scroll_area(
            self.card,
            STRETCH,
            margins=(4, 0, 4, 0),
            horizontalScrollBarPolicy=Qt.ScrollBarPolicy.ScrollBarAlwaysOff,
            minimumWidth=CARD_WIDTH,
            accessibleName="result of the chosen run",
        )
        self._card_area.hide()
        columns = make_splitter("explore/result", (rows, 1), (self._card_area, 0), sizes=[600, CARD_WIDTH])
        column(
            self.toolbar.series_row, self.toolbar.overlay_row, self.toolbar.runs_row, self.design, (columns, 1),
            parent=right, spacing=4,
        )  # fmt: skip
        return right

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
