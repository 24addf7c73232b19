"""Table widgets that show values: not editable, rows selected whole, left-aligned header."""

from collections.abc import Callable, Collection, Sequence
from typing import Literal

from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableView, QTableWidget, QTableWidgetItem

from app.gui.widgets.layouts import configure


def configure_table(
    table: QTableView, name: str, accessible_name: str, row_height: int = 0, **properties: object
) -> None:
    """Configure a table as all tables of the window: rows are selected whole, Tab leaves it, nothing is edited in it.

    Args:
        table: without a header at its left.
        name: object name.
        accessible_name: for screen readers.
        row_height: of every row; 0: as high as the style's.
        properties: further Qt properties, or others than the usual ones.
    """
    usual: dict[str, object] = {
        "accessibleName": accessible_name,
        "editTriggers": QAbstractItemView.EditTrigger.NoEditTriggers,
        "selectionBehavior": QAbstractItemView.SelectionBehavior.SelectRows,
        "tabKeyNavigation": False,
        "showGrid": False,
        "wordWrap": False,
    }
    configure(table, name, **(usual | properties))
    table.verticalHeader().hide()
    if row_height:
        table.verticalHeader().setDefaultSectionSize(row_height)
    table.horizontalHeader().setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)


def fit_to_rows(table: QTableView) -> None:
    """Fit the rows to their contents, and the height of a table to its rows."""
    table.resizeRowsToContents()
    heights = sum(table.rowHeight(at) for at in range(table.model().rowCount()))
    table.setFixedHeight(heights + table.horizontalHeader().sizeHint().height() + 4)


def make_read_only_table(
    columns: Sequence[str],
    name: str,
    accessible_name: str,
    stretched: Literal["last", "all", "none"] = "last",
    **properties: object,
) -> QTableWidget:
    """Return an empty table; Tab leaves it.

    Args:
        columns: their titles.
        name: object name.
        accessible_name: for screen readers.
        stretched: columns that share the free width; the others are as wide as their contents.
        properties: further Qt properties.
    """
    table = QTableWidget(0, len(columns))
    configure_table(table, name, accessible_name, 0, **{"wordWrap": stretched == "last", **properties})
    table.setHorizontalHeaderLabels(columns)
    header = table.horizontalHeader()
    mode = QHeaderView.ResizeMode
    header.setSectionResizeMode(mode.Stretch if stretched == "all" else mode.ResizeToContents)
    if stretched == "last":
        header.setSectionResizeMode(len(columns) - 1, mode.Stretch)
    return table


def fill_table(
    table: QTableWidget,
    rows: Sequence[Sequence[str]],
    color: Callable[[int, int], str] = lambda _row, _column: "",
    right_aligned: Collection[int] = (),
) -> None:
    """Show rows of texts.

    Args:
        table: its contents are replaced.
        rows: a text for each column.
        color: returns the colour of a cell by row and column; empty for the usual one.
        right_aligned: columns of numbers.
    """
    table.setRowCount(len(rows))
    # Columns as wide as their contents would be measured again for every item.
    with QSignalBlocker(table.model()):
        for at, texts in enumerate(rows):
            for place, text in enumerate(texts):
                item = QTableWidgetItem(text)
                if place in right_aligned:
                    item.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
                if name := color(at, place):
                    item.setForeground(QColor(name))
                table.setItem(at, place, item)
    table.model().layoutChanged.emit()
