"""Widget with a message over its top; the widget does not move."""

from PySide6.QtCore import QEvent, QObject, QSize, Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QFrame, QScrollArea, QSizePolicy, QWidget

MARGIN = 10
MIN_CONTENT_HEIGHT = 40


class FittedScrollArea(QScrollArea):
    """Widget with the height of its content, which scrolls in a window too small for it."""

    def __init__(self, content: QWidget, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.setWidgetResizable(True)
        self.setWidget(content)
        self.content = content
        content.setAutoFillBackground(False)
        self.viewport().setAutoFillBackground(False)
        policy = QSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Maximum)
        policy.setHeightForWidth(True)
        self.setSizePolicy(policy)

    def hasHeightForWidth(self) -> bool:
        return True

    def heightForWidth(self, width: int) -> int:
        content = self.content
        width = max(width, content.minimumSizeHint().width())
        height = content.heightForWidth(width) if content.hasHeightForWidth() else content.sizeHint().height()
        if width > self.width() > 0:
            height += self.horizontalScrollBar().sizeHint().height()
        return height

    def sizeHint(self) -> QSize:
        width = self.content.sizeHint().width()
        return QSize(width, self.heightForWidth(width))

    def minimumSizeHint(self) -> QSize:
        return QSize(0, min(MIN_CONTENT_HEIGHT, self.sizeHint().height()))

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() is QEvent.Type.LayoutRequest and watched is self.content:
            self.updateGeometry()
        return super().eventFilter(watched, event)


class Overlaid(QWidget):
    """Shows `base`, and `message` over its top while the message is visible."""

    def __init__(self, base: QWidget, message: QWidget) -> None:
        super().__init__()
        self._base, self._message = base, message
        base.setParent(self)
        self._area = FittedScrollArea(message, self)
        self._area.setVisible(not message.isHidden())
        message.installEventFilter(self)

    def sizeHint(self) -> QSize:
        return self._base.sizeHint()

    def minimumSizeHint(self) -> QSize:
        return self._base.minimumSizeHint()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._base.setGeometry(self.rect())
        self._place_message()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() in (QEvent.Type.ShowToParent, QEvent.Type.HideToParent, QEvent.Type.LayoutRequest):
            self._place_message()
        return super().eventFilter(watched, event)

    def _place_message(self) -> None:
        self._area.setVisible(not self._message.isHidden())
        width = self.width() - 2 * MARGIN
        self._area.setGeometry(MARGIN, 0, width, min(self._area.heightForWidth(width), self.height()))
        self._area.raise_()
