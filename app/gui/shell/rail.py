"""Navigation rail at the left of the window: an icon and a word for each page."""

from collections.abc import Sequence

from PySide6.QtCore import QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QResizeEvent
from PySide6.QtWidgets import QAbstractButton, QButtonGroup, QWidget

from app.gui.face import LABEL_PX, MEDIUM, class_of, draw_icon, px, text_font, tokens
from app.gui.widgets import ACTIONS, STRETCH, column, configure

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
            accessibleName=title,
            toolTip=f"{title}: {shortcut}",
            focusPolicy=Qt.FocusPolicy.TabFocus,
        )

    def sizeHint(self) -> QSize:
        grid = class_of(self)
        return QSize(px(grid.rail), px(ITEM_HEIGHT if grid.rail > 60 else ITEM_HEIGHT_ICON))

    def paintEvent(self, _event: QPaintEvent) -> None:
        colors, chosen = tokens(), self.isChecked()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if chosen:
            painter.fillRect(self.rect(), QColor(colors.accent_tint))
            painter.fillRect(QRectF(0, 0, px(3), self.height()), QColor(colors.accent_text))
        elif self.underMouse():
            painter.fillRect(self.rect(), QColor(colors.sunken))
        color = colors.accent_text if chosen else colors.text2
        side, worded = px(20), class_of(self).rail > 60
        top = px(8) if worded else (self.height() - side) / 2
        draw_icon(painter, self._icon, QRectF((self.width() - side) / 2, top, side, side), color)
        if worded:
            painter.setFont(text_font(LABEL_PX, MEDIUM))
            painter.setPen(QColor(color if chosen else colors.text))
            area = QRectF(0, px(31), self.width(), px(18))
            painter.drawText(area, Qt.AlignmentFlag.AlignCenter, self.text())
        if self.hasFocus():
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.setPen(QPen(QColor(colors.accent_text), 2.0))
            painter.drawRoundedRect(QRectF(self.rect()).adjusted(4, 2, -4, -2), px(6), px(6))
        painter.end()


class Rail(QWidget):
    """Chooses the page."""

    chosen = Signal(int)
    help_requested = Signal()

    def __init__(self, titles: Sequence[str]) -> None:
        super().__init__()
        configure(self, "rail", accessibleName="pages", kind="bar")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self._group = QButtonGroup(self)
        self.buttons = [RailButton(title, title.lower(), ACTIONS[f"page.{title.lower()}"].shortcut) for title in titles]
        for at, button in enumerate(self.buttons):
            self._group.addButton(button, at)
            button.clicked.connect(lambda _=False, at=at: self.chosen.emit(at))
        self.help_button = RailButton("Help", "help", ACTIONS["shortcuts"].shortcut, checkable=False)
        self.help_button.clicked.connect(lambda _=False: self.help_requested.emit())
        column(*self.buttons, STRETCH, self.help_button, parent=self, margins=(0, 4, 0, 8))

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
