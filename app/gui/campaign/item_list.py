"""A campaign's items in their order: how each stands in a symbol and in words; dragged, or moved by keys, to another place."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import QModelIndex, QPersistentModelIndex, QRect, QRectF, QSignalBlocker, QSize, Qt, Signal
from PySide6.QtGui import QColor, QDropEvent, QFont, QKeyEvent, QPainter
from PySide6.QtWidgets import (
    QAbstractItemView,
    QListWidget,
    QListWidgetItem,
    QStyle,
    QStyledItemDelegate,
    QStyleOptionViewItem,
)

from app.common.formatting import duration
from app.gui.bench.symbols import SYMBOLS
from app.gui.widgets.theme import Theme

if TYPE_CHECKING:
    from app.campaign.summary import Row, Sheet

ROW = Qt.ItemDataRole.UserRole
SYMBOL = {
    "done": "tick",
    "stale": "again",
    "missing": "open",
    "waiting": "dots",
    "unfinished": "pause",
    "failed": "cross",
    "running": "play",
    "skipped": "nothing",
}
"""By the word for how an item stands."""


class CampaignList(QListWidget):
    """Shows the rows of a sheet. Enter is told as `entered_key`; what it means is the page's affair."""

    moved = Signal(str, str)
    """An item, and the one it shall stand before ("" for the end)."""
    chosen_changed = Signal()
    entered_key = Signal()

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.drawn = ItemDrawing(theme)
        self.setItemDelegate(self.drawn)
        self.setDragDropMode(QAbstractItemView.DragDropMode.InternalMove)
        self.setDefaultDropAction(Qt.DropAction.MoveAction)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.setVerticalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setAccessibleName("measurements of the campaign")
        self.setToolTip("Drag to another place, or Alt+Up and Alt+Down")
        self.currentItemChanged.connect(lambda *_: self.chosen_changed.emit())

    @property
    def chosen(self) -> str:
        """Name of the chosen item, empty for none."""
        item = self.currentItem()
        return str(item.data(ROW).name) if item is not None else ""

    def choose(self, name: str) -> None:
        """Choose an item by its name."""
        for at in range(self.count()):
            if self.item(at).data(ROW).name == name:
                self.setCurrentRow(at)

    def show_sheet(self, sheet: Sheet, running: str) -> None:
        """Show how everything stands; what is chosen stays chosen, at first what comes next."""
        before = self.chosen or running or (sheet.next.name if sheet.next is not None else "")
        self.drawn.next = sheet.next.name if sheet.next is not None else ""
        self.drawn.running = running
        with QSignalBlocker(self):
            if [self.item(at).data(ROW).name for at in range(self.count())] != [row.name for row in sheet.rows]:
                self.clear()
                for _ in sheet.rows:
                    self.addItem(QListWidgetItem())
            for at, row in enumerate(sheet.rows):
                self.item(at).setData(ROW, row)
                state = "running" if row.name == running else f"{row.state}. {row.line.reason}"
                self.item(at).setText(f"{row.name}: {state}")
            self.choose(before)
            if self.currentRow() < 0:
                self.setCurrentRow(0)
        self.viewport().update()
        self.chosen_changed.emit()

    def step(self, by: int) -> None:
        """Move what is chosen up (-1) or down (+1)."""
        at, last = self.currentRow(), self.count() - 1
        if 0 <= at + by <= last and at >= 0:
            names = [self.item(i).data(ROW).name for i in range(self.count())]
            after = at + by + (by > 0)
            self.moved.emit(names[at], names[after] if after <= last else "")

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self.drawn.theme = theme
        self.viewport().update()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self.entered_key.emit()
            return
        super().keyPressEvent(event)

    def dropEvent(self, event: QDropEvent) -> None:
        """Tell where it was dropped; the list changes when the campaign has."""
        over = self.indexAt(event.position().toPoint())
        below = self.dropIndicatorPosition() == QAbstractItemView.DropIndicatorPosition.BelowItem
        at = self.count() if not over.isValid() else over.row() + below
        before = self.item(at).data(ROW).name if at < self.count() else ""
        if self.chosen and before != self.chosen:
            self.moved.emit(self.chosen, before)
        event.setDropAction(Qt.DropAction.IgnoreAction)
        event.accept()


class ItemDrawing(QStyledItemDelegate):
    """Draws one item: symbol, name and title, below it the state and why; at the right what it will take."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.theme = theme
        self.next = self.running = ""

    def sizeHint(self, option: QStyleOptionViewItem, _index: QModelIndex | QPersistentModelIndex) -> QSize:
        return QSize(200, round(2.7 * option.fontMetrics.height()))

    def paint(
        self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        row: Row | None = index.data(ROW)
        if row is None:
            return
        theme, area = self.theme, option.rect
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        chosen = bool(option.state & QStyle.StateFlag.State_Selected)
        if chosen:
            painter.fillRect(area, QColor(theme.line))
        if row.name in (self.next, self.running):  # a bar at the edge: here it goes on
            painter.fillRect(QRect(area.left(), area.top(), 5, area.height()), QColor(theme.accent))
        running = row.name == self.running
        standing = "running" if running else str(row.line.standing)
        side = 0.52 * area.height()
        box = QRectF(area.left() + 16, area.center().y() - side / 2, side, side)
        painter.setPen(QColor(self._ink(standing)))
        painter.save()
        SYMBOLS[SYMBOL[standing]](painter, box)
        painter.restore()
        words = QRect(area)
        words.setLeft(round(box.right()) + 16)
        words.setRight(area.right() - 10)
        top, bottom = QRect(words), QRect(words)
        top.setBottom(area.center().y() + 1)
        bottom.setTop(area.center().y())
        right = "" if row.told is None else duration(row.told.duration_s)
        hands = "by hand" if row.hands else ""
        self._two(painter, option, top, row.name, row.line.title, right)
        painter.setPen(QColor(self._ink(standing)))
        bold = QFont(option.font)
        bold.setBold(True)
        state = "running" if running else row.state
        reason = "" if standing in ("done", "running") else row.line.reason
        self._line(painter, option, bottom, state, bold, reason, hands)
        painter.setPen(QColor(theme.line))
        painter.drawLine(area.bottomLeft(), area.bottomRight())
        painter.restore()

    def _two(
        self, painter: QPainter, option: QStyleOptionViewItem, area: QRect, name: str, title: str, right: str
    ) -> None:
        painter.setPen(QColor(self.theme.text))
        bold = QFont(option.font)
        bold.setBold(True)
        self._line(painter, option, area.adjusted(0, 2, 0, 0), name, bold, title, right, QColor(self.theme.text))

    def _line(
        self,
        painter: QPainter,
        option: QStyleOptionViewItem,
        area: QRect,
        head: str,
        font: QFont,
        rest: str,
        right: str,
        ink: QColor | None = None,
    ) -> None:
        """A bold word, what follows it shortened to its room, and something at the right end."""
        flags = Qt.AlignmentFlag.AlignVCenter
        painter.setFont(font)
        painter.drawText(area, flags | Qt.AlignmentFlag.AlignLeft, head)
        used = painter.fontMetrics().horizontalAdvance(f"{head}  ")
        painter.setFont(option.font)
        painter.setPen(ink or QColor(self.theme.dim))
        metrics = painter.fontMetrics()
        room = area.width() - used - metrics.horizontalAdvance(f"{right}  ")
        words = metrics.elidedText(rest, Qt.TextElideMode.ElideRight, max(room, 0))
        painter.drawText(area.adjusted(used, 0, 0, 0), flags | Qt.AlignmentFlag.AlignLeft, words)
        painter.setPen(QColor(self.theme.dim))
        painter.drawText(area, flags | Qt.AlignmentFlag.AlignRight, right)

    def _ink(self, standing: str) -> str:
        theme = self.theme
        return {
            "done": theme.good,
            "stale": theme.warn,
            "unfinished": theme.warn,
            "failed": theme.bad,
            "running": theme.accent,
        }.get(standing, theme.dim)
