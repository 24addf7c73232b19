"""Table of runs: model over run summaries (ten thousand without a delay), and view with the days as groups."""

from collections.abc import Callable, Sequence
from datetime import date, datetime
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import Any, cast

from PySide6.QtCore import (
    QAbstractTableModel,
    QEvent,
    QItemSelectionModel,
    QMimeData,
    QModelIndex,
    QObject,
    QPersistentModelIndex,
    QRectF,
    Qt,
    QUrl,
    Signal,
)
from PySide6.QtGui import QColor, QFontMetricsF, QKeyEvent, QPainter, QResizeEvent
from PySide6.QtWidgets import QHeaderView, QStyledItemDelegate, QStyleOptionViewItem, QTableView

from app.archive import LARGEST_FIGURES, RunSummary
from app.common import pluralize, round_figure, sentence_case, typeset
from app.gui.face import CENTRE, draw_box, draw_hatch, draw_text, px, text_font, tokens
from app.gui.plots import color_of, curve_tone
from app.gui.runs.thumbnails import SIZE, Thumbnails
from app.gui.widgets import configure_table
from app.session import protocol_title
from model import format_with_uncertainty, shown_unit
from protocols.base import Outcome, RunFigure

Index = QModelIndex | QPersistentModelIndex
FIGURES = {"natural fr., Hz": ("natural_frequency",), "largest, µm": LARGEST_FIGURES}
"""Names of the figures of a run that have a column."""

RIGHT_ALIGNED = ("points", *FIGURES)


def _figure(summary: RunSummary, column: str) -> RunFigure | None:
    return next((each for each in summary.figures if each.name in FIGURES[column]), None)


SORT_KEYS: dict[str, Callable[[RunSummary], Any]] = {
    "begun": lambda e: e.start_time,
    "specimen": lambda e: e.specimen.casefold(),
    "protocol": lambda e: protocol_title(e.protocol),
    "verdict": lambda e: e.verdict_text,
    "natural fr., Hz": lambda e: e.natural_hz,
    "largest, µm": lambda e: e.largest_m,
    "points": lambda e: e.points,
    "found": lambda e: e.estimates_text,
    "tags": lambda e: e.tags.casefold(),
}
COLUMNS = tuple(SORT_KEYS)
THUMBNAIL_COLUMN = COLUMNS.index("begun")
WIDTHS = (16, 9, 15, 20, 13, 13, 7, 20, 12)
"""Of the columns, in characters; the thumbnail comes in addition."""
TIME_CHARACTERS = 7
ESSENTIAL = ("begun", "specimen", "protocol", "verdict", *FIGURES)
SHRINKING = (("verdict", 9), ("protocol", 10))
"""Columns that are narrower in a narrow table, with their least widths; where that is not enough, figures are left out."""
OPTIONAL = (("tags", 12), ("points", 7), ("found", 20))
"""Columns that are left out where they do not fit, the most important first, with their least widths."""
ROW_HEIGHT, DAY_HEIGHT, BADGE_PX, HATCH_PX = 40, 28, 18, 6
"""Height of a row, of the band above the first one of a day, diameter of the letter of a compared run, width of the hatch of a simulated one."""


class RunTableModel(QAbstractTableModel):
    """Table of run summaries, sortable; dragged rows carry their run files."""

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self.folder = Path()
        self.thumbnails = Thumbnails(self)
        self.thumbnails.changed.connect(self._on_thumbnails)
        self.summaries: list[RunSummary] = []
        self.days: dict[int, str] = {}
        """Heading of each day by its first row; empty unless the runs are sorted by time."""
        self.letters: dict[int, str] = {}
        """Letters of the compared runs by their rows."""
        self._others: Sequence[RunSummary] = ()
        self._sort_column, self._descending = 0, True

    def set_summaries(self, folder: Path, summaries: Sequence[RunSummary], others: Sequence[RunSummary] = ()) -> None:
        """Show these runs, sorted, and below them others, which a search found elsewhere than in specimen and tags."""
        self.beginResetModel()
        self.folder = folder
        key, self._others = SORT_KEYS[COLUMNS[self._sort_column]], others
        self.summaries = [
            run for part in (summaries, others) for run in sorted(part, key=key, reverse=self._descending)
        ]
        self.days, self.letters = {}, {}
        if COLUMNS[self._sort_column] == "begun":
            at, today = 0, date.today()
            for part, where in ((summaries, ""), (others, "Found in results and notes: " if summaries else "")):
                part_end = at + len(part)
                for day, runs in groupby(self.summaries[at:part_end], lambda e: _local_day(e.start_time)):
                    count = sum(1 for _ in runs)
                    self.days[at] = f"{where}{_day_text(day, today)}   {pluralize(count, 'run')}"
                    at += count
        self.endResetModel()

    def show_letters(self, letters: dict[int, str]) -> None:
        """Mark the runs that are compared."""
        changed, self.letters = {*self.letters, *letters}, letters
        for row in changed:
            at = self.index(row, THUMBNAIL_COLUMN)
            self.dataChanged.emit(at, at, [Qt.ItemDataRole.DecorationRole])

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
            return sentence_case(COLUMNS[section])
        return None

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        entry, column = self.summaries[index.row()], COLUMNS[index.column()]
        mark = ", SIMULATED" if entry.simulated else ""
        match role:
            case Qt.ItemDataRole.DisplayRole if column == "begun" and self.days and entry.started_at:
                return f"{entry.started_at:%H:%M}"
            case Qt.ItemDataRole.DisplayRole:
                return _cell_text(entry, column)
            case Qt.ItemDataRole.DecorationRole if index.column() == THUMBNAIL_COLUMN:
                return self.thumbnails.pixmap(self.folder, entry)
            case Qt.ItemDataRole.TextAlignmentRole if column in RIGHT_ALIGNED:
                return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
            case Qt.ItemDataRole.ForegroundRole if column == "verdict":
                return QColor(tokens().severity_color(entry.severity))
            case Qt.ItemDataRole.AccessibleTextRole if column == "verdict":
                return f"{_cell_text(entry, column)}{mark}"
            case Qt.ItemDataRole.ToolTipRole:
                note = f"\n\n{entry.note}" if entry.note else ""
                return f"{self.folder / entry.path}{mark}\n{entry.explanation}{note}"
        return None

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        self._sort_column, self._descending = column, order is Qt.SortOrder.DescendingOrder
        kept = len(self.summaries) - len(self._others)
        self.set_summaries(self.folder, self.summaries[:kept], self.summaries[kept:])

    def flags(self, index: Index) -> Qt.ItemFlag:
        return super().flags(index) | Qt.ItemFlag.ItemIsDragEnabled

    def mimeData(self, indexes: Sequence[QModelIndex]) -> QMimeData:
        mime = QMimeData()
        rows = sorted({index.row() for index in indexes})
        mime.setUrls([QUrl.fromLocalFile(str((self.folder / self.summaries[row].path).resolve())) for row in rows])
        return mime


@lru_cache(maxsize=200_000)
def _local_day(start_time: str) -> date | None:
    """Return the local day of a time, ISO, cached: a list of many runs is grouped at every letter of a search."""
    try:
        return datetime.fromisoformat(start_time).astimezone().date()
    except (ValueError, OverflowError, OSError):  # as `RunSummary.started_at`
        return None


def _cell_text(summary: RunSummary, column: str) -> str:
    match column:
        case "begun":
            return f"{summary.started_at:%Y-%m-%d %H:%M}" if summary.started_at else summary.name
        case "protocol":
            return protocol_title(summary.protocol)
        case "verdict":
            return f"{summary.symbol} {sentence_case(summary.verdict_text)}"
        case "points":
            return str(summary.points) if summary.readable else ""
        case _ if column in FIGURES:
            return _figure_text(_figure(summary, column))
        case "found":
            if summary.outcome is not Outcome.NOT_JUDGED and not summary.outcome.has_result:
                return summary.explanation
            has_column = _figure(summary, "natural fr., Hz") is not None
            return typeset(summary.estimates_text * (not has_column)) or (
                "" if summary.outcome is Outcome.GOOD else summary.explanation
            )
        case _:
            return str(getattr(summary, column))


def _figure_text(figure: RunFigure | None) -> str:
    """Return a figure in the unit of its column, with its total uncertainty where that is known; rounded to its noise elsewhere."""
    if figure is None:
        return ""
    factor, _ = shown_unit(figure.unit, figure.name)
    if figure.total <= figure.statistical:
        return typeset(round_figure(factor * figure.value, factor * figure.total))
    return typeset(format_with_uncertainty(factor * figure.value, factor * figure.total))


def _day_text(day: date | None, today: date) -> str:
    if day is None:
        return "Of unknown time"
    name = {0: "Today, ", 1: "Yesterday, "}.get((today - day).days, "")
    return f"{name}{day.day} {day:%B}{'' if day.year == today.year else f' {day.year}'}"


class RunDelegate(QStyledItemDelegate):
    """Draws the band of a day above its first row, the hatch of a simulated run, and the letter of a compared one."""

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: Index) -> None:
        model: Any = index.model()
        colors, day, letter = tokens(), model.days.get(index.row()), model.letters.get(index.row())
        first = index.column() == THUMBNAIL_COLUMN
        if day is not None:
            band = QRectF(option.rect.x(), option.rect.y(), option.rect.width(), px(DAY_HEIGHT))
            painter.fillRect(band, QColor(colors.window))
            option.rect.setTop(option.rect.top() + px(DAY_HEIGHT))
            # The date spans all columns; each cell paints its own part of the text.
            painter.save()
            painter.setClipRect(band)
            left: Any = option.widget.columnViewportPosition(THUMBNAIL_COLUMN)  # type: ignore[attr-defined]
            whole = QRectF(left + px(8), band.y(), option.widget.width(), band.height())
            draw_text(painter, whole, day, colors.text, "caption")
            painter.restore()
        super().paint(painter, option, index)
        if COLUMNS[index.column()] == "tags":
            self._draw_tags(painter, QRectF(option.rect), model.summaries[index.row()].tags)
        if first and model.summaries[index.row()].simulated:
            edge = QRectF(option.rect.x(), option.rect.y(), px(HATCH_PX), option.rect.height())
            draw_hatch(painter, edge, colors.violet2, QColor(colors.violet))
        if letter and first:
            painter.save()
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
            disc = QRectF(option.rect.x() + px(HATCH_PX + 2), option.rect.y() + px(2), px(BADGE_PX), px(BADGE_PX))
            draw_box(painter, disc, disc.width() / 2, color_of(curve_tone(ord(letter) - ord("A"))))
            draw_text(painter, disc, letter, colors.surface, "caption", CENTRE)
            painter.restore()

    def initStyleOption(self, option: QStyleOptionViewItem, index: Index) -> None:
        super().initStyleOption(option, index)
        if COLUMNS[index.column()] == "tags":  # drawn as pills
            option.text = ""

    @staticmethod
    def _draw_tags(painter: QPainter, cell: QRectF, tags: str) -> None:
        """Draw each tag in a pill, as many as the cell has a place for."""
        metrics, left, height = QFontMetricsF(text_font()), cell.left() + px(4), px(20)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for tag in filter(None, tags.split(", ")):
            pill = QRectF(left, cell.center().y() - height / 2, metrics.horizontalAdvance(tag) + px(16), height)
            pill.setRight(min(pill.right(), cell.right() - px(4)))
            draw_box(painter, pill, height / 2, "transparent", tokens().outline)
            text = metrics.elidedText(tag, Qt.TextElideMode.ElideRight, pill.width() - px(12))
            draw_text(painter, pill, text, tokens().text, align=CENTRE)
            left = pill.right() + px(4)
            if left > cell.right() - px(36):
                break


class RunTableView(QTableView):
    """Table in which Enter opens the selected run; not a shortcut, because Enter answers a prompt first."""

    open_requested = Signal()
    """The first selected run is to be opened."""

    def __init__(self, model: RunTableModel) -> None:
        super().__init__()
        self._tall_rows: set[int] = set()
        """First rows of the days, which have a band above them."""
        self.setModel(model)
        configure_table(
            self, "runs.table", "runs", px(ROW_HEIGHT), sortingEnabled=True, dragEnabled=True, alternatingRowColors=True, minimumWidth=420,
        )  # fmt: skip
        self.setItemDelegate(RunDelegate(self))
        model.modelReset.connect(self._make_place_for_days)
        self.doubleClicked.connect(lambda _: self.open_requested.emit())
        self.sortByColumn(0, Qt.SortOrder.DescendingOrder)
        header = self.horizontalHeader()
        # A header that knows the selection asks for the flags of every cell of it when it is painted.
        header.setSelectionModel(QItemSelectionModel(model, header))
        header.setSectionResizeMode(COLUMNS.index("found"), QHeaderView.ResizeMode.Stretch)
        self._follow_text_size()

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.FontChange and "_tall_rows" in vars(self):
            self._follow_text_size()

    def _follow_text_size(self) -> None:
        wide = self.fontMetrics().averageCharWidth()
        for at, count in enumerate(WIDTHS):
            self.setColumnWidth(at, count * wide)
        self.verticalHeader().setDefaultSectionSize(px(ROW_HEIGHT))
        self._make_place_for_days()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit_columns()

    def _fit_columns(self) -> None:
        """Give the time the width of what it shows, and leave out columns that the width cannot hold: the details have their values."""
        wide, model = self.fontMetrics().averageCharWidth(), cast("RunTableModel", self.model())
        begun = TIME_CHARACTERS if model.days or not model.summaries else WIDTHS[THUMBNAIL_COLUMN]
        self.setColumnWidth(THUMBNAIL_COLUMN, begun * wide + px(SIZE.width()))
        left = self.viewport().width()
        whole = {column: WIDTHS[COLUMNS.index(column)] * wide for column in ESSENTIAL[1:]}
        left -= self.columnWidth(THUMBNAIL_COLUMN) + sum(whole.values())
        for column, least in SHRINKING:
            width = max(whole[column] + min(left, 0), least * wide)
            self.setColumnWidth(COLUMNS.index(column), width)
            left += whole[column] - width
        for column in reversed(FIGURES):
            self.setColumnHidden(COLUMNS.index(column), left < 0)
            left += whole[column] if left < 0 else 0
        for column, characters in OPTIONAL:
            fits = left >= characters * wide
            self.setColumnHidden(COLUMNS.index(column), not fits)
            left -= characters * wide if fits else 0

    def _make_place_for_days(self) -> None:
        model: Any = self.model()
        for row in self._tall_rows - model.days.keys():
            self.setRowHeight(row, px(ROW_HEIGHT))
        for row in model.days:
            self.setRowHeight(row, px(ROW_HEIGHT + DAY_HEIGHT))
        self._tall_rows = set(model.days)
        self._fit_columns()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self.open_requested.emit()
            return
        super().keyPressEvent(event)
