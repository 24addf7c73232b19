"""Navigation rail at the left of the window: an icon and a word for each page."""

from collections.abc import Sequence

from PySide6.QtCore import QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QPaintEvent, QResizeEvent
from PySide6.QtWidgets import QAbstractButton, QWidget

from app.gui.face import CENTRE, class_of, draw_icon, draw_ring, draw_text, painting, px, tokens
from app.gui.widgets import ACTIONS, column, configure

ITEM_HEIGHT, ITEM_HEIGHT_ICON = 56, 46


class RailButton(QAbstractButton):
    """A page of the window, or the help.

    Args:
        title: its word.
        icon: its icon.
        shortcut: keys of the same action.
        checkable: whether it shows that its page is visible.
    """

    def __init__(self, title: str, icon: str, shortcut: str, checkable: bool = True) -> None:
        super().__init__()
        self._icon = icon
        self.setText(title)
        configure(
            self,
            f"rail.{title.lower()}",
            checkable=checkable,
            autoExclusive=checkable,
            accessibleName=title,
            toolTip=f"{title}: {shortcut}",
            focusPolicy=Qt.FocusPolicy.TabFocus,
        )

    def sizeHint(self) -> QSize:
        grid = class_of(self)
        return QSize(px(grid.rail), px(ITEM_HEIGHT if grid.rail > 60 else ITEM_HEIGHT_ICON))

    def paintEvent(self, _event: QPaintEvent) -> None:
        colors, chosen = tokens(), self.isChecked()
        color = colors.accent_text if chosen else colors.text2
        side, worded = px(20), class_of(self).rail > 60
        top = px(8) if worded else (self.height() - side) / 2
        with painting(self) as painter:
            if chosen:
                painter.fillRect(self.rect(), QColor(colors.accent_tint))
                painter.fillRect(QRectF(0, 0, px(3), self.height()), QColor(colors.accent_text))
            elif self.underMouse():
                painter.fillRect(self.rect(), QColor(colors.sunken))
            draw_icon(painter, self._icon, QRectF((self.width() - side) / 2, top, side, side), color)
            if worded:
                area, ink = QRectF(0, px(31), self.width(), px(18)), color if chosen else colors.text
                draw_text(painter, area, self.text(), ink, "key", CENTRE)
            if self.hasFocus():
                draw_ring(painter, self.rect().adjusted(3, 1, -3, -1), colors.accent_text)


class Rail(QWidget):
    """Chooses the page."""

    chosen = Signal(int)
    help_requested = Signal()

    def __init__(self, titles: Sequence[str]) -> None:
        super().__init__()
        configure(self, "rail", accessibleName="pages", kind="bar")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self.buttons = [RailButton(title, title.lower(), ACTIONS[f"page.{title.lower()}"].shortcut) for title in titles]
        for at, button in enumerate(self.buttons):
            button.clicked.connect(lambda _=False, at=at: self.chosen.emit(at))
        self.help_button = RailButton("Help", "help", ACTIONS["shortcuts"].shortcut, checkable=False)
        self.help_button.clicked.connect(lambda _=False: self.help_requested.emit())
        column(*self.buttons, None, self.help_button, parent=self, margins=(0, 4, 0, 8))

    def select(self, index: int) -> None:
        """Show which page is visible."""
        self.buttons[index].setChecked(True)

    def fit(self) -> None:
        """Take the width of the window's class."""
        self.setFixedWidth(px(class_of(self).rail))

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        for button in (*self.buttons, self.help_button):
            button.updateGeometry()
