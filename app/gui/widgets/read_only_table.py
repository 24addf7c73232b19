"""Table widgets that show values: not editable, rows selected whole, left-aligned header."""

from collections.abc import Callable, Collection, Sequence
from typing import Literal

from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableWidget, QTableWidgetItem

from app.gui.widgets.layouts import configure


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
    shown: dict[str, object] = {"showGrid": False, "wordWrap": stretched == "last", **properties}
    table = configure(
        QTableWidget(0, len(columns)),
        name,
        accessibleName=accessible_name,
        editTriggers=QAbstractItemView.EditTrigger.NoEditTriggers,
        selectionBehavior=QAbstractItemView.SelectionBehavior.SelectRows,
        tabKeyNavigation=False,
        **shown,
    )
    table.setHorizontalHeaderLabels(columns)
    table.verticalHeader().hide()
    header = table.horizontalHeader()
    header.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
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
