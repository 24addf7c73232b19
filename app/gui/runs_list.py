"""The list of runs: the table, and how it is laid out with the filter above it and what is chosen beside it."""

from collections.abc import Sequence

from PySide6.QtCore import QItemSelectionModel, Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QSplitter, QTableView, QVBoxLayout, QWidget

from app.gui.runs_table import COLUMNS, RunsModel
from app.run_entry import Entry


class RunsTable(QTableView):
    """Enter opens what is chosen; not by a shortcut, because Enter answers a prompt first."""

    opened = Signal()

    def __init__(self, model: RunsModel) -> None:
        super().__init__()
        self._runs = model
        self.setModel(model)
        self.setSortingEnabled(True)
        self.sortByColumn(0, Qt.SortOrder.DescendingOrder)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        self.setDragEnabled(True)
        self.setAlternatingRowColors(True)
        self.setShowGrid(False)
        self.setWordWrap(False)
        self.setTabKeyNavigation(False)
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(self.fontMetrics().height() + 8)
        header = self.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.Interactive)
        header.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        wide = self.fontMetrics().averageCharWidth()
        for at, count in enumerate((20, 12, 19, 29, 8, 9, 34, 9)):
            self.setColumnWidth(at, count * wide)
        header.setStretchLastSection(False)
        header.setSectionResizeMode(COLUMNS.index("found"), QHeaderView.ResizeMode.Stretch)
        self.setAccessibleName("runs")

    @property
    def chosen(self) -> list[Entry]:
        """The entries that are selected, in the list's order."""
        rows = sorted(index.row() for index in self.selectionModel().selectedRows())
        return [self._runs.entries[row] for row in rows]

    def choose(self, paths: Sequence[str]) -> None:
        """Select runs by their paths."""
        selection = self.selectionModel()
        selection.clearSelection()
        flags = QItemSelectionModel.SelectionFlag
        for row in filter(lambda row: row >= 0, map(self._runs.row_of, paths)):
            selection.select(self._runs.index(row, 0), flags.Select | flags.Rows)
            selection.setCurrentIndex(self._runs.index(row, 0), flags.NoUpdate)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self.opened.emit()
            return
        super().keyPressEvent(event)


class RunsList(QWidget):
    """Holds the three."""

    def __init__(self, top: QWidget, table: QWidget, side: QWidget) -> None:
        super().__init__()
        columns = QSplitter(Qt.Orientation.Horizontal)
        columns.addWidget(table)
        columns.addWidget(side)
        columns.setStretchFactor(0, 3)
        columns.setStretchFactor(1, 1)
        columns.setSizes([860, 390])
        columns.setObjectName("runs/columns")
        columns.setChildrenCollapsible(False)
        table.setMinimumWidth(500)
        side.setMinimumWidth(340)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(6)
        layout.addWidget(top)
        layout.addWidget(columns, 1)
