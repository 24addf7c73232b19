"""The list of runs: a table model over plain tuples, ten thousand of them without a pause."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QAbstractTableModel, QMimeData, QModelIndex, QPersistentModelIndex, Qt, QUrl
from PySide6.QtGui import QColor

from app.gui.theme import Theme
from app.run_entry import Entry, State
from app.words import duration

Index = QModelIndex | QPersistentModelIndex
COLUMNS = ("begun", "specimen", "protocol", "status", "points", "length", "found", "tags")
RIGHT = ("points", "length")
KEYS = {
    "begun": lambda e: e.start_time,
    "specimen": lambda e: e.specimen.casefold(),
    "protocol": lambda e: e.protocol,
    "status": lambda e: e.state,
    "points": lambda e: e.points,
    "length": lambda e: e.seconds,
    "found": lambda e: e.found,
    "tags": lambda e: e.tags.casefold(),
}
SIGNS = {
    State.COMPLETED: "✓",
    State.STOPPED: "■",
    State.FAILED: "✕",
    State.UNSAFE: "⚠",
    State.RUNNING: "▶",
    State.CRASHED: "✕",
    State.IMPORTED: "⇥",
    State.NEWER: "?",
    State.DAMAGED: "✕",
}


class RunsModel(QAbstractTableModel):
    """Shows entries in an order of its own; rows carry their files when they are dragged away."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.folder = Path()
        self.entries: list[Entry] = []
        self._theme = theme
        self._column, self._down = 0, True

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self._theme = theme

    def show(self, folder: Path, entries: Sequence[Entry]) -> None:
        """Show other entries."""
        self.beginResetModel()
        self.folder = folder
        self.entries = sorted(entries, key=KEYS[COLUMNS[self._column]], reverse=self._down)
        self.endResetModel()

    def row_of(self, path: str) -> int:
        """Where a run stands; -1 if it does not."""
        return next((row for row, entry in enumerate(self.entries) if entry.path == path), -1)

    def rowCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008 - Qt's own signature
        return 0 if parent.isValid() else len(self.entries)

    def columnCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008
        return 0 if parent.isValid() else len(COLUMNS)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if orientation is Qt.Orientation.Horizontal and role == Qt.ItemDataRole.DisplayRole:
            return COLUMNS[section]
        return None

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        entry, column = self.entries[index.row()], COLUMNS[index.column()]
        match role:
            case Qt.ItemDataRole.DisplayRole:
                return _text(entry, column)
            case Qt.ItemDataRole.TextAlignmentRole if column in RIGHT:
                return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
            case Qt.ItemDataRole.ForegroundRole if column == "status":
                return QColor(self._colour(State(entry.state)))
            case Qt.ItemDataRole.ToolTipRole:
                note = f"\n\n{entry.note}" if entry.note else ""
                return f"{self.folder / entry.path}\n{entry.reason}{note}"
        return None

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        self._column, self._down = column, order is Qt.SortOrder.DescendingOrder
        self.show(self.folder, self.entries)

    def flags(self, index: Index) -> Qt.ItemFlag:
        return super().flags(index) | Qt.ItemFlag.ItemIsDragEnabled

    def mimeData(self, indexes: Sequence[QModelIndex]) -> QMimeData:
        mime = QMimeData()
        rows = sorted({index.row() for index in indexes})
        mime.setUrls([QUrl.fromLocalFile(str((self.folder / self.entries[row].path).resolve())) for row in rows])
        return mime

    def _colour(self, state: State) -> str:
        match state:
            case State.COMPLETED | State.IMPORTED:
                return self._theme.good
            case State.STOPPED | State.RUNNING | State.NEWER:
                return self._theme.warn
            case _:
                return self._theme.bad


def _text(e: Entry, column: str) -> str:
    match column:
        case "begun":
            return f"{e.begun:%Y-%m-%d %H:%M}" if e.begun else e.name
        case "status":
            return f"{SIGNS[State(e.state)]} {e.state}" + (", SIMULATED" if e.simulated else "")
        case "points":
            return str(e.points) if e.readable else ""
        case "length":
            return duration(e.seconds) if e.readable else ""
        case "found":
            return e.found or ("" if e.state == State.COMPLETED else e.reason)
        case _:
            return str(getattr(e, column))
