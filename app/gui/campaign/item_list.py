"""List of a campaign's items with status symbols, reordered by dragging or shortcuts."""

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

from app.common import format_duration
from app.gui.bench.symbols import SYMBOLS
from app.gui.widgets.theme import Theme

if TYPE_CHECKING:
    from app.campaign import CampaignSummary, ItemSummary

ITEM_ROLE = Qt.ItemDataRole.UserRole
STATUS_SYMBOLS = {
    "done": "tick",
    "stale": "again",
    "missing": "open",
    "waiting": "dots",
    "unfinished": "pause",
    "failed": "cross",
    "running": "play",
    "skipped": "nothing",
}
"""By item status."""


class CampaignList(QListWidget):
    """Shows the items of a campaign in their order; they can be dragged to another place."""

    item_moved = Signal(str, str)
    """Name of an item and of the one to place it before ("" for the end)."""
    selected_item_changed = Signal()
    enter_pressed = Signal()

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.item_delegate = CampaignItemDelegate(theme)
        self.setItemDelegate(self.item_delegate)
        self.setDragDropMode(QAbstractItemView.DragDropMode.InternalMove)
        self.setDefaultDropAction(Qt.DropAction.MoveAction)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.setVerticalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setAccessibleName("measurements of the campaign")
        self.setToolTip("Drag to another place, or Alt+Up and Alt+Down")
        self.currentItemChanged.connect(lambda *_: self.selected_item_changed.emit())

    @property
    def selected_item(self) -> str:
        """Name of the selected item, empty for none."""
        item = self.currentItem()
        return str(item.data(ITEM_ROLE).name) if item is not None else ""

    def select_item(self, name: str) -> None:
        """Select an item by its name."""
        for at in range(self.count()):
            if self.item(at).data(ITEM_ROLE).name == name:
                self.setCurrentRow(at)

    def show_summary(self, summary: CampaignSummary, running: str) -> None:
        """Show the items and keep the selection; at first the next item is selected."""
        before = self.selected_item or running or (summary.next_item.name if summary.next_item is not None else "")
        self.item_delegate.next_item = summary.next_item.name if summary.next_item is not None else ""
        self.item_delegate.running_item = running
        with QSignalBlocker(self):
            if [self.item(at).data(ITEM_ROLE).name for at in range(self.count())] != [
                row.name for row in summary.items
            ]:
                self.clear()
                for _ in summary.items:
                    self.addItem(QListWidgetItem())
            for at, row in enumerate(summary.items):
                self.item(at).setData(ITEM_ROLE, row)
                state = "running" if row.name == running else f"{row.status_text}. {row.state.reason}"
                self.item(at).setText(f"{row.name}: {state}")
            self.select_item(before)
            if self.currentRow() < 0:
                self.setCurrentRow(0)
        self.viewport().update()
        self.selected_item_changed.emit()

    def move_selected(self, offset: int) -> None:
        """Move the selected item up (-1) or down (+1)."""
        at, last = self.currentRow(), self.count() - 1
        if 0 <= at + offset <= last and at >= 0:
            names = [self.item(i).data(ITEM_ROLE).name for i in range(self.count())]
            after = at + offset + (offset > 0)
            self.item_moved.emit(names[at], names[after] if after <= last else "")

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self.item_delegate.theme = theme
        self.viewport().update()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self.enter_pressed.emit()
            return
        super().keyPressEvent(event)

    def dropEvent(self, event: QDropEvent) -> None:
        """Emit the new place; the list changes when the campaign has changed."""
        over = self.indexAt(event.position().toPoint())
        below = self.dropIndicatorPosition() == QAbstractItemView.DropIndicatorPosition.BelowItem
        at = self.count() if not over.isValid() else over.row() + below
        before = self.item(at).data(ITEM_ROLE).name if at < self.count() else ""
        if self.selected_item and before != self.selected_item:
            self.item_moved.emit(self.selected_item, before)
        event.setDropAction(Qt.DropAction.IgnoreAction)
        event.accept()


class CampaignItemDelegate(QStyledItemDelegate):
    """Draws one item: symbol, name and title; below them status and reason; at the right the duration."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.theme = theme
        self.next_item = self.running_item = ""

    def sizeHint(self, option: QStyleOptionViewItem, _index: QModelIndex | QPersistentModelIndex) -> QSize:
        return QSize(200, round(2.7 * option.fontMetrics.height()))

    def paint(
        self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        row: ItemSummary | None = index.data(ITEM_ROLE)
        if row is None:
            return
        theme, area = self.theme, option.rect
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        chosen = bool(option.state & QStyle.StateFlag.State_Selected)
        if chosen:
            painter.fillRect(area, QColor(theme.line))
        if row.name in (self.next_item, self.running_item):  # a bar at the edge marks the next or running item
            painter.fillRect(QRect(area.left(), area.top(), 5, area.height()), QColor(theme.accent))
        running = row.name == self.running_item
        status = "running" if running else str(row.state.status)
        side = 0.52 * area.height()
        box = QRectF(area.left() + 16, area.center().y() - side / 2, side, side)
        painter.setPen(QColor(self._text_color(status)))
        painter.save()
        SYMBOLS[STATUS_SYMBOLS[status]](painter, box)
        painter.restore()
        words = QRect(area)
        words.setLeft(round(box.right()) + 16)
        words.setRight(area.right() - 10)
        top, bottom = QRect(words), QRect(words)
        top.setBottom(area.center().y() + 1)
        bottom.setTop(area.center().y())
        right = "" if row.rehearsal is None else format_duration(row.rehearsal.duration_s)
        hands = "by hand" if row.needs_operator else ""
        self._draw_title_line(painter, option, top, row.name, row.state.title, right)
        painter.setPen(QColor(self._text_color(status)))
        bold = QFont(option.font)
        bold.setBold(True)
        state = "running" if running else row.status_text
        reason = "" if status in ("done", "running") else row.state.reason
        self._draw_line(painter, option, bottom, state, bold, reason, hands)
        painter.setPen(QColor(theme.line))
        painter.drawLine(area.bottomLeft(), area.bottomRight())
        painter.restore()

    def _draw_title_line(
        self, painter: QPainter, option: QStyleOptionViewItem, area: QRect, name: str, title: str, right: str
    ) -> None:
        painter.setPen(QColor(self.theme.text))
        bold = QFont(option.font)
        bold.setBold(True)
        self._draw_line(painter, option, area.adjusted(0, 2, 0, 0), name, bold, title, right, QColor(self.theme.text))

    def _draw_line(
        self,
        painter: QPainter,
        option: QStyleOptionViewItem,
        area: QRect,
        head: str,
        font: QFont,
        rest: str,
        right: str,
        color: QColor | None = None,
    ) -> None:
        """Draw a bold word, elided text after it, and text at the right end."""
        flags = Qt.AlignmentFlag.AlignVCenter
        painter.setFont(font)
        painter.drawText(area, flags | Qt.AlignmentFlag.AlignLeft, head)
        used = painter.fontMetrics().horizontalAdvance(f"{head}  ")
        painter.setFont(option.font)
        painter.setPen(color or QColor(self.theme.secondary_text))
        metrics = painter.fontMetrics()
        available = area.width() - used - metrics.horizontalAdvance(f"{right}  ")
        words = metrics.elidedText(rest, Qt.TextElideMode.ElideRight, max(available, 0))
        painter.drawText(area.adjusted(used, 0, 0, 0), flags | Qt.AlignmentFlag.AlignLeft, words)
        painter.setPen(QColor(self.theme.secondary_text))
        painter.drawText(area, flags | Qt.AlignmentFlag.AlignRight, right)

    def _text_color(self, status: str) -> str:
        theme = self.theme
        return {
            "done": theme.success,
            "stale": theme.warning,
            "unfinished": theme.warning,
            "failed": theme.error,
            "running": theme.accent,
        }.get(status, theme.secondary_text)
