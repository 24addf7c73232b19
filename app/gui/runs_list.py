"""How the list of runs is laid out: the filter above, the table, and beside it what is chosen."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QSplitter, QVBoxLayout, QWidget


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
        columns.setChildrenCollapsible(False)
        table.setMinimumWidth(500)
        side.setMinimumWidth(340)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(6)
        layout.addWidget(top)
        layout.addWidget(columns, 1)
