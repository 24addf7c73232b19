"""Runs page: search, open, compare, annotate, export and import the runs of a folder."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QStackedWidget, QWidget

from app.archive import Format, LoadedRun, RunState, RunSummary, TraceWindow, load_run, load_trace_window
from app.comparison import MAX_RUNS, ComparedRun, Comparison, ComparisonView, model_in, model_request
from app.config import AmplifierTable
from app.gui.runs.compare import ComparisonWorkspace
from app.gui.runs.list_pane import RunListPane
from app.gui.runs.transfers import RunTransfers
from app.gui.runs.viewer import RunViewer
from app.gui.widgets import (
    RUN_SUFFIXES,
    TABLE_SUFFIXES,
    BackgroundWorker,
    FileDrops,
    Mode,
    add_actions,
    at_end,
    choose_file,
    choose_files,
    tooltip,
)
from app.live import Overlay, curve_request_of
from app.session import WindowState
from protocols.runfile import RunReadError

FELT = "peak to peak over frequency"
"""Quantity that is plotted of a single run; others have the plot of their protocol."""


class RunsPage(QStackedWidget):
    """The list of runs, or in its place an opened run or a comparison.

    Args:
        folder: function that returns the folder of the runs.
        specimen: function that returns the specimen of imported tables.
        amplifier: amplifier of imported tables.
    """

    title = "Runs"
    explore_requested = Signal(object)
    """Paths of runs to overlay on the model curve."""
    continue_requested = Signal(object)
    """Path of a stopped run to continue."""

    def __init__(
        self,
        folder: Callable[[], Path],
        specimen: Callable[[], str],
        amplifier: AmplifierTable,
        overlay: Overlay,
        index: Path | None = None,
    ) -> None:
        super().__init__()
        self._overlay = Overlay(overlay.amplifier, overlay.cache)
        at_end(self, self._overlay.close)
        self._worker = BackgroundWorker("run files", self)
        self._folder = folder
        self.list, self.viewer = RunListPane(folder, index), RunViewer()
        self.details = self.list.details
        self.transfers = RunTransfers(self.details.progress_row, folder, specimen, amplifier, self)
        self.workspace = ComparisonWorkspace()
        self.addWidget(self.list)
        self.addWidget(self.viewer)
        self.addWidget(self.workspace)
        self._state: WindowState | None = None
        self._connect_signals()

    # -- interface to the main window ----------------------------------------------------------------------------------

    def set_state(self, view: WindowState) -> None:
        """Show a window state; rescan the folder after any run ends."""
        self.list.folder_model.set_busy(view.busy)
        self._state = view
        self._update_continue()

    def set_active_file(self, path: Path | None) -> None:
        """Set the run file that this program is writing."""
        self.list.folder_model.active_file = path

    def activate(self) -> None:
        """Take the keyboard focus."""
        first: dict[QWidget | None, QWidget]
        first = {self.viewer: self.viewer.back_button, self.workspace: self.workspace.layers}
        first.get(self.currentWidget(), self.list.table).setFocus()

    def tick(self) -> None:
        """Refresh values that change between events; called at every tick while the page is visible."""
        self.list.folder_model.refresh_if_changed()
        if self.currentWidget() is self.list or (curve := self._overlay.result()) is None:
            return
        if self.currentWidget() is self.viewer:
            self.viewer.plots.show_model_curve(curve)
        elif (shown := self.workspace.comparison) is not None and shown.view.model and not shown.model:
            self.workspace.show_model(model_in(curve, curve.request.amplitude_v))

    # -- commands -------------------------------------------------------------------------------------------

    def open_selected(self) -> None:
        """Open the selected run, or compare several."""
        if len(paths := self.list.readable_paths) > 1:
            self.details.show_message("opening …")
            self.workspace.open_runs(paths)
        elif paths:
            self.open_run(paths[0])
        elif chosen := self.list.selected:
            self.details.show_message(chosen[0].record.reason, is_error=True)

    def open_run(self, path: Path) -> None:
        """Open a run in the viewer."""
        self.details.show_message("opening …")
        self._worker.submit(lambda: load_run(path), self._on_run_loaded, self._on_error)

    def go_back(self) -> bool:
        """Return from an opened run or comparison to the list, or clear the filter; return whether either was done."""
        if self.currentWidget() is self.list and self.list.filter_bar.clear():
            return True
        opened = self.currentWidget() is not self.list
        self.setCurrentIndex(0)
        self.list.table.setFocus()
        return opened

    def export_selected(self, folder: Path, kind: Format, selected: Sequence[RunSummary] | None = None) -> None:
        """Export the selected or given runs as files for other programs."""
        entries = self.list.selected if selected is None else selected
        self.transfers.export_runs([self.list.path_of(e) for e in entries if e.readable], folder, kind)

    def explore_selected(self) -> None:
        """Overlay the selected or opened runs on the model curve."""
        if self.currentWidget() is self.viewer and self.viewer.run is not None:
            self.explore_requested.emit([self.viewer.run.path])
        elif paths := self.list.readable_paths:
            self.explore_requested.emit(paths)

    def continue_selected(self) -> None:
        """Continue the selected run, which was stopped, with the points that are missing."""
        if not (why := self._continue_refusal()):
            self.continue_requested.emit(self.list.path_of(self.list.selected[0]))
        else:
            self.details.show_message(f"Cannot continue: {why}.", is_error=True)

    def move_selected_to_trash(self) -> None:
        """Move the selected runs to the trash, except a run being written."""
        if self.currentWidget() is not self.list:
            return
        if paths := [self.list.path_of(e) for e in self.list.selected if e.state != RunState.RUNNING]:
            self.transfers.move_to_trash(paths)
        else:
            self.details.show_message("A run that is being written cannot be moved to the trash.", is_error=True)

    def import_files(self, paths: list[Path]) -> None:
        """Copy run files into the folder, and import tables."""
        runs = [path for path in paths if path.suffix.lower() in RUN_SUFFIXES]
        if runs:
            self.transfers.copy_in(runs)
        if tables := [path for path in paths if path not in runs]:
            self.transfers.import_tables(tables)

    # -- inside --------------------------------------------------------------------------------------------------------

    def _on_selection_changed(self) -> None:
        self._update_continue()
        chosen, paths = self.list.selected, self.list.readable_paths[:MAX_RUNS]

        def read() -> tuple[Comparison | None, LoadedRun | None]:
            runs = []
            for path in paths:
                with suppress(RunReadError):
                    runs.append(ComparedRun.read(path))
            runs = [run for run in runs if run.curves and (len(paths) > 1 or run.curves[0].quantity == FELT)]
            one = load_run(paths[0], with_traces=False) if len(paths) == 1 else None
            return Comparison(runs, ComparisonView()) if runs else None, one

        def show(loaded: tuple[Comparison | None, LoadedRun | None]) -> None:
            self.details.show_runs(loaded[0], len(chosen), "" if paths else "No curve to compare.")
            if loaded[1] is not None:
                self.details.show_result(loaded[1])

        def show_error(error: Exception) -> None:
            self.details.show_runs(None, len(chosen), str(error))

        self._worker.submit(read, show, show_error, latest_only="responses")

    def _continue_refusal(self) -> str:
        """Return why the selected run cannot be continued now; empty if it can."""
        chosen = self.list.selected
        if len(chosen) != 1 or not chosen[0].resumable:
            return "select one run that was stopped and has points"
        if self._state is None or not self._state.can_run:
            return (self._state.blocked_reason if self._state is not None else "") or "there is no bench"
        if bool(chosen[0].simulated) is not self._state.simulated:
            kinds = ("real", "simulated")
            return f"the run is {kinds[bool(chosen[0].simulated)]}, the open bench is {kinds[self._state.simulated]}"
        return ""

    def _update_continue(self) -> None:
        button = self.details.continue_button
        chosen = self.list.selected
        button.setVisible(len(chosen) == 1 and chosen[0].resumable)
        why = self._continue_refusal()
        button.setEnabled(not why)
        button.setToolTip(f"Cannot continue: {why}" if why else tooltip("runs.continue"))

    def _choose_imports(self) -> None:
        kinds = " ".join(f"*{suffix}" for suffix in sorted(RUN_SUFFIXES | TABLE_SUFFIXES))
        choose_files(
            self, "Import run files and tables", self.import_files, f"Runs and tables ({kinds})", str(self._folder()),
            Mode.ExistingFiles,
        )  # fmt: skip

    def _on_comparison_opened(self) -> None:
        self.details.show_message("")
        self.setCurrentWidget(self.workspace)
        self.workspace.layers.setFocus()

    def _on_run_loaded(self, run: LoadedRun) -> None:
        self.details.show_message("")
        self.viewer.show_run(run)
        self._overlay.submit(curve_request_of(run))
        self.setCurrentWidget(self.viewer)
        self.viewer.back_button.setFocus()

    def _load_trace_window(self, from_s: float, to_s: float) -> None:
        """Read the visible range from the file, and show it if it is still visible then."""
        run, traces = self.viewer.run, self.viewer.trace_plot
        if run is None:
            return

        def show(part: TraceWindow) -> None:
            if self.viewer.run is run and traces.visible_range == (from_s, to_s):
                traces.show_window(part)

        self._worker.submit(lambda: load_trace_window(run.path, from_s, to_s), show, self._on_error)

    def _on_error(self, error: Exception) -> None:
        self.details.show_message(str(error), is_error=True)

    def _choose_export_folder(self, kind: Format) -> None:
        if chosen := self.list.selected:
            choose_file(
                self, "Folder for the exported files", lambda path: self.export_selected(path, kind, chosen),
                start=str(self._folder()), mode=Mode.Directory,
            )  # fmt: skip

    def _focus_search(self) -> None:
        if self.currentWidget() is self.list:
            self.list.filter_bar.search_edit.setFocus()
            self.list.filter_bar.search_edit.selectAll()

    def _connect_signals(self) -> None:
        self.list.folder_model.failed.connect(self._on_error)
        self.list.selection_changed.connect(self._on_selection_changed)
        self.list.table.open_requested.connect(self.open_selected)
        self.list.table.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self.list.table.customContextMenuRequested.connect(
            lambda at: self.list.make_menu(self).popup(self.list.table.viewport().mapToGlobal(at))
        )
        FileDrops(self, RUN_SUFFIXES | TABLE_SUFFIXES, self.import_files, own=False)
        self.details.continue_button.clicked.connect(self.continue_selected)
        self.transfers.finished.connect(self.list.folder_model.rescan)
        self.transfers.message.connect(self.details.show_message)
        self.details.open_button.clicked.connect(self.open_selected)
        self.details.explore_button.clicked.connect(self.explore_selected)
        self.details.export_pressed.connect(self._choose_export_folder)
        self.viewer.trace_plot.range_viewed.connect(self._load_trace_window)
        self.viewer.back_button.clicked.connect(self.go_back)
        self.workspace.back_button.clicked.connect(self.go_back)
        self.workspace.opened.connect(self._on_comparison_opened)
        self.workspace.failed.connect(self._on_error)
        self.workspace.model_asked.connect(lambda comparison: self._overlay.submit(model_request(comparison)))
        self.viewer.explore_button.clicked.connect(self.explore_selected)
        add_actions(
            self,
            {
                "runs.search": self._focus_search,
                "runs.explore": self.explore_selected,
                "runs.export": lambda: self._choose_export_folder("csv"),
                "runs.notes": self.details.tags_edit.setFocus,
                "runs.copy-paths": self.list.copy_paths,
                "runs.continue": self.continue_selected,
                "runs.show-folder": self.list.show_folder,
                "runs.import": self._choose_imports,
                "runs.trash": self.move_selected_to_trash,
                "runs.undo": self.transfers.restore_trashed,
            },
        )
