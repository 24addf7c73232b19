"""Table of runs: model over run summaries (ten thousand without a delay), and view."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QAbstractTableModel, QMimeData, QModelIndex, QPersistentModelIndex, Qt, QUrl, Signal
from PySide6.QtGui import QColor, QKeyEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableView

from app.archive import RunSummary
from app.common import format_duration, typeset
from app.gui.face import px, tokens
from app.gui.runs.thumbnails import SIZE, Thumbnails
from app.gui.widgets import configure
from protocols import PROTOCOLS
from protocols.base import Outcome

Index = QModelIndex | QPersistentModelIndex
RIGHT_ALIGNED = ("points", "length")
SORT_KEYS = {
    "begun": lambda e: e.start_time,
    "specimen": lambda e: e.specimen.casefold(),
    "protocol": lambda e: protocol_title(e.protocol),
    "verdict": lambda e: e.verdict_text,
    "points": lambda e: e.points,
    "length": lambda e: e.seconds,
    "found": lambda e: e.estimates_text,
    "tags": lambda e: e.tags.casefold(),
}
COLUMNS = tuple(SORT_KEYS)
THUMBNAIL_COLUMN = COLUMNS.index("begun")
ROW_HEIGHT = 40


def protocol_title(name: str) -> str:
    """Return a protocol as the form calls it; the stored name of one that is not known here."""
    return PROTOCOLS.title(name) if name in PROTOCOLS else name


class RunTableModel(QAbstractTableModel):
    """Table of run summaries, sortable; dragged rows carry their run files."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path()
        self.thumbnails = Thumbnails(self)
        self.thumbnails.changed.connect(self._on_thumbnails)
        self.summaries: list[RunSummary] = []
        self._sort_column, self._descending = 0, True

    def set_summaries(self, folder: Path, summaries: Sequence[RunSummary]) -> None:
        """Show these runs."""
        self.beginResetModel()
        self.folder = folder
        self.summaries = sorted(summaries, key=SORT_KEYS[COLUMNS[self._sort_column]], reverse=self._descending)
        self.endResetModel()

    def _on_thumbnails(self) -> None:
        if self.summaries:
            last = self.index(len(self.summaries) - 1, THUMBNAIL_COLUMN)
            self.dataChanged.emit(self.index(0, THUMBNAIL_COLUMN), last, [Qt.ItemDataRole.DecorationRole])

    def rowCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008 - Qt's own signature
        return 0 if parent.isValid() else len(self.summaries)

    def columnCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008
        return 0 if parent.isValid() else len(COLUMNS)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if orientation is Qt.Orientation.Horizontal and role == Qt.ItemDataRole.DisplayRole:
            return COLUMNS[section]
        return None

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        entry, column = self.summaries[index.row()], COLUMNS[index.column()]
        match role:
            case Qt.ItemDataRole.DisplayRole:
                return _cell_text(entry, column)
            case Qt.ItemDataRole.DecorationRole if index.column() == THUMBNAIL_COLUMN:
                return self.thumbnails.pixmap(self.folder, entry)
            case Qt.ItemDataRole.TextAlignmentRole if column in RIGHT_ALIGNED:
                return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
            case Qt.ItemDataRole.ForegroundRole if column == "verdict":
                return QColor(tokens().severity_color(entry.severity))
            case Qt.ItemDataRole.ToolTipRole:
                note = f"\n\n{entry.note}" if entry.note else ""
                return f"{self.folder / entry.path}\n{entry.explanation}{note}"
        return None

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        self._sort_column, self._descending = column, order is Qt.SortOrder.DescendingOrder
        self.set_summaries(self.folder, self.summaries)

    def flags(self, index: Index) -> Qt.ItemFlag:
        return super().flags(index) | Qt.ItemFlag.ItemIsDragEnabled

    def mimeData(self, indexes: Sequence[QModelIndex]) -> QMimeData:
        mime = QMimeData()
        rows = sorted({index.row() for index in indexes})
        mime.setUrls([QUrl.fromLocalFile(str((self.folder / self.summaries[row].path).resolve())) for row in rows])
        return mime


def _cell_text(summary: RunSummary, column: str) -> str:
    match column:
        case "begun":
            return f"{summary.started_at:%Y-%m-%d %H:%M}" if summary.started_at else summary.name
        case "protocol":
            return protocol_title(summary.protocol)
        case "verdict":
            return f"{summary.symbol} {summary.verdict_text}" + (", SIMULATED" if summary.simulated else "")
        case "points":
            return str(summary.points) if summary.readable else ""
        case "length":
            return format_duration(summary.seconds) if summary.readable else ""
        case "found":
            if summary.outcome is not Outcome.NOT_JUDGED and not summary.outcome.has_result:
                return summary.explanation
            return typeset(summary.estimates_text) or ("" if summary.outcome is Outcome.GOOD else summary.explanation)
        case _:
            return str(getattr(summary, column))


class RunTableView(QTableView):
    """Table in which Enter opens the selected run; not a shortcut, because Enter answers a prompt first."""

    open_requested = Signal()

    def __init__(self, model: RunTableModel) -> None:
        super().__init__()
        self.setModel(model)
        configure(
            self,
            "runs.table",
            accessibleName="runs",
            sortingEnabled=True,
            selectionBehavior=QAbstractItemView.SelectionBehavior.SelectRows,
            selectionMode=QAbstractItemView.SelectionMode.ExtendedSelection,
            dragEnabled=True,
            alternatingRowColors=True,
            showGrid=False,
            wordWrap=False,
            tabKeyNavigation=False,
            minimumWidth=420,
        )
        self.sortByColumn(0, Qt.SortOrder.DescendingOrder)
        configure(self.verticalHeader(), visible=False, defaultSectionSize=px(ROW_HEIGHT))
        header = self.horizontalHeader()
        header.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        wide = self.fontMetrics().averageCharWidth()
        for at, count in enumerate((20, 12, 19, 29, 8, 9, 34, 9)):
            self.setColumnWidth(at, count * wide + (px(SIZE.width()) if at == THUMBNAIL_COLUMN else 0))
        header.setSectionResizeMode(COLUMNS.index("found"), QHeaderView.ResizeMode.Stretch)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self.open_requested.emit()
            return
        super().keyPressEvent(event)
