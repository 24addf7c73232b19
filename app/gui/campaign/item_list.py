"""List of a campaign's items with status symbols, reordered by dragging or shortcuts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import QModelIndex, QPersistentModelIndex, QPointF, QRectF, QSignalBlocker, QSize, Qt, Signal
from PySide6.QtGui import QColor, QDropEvent, QFontMetricsF, QKeyEvent, QPainter
from PySide6.QtWidgets import (
    QAbstractItemView,
    QListWidget,
    QListWidgetItem,
    QStyle,
    QStyledItemDelegate,
    QStyleOptionViewItem,
)

from app.common import format_duration, round_figure, typeset
from app.gui.face import draw_icon, draw_text, px, text_font, text_width, tokens
from app.gui.widgets import configure
from model import shown_unit

if TYPE_CHECKING:
    from app.campaign import CampaignSummary, ItemSummary

ITEM_ROLE = Qt.ItemDataRole.UserRole
RIGHT = Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignRight
STATUS_SYMBOLS = {
    "done": ("good", "green_text"),
    "doubtful": ("warning", "amber_text"),
    "stale": ("again", "amber_text"),
    "missing": ("waiting", "text2"),
    "waiting": ("more", "text2"),
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
    """Draws one item: symbol and title; below them the status or its reason; at the right the figure found, or the duration."""

    def __init__(self) -> None:
        super().__init__()
        self.next_item = self.running_item = ""

    def sizeHint(self, _option: QStyleOptionViewItem, _index: QModelIndex | QPersistentModelIndex) -> QSize:
        return QSize(px(200), px(48))

    def paint(
        self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        row: ItemSummary | None = index.data(ITEM_ROLE)
        if row is None:
            return
        theme, area = tokens(), QRectF(option.rect)
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if option.state & QStyle.StateFlag.State_Selected:
            painter.fillRect(area, QColor(theme.accent_tint))
        running = row.name == self.running_item
        if running or row.name == self.next_item:  # a bar at the edge marks the next or running item
            painter.fillRect(QRectF(area.left(), area.top(), px(3), area.height()), QColor(theme.accent_text))
        doubtful = row.is_doubtful and row.state.status == "done"
        status = "running" if running else "doubtful" if doubtful else str(row.state.status)
        symbol, color_name = STATUS_SYMBOLS[status]
        color, side = str(getattr(theme, color_name)), px(14)
        box = QRectF(area.left() + px(12), area.center().y() - side / 2, side, side)
        draw_icon(painter, symbol, box, color, theme.surface)
        area = area.adjusted(px(36), px(4), -px(10), -px(4))
        middle = area.center().y()
        right = _figure_text(row)
        # A result says itself that it is there.
        head = "running" if running else row.status_text.removeprefix("done, ")
        waits = status in ("missing", "waiting", "unfinished", "failed", "stale")
        text = row.state.reason if waits and row.state.reason else head
        upper, lower = QRectF(area.topLeft(), QPointF(area.right(), middle)), area.adjusted(0, area.height() / 2, 0, 0)
        free = upper.width() - text_width(right, "caption") - px(8) * bool(right)
        ink = theme.text2 if waits else color
        for line, left, kind, tone, width in (
            (upper, row.state.title, "large", theme.text, free), (lower, text, "", ink, lower.width()),
        ):  # fmt: skip
            elided = QFontMetricsF(text_font(kind)).elidedText(left, Qt.TextElideMode.ElideRight, width)
            draw_text(painter, line, elided, tone, kind)
        draw_text(painter, upper, right, theme.text, "caption", RIGHT)
        painter.setPen(QColor(theme.line))
        painter.drawLine(option.rect.bottomLeft(), option.rect.bottomRight())
        painter.restore()


def _figure_text(row: ItemSummary) -> str:
    """Return the first figure of an accepted result, without its uncertainty; else the time that the measurement takes."""
    figures = row.state.estimates if row.state.accepted else ()
    if figures:
        first = figures[0]
        factor, unit = shown_unit(first.unit, first.name)
        rounded = round_figure(factor * first.value, factor * first.standard_error)
        return typeset(f"{rounded} {unit}")
    if row.duration_s is None:
        return ""
    whole = 60 * round(row.duration_s / 60)  # from a minute on in minutes
    return format_duration(whole).removesuffix(" 00 s") if row.duration_s > 60 else format_duration(row.duration_s)
