"""List of the runs of a folder: filter, table, and details of the selected runs."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import groupby
from pathlib import Path

from PySide6.QtCore import QItemSelection, QItemSelectionModel, Qt, QUrl, Signal
from PySide6.QtGui import QDesktopServices, QGuiApplication
from PySide6.QtWidgets import QWidget

from app.archive import RunSummary, ScanResult
from app.comparison import LETTERS, MAX_RUNS
from app.gui.face import set_length
from app.gui.runs.details import RunDetailsPane
from app.gui.runs.filter_bar import RunFilterBar
from app.gui.runs.folder_model import RunFolderModel
from app.gui.runs.run_table import RunTableModel, RunTableView
from app.gui.widgets import Menu, column, make_splitter


class RunListPane(QWidget):
    """Lists and filters the runs, and keeps their selection."""

    selection_changed = Signal()

    def __init__(self, folder: Callable[[], Path], index: Path | None) -> None:
        super().__init__()
        self.folder_model = RunFolderModel(folder, index, self)
        self.model = RunTableModel(self)
        self._rows: list[int] | None = None
        self.model.modelReset.connect(self._forget_rows)
        self.table, self.filter_bar = RunTableView(self.model), RunFilterBar()
        self.details = RunDetailsPane(self.folder_model)
        columns = make_splitter("runs/columns", (self.table, 3), (self.details, 1), sizes=[860, 390])
        set_length(self.details, least_width=340)  # now: at first the details have the width that their buttons need
        column(self.filter_bar, (columns, 1), parent=self, margins=(0, 0, 8, 0), spacing=6)
        self.filter_bar.changed.connect(self._update_table)
        self.filter_bar.stop_pressed.connect(self.folder_model.cancel)
        self.filter_bar.list_requested.connect(self.table.setFocus)
        self.folder_model.cleared.connect(self._update_table)
        self.folder_model.listed.connect(self._on_listed)
        self.folder_model.progressed.connect(self.filter_bar.show_progress)
        self.folder_model.scanned.connect(self._on_scanned)
        self.table.selectionModel().selectionChanged.connect(self._forget_rows)
        self.table.selectionModel().selectionChanged.connect(lambda *_: self._on_selection_changed())
        self.details.notes_changed.connect(self.annotate)
        self.details.clear_button.clicked.connect(lambda _: self.filter_bar.clear())

    @property
    def selected(self) -> list[RunSummary]:
        """The selected runs in the order of the list."""
        return [self.model.summaries[row] for row in self._selected_rows]

    @property
    def readable_paths(self) -> list[Path]:
        """The selected runs that can be opened: not the one that this program is writing."""
        paths = [self.path_of(each) for each in self.selected if each.readable]
        return [path for path in paths if path != self.folder_model.active_file]

    @property
    def _selected_rows(self) -> list[int]:
        """The selected rows by their ranges: Qt's list of rows asks the model for the flags of every cell."""
        if self._rows is None:
            ranges = self.table.selectionModel().selection()
            each_range = (ranges.at(i) for i in range(ranges.count()))
            self._rows = sorted({row for each in each_range for row in range(each.top(), each.bottom() + 1)})
        return self._rows

    def _forget_rows(self) -> None:
        self._rows = None

    def select_paths(self, paths: Sequence[str]) -> None:
        """Select runs by their paths."""
        selection, flags = self.table.selectionModel(), QItemSelectionModel.SelectionFlag
        selection.clearSelection()
        chosen, wanted = QItemSelection(), set(paths)
        rows = [row for row, entry in enumerate(self.model.summaries) if entry.path in wanted]
        for _, run in groupby(enumerate(rows), lambda at: at[1] - at[0]):
            together = [row for _, row in run]
            chosen.select(self.model.index(together[0], 0), self.model.index(together[-1], 0))
        selection.select(chosen, flags.Select | flags.Rows)
        if rows:
            row_of = {self.model.summaries[row].path: row for row in rows}
            last = next(row_of[path] for path in reversed(paths) if path in row_of)
            selection.setCurrentIndex(self.model.index(last, 0), flags.NoUpdate)

    def path_of(self, summary: RunSummary) -> Path:
        """Return the path of a listed run."""
        return self.model.folder / summary.path

    def annotate(self, tags: str, note: str) -> None:
        """Write tags and a note for the selected runs; with several, tags are added and notes stay."""
        self.folder_model.annotate([(self.path_of(e), e.tags, e.note) for e in self.selected], tags, note)

    def make_menu(self, page: QWidget) -> Menu:
        """Return the context menu of the selected runs, with the actions of a page."""
        menu = Menu(self.table)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        menu.addAction(f"{self.details.open_button.text()}\tEnter", self.table.open_requested.emit)
        one = self.selected[0] if len(self.selected) == 1 else None
        if one is not None and one.readable and one.specimen:
            menu.addAction(
                f"Report of {one.specimen} …", partial(self.details.card.requested.emit, "report", self.path_of(one))
            )
        names = ("continue", "explore", "", "notes", "export", "copy-paths", "show-folder", "", "trash", "import")
        menu.add_named(page, (f"runs.{name}" if name else "" for name in names))
        return menu

    def show_folder(self) -> None:
        """Open the folder of the first selected run in the file manager."""
        if chosen := self.selected:
            QDesktopServices.openUrl(QUrl.fromLocalFile(str(self.path_of(chosen[0]).resolve().parent)))

    def copy_paths(self) -> None:
        """Copy the paths of the selected runs."""
        QGuiApplication.clipboard().setText("\n".join(str(self.path_of(e).resolve()) for e in self.selected))

    def _on_listed(self) -> None:
        self.filter_bar.set_choices(self.folder_model.summaries)
        self._update_table()

    def _on_scanned(self, result: ScanResult) -> None:
        self.filter_bar.show_scan_result(result)
        if not self.folder_model.summaries:  # and none follows, unless the folder is still being read
            self._update_table()

    def _update_table(self) -> None:
        chosen = [entry.path for entry in self.selected]
        try:
            first, others = self.filter_bar.selected_filter.split(self.folder_model.summaries)
        except ValueError as error:
            self.filter_bar.show_mistake(str(error))
            return
        summaries = [*first, *others]
        self.model.set_summaries(self.folder_model.path, first, others)
        self.select_paths(chosen)
        if not self.selected and summaries:
            self.table.setCurrentIndex(self.model.index(0, 0))
        self.filter_bar.show_count(len(summaries), len(self.folder_model.summaries))
        self._on_selection_changed()

    def _on_selection_changed(self) -> None:
        chosen = self.selected
        rows = [row for row in self._selected_rows if self.model.summaries[row].readable]
        self.model.show_letters(dict(zip(rows, LETTERS, strict=False)) if 1 < len(rows) <= MAX_RUNS else {})
        self.details.show_selection(chosen, bool(self.readable_paths))
        self.selection_changed.emit()
