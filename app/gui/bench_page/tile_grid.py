"""Grid of tiles with as many columns as the width leaves."""

from collections.abc import Sequence

from PySide6.QtCore import QSize
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QGridLayout, QWidget


class TileGrid(QWidget):
    """Tiles in a row where there is room, else in two columns or one."""

    def __init__(self, tiles: Sequence[QWidget]) -> None:
        super().__init__()
        self._tiles, self._columns = tuple(tiles), 0
        self._layout = QGridLayout(self)
        self._layout.setContentsMargins(0, 0, 0, 0)
        self._layout.setSpacing(8)
        self._layout.setSizeConstraint(QGridLayout.SizeConstraint.SetNoConstraint)
        self._arrange(1)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        fitting = [columns for columns in (4, 2) if self._least_width(columns) <= self.width()]
        self._arrange(fitting[0] if fitting else 1)

    def minimumSizeHint(self) -> QSize:
        return QSize(self._least_width(1), super().minimumSizeHint().height())

    def _least_width(self, columns: int) -> int:
        widths = [tile.minimumSizeHint().width() for tile in self._tiles]
        return sum(max(widths[at::columns]) for at in range(columns)) + (columns - 1) * self._layout.spacing()

    def _arrange(self, columns: int) -> None:
        if columns == self._columns:
            return
        for at in range(max(self._columns, columns)):
            self._layout.setColumnStretch(at, int(at < columns))
        self._columns = columns
        for at, tile in enumerate(self._tiles):
            self._layout.addWidget(tile, at // columns, at % columns)
