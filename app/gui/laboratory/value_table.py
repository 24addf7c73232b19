"""Table widget of the Laboratory page: shows an `app.common.Table`, sortable by its values, thousands of rows without a delay."""

import math
from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt, Signal
from PySide6.QtGui import QColor, QFont, QKeyEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableView

from app.common import CellValue, Column, Severity, Table, sentence_case, typeset
from app.gui.face import tokens
from app.gui.widgets import configure_table

Index = QModelIndex | QPersistentModelIndex
AS_TEXT = " as text"
"""End of the name of a column of texts that is sorted by the column of numbers without it."""

CELL_MARGIN, BOLD_SHARE = 12, 1.06
"""Free width of a cell in pixels, and ratio of the widths of bold and plain text."""
LAST_COLUMN, CUT_LAST_COLUMN, LEAST_COLUMN = 120, 56, 24
"""Least widths of the last column, while others have their widths and before they are cut, and of any column, in pixels."""


class ValueTableModel(QAbstractTableModel):
    """The displayed columns of a table.

    Attributes:
        order: row of the table for each displayed row.
        longest: text of each column that defines its width: a size hint of each cell would take longer than all other work.
    """

    def __init__(self) -> None:
        super().__init__()
        self._columns: tuple[Column, ...] = ()
        self._texts: list[tuple[str, ...]] = []
        self._keys: list[list[CellValue]] = []
        self._severities: Sequence[Severity] = ()
        self._highlighted: frozenset[int] = frozenset()
        self._sorted: tuple[int, Qt.SortOrder] | None = None
        self.order: list[int] = []
        self.longest: list[str] = []

    def set_table(self, table: Table, severities: Sequence[Severity] = ()) -> None:
        """Show a table; `severities` colour its rows, and so do its highlighted rows."""
        self.beginResetModel()
        self._columns = tuple(column for column in table.columns if column.displayed)
        by_name = {column.name: column for column in table.columns}
        self._keys = [by_name.get(c.name.removesuffix(AS_TEXT), c).cells for c in self._columns]
        texts = [[column.format_value(cell) for cell in column.cells] for column in self._columns]
        self._texts = list(zip(*texts, strict=True))
        self.longest = [max((text for text in column), key=len, default="") for column in texts]
        self._severities, self._highlighted = severities, table.highlighted_rows
        self.order = list(range(len(self._texts)))
        if self._sorted is not None and self._sorted[0] < len(self._columns):
            self._sort(*self._sorted)
        self.endResetModel()

    def rowCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008 - Qt's own signature
        return 0 if parent.isValid() else len(self.order)

    def columnCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008
        return 0 if parent.isValid() else len(self._columns)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if orientation is Qt.Orientation.Horizontal and role == Qt.ItemDataRole.DisplayRole:
            column = self._columns[section]
            name = sentence_case(typeset(column.displayed_name))
            return f"{name} ({column.displayed_unit})" if column.displayed_unit else name
        return None

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        row = self.order[index.row()]
        match role:
            case Qt.ItemDataRole.DisplayRole | Qt.ItemDataRole.ToolTipRole:
                return self._texts[row][index.column()]
            case Qt.ItemDataRole.ForegroundRole if row < len(self._severities):
                return QColor(tokens().severity_color(self._severities[row]))
            case Qt.ItemDataRole.ForegroundRole if row in self._highlighted:
                return QColor(tokens().amber_text)
            case Qt.ItemDataRole.FontRole if row in self._highlighted:
                font = QFont()
                font.setBold(True)
                return font
        return None

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        self.layoutAboutToBeChanged.emit()
        if 0 <= column < len(self._columns):
            self._sorted = (column, order)
            self._sort(column, order)
        self.layoutChanged.emit()

    def _sort(self, column: int, order: Qt.SortOrder) -> None:
        keys = self._keys[column]
        descending = order is Qt.SortOrder.DescendingOrder
        self.order.sort(key=lambda row: _sort_key(keys[row]), reverse=descending)
        missing = [row for row in self.order if keys[row] is None]
        if missing:  # last in either direction
            self.order = [row for row in self.order if keys[row] is not None] + missing


def share_width(needed: Sequence[int], free: int) -> list[int]:
    """Return the widths of columns in a free width: as requested, with the widest cut to one width if it is too small."""
    limit, left = max(needed, default=0), free
    for rank, width in enumerate(sorted(needed)):
        if width * (len(needed) - rank) > left:
            limit = max(left, 0) // (len(needed) - rank)
            break
        left -= width
    return [min(width, limit) for width in needed]


def _sort_key(value: CellValue) -> tuple[int, float, str]:
    if isinstance(value, str):
        return (1, 0.0, value.casefold())
    return (0, math.inf if value is None else float(value), "")


class ValueTable(QTableView):
    """Read-only table whose last column takes the free width."""

    row_selected = Signal(int)
    """Row of the shown table; -1 for none."""
    row_opened = Signal(int)
    """Row activated by Enter or a double click."""

    def __init__(self, name: str, accessible_name: str, sortable: bool = True) -> None:
        super().__init__()
        self._values = ValueTableModel()
        self.setModel(self._values)
        configure_table(
            self, name, accessible_name, self.fontMetrics().height() + 8, alternatingRowColors=True,
            selectionMode=QAbstractItemView.SelectionMode.SingleSelection,
        )  # fmt: skip
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        header.setTextElideMode(Qt.TextElideMode.ElideRight)
        if sortable:
            header.setSortIndicator(-1, Qt.SortOrder.AscendingOrder)
            self.setSortingEnabled(True)
        self.selectionModel().currentRowChanged.connect(lambda now, _: self.row_selected.emit(self._row(now)))
        self.doubleClicked.connect(lambda index: self.row_opened.emit(self._row(index)))

    def set_table(self, table: Table, severities: Sequence[Severity] = ()) -> None:
        self._values.set_table(table, severities)
        self.row_selected.emit(-1)
        self._fit_columns()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter) and self.currentIndex().isValid():
            self.row_opened.emit(self._row(self.currentIndex()))
            return
        super().keyPressEvent(event)

    def _row(self, index: QModelIndex) -> int:
        return self._values.order[index.row()] if index.isValid() else -1

    def _fit_columns(self) -> None:
        """Give each column the width of its contents and the last one the rest; wide columns get less where there is too little."""
        header, count = self.horizontalHeader(), self._values.columnCount()
        for at in range(count):
            last = at == count - 1
            header.setSectionResizeMode(
                at, QHeaderView.ResizeMode.Stretch if last else QHeaderView.ResizeMode.Interactive
            )
        width_of = self.fontMetrics().horizontalAdvance
        contents = [round(BOLD_SHARE * width_of(text)) + CELL_MARGIN for text in self._values.longest]
        needed = [max(contents[at], header.sectionSizeHint(at) + 6) for at in range(count)]
        left = self.viewport().width() - sum(needed[:-1])
        least_last = min(needed[-1], max(CUT_LAST_COLUMN, min(left, LAST_COLUMN))) if needed else 0
        for at, width in enumerate(share_width(needed[:-1], self.viewport().width() - least_last)):
            self.setColumnWidth(at, max(width, LEAST_COLUMN))

    def resizeEvent(self, event: Any) -> None:
        super().resizeEvent(event)
        self._fit_columns()
