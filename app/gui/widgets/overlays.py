"""Overlays: cards and drawers that lie over the page, in no layout, so that nothing moves when one is opened."""

from enum import Enum
from typing import TypeVar

from PySide6.QtCore import QEvent, QObject, QRect, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QPaintEvent, QResizeEvent
from PySide6.QtWidgets import QApplication, QFrame, QWidget
from shiboken6 import isValid

from app.gui.face import class_of, draw_box, painting, px, tokens
from app.gui.widgets.layouts import UPRIGHT, column, configure, make_scroll_area

RIM = 5
"""Width of the two translucent rims around an overlay, in the place of a shadow."""

TOP_GAP, EDGE_GAP = 24, 16
DRAWER_WIDTH = 432
LOG_SHARE = 0.4
"""Of the page's height."""


Added = TypeVar("Added", bound="OverlayCard")


class Place(Enum):
    """Where an overlay lies on the page."""

    TOP = "card at the top, in the middle"
    RIGHT = "drawer at the right"
    BOTTOM = "drawer from below, right of the left column"
    HINT = "card at the bottom, right of the left column"


class OverlayCard(QFrame):
    """A card or drawer around a content, hidden at first; it scrolls where the page is too small for it.

    Args:
        name: object name.
        content: what it shows.
        place: where it lies.
        width: largest width of a card, in lengths of the design.
        edge: token of the colour of its edge.
        closable: whether Esc closes it when no run goes on.
        washed: whether the page below it is dimmed.
        footer: stays in view below the content where that scrolls.
    """

    closed = Signal()
    """It was closed by the user."""

    def __init__(
        self,
        name: str,
        content: QWidget,
        place: Place = Place.TOP,
        *,
        width: int = 760,
        edge: str = "outline",
        closable: bool = True,
        washed: bool = False,
        footer: QWidget | None = None,
    ) -> None:
        super().__init__()
        self.content, self.place, self.closable, self.washed = content, place, closable, washed
        self._footer = footer
        self._width, self._edge = width, edge
        self._previous_focus: QWidget | None = None
        configure(self, name)
        self.setVisible(False)
        self._area = make_scroll_area(**UPRIGHT)
        hidden = content.testAttribute(Qt.WidgetAttribute.WA_WState_ExplicitShowHide) and content.isHidden()
        self._area.setWidget(content)  # which shows it
        content.setHidden(hidden)
        content.setAutoFillBackground(False)
        content.installEventFilter(self)
        inset = RIM + 1  # the rim and the edge
        margins = {Place.RIGHT: (RIM, 0, 0, 0), Place.BOTTOM: (RIM, RIM, 0, 0)}.get(place, (inset, inset, inset, inset))
        column(self._area, *([] if footer is None else [footer]), parent=self, margins=margins, spacing=0)

    def open(self, focus: QWidget | None = None) -> None:
        """Show the overlay above all others; `focus` takes the keyboard."""
        if self.isHidden():
            self._previous_focus = QApplication.focusWidget()
            for each in (self.content, *self.content.findChildren(QWidget)):
                each.ensurePolished()  # its paddings are the style sheet's
            if (layout := self.content.layout()) is not None:
                layout.invalidate()  # not where it is placed: that requests a layout, after which it is placed again
        self.show()
        self.raise_()
        self._place()
        if focus is not None:
            focus.setFocus(Qt.FocusReason.ShortcutFocusReason)

    def dismiss(self) -> None:
        """Hide the overlay, and give the keyboard back to the widget that had it."""
        if self.isHidden():
            return
        focused = QApplication.focusWidget()
        inside = focused is None or self.isAncestorOf(focused)
        self.hide()
        previous, self._previous_focus = self._previous_focus, None
        if inside and previous is not None and isValid(previous):
            previous.setFocus()

    def leave(self) -> None:
        """Close the overlay for the user."""
        self.dismiss()
        self.closed.emit()

    def height_in(self, width: int) -> int:
        """Return the height that the content needs at a width."""
        around, content = 2 * px(RIM + 1), self.content
        inner = width - around
        high = content.heightForWidth(inner) if content.hasHeightForWidth() else content.sizeHint().height()
        below = 0 if self._footer is None else self._footer.sizeHint().height()
        return max(high, content.minimumSizeHint().height()) + below + around

    def geometry_in(self, page: QRect) -> QRect:
        """Return where the overlay lies on a page."""
        left = px(class_of(self).left)
        match self.place:
            case Place.RIGHT:
                width = min(px(DRAWER_WIDTH), page.width() - left) + px(RIM)
                return QRect(page.right() + 1 - width, 0, width, page.height())
            case Place.BOTTOM:
                height = round(LOG_SHARE * page.height()) + px(RIM)
                return QRect(left - px(RIM), page.height() - height, page.width() - left + px(RIM), height)
            case Place.HINT:
                width = min(px(self._width), page.width() - left - px(EDGE_GAP))
                height = self._limit(self.height_in(width), page.height() // 2)
                return QRect(left, page.height() - height - px(8), width, height)
            case _:
                width = min(px(self._width), page.width() - 2 * px(EDGE_GAP))
                height = self._limit(self.height_in(width), page.height() - px(TOP_GAP) - px(8))
                return QRect((page.width() - width) // 2, px(TOP_GAP) - px(RIM), width, height)

    def _limit(self, needed: int, most: int) -> int:
        """Return the height of a card; without a scroll bar, which would take width and so make the content higher, if it fits."""
        policy = Qt.ScrollBarPolicy
        self._area.setVerticalScrollBarPolicy(policy.ScrollBarAsNeeded if needed > most else policy.ScrollBarAlwaysOff)
        return min(needed, most)

    def eventFilter(self, _watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.LayoutRequest and not self.isHidden():
            self._place()
        return False

    def _place(self) -> None:
        if isinstance(host := self.parentWidget(), OverlayHost):
            host.place_overlay(self)

    def paintEvent(self, _event: QPaintEvent) -> None:
        colors, rim = tokens(), px(RIM)
        body = QRectF(self.rect()).adjusted(
            rim, 0 if self.place is Place.RIGHT else rim, -rim * self._is_card, -rim * self._is_card
        )
        edge, radius = str(getattr(colors, self._edge)), px(10) if self._is_card else 0
        with painting(self) as painter:
            for width, alpha in ((rim, 14), (round(0.4 * rim), 22)):
                shade = QColor(0, 0, 0, alpha * (3 if colors.dark else 1))
                draw_box(painter, body.adjusted(-width, -width, width, width), px(10) + width, shade)
            body.adjust(0.5, 0.5, -0.5, -0.5)
            draw_box(painter, body, radius, colors.surface, edge, 2.0 if self._edge == "red_line" else 1.0)

    @property
    def _is_card(self) -> bool:
        return self.place in (Place.TOP, Place.HINT)


class _Wash(QWidget):
    """Dims the page; the mouse goes through it."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.hide()

    def paintEvent(self, _event: QPaintEvent) -> None:
        with painting(self) as painter:
            painter.fillRect(self.rect(), QColor(0, 0, 0, 128 if tokens().dark else 77))


class OverlayHost(QWidget):
    """Shows a page, and overlays on it that never change its geometry."""

    def __init__(self, page: QWidget) -> None:
        super().__init__()
        self._page, self._overlays = page, list[OverlayCard]()
        page.setParent(self)
        self._wash = _Wash(self)

    def add_overlay(self, overlay: Added) -> Added:
        """Take an overlay; it stays hidden until it is opened."""
        overlay.setParent(self)
        overlay.hide()
        overlay.installEventFilter(self)
        self._overlays.append(overlay)
        return overlay

    def place_overlay(self, overlay: OverlayCard) -> None:
        """Place an overlay where it lies on the page."""
        if overlay.geometry() != (goal := overlay.geometry_in(self.rect())):
            overlay.setGeometry(goal)

    @property
    def opened(self) -> list[OverlayCard]:
        """The visible overlays, the topmost one last."""
        order = {child: at for at, child in enumerate(self.children())}
        return sorted((each for each in self._overlays if not each.isHidden()), key=lambda each: order[each])

    def close_topmost(self) -> bool:
        """Close the topmost overlay that can be closed, and return whether there was one."""
        closable = [each for each in self.opened if each.closable]
        if not closable:
            return False
        closable[-1].leave()
        return True

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._page.setGeometry(self.rect())
        self._wash.setGeometry(self.rect())
        for overlay in self.opened:
            self.place_overlay(overlay)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() in (QEvent.Type.ShowToParent, QEvent.Type.HideToParent):
            washing = [each for each in self.opened if each.washed]
            self._wash.setVisible(bool(washing))
            if washing:
                self._wash.raise_()
                for each in self.opened:
                    each.raise_()
            if isinstance(watched, OverlayCard) and event.type() == QEvent.Type.ShowToParent:
                self.place_overlay(watched)
        return super().eventFilter(watched, event)
