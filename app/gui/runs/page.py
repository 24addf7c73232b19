"""Runs page: search, open, compare, annotate, export and import the runs of a folder."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, QUrl, Signal
from PySide6.QtGui import QAction, QDesktopServices, QDragEnterEvent, QDropEvent, QGuiApplication
from PySide6.QtWidgets import QStackedWidget, QWidget

from app.archive import (
    Format,
    LoadedRun,
    MeasuredResponse,
    RunState,
    RunSummary,
    TraceWindow,
    TrashedRun,
    load_run,
    load_trace_window,
    measured_responses,
    move_to_trash,
    restore_from_trash,
)
from app.common import pluralize
from app.config import AmplifierTable
from app.gui.runs.details import RunDetailsPane
from app.gui.runs.filter_bar import RunFilterBar
from app.gui.runs.folder_model import RunFolderModel
from app.gui.runs.table import RunTableModel, RunTableView
from app.gui.runs.transfers import RunTransfers
from app.gui.runs.viewer import RunViewer
from app.gui.widgets import (
    TABLE_SUFFIXES,
    BackgroundWorker,
    Menu,
    Mode,
    Toast,
    WindowTheme,
    add_actions,
    choose_files,
    column,
    dropped_runs,
    dropped_tables,
    make_splitter,
    tooltip,
)
from app.live import CurveRequest, Overlay, elongations_of
from app.session import WindowState

MAX_COMPARED = 24


class RunsPage(QStackedWidget):
    """The list of runs, or in its place an opened run.

    Args:
        folder: returns the folder of the runs.
        specimen: returns the specimen of imported tables.
        amplifier: through which the specimen of imported tables was driven.
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
        theme: WindowTheme,
        index: Path | None = None,
    ) -> None:
        super().__init__()
        self._overlay = Overlay(overlay.amplifier, overlay.cache)
        self._worker = BackgroundWorker("run files", self)
        self._folder = folder
        self.folder_model = RunFolderModel(folder, index, self)
        self.model = RunTableModel(theme)
        self.table = RunTableView(self.model)
        self.filter_bar, self.details, self.viewer = RunFilterBar(), RunDetailsPane(theme), RunViewer(theme)
        self.transfers = RunTransfers(self.details.progress_row, folder, specimen, amplifier, self)
        catalogue_pane = QWidget()
        columns = make_splitter("runs/columns", (self.table, 3), (self.details, 1), sizes=[860, 390])
        self.details.setMinimumWidth(340)  # now: at first the details have the width that their buttons need
        column(self.filter_bar, (columns, 1), parent=catalogue_pane, margins=(0, 0, 0, 0), spacing=6)
        self.addWidget(catalogue_pane)
        self.addWidget(self.viewer)
        self.setAcceptDrops(True)
        self.toast = Toast(self)
        self._trashed: list[list[TrashedRun]] = []
        """The deletions that can be undone, the last one at the end."""
        self._state: WindowState | None = None
        self._connect_signals()

    # -- interface to the main window ----------------------------------------------------------------------------------

    def set_state(self, view: WindowState) -> None:
        """Show a window state; rescan the folder after any run ends."""
        self.folder_model.set_busy(view.busy)
        self._state = view
        self._update_continue()

    def set_active_file(self, path: Path | None) -> None:
        """Set the run file that this program is writing."""
        self.folder_model.set_active_file(path)

    def activate(self) -> None:
        """Take the keyboard focus."""
        (self.viewer.back_button if self.currentWidget() is self.viewer else self.table).setFocus()

    def tick(self) -> None:
        """Refresh what changes between events; called at every tick while the page is visible."""
        self.folder_model.refresh_if_changed()
        if self.currentWidget() is self.viewer and (curve := self._overlay.result()) is not None:
            self.viewer.show_model_curve(curve)

    def shutdown(self) -> None:
        """Stop background threads."""
        self.transfers.shutdown()
        self.folder_model.shutdown()
        self._worker.close()
        self._overlay.close()

    # -- commands -------------------------------------------------------------------------------------------

    def open_selected(self) -> None:
        """Open the selected run."""
        chosen = self.selected
        if chosen and chosen[0].readable:
            self.open_run(self._path_of(chosen[0]))
        elif chosen:
            self.details.show_message(chosen[0].reason, is_error=True)

    def open_run(self, path: Path) -> None:
        """Open a run in the viewer."""
        self.details.show_message("opening …")
        self._worker.submit(lambda: load_run(path), self._on_run_loaded, self._on_error)

    def go_back(self) -> bool:
        """Return from an opened run to the list, or clear the filter; return whether either was done."""
        if self.currentWidget() is not self.viewer and self.filter_bar.clear():
            return True
        opened = self.currentWidget() is self.viewer
        self.setCurrentIndex(0)
        self.table.setFocus()
        return opened

    def annotate(self, tags: str, note: str) -> None:
        """Write tags and a note for the selected runs; with several, tags are added and notes stay."""
        self.folder_model.annotate([(self._path_of(e), e.tags, e.note) for e in self.selected], tags, note)

    def export_selected(self, folder: Path, kind: Format, selected: Sequence[RunSummary] | None = None) -> None:
        """Export the selected or given runs as files for other programs."""
        entries = self.selected if selected is None else selected
        self.transfers.export_runs([self._path_of(e) for e in entries if e.readable], folder, kind)

    def explore_selected(self) -> None:
        """Overlay the selected or opened runs on the model curve."""
        if self.currentWidget() is self.viewer and self.viewer.run is not None:
            self.explore_requested.emit([self.viewer.run.path])
        elif paths := [self._path_of(e) for e in self.selected if e.readable]:
            self.explore_requested.emit(paths)

    def continue_selected(self) -> None:
        """Continue the selected run, which was stopped, with the points that are missing."""
        if not (why := self._continue_refusal()):
            self.continue_requested.emit(self._path_of(self.selected[0]))
        else:
            self.details.show_message(f"Cannot continue: {why}.", is_error=True)

    def move_selected_to_trash(self) -> None:
        """Move the selected runs to the trash; the one that is being written stays."""
        if self.currentWidget() is self.viewer:
            return
        paths = [self._path_of(e) for e in self.selected if e.state != RunState.RUNNING]
        if not paths:
            self.details.show_message("A run that is being written cannot be moved to the trash.", is_error=True)
            return
        words = pluralize(len(paths), "run")

        def done(moved: list[TrashedRun]) -> None:
            self._trashed.append(moved)
            self.toast.show_message(f"{words} moved to the trash ({moved[0].trashed.parent})", self.restore_trashed)
            self.folder_model.rescan()

        self._worker.submit(lambda: move_to_trash(paths), done, self._on_trash_error)

    def restore_trashed(self) -> None:
        """Take the runs of the last deletion out of the trash."""
        if not self._trashed:
            return
        moved = self._trashed.pop()

        def done(count: int) -> None:
            self.toast.show_message(f"{pluralize(count, 'run')} restored")
            self.folder_model.rescan()

        self._worker.submit(lambda: restore_from_trash(moved), done, self._on_trash_error)

    def import_files(self, paths: list[Path]) -> None:
        """Copy run files into the folder, and import tables."""
        if runs := [path for path in paths if path.suffix == ".h5"]:
            self.transfers.copy_in(runs)
        if tables := [path for path in paths if path.suffix != ".h5"]:
            self.transfers.import_tables(tables)

    def make_menu(self) -> Menu:
        """Return the context menu of the selected runs."""
        menu = Menu(self.table)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        menu.addAction("Open\tEnter", self.open_selected)
        one = self.selected[0] if len(self.selected) == 1 else None
        if one is not None and one.readable and one.specimen:
            menu.addAction(
                f"Report of {one.specimen} …", partial(self.details.card.requested.emit, "report", self._path_of(one))
            )
        names = ("continue", "explore", "", "notes", "export", "copy-paths", "show-folder", "", "trash", "import")
        for name in names:
            if not name:
                menu.addSeparator()
            elif (action := self.findChild(QAction, f"runs.{name}")) is not None:
                menu.addAction(action)
        return menu

    @property
    def selected(self) -> list[RunSummary]:
        """The selected runs in the list's order."""
        return self.table.selected

    def select_paths(self, paths: Sequence[str]) -> None:
        """Select runs by their paths."""
        self.table.select_paths(paths)

    # -- inside --------------------------------------------------------------------------------------------------------

    def _path_of(self, summary: RunSummary) -> Path:
        return self.model.folder / summary.path

    def _on_listed(self) -> None:
        self.filter_bar.set_choices(self.folder_model.summaries)
        self._update_table()

    def _update_table(self) -> None:
        chosen = [entry.path for entry in self.selected]
        found = self.filter_bar.selected_filter.apply(self.folder_model.summaries)
        self.model.set_summaries(self.folder_model.path, found)
        self.select_paths(chosen)
        if not self.selected and found:
            self.table.setCurrentIndex(self.model.index(0, 0))
        self.filter_bar.show_count(len(found), len(self.folder_model.summaries))
        self._on_selection_changed()

    def _on_selection_changed(self) -> None:
        chosen = self.selected
        self.details.show_selection(chosen)
        self._update_continue()
        paths = [self._path_of(e) for e in chosen if e.readable][:MAX_COMPARED]

        def read() -> tuple[Sequence[MeasuredResponse], LoadedRun | None]:
            runs = measured_responses(paths)
            return runs, load_run(paths[0], with_traces=False) if len(paths) == 1 else None

        def show(found: tuple[Sequence[MeasuredResponse], LoadedRun | None]) -> None:
            self.details.show_runs(found[0], len(chosen))
            if found[1] is not None:
                self.details.show_result(found[1])

        self._worker.submit(read, show, self._on_error, latest_only="responses")

    def _continue_refusal(self) -> str:
        """Return why the selected run cannot be continued now; empty if it can."""
        chosen = self.selected
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
        chosen = self.selected
        button.setVisible(len(chosen) == 1 and chosen[0].resumable)
        why = self._continue_refusal()
        button.setEnabled(not why)
        button.setToolTip(f"Cannot continue: {why}" if why else tooltip("runs.continue"))

    def _on_trash_error(self, error: Exception) -> None:
        self._on_error(error)
        self.folder_model.rescan()

    def _show_folder(self) -> None:
        if chosen := self.selected:
            QDesktopServices.openUrl(QUrl.fromLocalFile(str(self._path_of(chosen[0]).resolve().parent)))

    def _choose_imports(self) -> None:
        kinds = " ".join(f"*{suffix}" for suffix in sorted({".h5", *TABLE_SUFFIXES}))
        choose_files(
            self, "Import run files and tables", self.import_files, f"Runs and tables ({kinds})", str(self._folder()),
            Mode.ExistingFiles,
        )  # fmt: skip

    def _on_run_loaded(self, run: LoadedRun) -> None:
        self.details.show_message("")
        self.viewer.show_run(run)
        amplitude_v, elongations = float(run.parameters.get("peak_to_peak_v", 5.0)) / 2, elongations_of(run.points)
        self._overlay.submit(CurveRequest(1.05 * run.max_hz, amplitude_v, run.path.parent, run.specimen, elongations))
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
        if chosen := self.selected:
            choose_files(
                self, "Folder for the exported files", lambda paths: self.export_selected(paths[0], kind, chosen),
                start=str(self._folder()), mode=Mode.Directory,
            )  # fmt: skip

    def _copy_paths(self) -> None:
        QGuiApplication.clipboard().setText("\n".join(str(self._path_of(e).resolve()) for e in self.selected))

    def _focus_search(self) -> None:
        if self.currentWidget() is not self.viewer:
            self.filter_bar.search_edit.setFocus()
            self.filter_bar.search_edit.selectAll()

    def _connect_signals(self) -> None:
        self.filter_bar.changed.connect(self._update_table)
        self.filter_bar.stop_pressed.connect(self.folder_model.cancel)
        self.folder_model.cleared.connect(self._update_table)
        self.folder_model.listed.connect(self._on_listed)
        self.folder_model.progressed.connect(self.filter_bar.progressed)
        self.folder_model.scanned.connect(self.filter_bar.show_scan_result)
        self.folder_model.failed.connect(self._on_error)
        self.filter_bar.list_requested.connect(self.table.setFocus)
        self.table.selectionModel().selectionChanged.connect(lambda *_: self._on_selection_changed())
        self.table.open_requested.connect(self.open_selected)
        self.table.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self.table.customContextMenuRequested.connect(
            lambda at: self.make_menu().popup(self.table.viewport().mapToGlobal(at))
        )
        self.details.continue_pressed.connect(self.continue_selected)
        self.table.doubleClicked.connect(lambda _: self.open_selected())
        self.transfers.finished.connect(self.folder_model.rescan)
        self.transfers.message.connect(self.details.show_message)
        self.details.notes_changed.connect(self.annotate)
        self.details.open_pressed.connect(self.open_selected)
        self.details.explore_pressed.connect(self.explore_selected)
        self.details.export_pressed.connect(self._choose_export_folder)
        self.viewer.trace_plot.range_viewed.connect(self._load_trace_window)
        self.viewer.back_pressed.connect(self.go_back)
        self.viewer.explore_pressed.connect(self.explore_selected)
        add_actions(
            self,
            {
                "runs.search": self._focus_search,
                "runs.explore": self.explore_selected,
                "runs.export": lambda: self._choose_export_folder("csv"),
                "runs.notes": self.details.tags_edit.setFocus,
                "runs.copy-paths": self._copy_paths,
                "runs.continue": self.continue_selected,
                "runs.show-folder": self._show_folder,
                "runs.import": self._choose_imports,
                "runs.trash": self.move_selected_to_trash,
                "runs.undo": self.restore_trashed,
            },
        )

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        if (dropped_runs(event) or dropped_tables(event)) and event.source() is None:
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        if runs := dropped_runs(event):
            self.transfers.copy_in(runs)
        if tables := dropped_tables(event):
            self.transfers.import_tables(tables)
        event.acceptProposedAction()
