"""List of a campaign's items with status symbols, reordered by dragging or shortcuts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import QModelIndex, QPersistentModelIndex, QPoint, QRect, QRectF, QSignalBlocker, QSize, Qt, Signal
from PySide6.QtGui import QColor, QDropEvent, QFontMetrics, QKeyEvent, QPainter
from PySide6.QtWidgets import (
    QAbstractItemView,
    QListWidget,
    QListWidgetItem,
    QStyle,
    QStyledItemDelegate,
    QStyleOptionViewItem,
)

from app.common import format_duration
from app.gui.face import draw_icon, draw_text, px, tokens
from app.gui.widgets import configure

if TYPE_CHECKING:
    from app.campaign import CampaignSummary, ItemSummary

ITEM_ROLE = Qt.ItemDataRole.UserRole
STATUS_SYMBOLS = {
    "done": ("good", "green_text"),
    "doubtful": ("warning", "amber_text"),
    "stale": ("again", "amber_text"),
    "missing": ("waiting", "text2"),
    "waiting": ("dots", "text2"),
    "unfinished": ("pause", "amber_text"),
    "failed": ("error", "red_text"),
    "running": ("play", "accent_text"),
    "skipped": ("nothing", "text2"),
}
"""Symbol and name of its colour in a `Tokens`, by item status."""


class CampaignList(QListWidget):
    """Shows the items of a campaign in their order; they can be dragged to another place."""

    item_moved = Signal(str, str)
    """Name of an item and of its successor ("" for the end)."""
    selected_item_changed = Signal()
    enter_pressed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.item_delegate = CampaignItemDelegate()
        self.setItemDelegate(self.item_delegate)
        configure(
            self,
            "campaign.items",
            accessibleName="measurements of the campaign",
            toolTip="Drag to another place, or Alt+Up and Alt+Down",
            minimumWidth=300,
            dragDropMode=QAbstractItemView.DragDropMode.InternalMove,
            defaultDropAction=Qt.DropAction.MoveAction,
            selectionMode=QAbstractItemView.SelectionMode.SingleSelection,
            verticalScrollMode=QAbstractItemView.ScrollMode.ScrollPerPixel,
            horizontalScrollBarPolicy=Qt.ScrollBarPolicy.ScrollBarAlwaysOff,
        )
        self.currentItemChanged.connect(lambda *_: self.selected_item_changed.emit())

    @property
    def names(self) -> list[str]:
        """Names of the items in their order."""
        return [self.item(at).data(ITEM_ROLE).name for at in range(self.count())]

    @property
    def selected_item(self) -> str:
        """Name of the selected item, empty for none."""
        row: ItemSummary | None = self.currentIndex().data(ITEM_ROLE)
        return "" if row is None else row.name

    def select_item(self, name: str) -> None:
        if name in self.names:
            self.setCurrentRow(self.names.index(name))

    def show_summary(self, summary: CampaignSummary, running: str) -> None:
        """Show the items and keep the selection; at first the next item is selected."""
        next_item = summary.next_item.name if summary.next_item is not None else ""
        before = self.selected_item or running or next_item
        self.item_delegate.next_item, self.item_delegate.running_item = next_item, running
        with QSignalBlocker(self):
            rebuild = self.names != [row.name for row in summary.items]
            if rebuild:
                self.clear()
            for at, row in enumerate(summary.items):
                if rebuild:
                    self.addItem(QListWidgetItem())
                item = self.item(at)
                if item.data(ITEM_ROLE) is not row:  # each change lays the list out anew
                    item.setData(ITEM_ROLE, row)
                state = "running" if row.name == running else f"{row.status_text}. {row.state.reason}"
                if item.text() != (text := f"{row.name}: {state}"):
                    item.setText(text)
            self.select_item(before)
            if self.currentRow() < 0:
                self.setCurrentRow(0)
        self.viewport().update()
        self.selected_item_changed.emit()

    def move_selected(self, offset: int) -> None:
        """Move the selected item up (-1) or down (+1)."""
        at, names = self.currentRow(), self.names
        if 0 <= at + offset < len(names) and at >= 0:
            self.item_moved.emit(names[at], [*names, ""][at + offset + (offset > 0)])

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self.enter_pressed.emit()
            return
        super().keyPressEvent(event)

    def dropEvent(self, event: QDropEvent) -> None:
        """Emit the new place; the list changes when the campaign has changed."""
        over = self.indexAt(event.position().toPoint())
        below = self.dropIndicatorPosition() == QAbstractItemView.DropIndicatorPosition.BelowItem
        before = [*self.names, ""][over.row() + below] if over.isValid() else ""
        if self.selected_item and before != self.selected_item:
            self.item_moved.emit(self.selected_item, before)
        event.setDropAction(Qt.DropAction.IgnoreAction)
        event.accept()


class CampaignItemDelegate(QStyledItemDelegate):
    """Draws one item: symbol, name and title; below them status and reason; at the right the duration."""

    def __init__(self) -> None:
        super().__init__()
        self.next_item = self.running_item = ""

    def sizeHint(self, option: QStyleOptionViewItem, _index: QModelIndex | QPersistentModelIndex) -> QSize:
        return QSize(200, round(2.7 * option.fontMetrics.height()))

    def paint(
        self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        row: ItemSummary | None = index.data(ITEM_ROLE)
        if row is None:
            return
        theme, area = tokens(), option.rect
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        chosen = bool(option.state & QStyle.StateFlag.State_Selected)
        if chosen:
            painter.fillRect(area, QColor(theme.accent_tint))
        if row.name in (self.next_item, self.running_item):  # a bar at the edge marks the next or running item
            painter.fillRect(QRect(area.left(), area.top(), 5, area.height()), QColor(theme.accent))
        running = row.name == self.running_item
        doubtful = row.is_doubtful and row.state.status == "done"
        status = "running" if running else "doubtful" if doubtful else str(row.state.status)
        side = 0.4 * area.height()
        box = QRectF(area.left() + 16, area.center().y() - side / 2, side, side)
        symbol, color_name = STATUS_SYMBOLS[status]
        color = str(getattr(theme, color_name))
        draw_icon(painter, symbol, box, color, theme.surface)
        left, right, middle = round(box.right()) + 16, area.right() - 10, area.center().y()
        top = QRect(QPoint(left, area.top() + 2), QPoint(right, middle + 1))
        bottom = QRect(QPoint(left, middle), QPoint(right, area.bottom()))
        duration = "" if row.duration_s is None else format_duration(row.duration_s)
        self._draw_line(
            painter, option.fontMetrics, top, (row.name, theme.text), (row.state.title, theme.text), duration
        )
        head = ("running" if running else row.status_text, color)
        reason = "" if status in ("done", "doubtful", "running") else row.state.reason
        by_hand = "by hand" if row.needs_operator else ""
        self._draw_line(painter, option.fontMetrics, bottom, head, (reason, theme.text2), by_hand)
        painter.setPen(QColor(theme.line))
        painter.drawLine(area.bottomLeft(), area.bottomRight())
        painter.restore()

    def _draw_line(
        self,
        painter: QPainter,
        metrics: QFontMetrics,
        area: QRect,
        head: tuple[str, str],
        rest: tuple[str, str],
        right: str,
    ) -> None:
        """Draw a bold text, elided text after it, each with its colour, and text at the right end."""
        used = draw_text(painter, area, head[0], head[1], "caption") + px(8)
        available = area.width() - used - metrics.horizontalAdvance(f"{right}  ")
        elided = metrics.elidedText(rest[0], Qt.TextElideMode.ElideRight, max(available, 0))
        draw_text(painter, area.adjusted(used, 0, 0, 0), elided, rest[1])
        draw_text(
            painter, area, right, tokens().text2, align=Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignRight
        )
